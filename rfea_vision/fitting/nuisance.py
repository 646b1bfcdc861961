"""Nuisance parameters of a run: a sensor's zero, and the motion that the run begins with.

Both are told as pressure: a zero is a constant on top of the log, and a tube that moves when its log begins has been
driven before it. Each unknown is an amplitude of order one times a wave on the excitation's grid. Amplitudes are found
for every set of parameters by Gauss-Newton steps and eliminated from the derivatives (variable projection; Kaufman 1975,
doi:10.1007/BF01932995), so that the optimiser, the score tests and the intervals need not know of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.simulation import Excitation

#: The unknown pressure before the log: held from the start of the excitation, and twice more shortly before the log begins.
BEFORE_S = 0.5
SINCE_S = {"held": np.inf, "lately": 0.2, "just": 0.06}
#: A start is forgotten after this long: later frames say nothing of it.
FORGOTTEN_S = 2.5
#: A priori standard deviation of either, as a share of the largest pressure of the run.
UNKNOWN_SHARE = 0.5
GAUSS_NEWTON_STEPS = 8
LARGEST_STEP, LARGEST = 0.7, 3.0
#: Amplitudes are found where a step more would win less than this share of the cost: far less than any fit is followed to.
SAME = 1e-8


@dataclass(frozen=True)
class Unknowns:
    """Waves of pressure, (k, grid) in Pa, whose amplitudes have an a priori standard deviation of one."""

    names: tuple[str, ...]
    waves: FloatArray
    sizes: FloatArray  # Pa, what an amplitude of one means

    def driven(self, excitation: Excitation, amplitude: FloatArray) -> Excitation:
        """Excitation with the waves on it by their amplitudes (k,); it may end before they do."""
        return replace(excitation, pressure=excitation.pressure + amplitude @ self.waves[:, : excitation.pressure.size])

    def values_kPa(self, amplitude: FloatArray) -> dict[str, float]:
        """Pressures in kPa that amplitudes (k,) mean, by name."""
        return {f"{name}_kPa": float(a * s / 1e3) for name, a, s in zip(self.names, amplitude, self.sizes, strict=True)}


def unknowns_of(excitation: Excitation, pressure_zero_sd: float, unknown_before_s: float | None) -> Unknowns | None:
    """Unknowns of a run; None where it has none.

    Parameters
    ----------
    excitation : pressure of the run
    pressure_zero_sd : standard error (Pa) of the sensor's zero; 0 where that is known
    unknown_before_s : time at which the log begins, where the tube moves then; else None
    """
    grid = excitation.grid_s
    names, waves, sizes = [], [], []
    if pressure_zero_sd > 0:
        names.append("pressure_zero")
        waves.append(np.ones(grid.size))
        sizes.append(pressure_zero_sd)
    if unknown_before_s is not None:
        before = grid < unknown_before_s - 1e-9
        size = UNKNOWN_SHARE * max(float(np.max(np.abs(excitation.pressure))), 1e3)
        for name, since_s in SINCE_S.items():
            names.append(f"pressure_{name}_before")
            waves.append(np.where(before & (grid >= unknown_before_s - since_s), 1.0, 0.0))
            sizes.append(size)
    if not names:
        return None
    return Unknowns(tuple(names), np.array(sizes)[:, None] * np.array(waves), np.array(sizes))


def eliminate(
    amplitude: FloatArray, look: Callable[[FloatArray], tuple[FloatArray, FloatArray] | None]
) -> FloatArray | None:
    """Amplitudes (k,) that fit a run best, sought from those given; None where it cannot be simulated.

    look : amplitudes to the weighted residual (rows,) and its derivatives (rows, k); None where the simulation fails
    """
    seen = look(amplitude)
    if seen is None:
        return None
    for _ in range(GAUSS_NEWTON_STEPS):
        residual, columns = seen
        before = float(residual @ residual + amplitude @ amplitude)
        step = _bounded_step(columns, residual, amplitude)
        left, then = residual + columns @ step, amplitude + step
        if left @ left + then @ then > before * (1 - SAME):
            break
        for share in (1.0, 0.3, 0.1, 0.03):
            wanted = amplitude + share * step
            ahead = look(wanted)
            if ahead is not None and float(ahead[0] @ ahead[0] + wanted @ wanted) < before:
                break
        else:
            break  # nothing lower this way: the best there is
        amplitude, seen = wanted, ahead
    return amplitude


def answer(columns: FloatArray, residuals: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Change of the amplitudes (k, ...) that leaves least of the residuals (rows, ...), whose derivatives are `columns` (rows, k).

    By orthogonal factors: squares of the derivatives of a motion that runs away would leave no digit of the a priori knowledge.
    """
    known = np.concatenate([columns, np.eye(columns.shape[1])])
    return -np.asarray(np.linalg.lstsq(known, np.concatenate([residuals, amplitude]), rcond=None)[0], dtype=float)


def _bounded_step(columns: FloatArray, residual: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Gauss-Newton's step of the amplitudes, none longer than `LARGEST_STEP` and none beyond `LARGEST`."""
    step = answer(columns, residual, amplitude)
    step *= min(1.0, LARGEST_STEP / max(float(np.max(np.abs(step))), 1e-12))
    return np.clip(amplitude + step, -LARGEST, LARGEST) - amplitude
