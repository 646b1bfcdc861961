"""Units stop at the door: text with a unit comes in, a plain number in the unit asked for goes on.

Only files and the command line meet units as text; behind them all is SI, with a suffix in the name where it is not.
"""

from __future__ import annotations

import difflib
import math
import re
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint

_QUANTITY = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")
# pint works powers out as it reads them: 'mm**9**9**9' would never end. A unit has powers of names, of one digit.
_LONGEST_UNIT = 64
_POWER, _POWER_OF_A_UNIT = re.compile(r"\*\*|\^"), re.compile(r"[^\W\d]\s*(?:\*\*|\^)\s*[+-]?\d(?!\d)")
_NEAR = math.log(8.0)  # below this factor from the example a number has its unit; the next unit people write is 10 away
# What nearly every file holds, in SI, so that a command need not load pint (0.8 s) to read it; tests hold it equal to pint.
_PLAIN_UNITS = {
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "m": ("m", 1.0),
    "kPa": ("Pa", 1e3),
    "Pa": ("Pa", 1.0),
    "MPa": ("Pa", 1e6),
    "bar": ("Pa", 1e5),
    "mbar": ("Pa", 1e2),
    "hPa": ("Pa", 1e2),
    "psi": ("Pa", 6894.757293168361),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "min": ("s", 60.0),
    "Hz": ("Hz", 1.0),
    "kHz": ("Hz", 1e3),
    "fps": ("Hz", 1.0),
    "deg": ("rad", math.pi / 180),
    "rad": ("rad", 1.0),
    "g": ("kg", 1e-3),
    "kg": ("kg", 1.0),
    "kg/m^3": ("kg/m^3", 1.0),
    "g/cm^3": ("kg/m^3", 1e3),
    "N": ("N", 1.0),
    "mN": ("N", 1e-3),
    "N m": ("N m", 1.0),
}
#: Signs that people write for a unit and pint does not read.
_SIGNS = {'"': "in", "\u2033": "in", "\u201d": "in", "''": "in", "'": "ft", "\u2032": "ft"}


@cache
def _registry() -> pint.UnitRegistry:
    import pint  # half a second that commands without quantities need not pay

    registry = pint.UnitRegistry(on_redefinition="ignore")
    registry.define("frame_per_second = 1 / second = fps")  # of films: pint's own fps are feet per second
    return registry


@cache
def _unit(text: str, like: str = "") -> pint.Unit:
    """Parse a unit, or raise a ValueError that suggests the one probably meant, of those that measure what `like` does."""
    import pint

    if len(text) > _LONGEST_UNIT or len(_POWER.findall(text)) != len(_POWER_OF_A_UNIT.findall(text)):
        raise ValueError(f"unknown unit '{text[:_LONGEST_UNIT]}'; write one such as 'kg/m^3'")
    try:
        return _registry().Unit(f"1{text}" if text.startswith("/") else text)  # 5e-7/Pa is 5e-7 1/Pa
    except Exception as error:
        # pint raises a family of unrelated exceptions for malformed text (tokenizer, attribute, type errors).
        if isinstance(error, pint.UndefinedUnitError) or text:
            if text in _SIGNS:
                raise ValueError(f"unknown unit '{text}'; write '{_SIGNS[text]}'") from error
            lowered = {name.lower(): name for name in _PLAIN_UNITS if not like or _unit(name).is_compatible_with(_unit(like))}
            close = difflib.get_close_matches(text.lower(), lowered, n=1, cutoff=0.5)
            known = f"; write one such as {', '.join(lowered.values())}" if like and lowered else ""
            hint = f"; did you mean '{lowered[close[0]]}'?" if close else known
            raise ValueError(f"unknown unit '{text}'{hint}") from error
        raise


def dimension_of(unit: str) -> object:
    """Return the dimension of a unit, of pint's type, which compares, multiplies and takes powers."""
    return _registry().Unit(unit).dimensionality


def si_factor(unit: str) -> float:
    """Return how many of the SI unit one of `unit` is: 1 of ``N*m``, 1e-6 of ``1/MPa``."""
    return float(_registry().Quantity(1.0, unit).to_base_units().magnitude)


def conversion_factor(unit: str, to: str) -> float:
    """Return the number by which a value in `unit` is multiplied to be in `to` (no offset units).

    Raises
    ------
    ValueError
        If a unit is unknown or the two measure different things.
    """
    if unit in _PLAIN_UNITS and to in _PLAIN_UNITS:
        (kind, value), (other, size) = _PLAIN_UNITS[unit], _PLAIN_UNITS[to]
        if kind == other:
            return value / size
    have, want = _unit(unit, to), _unit(to)
    if have.dimensionality != want.dimensionality:
        alike = [name for name in _PLAIN_UNITS if name.lower() == unit.lower() and _unit(name).is_compatible_with(want)]
        hint = f"did you mean '{alike[0]}'?" if alike else f"write one that converts to '{to}'"
        raise ValueError(f"'{unit}' is not a unit of the right kind; {hint}")
    return float(_registry().Quantity(1.0, have).to(want).magnitude)


