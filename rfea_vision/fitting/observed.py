"""What the fit sees of one recording: positions in the dynamics' frame with weights, and the pressure on the engine's grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.simulation import STANDARD_GRAVITY, Excitation
from rfea_vision.fitting.nuisance import FORGOTTEN_S, Unknowns, unknowns_of
from rfea_vision.fitting.release import Held
from rfea_vision.options.fit import Observe

MM = 1e-3  # in m


@dataclass(frozen=True)
class Observed:
    """One experiment, SI, mirrored where the tube bends right so that bending is towards -x.

    time : (frames,) s on the log's clock, valid frames only
    points : (frames, m, 2) m at `fractions` of the centre line, the last one the tip, or that alone; no point (m 0)
        where only an angle was measured
    normals : (frames, m, 2) unit normals of the measured centre line
    sigma : (frames, m) m; angle, angle_sigma : (frames,) rad or NaN
    """

    name: str
    role: str
    mirror: float
    time: FloatArray
    frame: NDArray[np.int64]
    fractions: FloatArray
    points: FloatArray
    normals: FloatArray
    sigma: FloatArray
    angle: FloatArray
    angle_sigma: FloatArray
    excitation: Excitation
    observe: Observe
    clock_sigma: float  # s; 0 where the clock is taken as given
    middle_s: float  # middle of the recording, where a clock drift is zero: the same for every part of it
    repeat_of: str | None = None
    tip_noise_mm: float = 0.0
    origin_sigma: float = 0.0  # m; 0 where a track of another tool is taken as it stands in the rig frame
    pressure_zero_sd: float = 0.0  # Pa; 0 where the sensor's zero is taken as given
    angle_zero_sd: float = 0.0  # rad; as above, of the angle of a run without a tip
    gravity: float = STANDARD_GRAVITY  # m/s^2 in the plane of motion
    mounting: float = 0.0  # direction of gravity from down (rad), positive towards the side of the bend
    held: Held | None = None  # where the run begins in a held shape
    conditions: Mapping[str, float] = field(default_factory=dict)  # parameters of effects that are known for this run
    unknown_before_s: float | None = None  # before that the pressure is unknown; None where the run begins at rest

    @cached_property
    def unknowns(self) -> Unknowns | None:
        """Nuisance amplitudes of this run."""
        return unknowns_of(self.excitation, self.pressure_zero_sd, self.unknown_before_s)

    @cached_property
    def informative(self) -> Observed:
        """The part of the run that depends on its unknowns: all of it, or where only the start is unknown its beginning."""
        early = int(np.searchsorted(self.time, self.time[0] + FORGOTTEN_S))
        if self.pressure_zero_sd > 0 or early >= self.time.size:
            return self
        return self.opening(early)

    def opening(self, frames: int) -> Observed:
        """The first so many frames of the run, with the log to a quarter of a second behind them."""
        given = self.excitation
        last = int((self.time[frames - 1] - given.start_s) / given.step_s + 0.25 / given.step_s)
        return replace(self._picked(slice(0, frames)), excitation=given.first(last))

    def _picked(self, pick: slice) -> Observed:
        names = ("time", "frame", "points", "normals", "sigma", "angle", "angle_sigma")
        return replace(self, **{name: getattr(self, name)[pick] for name in names})

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Which frames (frames,) have a weight: all, but those that a prediction is read off at beside (`everywhere`)."""
        return np.isfinite(self.sigma[:, -1] if self.has_tip else self.angle_sigma)

    def everywhere(self, time: FloatArray) -> Observed:
        """The same run seen at every frame of it from the first on (`time`, (frames,) in s); those that were left out weigh nothing."""
        inside = (time >= self.time[0]) & (time <= self.excitation.end_s)
        inside &= np.concatenate([[True], time[1:] > np.maximum.accumulate(time)[:-1]])
        frame = np.flatnonzero(inside)
        at = np.searchsorted(frame, self.frame)

        def spread(values: FloatArray, elsewhere: float) -> FloatArray:
            out = np.full((frame.size, *values.shape[1:]), elsewhere)
            out[at] = values
            return out

        nowhere = {name: spread(getattr(self, name), 0.0) for name in ("points", "normals", "angle")}
        weightless = {name: spread(getattr(self, name), np.inf) for name in ("sigma", "angle_sigma")}
        return replace(self, time=time[frame], frame=frame, **nowhere, **weightless)

    @property
    def period_s(self) -> float:
        """Time (s) from one frame to the next."""
        return float(np.median(np.diff(self.time)))

    @property
    def clock_free(self) -> bool:
        """Whether the clock of this run is found with the fit."""
        return self.clock_sigma > 0

    @property
    def has_midline(self) -> bool:
        """Whether points of the centre line beside the tip are compared."""
        return self.fractions.size > 1

    @property
    def has_tip(self) -> bool:
        """Whether positions are compared; else only an angle was measured."""
        return self.fractions.size > 0

    @property
    def tip_or_angle(self) -> FloatArray:
        """What errors are counted in: the tip (frames, 2) in mm, or where there is none the angle (frames, 1) in deg."""
        return self.points[:, -1] / MM if self.has_tip else np.rad2deg(self.angle)[:, None]

    def thinned(self, step: int) -> Observed:
        """Every `step`-th frame, for screening."""
        if step <= 1:
            return self
        return self._picked(slice(None, None, step))

    def rough(self, frames: int) -> Observed:
        """About so many frames of the same run, simulated with twice the step: for first fits and coarse comparisons."""
        return self.thinned(max(1, self.time.size // frames)).coarser()

    def coarser(self) -> Observed:
        """The same run, to be simulated with twice the step: half the cost, four times the integrator's error."""
        return replace(self, excitation=self.excitation.coarser())

    def in_steps_of(self, longest_s: float | None) -> Observed:
        """The same run in steps doubled as often as they stay within these; as it is where none are given."""
        item = self
        while longest_s is not None and 2 * item.excitation.step_s < longest_s * (1 + 1e-9):
            item = item.coarser()
        return item
