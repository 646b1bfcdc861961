"""What drives a run: the pressure on the grid that the integrator steps along, and the lag of a line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
LONGEST_STEP_S = 1e-3


@dataclass(frozen=True)
class Excitation:
    """Pressure (Pa, gauge) over time (s), on the uniform grid that the integrator steps along; linear between grid points."""

    start_s: float
    step_s: float
    pressure: FloatArray
    drive: FloatArray | None = None  # (grid, n) torques (N m) on the joints, for general chains

    @classmethod
    def from_log(
        cls,
        time_s: FloatArray,
        pressure_Pa: FloatArray,
        from_s: float,
        to_s: float,
        longest_step_s: float = LONGEST_STEP_S,
    ) -> Excitation:
        """Put a log on a grid aligned with its own samples: every sample of a regular log up to 1 kHz is a grid point."""
        period = float(np.median(np.diff(time_s)))
        step = period / np.ceil(period / longest_step_s - 1e-6) if period > longest_step_s / 2 else longest_step_s
        first = time_s[0] + np.floor((from_s - time_s[0]) / step + 1e-9) * step
        count = int(np.ceil((to_s - first) / step - 1e-9)) + 1
        grid = first + step * np.arange(max(count, 2))
        return cls(first, step, np.interp(grid, time_s, pressure_Pa))

    @property
    def end_s(self) -> float:
        return self.start_s + self.step_s * (self.pressure.size - 1)

    @property
    def grid_s(self) -> FloatArray:
        """Times (s) of the grid."""
        return self.start_s + self.step_s * np.arange(self.pressure.size)  # pyright: ignore

    def at(self, time_s: FloatArray) -> FloatArray:
        """Pressure (Pa) at times (s)."""
        return np.interp(time_s, self.grid_s, self.pressure)


@njit(cache=True, nogil=True)
def lagged(values, step, nodes, T):
    """First-order lag of a piecewise linear signal: value and d/dT at (steps, stages), exact; T = 0 is the signal itself."""
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
