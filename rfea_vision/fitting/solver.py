"""Bounded least squares on exact Jacobians; a failed simulation costs a step, not the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rfea_vision.dynamics.simulation import Model
from rfea_vision.fitting.coordinates import Coordinates
from rfea_vision.fitting.observation import Observed
from rfea_vision.fitting.residuals import Evaluation, evaluate

FloatArray = NDArray[np.float64]
CLOCK_SCALE_S = 0.005
CLOCK_PRIOR_S = 0.05
LARGEST_CLOCK_S = 0.2


@dataclass(frozen=True)
class Solution:
    """Where the optimiser ended: full parameter vector, clocks per experiment, cost and the evaluation there.

    `scaled_jacobian` is with respect to [coordinates, free clocks] in the optimiser's units.
    """

    par: FloatArray
    y: FloatArray
    clocks: FloatArray
    cost: float
    converged: bool
    message: str
    evaluation: Evaluation
    scaled_jacobian: FloatArray
    clock_index: tuple[int, ...]
    evaluations: int


def solve(
    model: Model,
    items: Sequence[Observed],
    coordinates: Coordinates,
    start: FloatArray,
    clocks: FloatArray | None = None,
    *,
    most_evaluations: int = 60,
    tolerance: float = 1e-7,
    weights: Sequence[FloatArray] | None = None,
) -> Solution | None:
    """Minimise from `start` (full parameter vector); None where not even the start can be simulated.

    Experiments whose clock was found from their motion get it as a nuisance parameter.
    """
    clock_index = tuple(i for i, item in enumerate(items) if item.clock_free)
    offsets = np.zeros(len(items)) if clocks is None else clocks.copy()
    ny, nc = len(coordinates.free), len(clock_index)
    pick = [*range(ny), *(ny + i for i in clock_index)]
    sub = coordinates.matrix[list(coordinates.free)]
    cache: dict[bytes, tuple[FloatArray, FloatArray, Evaluation] | None] = {}
    count = 0

    def unpack(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = offsets.copy()
        for position, index in enumerate(clock_index):
            values[index] = x[ny + position] * CLOCK_SCALE_S
        return coordinates.parameters(x[:ny]), values

    def at(x: FloatArray) -> tuple[FloatArray, FloatArray, Evaluation] | None:
        nonlocal count
        key = x.tobytes()
        if key not in cache:
            count += 1
            par, values = unpack(x)
            result = evaluate(model, par, items, coordinates.free, values)
            if result is None:
                cache[key] = None
            else:
                jacobian = result.jacobian[:, pick].copy()
                jacobian[:, :ny] = jacobian[:, :ny] @ sub
                jacobian[:, ny:] *= CLOCK_SCALE_S
                prior = np.zeros((nc, ny + nc))
                prior[np.arange(nc), ny + np.arange(nc)] = CLOCK_SCALE_S / CLOCK_PRIOR_S
                residual = np.concatenate([result.residual, x[ny:] * CLOCK_SCALE_S / CLOCK_PRIOR_S])
                cache.clear()
                cache[key] = (residual, np.concatenate([jacobian, prior]), result)
        return cache[key]

    y0 = coordinates.coordinates(start)
    x0 = np.concatenate([y0, [offsets[i] / CLOCK_SCALE_S for i in clock_index]])
    first = at(x0)
    if first is None:
        return None
    bad = np.full(first[0].size, 1e3 * np.sqrt(first[0] @ first[0] / first[0].size) + 1e3)

    def fun(x: FloatArray) -> FloatArray:
        value = at(x)
        return bad if value is None else value[0]

    def jac(x: FloatArray) -> FloatArray:
        value = at(x)
        return np.zeros((bad.size, x.size)) if value is None else value[1]

    limit = LARGEST_CLOCK_S / CLOCK_SCALE_S
    lower = np.concatenate([coordinates.lower, np.full(nc, -limit)])
    upper = np.concatenate([coordinates.upper, np.full(nc, limit)])
    if x0.size == 0:
        par, values = unpack(x0)
        return Solution(par, y0, values, first[2].cost, True, "nothing to fit", first[2], first[1], clock_index, count)
    result = least_squares(
        fun,
        x0,
        jac,  # type: ignore[arg-type]
        bounds=(lower, upper),
        method="trf",
        x_scale="jac",
        ftol=tolerance,
        xtol=1e-9,
        gtol=1e-12,
        max_nfev=most_evaluations,
    )
    last = at(result.x)
    if last is None:
        return None
    par, values = unpack(result.x)
    return Solution(
        par,
        result.x[:ny],
        values,
        last[2].cost,
        result.status > 0,
        str(result.message),
        last[2],
        last[1][: last[2].residual.size],
        clock_index,
        count,
    )


def fit_clocks(model: Model, items: Sequence[Observed], par: FloatArray) -> FloatArray:
    """Clock offset of each experiment for fixed parameters: what a held-out run may adjust, and nothing else."""
    clocks = np.zeros(len(items))
    for index, item in enumerate(items):
        if not item.clock_free:
            continue
        for _ in range(6):
            result = evaluate(model, par, [item], (), clocks[index : index + 1])
            if result is None:
                break
            j = result.jacobian[:, 0]
            step = -float(j @ result.residual) / max(float(j @ j), 1e-30)
            clocks[index] = np.clip(clocks[index] + np.clip(step, -0.03, 0.03), -LARGEST_CLOCK_S, LARGEST_CLOCK_S)
            if abs(step) < 1e-6:
                break
    return clocks
