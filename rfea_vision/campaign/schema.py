"""What may stand in campaign.yaml and experiment.yaml: the keys, their kinds and their units.

These models describe one file as it is written. Inheritance, paths and whatever else needs the folder: see `loading`; what
needs nothing of it goes to the stages as it stands here. `rfea schema` prints the models as JSON Schema.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, WithJsonSchema

from rfea_vision.artefacts import Actuator
from rfea_vision.artefacts.clocks import SYNC_METHODS
from rfea_vision.artefacts.lenses import LENSES
from rfea_vision.units import conversion_factor, parse_moment, parse_quantity, pressure_unit, split_quantity


def _quantity(unit: str, example: str, *, positive: bool = False) -> BeforeValidator:
    """Return the validator that reads a quantity as a number in `unit`."""

    def parse(value: object) -> float:
        number = parse_quantity(value, unit, example=example)
        if positive and not number > 0:
            raise ValueError(f"'{value}' must be greater than zero")
        return number

    return BeforeValidator(parse)


def _shown(example: str) -> WithJsonSchema:
    """Return what the JSON Schema says of a quantity."""
    text = f"a quantity with its unit, for example '{example}'"
    return WithJsonSchema({"type": "string", "description": text, "examples": [example]})


def _text(value: object) -> object:
    """Accept names that YAML reads as numbers or dates: an experiment may be called 270 or 2018-03-01."""
    return value if value is None or isinstance(value, bool | list | dict) else str(value)


def _moment(value: object) -> object:
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


def _unit_of(kind: str) -> BeforeValidator:
    """Return the validator that refuses a unit which does not convert to that of its `kind`."""

    def check(value: object) -> object:
        if isinstance(value, str):
            conversion_factor(pressure_unit(value)[0] if kind == "kPa" else value, kind)
        return value

    return BeforeValidator(check)


def _sync(value: object) -> object:
    """Let ``sync: motion`` stand for ``sync: {method: motion}``."""
    return {"method": value} if isinstance(value, str) else value


def _camera_profile(value: object) -> object:
    if isinstance(value, str):
        from rfea_vision.data import read_camera_profile

        read_camera_profile(value)
    return value


def _gravity(value: object) -> object:
    """Say how an angle is written where it stands alone."""
    if isinstance(value, int | float) or (isinstance(value, str) and re.match(r"[+-]?[.\d]", value)):
        raise ValueError(f"found {value}; an angle from down is written {{angle: {split_quantity(value)[0]:g} deg}}")
    return value


def _named_board(value: object) -> object:
    """Let ``board: checkerboard-9x6-12mm`` name a file of calib/boards."""
    if not isinstance(value, str):
        return value
    from rfea_vision.data import read_board

    return read_board(value)


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


Length = Annotated[float, _quantity("m", "4 mm", positive=True), _shown("4 mm")]
LongLength = Annotated[float, _quantity("m", "155 mm", positive=True), _shown("155 mm")]
SquareSide = Annotated[float, _quantity("m", "12 mm", positive=True), _shown("12 mm")]
Offset = Annotated[float, _quantity("m", "3 mm"), _shown("3 mm")]
Force = Annotated[float, _quantity("N", "0.2 N", positive=True), _shown("0.2 N")]
Area = Annotated[float, _quantity("m^2", "12 mm^2", positive=True), _shown("12 mm^2")]
SecondMoment = Annotated[float, _quantity("m^4", "67500 mm^4", positive=True), _shown("67500 mm^4")]
Mass = Annotated[float, _quantity("kg", "33.2 g", positive=True), _shown("33.2 g")]
MassPerLength = Annotated[float, _quantity("kg/m", "0.47 g/mm", positive=True), _shown("0.47 g/mm")]
Angle = Annotated[float, _quantity("deg", "30 deg"), _shown("30 deg")]
Pressure = Annotated[float, _quantity("kPa", "0 kPa"), _shown("0 kPa")]
Density = Annotated[float, _quantity("kg/m^3", "965 kg/m^3", positive=True), _shown("965 kg/m^3")]
Duration = Annotated[float, _quantity("s", "12 ms"), _shown("12 ms")]
Moment = Annotated[float, _quantity("s", "0.8 s"), _shown("0.8 s")]
Rate = Annotated[float, _quantity("Hz", "240 Hz", positive=True), _shown("240 Hz")]
Text = Annotated[str, BeforeValidator(_text)]
_Grey = Annotated[int, Field(ge=0, le=255)]
Rgb = Annotated[tuple[_Grey, _Grey, _Grey], BeforeValidator(_colour)]
Ambient = Annotated[float | str, BeforeValidator(_pressure_or_column), _shown("101.3 kPa")]
Axis = Annotated[Literal["x", "y", "z", "-x", "-y", "-z"], BeforeValidator(_text)]
PixelPair = tuple[tuple[float, float], tuple[float, float]]
PixelBox = tuple[float, float, Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]]
LensName = Literal["auto", *LENSES]  # the names of a table, which the type checker cannot read
SyncMethod = Literal[*SYNC_METHODS]
Role = Literal["train", "validate", "test", "ignore"]


class _Part(BaseModel):
    """Every part refuses keys that it does not know: a misspelt key must not be ignored in silence."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SectionPart(_Part):
    """What is bent: a tube about its inextensible side, or a beam about its middle.

    A rod has its `outer_radius` from the actuator; a rectangle a `width` and a `thickness` (in the plane of motion); a custom
    section what is known of it. `chamber_area` is that on which a pressure acts, in a beam that has a chamber.
    """

    kind: Literal["tube", "rod", "rectangle", "custom"] = "tube"
    width: Length | None = None
    thickness: Length | None = None
    area: Area | None = None
    second_moment: SecondMoment | None = None
    chamber_area: Area | None = None


