"""Steady state first: plateaus found in the recordings, and the stiffness that explains them (the paper's first step)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.simulation import STANDARD_GRAVITY, Model
from rfea_vision.fitting.coordinates import Coordinates
from rfea_vision.fitting.observed import Observed

SHORTEST_PLATEAU_S = 0.25  # a shorter hold is a step on a ramp


#: Weights of a plateau's points and of its angle: about what a track is worth.
STEADY_SIGMA_M, STEADY_SIGMA_RAD = 1e-4, 1e-3


@dataclass(frozen=True)
class Plateau:
    """A stretch where pressure and tube rest: mean pressure (Pa), points (m, 2) in m, bend angle (rad)."""

    experiment: str
    from_s: float
    to_s: float
    pressure: float
    points: FloatArray
    angle: float
    gravity: float = STANDARD_GRAVITY  # as the rig of this run stands, see `Observed`
    mounting: float = 0.0


def find_plateaus(items: Sequence[Observed]) -> list[Plateau]:
    """Stretches of at least a quarter second over which the pressure and the tube stay within narrow bands."""
    found = []
    for item in items:
        if item.conditions:  # its rest is that of another tube, or of a loaded one
            continue
        pressure = item.excitation.at(item.time)
        band = max(0.01 * np.ptp(item.excitation.pressure), 1e3)
        signal = item.tip_or_angle
        still = 1.0 + 5 * item.tip_noise_mm
        start = 0
        while start < item.time.size - 5:
            stop = start
            low = high = pressure[start]
            while stop < item.time.size:
                low, high = min(low, pressure[stop]), max(high, pressure[stop])
                if high - low > band:
                    break
                stop += 1
            if item.time[stop - 1] - item.time[start] >= SHORTEST_PLATEAU_S:
                # The tube is still moving when the pressure has stopped: only the end of the hold counts.
                tail = slice(start + (stop - start) * 2 // 3, stop)
                if tail.stop - tail.start >= 5 and np.all(np.ptp(signal[tail], axis=0) < still):
                    found.append(
                        Plateau(
                            item.name,
                            float(item.time[start]),
                            float(item.time[stop - 1]),
                            float(pressure[tail].mean()),
                            item.points[tail].mean(axis=0),
                            float(np.mean(item.angle[tail])),
                            item.gravity,
                            item.mounting,
                        )
                    )
                start = stop
            else:
                start += max(1, (stop - start) // 4)
    return found


def steady_points(
    model: Model,
    par: FloatArray,
    pressure: float,
    free: Sequence[int],
    fractions: FloatArray,
    start: FloatArray | None,
) -> tuple[FloatArray, FloatArray, float, FloatArray, FloatArray] | None:
    """Points (m, 2), derivatives, tip angle and its derivative at one pressure, and phi; None where there is no steady state."""
    steady = model.steady(par, pressure, free, start=start)
    if not steady.found:
        steady = model.steady(par, pressure, free)
        if not steady.found:
            return None
    points = model.line_at_rest(par, steady, fractions, free)
    return *points, float(steady.phi[-1]), steady.sensitivity[-1], steady.phi


def fit_steady(
    model: Model,
    plateaus: Sequence[Plateau],
    coordinates: Coordinates,
    start: FloatArray,
    fractions: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Least squares on the plateaus: parameters and weighted residual; None where the start has no steady state.

    start : (parameters,) in SI; fractions : (m,) places on the centre line at which the plateaus have points, or none
    The weights (`STEADY_SIGMA_M`, `STEADY_SIGMA_RAD`) are about what a track is worth, the same for all plateaus.
    """
    guesses: dict[int, FloatArray] = {}

    def run(y: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        par = coordinates.parameters(y)
        residuals, jacobians = [], []
        for index, plateau in enumerate(plateaus):
            own = model.rigged(plateau.gravity, plateau.mounting)
            out = steady_points(own, par, plateau.pressure, coordinates.free, fractions, guesses.get(index))
            if out is None:
                return None
            points, dpoints, angle, dangle, guesses[index] = out
            if fractions.size:
                residuals.append(((plateau.points - points) / STEADY_SIGMA_M).ravel())
                jacobians.append((-dpoints / STEADY_SIGMA_M).reshape(-1, len(coordinates.free)))
            else:
                residuals.append(np.array([(plateau.angle - angle) / STEADY_SIGMA_RAD]))
                jacobians.append(-dangle[None] / STEADY_SIGMA_RAD)
        return np.concatenate(residuals), np.concatenate(jacobians) @ coordinates.matrix[list(coordinates.free)]

    y0 = coordinates.coordinates(start)
    first = run(y0)
    if first is None:
        return None
    bad = np.full(first[0].size, 1e6)

    def fun(y: FloatArray) -> FloatArray:
        out = run(y)
        return bad if out is None else out[0]

    def jac(y: FloatArray) -> FloatArray:
        out = run(y)
        return np.zeros((bad.size, y.size)) if out is None else out[1]

    bounds = (coordinates.lower, coordinates.upper)
    result = least_squares(fun, y0, jac, bounds=bounds, x_scale="jac", max_nfev=40)  # type: ignore[arg-type]
    return coordinates.parameters(result.x), result.fun
