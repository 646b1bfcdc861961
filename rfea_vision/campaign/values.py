"""How values are written in campaign.yaml and experiment.yaml: quantities with their units, dates, colours, places in a picture."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from rfea_vision.units import conversion_factor, measures, parse_moment, parse_quantity, pressure_unit


def quantity(unit: str, example: str, *, positive: bool = False) -> BeforeValidator:
    """Return the validator that reads a quantity as a number in `unit`."""

    def parse(value: object) -> float:
        number = parse_quantity(value, unit, example=example)
        if positive and not number > 0:
            raise ValueError(f"'{value}' must be greater than zero")
        return number

    return BeforeValidator(parse)


def shown_as(example: str) -> WithJsonSchema:
    """Return what the JSON Schema says of a quantity."""
    text = f"a quantity with its unit, for example '{example}'"
    return WithJsonSchema({"type": "string", "description": text, "examples": [example]})


def _text(value: object) -> object:
    """Accept names that YAML reads as numbers or dates: an experiment may be called 270 or 2018-03-01."""
    return value if value is None or isinstance(value, bool | list | dict) else str(value)


def date_and_time(value: object) -> object:
    """Refuse what is no date and time, and keep it as it is written."""
    if value is None:
        return None
    parse_moment(value)
    return str(value)


def _pressure_or_column(value: object) -> object:
    """Read a quantity in kPa; what begins with no number names a column of the log."""
    if isinstance(value, str) and not re.match(r"\s*[+-]?[.\d]", value):
        return value
    return parse_quantity(value, "kPa", example="101.3 kPa")


def unit_of(kind: str, *others: str) -> BeforeValidator:
    """Return the validator that refuses a unit which does not convert to that of its `kind`, nor of the `others`."""

    def check(value: object) -> object:
        if isinstance(value, str):
            bare = pressure_unit(value)[0] if kind == "kPa" else value
            if not any(measures(bare, other) for other in others):
                conversion_factor(bare, kind)
        return value

    return BeforeValidator(check)


#: Red, green and blue of what people call by these names.
_COLOURS = {
    "red": (200, 40, 40),
    "orange": (240, 140, 30),
    "yellow": (230, 210, 40),
    "green": (50, 150, 60),
    "blue": (40, 80, 200),
    "black": (25, 25, 25),
    "white": (240, 240, 240),
}


def _colour(value: object) -> object:
    """Let a name or ``#rrggbb`` stand for red, green and blue."""
    if not isinstance(value, str):
        return value
    if value in _COLOURS:
        return _COLOURS[value]
    digits = value.removeprefix("#")
    if len(digits) == 6 and all(digit in "0123456789abcdefABCDEF" for digit in digits):
        return tuple(int(digits[i : i + 2], 16) for i in (0, 2, 4))
    raise ValueError(f"'{value}' is no colour; give one of {', '.join(_COLOURS)}, or '#rrggbb' as a picture editor shows it")


Length = Annotated[float, quantity("m", "4 mm", positive=True), shown_as("4 mm")]
LongLength = Annotated[float, quantity("m", "155 mm", positive=True), shown_as("155 mm")]
SquareSide = Annotated[float, quantity("m", "12 mm", positive=True), shown_as("12 mm")]
Offset = Annotated[float, quantity("m", "3 mm"), shown_as("3 mm")]
Force = Annotated[float, quantity("N", "0.2 N", positive=True), shown_as("0.2 N")]
Area = Annotated[float, quantity("m^2", "12 mm^2", positive=True), shown_as("12 mm^2")]
SecondMoment = Annotated[float, quantity("m^4", "67500 mm^4", positive=True), shown_as("67500 mm^4")]
Mass = Annotated[float, quantity("kg", "33.2 g", positive=True), shown_as("33.2 g")]
MassPerLength = Annotated[float, quantity("kg/m", "0.47 g/mm", positive=True), shown_as("0.47 g/mm")]
Angle = Annotated[float, quantity("deg", "30 deg"), shown_as("30 deg")]
Pressure = Annotated[float, quantity("kPa", "0 kPa"), shown_as("0 kPa")]
Density = Annotated[float, quantity("kg/m^3", "965 kg/m^3", positive=True), shown_as("965 kg/m^3")]
Duration = Annotated[float, quantity("s", "12 ms"), shown_as("12 ms")]
Moment = Annotated[float, quantity("s", "0.8 s"), shown_as("0.8 s")]
Rate = Annotated[float, quantity("Hz", "240 Hz", positive=True), shown_as("240 Hz")]
Text = Annotated[str, BeforeValidator(_text)]
_Grey = Annotated[int, Field(ge=0, le=255)]
Rgb = Annotated[tuple[_Grey, _Grey, _Grey], BeforeValidator(_colour)]
Ambient = Annotated[float | str, BeforeValidator(_pressure_or_column), shown_as("101.3 kPa")]
Axis = Annotated[Literal["x", "y", "z", "-x", "-y", "-z"], BeforeValidator(_text)]
PixelPair = tuple[tuple[float, float], tuple[float, float]]
PixelBox = tuple[float, float, Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]]