class RigAnglePart(_Part):
    """Gravity's direction from down, positive in the direction that `actuator.bends` names."""

    angle: Angle


class PlumbPart(_Part):
    """Two pixels on a line that hangs plumb, upper one first."""

    plumb: PixelPair


class RigPart(_Part):
    """How the rig stands: where gravity points in the frame in which the unloaded tube points down.

    With ``{plumb: ...}`` it is read from the picture, and `camera.vertical` is then the axis of the rig.
    """

    gravity: Annotated[
        Literal["down", "up", "left", "right", "none"] | RigAnglePart | PlumbPart, BeforeValidator(_gravity)
    ] = "down"


class StartPart(_Part):
    """A run that begins held by hand in the measured shape, and is let go: at a time, or when it is seen to move.

    With a `force`, a string pulls at the tip until it is cut; `direction` is that of the force from down, positive in the
    direction that `actuator.bends` names.
    """

    shape: Literal["measured"] = "measured"
    force: Force | None = None
    direction: Angle = 90.0
    held_until: Literal["auto"] | Moment = "auto"


class ActuatorPart(_Part):
    """The tube at rest. Radii are radii: the 8 and 6 mm printed in the paper are diameters.

    `mass` (of the whole length) or `mass_per_length` stand in place of the densities.
    """

    mass: Mass | None = None
    mass_per_length: MassPerLength | None = None
    section: SectionPart | None = None
    material: Text | None = None
    outer_radius: Length = Actuator.outer_radius
    inner_radius: Length = Actuator.inner_radius
    length: LongLength = Actuator.length
    density: Density = Actuator.density
    fluid_density: Density = Actuator.fluid_density
    bends: Literal["left", "right"] = Actuator.bends


class BoardPart(_Part):
    """A calibration board; `inner_corners` are columns and rows of inner corners."""

    kind: Literal["checkerboard", "charuco"] = "checkerboard"
    inner_corners: tuple[Annotated[int, Field(ge=2)], Annotated[int, Field(ge=2)]]
    square: SquareSide
    marker: SquareSide | None = None
    dictionary: str | None = None


class ScalePart(_Part):
    """A scale without a board: two `points` in pixels and their `distance`; or four and more, and their `places`.

    `error` is the standard error of the distance, or of each place.
    """

    points: Annotated[tuple[tuple[float, float], ...], Field(min_length=2)]
    distance: LongLength | None = None
    places: Annotated[tuple[tuple[Offset, Offset], ...], Field(min_length=4)] | None = None
    error: Length | None = None


class CorrectionPart(_Part):
    """Where the tube is in a later `frame` (the first is 0): `points` on it in that frame's pixels, from the clamp on, the tip last."""

    frame: Annotated[int, Field(ge=1)]
    points: Annotated[list[tuple[float, float]], Field(min_length=1)]


class CameraPart(_Part):
    """How the pictures are to be read: `board` and `photos`, or `file` of an earlier calibration, or a `scale` alone.

    `clamp`, `tip`, `centre_line`, `region`, `exclude`, `colour` and `marks` are hints, in pixels of the first frame, and
    `corrections` in those of later ones.
    `profile` names a file of calib/cameras, whose lens model is taken where `lens` is not given.
    """

    board: Annotated[BoardPart | None, BeforeValidator(_named_board)] = None
    photos: str | list[str] | None = None
    plane: str | None = None
    board_offset: Offset = 0.0
    file: str | None = None
    profile: Annotated[str | None, BeforeValidator(_camera_profile)] = None
    lens: LensName | None = None  # pyright: ignore[reportInvalidTypeForm]
    vertical: Literal["board", "rest", "image"] | PlumbPart = "board"
    scale: Literal["tube"] | ScalePart | None = None
    clamp: PixelPair | None = None
    tip: tuple[float, float] | None = None
    centre_line: list[tuple[float, float]] | None = None
    corrections: list[CorrectionPart] | None = None
    region: PixelBox | None = None
    exclude: list[PixelBox] | None = None
    colour: Rgb | None = None
    marks: Rgb | None = None
    masks: str | None = None
    keypoints: str | None = None
    line_delay: Annotated[float, _quantity("s", "20 us"), _shown("20 us")] | None = None


