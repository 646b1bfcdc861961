"""What the stages work on: a campaign and its experiments, with units resolved, paths absolute and inheritance done.

Keys that mean the same in every folder are not said again: they stand in the parts of `schema`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rfea_vision.artefacts import Actuator, Hints, bend_sign
from rfea_vision.artefacts.measurement import Pixel, Vertical
from rfea_vision.campaign.schema import PressurePart, ScalePart, SyncPart, TrackPart
from rfea_vision.errors import InputError

if TYPE_CHECKING:
    from rfea_vision.calibration.board import Board

#: Directions of gravity in the frame in which the unloaded tube points down, as angles (deg) from down towards camera-left.
GRAVITY_DEG = {"down": 0.0, "left": 90.0, "up": 180.0, "right": -90.0}


def gravity_deg(given: str | float, bends: str) -> float | None:
    """Angle (deg) of gravity from down, positive in the direction of the bend, by word or given; None for ``none``."""
    if not isinstance(given, str):
        return given
    return None if given == "none" else GRAVITY_DEG[given] * bend_sign(bends)


@dataclass(frozen=True)
class CameraSpec:
    """How pictures are turned into millimetres: a board with photos, the file of an earlier calibration, or a scale.

    The scale ``tube`` is the tube's own length between the hints `clamp` and `tip`.
    """

    board: Board | None = None
    photos: tuple[Path, ...] = ()
    plane: Path | None = None
    file: Path | None = None
    vertical: Vertical = "board"
    scale: ScalePart | Literal["tube"] | None = None
    hints: Hints = field(default_factory=Hints)
    board_offset_mm: float = 0.0
    lens: str = "auto"
    line_delay_s: float | None = None


@dataclass(frozen=True)
class VideoSpec:
    """A video `file`, or a folder of `frames` with their `times` table, or without; `rate_Hz` overrides recorded times.

    No picture may lie outside of `within`, where that is given.
    """

    file: Path | None = None
    frames: Path | None = None
    times: Path | None = None
    rate_Hz: float | None = None
    within: Path | None = None

    @property
    def found(self) -> bool:
        """Whether its pictures were there when the campaign was read."""
        return self.file is not None or self.frames is not None


@dataclass(frozen=True)
class TrackSpec:
    """A track made by another tool, and the keys that say how to read it."""

    file: Path
    keys: TrackPart = field(default_factory=TrackPart)


@dataclass(frozen=True)
class PressureSpec:
    """A pressure log in a file or behind a database URL, or a constant pressure, and the keys that say how to read it.

    Of several chambers this is the first one, and `further` are the others: what bends is the sum of all pressures, each times
    its sign. Names of databases are looked up from `folder`. `tendon`: the log is the tension of one, a force.
    """

    file: Path | None = None
    keys: PressurePart = field(default_factory=PressurePart)
    folder: Path = Path()
    further: tuple[PressureSpec, ...] = ()
    tendon: bool = False

    @property
    def name(self) -> str:
        """What the chamber is called; empty of one alone."""
        return self.keys.chamber or ""

    @property
    def constant_kPa(self) -> float | None:
        """The pressure of a chamber without a log; None where there is one, or should be."""
        return self.keys.value

    @property
    def chambers(self) -> tuple[PressureSpec, ...]:
        """Every chamber's, this one first."""
        return (self, *self.further)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of all chambers, each once."""
        return tuple(dict.fromkeys(part.file for part in self.chambers if part.file is not None))

    @property
    def missing(self) -> bool:
        """Whether some chamber has neither a log nor a constant pressure."""
        return any((part.file, part.keys.url, part.constant_kPa) == (None, None, None) for part in self.chambers)

    @property
    def acts(self) -> bool:
        """Whether some chamber has a log, or a constant pressure other than none."""
        return any(part.file or part.keys.url or part.constant_kPa for part in self.chambers)

    @property
    def constant(self) -> bool:
        """Whether there is no log at all: the pressure of every chamber was constant."""
        return all(part.constant_kPa is not None for part in self.chambers)


@dataclass(frozen=True)
class RigSpec:
    """How a run was set up.

    Attributes
    ----------
    gravity_deg : direction of gravity from down, positive in the direction of the bend; None where there is none in the plane
    plumb : two pixels on a line that hangs plumb, upper one first, where the direction of gravity is read from the picture
    held : whether the tube was held in the measured shape and let go; `held_until_s` None: when it is seen to move
    pulled : force in N by which the tip was held, and its direction (deg) from down, positive in the direction of the bend
    conditions : parameters of effects that are known for this run, ``{"payload.m": 0.01}`` in SI
    """

    gravity_deg: float | None = 0.0
    plumb: tuple[Pixel, Pixel] | None = None
    held: bool = False
    held_until_s: float | None = None
    pulled: tuple[float, float] | None = None
    conditions: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ExperimentSpec:
    """One recorded run. Exactly one of `video` and `track` is given."""

    name: str
    folder: Path
    role: str
    actuator: Actuator
    camera: CameraSpec | None
    video: VideoSpec | None
    track: TrackSpec | None
    pressure: PressureSpec
    sync: SyncPart
    repeat_of: str | None = None
    recorded_at: str | None = None
    memory: str = "fresh"
    note: str = ""
    rig: RigSpec = field(default_factory=RigSpec)

    @property
    def file(self) -> Path:
        """The experiment.yaml that says all this."""
        return self.folder / "experiment.yaml"


@dataclass(frozen=True)
class Campaign:
    """A folder of experiments on one tube; everything made from it goes to `out`. `design`: number and unit by name."""

    name: str
    root: Path
    out: Path
    actuator: Actuator
    camera: CameraSpec | None
    experiments: tuple[ExperimentSpec, ...] = field(default=())
    design: Mapping[str, tuple[float, str]] = field(default_factory=dict)

    def experiment(self, name: str) -> ExperimentSpec:
        """Return one experiment by name.

        Raises
        ------
        InputError
            If the campaign has no experiment of that name.
        """
        for experiment in self.experiments:
            if experiment.name == name:
                return experiment
        names = ", ".join(item.name for item in self.experiments) or "none"
        called = "".join(f"; the one in that folder has the name '{it.name}'" for it in self.experiments if it.file.parent.name == name)
        raise InputError(f"{self.root}: no experiment '{name}'; there are: {names}{called}")

    def with_role(self, *roles: str) -> tuple[ExperimentSpec, ...]:
        """Return the experiments of these roles, in order."""
        return tuple(item for item in self.experiments if item.role in roles)
