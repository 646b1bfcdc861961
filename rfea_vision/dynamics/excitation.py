"""What drives a run: the pressure on the grid that the integrator steps along, and the lag of a line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from scipy.linalg import solveh_banded

from rfea_vision.arrays import FloatArray

LONGEST_STEP_S = 1e-3  # the method of order two then rings slower by 3e-5


@dataclass(frozen=True)
class Excitation:
    """Pressure (Pa, gauge) over time (s), on the uniform grid that the integrator steps along; linear between grid points.

    Of several chambers `pressure` is the sum, each times its sign, and `chambers` has the sign and the pressure (grid,) of each.
    """

    start_s: float
    step_s: float
    pressure: FloatArray
    drive: FloatArray | None = None  # (grid, n) torques (N m) on the joints, for general chains
    chambers: Mapping[str, tuple[float, FloatArray]] = field(default_factory=dict)

    @classmethod
    def from_log(
        cls,
        time_s: FloatArray,
        pressure_Pa: FloatArray,
        from_s: float,
        to_s: float,
        longest_step_s: float = LONGEST_STEP_S,
        chambers_Pa: Mapping[str, tuple[float, FloatArray]] | None = None,
        *,
        at_once: bool = False,
    ) -> Excitation:
        """Put a log on a grid aligned with its own samples: every sample of a regular log up to 1 kHz is a grid point.

        time_s, pressure_Pa : (samples,) the log; from_s, to_s : what of it is to be covered; longest_step_s : of the grid
        chambers_Pa : of several chambers, by name, the sign with which each bends, and its own pressure (samples,)
        at_once : begin at `from_s` to the last digit, as what begins in motion must, and not at the sample before
        """
        period = float(np.median(np.diff(time_s)))
        step = period / np.ceil(period / longest_step_s - 1e-6) if period > longest_step_s / 2 else longest_step_s
        first = from_s if at_once else time_s[0] + np.floor((from_s - time_s[0]) / step + 1e-9) * step
        count = int(np.ceil((to_s - first) / step - 1e-9)) + 1
        grid = first + step * np.arange(max(count, 2))
        chambers = {name: (sign, np.interp(grid, time_s, own)) for name, (sign, own) in (chambers_Pa or {}).items()}
        return cls(first, step, np.interp(grid, time_s, pressure_Pa), chambers=chambers)

    @property
    def opposed(self) -> FloatArray:
        """What the sum of the pressures in all chambers (grid,), in Pa, is beyond the pressure that bends; nought of one chamber."""
        return sum(((1.0 - sign) * own for sign, own in self.chambers.values()), start=np.zeros(self.pressure.size))

    def first(self, count: int) -> Excitation:
        """The first so many points of the grid."""
        return self._picked(slice(count), self.step_s)

    def coarser(self, every: int = 2) -> Excitation:
        """Steps so many times as long that push as much: where each `every`-th point were taken, peaks and noise would be, too."""
        chambers = {name: (sign, _nearest_line(own, every)) for name, (sign, own) in self.chambers.items()}
        drive = None if self.drive is None else np.apply_along_axis(_nearest_line, 0, self.drive, every)
        pressure = _nearest_line(self.pressure, every)
        return replace(self, step_s=every * self.step_s, pressure=pressure, drive=drive, chambers=chambers)

    def _picked(self, pick: slice, step_s: float) -> Excitation:
        chambers = {name: (sign, own[pick]) for name, (sign, own) in self.chambers.items()}
        drive = None if self.drive is None else self.drive[pick]
        return replace(self, step_s=step_s, pressure=self.pressure[pick], drive=drive, chambers=chambers)

    @property
    def end_s(self) -> float:
        """Time of the last point of the grid in s."""
        return self.start_s + self.step_s * (self.pressure.size - 1)

    @property
    def grid_s(self) -> FloatArray:
        """Times (grid,) of the grid in s."""
        return self.start_s + self.step_s * np.arange(self.pressure.size)  # pyright: ignore

    def at(self, time_s: FloatArray, values: FloatArray | None = None) -> FloatArray:
        """Pressure (times,) in Pa, or other `values` (grid,), at times in s."""
        return np.interp(time_s, self.grid_s, self.pressure if values is None else values)


def _nearest_line(values: FloatArray, every: int) -> FloatArray:
    """Least-squares values (coarse,) of a line with a corner at every n-th of the `values` (fine,).

    It begins where these do, for there the tube is at rest, and ends with a corner at their last or behind.
    """
    values = np.pad(values, (0, -(values.size - 1) % every), mode="edge")
    count = (values.size - 1) // every
    place = np.arange(values.size) / every
    left = np.minimum(place.astype(int), count - 1)
    f = place - left
    right = np.bincount(left, (1 - f) * values, count + 1) + np.bincount(left + 1, f * values, count + 1)
    bands = np.zeros((2, count + 1))
    bands[0, 1:] = np.bincount(left, f * (1 - f), count)
    bands[1] = np.bincount(left, (1 - f) ** 2, count + 1) + np.bincount(left + 1, f**2, count + 1)
    right[1] -= bands[0, 1] * values[0]
    return np.concatenate([values[:1], solveh_banded(bands[:, 1:], right[1:])])


@njit(cache=True, nogil=True)
def lagged(values, step, nodes, T):
    """First-order lag T (s) of a piecewise linear signal, `values` (steps + 1,) a `step` (s) apart: exact, T = 0 is the signal itself.

    Returns value and d/dT (steps, stages) at the fractions `nodes` (stages,) of each step.
    """
    steps, stages = values.size - 1, nodes.size
    out, slope = np.empty((steps, stages)), np.empty((steps, stages))
    y, dy = values[0], 0.0
    for k in range(steps):
        p0 = values[k]
        rate = (values[k + 1] - p0) / step
        for s in range(stages):
            t = nodes[s] * step
            if T < 1e-9:
                out[k, s], slope[k, s] = p0 + rate * t, -rate
            else:
                decay = np.exp(-t / T)
                gap = y - p0 + rate * T
                out[k, s] = p0 + rate * t - rate * T + gap * decay
                slope[k, s] = -rate + (dy + rate) * decay + gap * decay * t / T**2
        y, dy = out[k, stages - 1], slope[k, stages - 1]
    return out, slope