class VideoPart(_Part):
    """A video; `rate` overrides the time stamps of the container (slow-motion files)."""

    file: str | None = None
    rate: Rate | None = None


class FramesPart(_Part):
    """Single pictures, and a table (file, time_s) with the time of each; or a constant `rate`."""

    folder: str | None = None
    times: str | None = None
    rate: Rate | None = None


class TrackPart(_Part):
    """A track made by another tool.

    Of a file with named points (DeepLabCut, SLEAP, Tierpsy, movement, c3d, or columns such as ``tip_x_px``): `points` from the
    clamp to the tip, a list in the list being a group whose mean counts, or ``all``; `individual`; `axes` of the file that
    are the rig's x and y, such as ``[x, -z]``; `scale`, the length of one unit of the file; `rate`, where it names no times;
    `origin`, where the clamp is in the file's units; `confidence`, below which a point is not taken. Of a table, `time` and
    `angle` name columns that are not called ``time_s`` and ``angle_deg``; `time_unit` and `unit` say what they are in where
    the header does not.
    """

    file: str | None = None
    points: Literal["all"] | list[Text | list[Text]] | None = None
    individual: Text | None = None
    axes: tuple[Axis, Axis] | None = None
    scale: Length | None = None
    rate: Rate | None = None
    origin: list[float] | None = Field(default=None, min_length=2, max_length=3)
    confidence: Annotated[float, Field(ge=0.0, le=1.0)] = 0.6
    time: Text | None = None
    angle: Text | None = None
    unit: Annotated[str | None, _unit_of("deg")] = None
    time_unit: Annotated[str | None, _unit_of("s")] = None

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The points from the clamp to the tip, a single one as a group of one; ``(("all",),)`` for all in the file's order."""
        named = ["all"] if self.points == "all" else self.points or []
        return tuple(tuple(item) if isinstance(item, list) else (item,) for item in named)


class PressurePart(_Part):
    """The pressure log: a table in a file or from a database, the columns to take, and their units.

    `ambient` is a pressure or the name of a column; without `reference`, a unit such as ``psia`` or ``bar(g)`` says it.
    `value` alone is a run at constant pressure, without a log. Each of several has the name of its `chamber`, and a `sign`,
    -1 where it bends against the direction of `actuator.bends`.
    """

    chamber: Text | None = None
    sign: Literal[1, -1] = 1
    value: Pressure | None = None
    file: str | None = None
    url: str | None = None
    query: str | None = None
    time: Text | None = None
    pressure: Text | None = None
    unit: Annotated[str | None, _unit_of("kPa")] = None
    time_unit: Annotated[str | None, _unit_of("s")] = None
    reference: Literal["gauge", "absolute"] | None = None
    ambient: Ambient = 101.325


Pressures = Annotated[
    Annotated[PressurePart, Tag("one")] | Annotated[list[PressurePart], Field(min_length=1), Tag("several")],
    Discriminator(lambda value: "several" if isinstance(value, list) else "one"),
]


class SyncPart(_Part):
    """How camera clock and log clock are brought together.

    `value` is log clock minus camera clock; `box` is x, y, width and height of the lamp in pixels (`led` is an older
    name of the same); `channel` is the column of the log with the lamp's or the trigger's signal.
    """

    method: SyncMethod = "motion"  # pyright: ignore[reportInvalidTypeForm]
    value: Duration | None = None
    box: tuple[float, float, float, float] | None = None
    led: tuple[float, float, float, float] | None = None
    channel: Text | None = None

    @property
    def lamp_box(self) -> tuple[float, float, float, float] | None:
        """Where the lamp is in the picture, by either name."""
        return self.box or self.led


class _Shared(_Part):
    """Keys that a campaign may set for all its experiments, and an experiment may override."""

    actuator: ActuatorPart | None = None
    rig: RigPart | None = None
    camera: CameraPart | None = None
    role: Role | None = None
    video: VideoPart | None = None
    frames: FramesPart | None = None
    track: TrackPart | None = None
    pressure: Pressures | None = None
    start: StartPart | None = None
    conditions: dict[str, str | float] | None = None
    sync: Annotated[SyncPart | None, BeforeValidator(_sync)] = None
    recorded_at: Annotated[str | None, BeforeValidator(_moment)] = None
    memory: Literal["fresh", "carried"] | None = None
    note: Text | None = None


class CampaignFile(_Shared):
    """campaign.yaml. `design` holds design variables, numbers with or without a unit, for comparisons over campaigns."""

    format: Literal["rfea-campaign/1"] = "rfea-campaign/1"
    name: Text | None = None
    design: dict[str, Annotated[tuple[float, str], BeforeValidator(split_quantity), _shown("30 g")]] | None = None


class ExperimentFile(_Shared):
    """experiment.yaml. Whatever it leaves out is inherited from campaign.yaml."""

    format: Literal["rfea-experiment/1"] = "rfea-experiment/1"
    name: Text | None = None
    repeat_of: Text | None = None
