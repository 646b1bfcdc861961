"""What may stand in campaign.yaml and experiment.yaml: the keys, their kinds and their units.

These models describe one file as it is written. Inheritance, paths and whatever else needs the folder: see `loading`; what
needs nothing of it goes to the stages as it stands here. `rfea schema` prints the models as JSON Schema.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag

from rfea_vision.artefacts import Actuator
from rfea_vision.artefacts.clocks import SYNC_METHODS
from rfea_vision.artefacts.lenses import LENSES
from rfea_vision.campaign.values import (
    Ambient,
    Angle,
    Area,
    Axis,
    Density,
    Duration,
    Force,
    Length,
    LongLength,
    Mass,
    MassPerLength,
    Moment,
    Offset,
    PixelBox,
    PixelPair,
    Pressure,
    Rate,
    Rgb,
    SecondMoment,
    SquareSide,
    Text,
    date_and_time,
    quantity,
    shown_as,
    unit_of,
)
from rfea_vision.units import split_quantity


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


LensName = Literal["auto", *LENSES]  # the names of a table, which the type checker cannot read
SyncMethod = Literal[*SYNC_METHODS]
Role = Literal["train", "validate", "test", "ignore"]


class _Part(BaseModel):
    """Every part refuses keys that it does not know: a misspelt key must not be ignored in silence."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SectionPart(_Part):
    """What is bent: a tube about its inextensible side, or a beam about its middle.

    A rod has its `outer_radius` from the actuator; a rectangle a `width` and a `thickness` (in the plane of motion); a custom
    section what is known of it. `chamber_area` is that on which a pressure acts, in a beam that has a chamber; where a tendon pulls,
    `tendon` is its distance from the middle, and what is logged is its tension. `keeps` says which line of a beam does not stretch:
    its `middle`, or the `side` to which it bends, as of a finger with a strain-limiting layer.
    """

    kind: Literal["tube", "rod", "rectangle", "custom"] = "tube"
    width: Length | None = None
    thickness: Length | None = None
    area: Area | None = None
    second_moment: SecondMoment | None = None
    chamber_area: Area | None = None
    tendon: Length | None = None
    keeps: Literal["middle", "side"] | None = None


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

    `error` is the standard error of the distance, or of each place; `behind` how far behind the plane of motion they lie.
    """

    points: Annotated[tuple[tuple[float, float], ...], Field(min_length=2)]
    distance: LongLength | None = None
    places: Annotated[tuple[tuple[Offset, Offset], ...], Field(min_length=4)] | None = None
    error: Length | None = None
    behind: Offset = 0.0


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
    line_delay: Annotated[float, quantity("s", "20 us"), shown_as("20 us")] | None = None


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
    unit: Annotated[str | None, unit_of("deg")] = None
    time_unit: Annotated[str | None, unit_of("s")] = None

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The points from the clamp to the tip, a single one as a group of one; ``(("all",),)`` for all in the file's order."""
        named = ["all"] if self.points == "all" else self.points or []
        return tuple(tuple(item) if isinstance(item, list) else (item,) for item in named)


class PressurePart(_Part):
    """The pressure log: a table in a file or from a database, the columns to take, and their units.

    `ambient` is a pressure or the name of a column; without `reference`, a unit such as ``psia`` or ``bar(g)`` says it.
    `value` alone is a run at constant pressure, without a log. Each of several has the name of its `chamber`, and a `sign`,
    -1 where it bends against the direction of `actuator.bends`. Of a tendon (`actuator.section`) the log is its tension, a force.
    """

    chamber: Text | None = None
    sign: Literal[1, -1] = 1
    value: Pressure | None = None
    file: str | None = None
    url: str | None = None
    query: str | None = None
    time: Text | None = None
    pressure: Text | None = None
    unit: Annotated[str | None, unit_of("kPa", "N")] = None
    time_unit: Annotated[str | None, unit_of("s")] = None
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
    recorded_at: Annotated[str | None, BeforeValidator(date_and_time)] = None
    memory: Literal["fresh", "carried"] | None = None
    note: Text | None = None


class CampaignFile(_Shared):
    """campaign.yaml. `design` holds design variables, numbers with or without a unit, for comparisons over campaigns."""

    format: Literal["rfea-campaign/1"] = "rfea-campaign/1"
    name: Text | None = None
    design: dict[str, Annotated[tuple[float, str], BeforeValidator(split_quantity), shown_as("30 g")]] | None = None


class ExperimentFile(_Shared):
    """experiment.yaml. Whatever it leaves out is inherited from campaign.yaml."""

    format: Literal["rfea-experiment/1"] = "rfea-experiment/1"
    name: Text | None = None
    repeat_of: Text | None = None