def measures(unit: str, like: str) -> bool:
    """Whether `unit` is one, and measures what `like` does."""
    try:
        conversion_factor(unit, like)
    except ValueError:
        return False
    return True


def split_quantity(value: object) -> tuple[float, str]:
    """Take ``30 g`` apart: number and unit, empty for a bare number.

    Raises
    ------
    ValueError
        If there is no finite number, or the unit is unknown.
    """
    match = (
        _QUANTITY.match(str(value)) if isinstance(value, str | int | float) and not isinstance(value, bool) else None
    )
    if match is None or not math.isfinite(float(match[1])):
        raise ValueError(f"'{value}' is not a number, with or without a unit; write for example 12 or '30 g'")
    if match[2] and match[2] not in _PLAIN_UNITS:
        _unit(match[2])
    return float(match[1]), match[2]


def _with_unit(number: str, example: str) -> str:
    """Return a bare number with the unit that brings it nearest to the size of the example."""
    shown = _QUANTITY.match(example)
    if shown is None or not math.isfinite(float(number)):
        return example
    usual, own, kind = float(shown[1]), abs(float(number)), _unit(shown[2]).dimensionality

    def off(unit: str) -> float:
        return abs(math.log(own * conversion_factor(unit, shown[2]) / usual))

    alike = [unit for unit in (shown[2], *_PLAIN_UNITS) if _unit(unit).dimensionality == kind]
    unit = shown[2] if not (own and usual) or off(shown[2]) < _NEAR else min(alike, key=off)
    return f"{number}{' ' if ' ' in example else ''}{unit}"


_REFERENCED = re.compile(
    r"^(bar|psi|kPa|MPa|Pa|mbar|hPa)[\s_]*[\[(]?(g|a|gauge|abs|absolute?|rel|relative?)\.?[\])]?$", re.IGNORECASE
)


def pressure_unit(text: str) -> tuple[str, str | None]:
    """Take apart ``psig``, ``bar(a)``, ``kPa abs``: the unit, and ``gauge``, ``absolute`` or None."""
    match = _REFERENCED.match(text.strip())
    if match is None:
        return text, None
    return match[1], "absolute" if match[2].lower().startswith("a") else "gauge"


def parse_quantity(value: object, to: str, *, example: str) -> float:
    """Read ``"4 mm"`` as a number in the unit `to`.

    Parameters
    ----------
    value : what stood in the file or on the command line
    to : unit of the result, for example ``"m"``; the text must be of the same kind
    example : what a right answer looks like, for the error message

    Raises
    ------
    ValueError
        If the unit is missing, unknown or of another kind, or the number is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"expected a quantity such as '{example}', found {value!r}")
    if not isinstance(value, str):
        raise ValueError(f"{value} has no unit; write for example '{_with_unit(str(value), example)}'")
    match = _QUANTITY.match(value)
    if match is None:
        raise ValueError(f"'{value}' is not a number with a unit; write for example '{example}'")
    number, unit = float(match[1]), match[2]
    if unit.startswith(","):
        raise ValueError(f"'{value}' has a decimal comma; write '{value.replace(',', '.', 1)}'")
    if not unit:
        raise ValueError(f"'{value}' has no unit; write for example '{_with_unit(match[1], example)}'")
    if not math.isfinite(number):
        raise ValueError(f"'{value}' is not a finite number; write for example '{example}'")
    return number * conversion_factor(unit, to)


def parse_moment(value: object) -> datetime:
    """Return when something was, by the local clock or with its zone.

    Raises
    ------
    ValueError
        If it is no date as 2026-03-01, with or without a time of day.
    """
    try:
        return datetime.fromisoformat(str(value))
    except ValueError:
        raise ValueError(f"'{value}' is no date and time; write it as 2026-03-01 14:05:30") from None


def counted(number: int, noun: str) -> str:
    """Return ``1 run``, ``2 runs``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def rounded(value: float, digits: int = 3) -> str:
    """Return `value` to `digits` significant digits: three in every text, table and tile alike."""
    if not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    exponent = int(f"{value:.{digits - 1}e}".split("e")[1])  # of the rounded number: 0.09998 is 0.100, not 0.1000
    if not -4 <= exponent < 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - exponent)}f}"


def to_error(value: float, error: float | None) -> str:
    """Return `value` to the second digit of its standard error, as -1344406.8 beside 9.1; without one as `rounded`."""
    if not error or not math.isfinite(error) or not math.isfinite(value):
        return rounded(value)
    return f"{value:.{min(6, max(0, 1 - math.floor(math.log10(error))))}f}"


def finite(value: object) -> object:
    """The same with None in place of the numbers that JSON cannot say, and text for keys, in dictionaries and lists of any depth."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
