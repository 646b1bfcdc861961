"""From thinned runs in long steps on a coarse chain to all frames in the steps of the log, without derivatives.

The residual is that of the fine simulation, its slopes those that the rough fit has left (defect correction: Stetter 1978,
doi:10.1007/BF01432879): slopes that are a few per cent off leave a few per cent of the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from rfea_vision.arrays import FloatArray
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.residuals import Predicted, evaluate, rows
from rfea_vision.fitting.solver import CLOCK_SCALE_S, WEAKEST

#: Steps at most; and the share of what a step predicts that it must win, lest the slopes lead astray.
MOST_STEPS, TRUSTED = 5, 0.5
#: A step that fails has arrived where it predicted less than this share: half of it in the error, no digit of three.
IDLE = 1e-3


def carried_over(
    near: Fitted, rough: Sequence[Observed], items: Sequence[Observed], gain: float
) -> tuple[Fitted, bool]:
    """A fit to `rough` as it is to `items`, its slopes still those of `rough`; and whether it has arrived there.

    It has where a step more would win less than the share `gain` of the cost. Where it cannot be simulated, or the slopes lead
    astray, the best so far is returned.
    """
    best, now, lowest, predicted = near, near, np.inf, 0.0
    for _ in range(MOST_STEPS):
        seen = evaluate(now.model, now.par, items, (), now.solution.clocks, now.solution.evaluation)
        prior = now.solution.prior_residual
        if seen is None or (cost := seen.cost + float(prior @ prior)) >= lowest:
            return best, predicted < IDLE and best is not near
        now = replace(now, solution=replace(now.solution, evaluation=seen, cost=seen.cost))
        won, best, lowest = 1 - cost / lowest, now, cost
        step, following = _step(now, rough, items)
        if following < gain or won < gain:
            return best, True
        if won < TRUSTED * predicted:
            return best, False
        now, predicted = _moved(now, step), following
    return best, False


def _step(now: Fitted, rough: Sequence[Observed], items: Sequence[Observed]) -> tuple[FloatArray, float]:
    """A Gauss-Newton step of coordinates and free clocks within their bounds, and the share of the cost that it predicts to win."""
    solution, coordinates = now.solution, now.coordinates
    seen = zip(rough, items, solution.evaluation.predicted, strict=True)
    residual = np.concatenate([*(_rows_of(*three) for three in seen), solution.prior_residual])
    slopes = np.concatenate([solution.scaled_jacobian, solution.prior_jacobian])
    limits = solution.clock_limits / CLOCK_SCALE_S
    low, high = np.concatenate([coordinates.lower, -limits]), np.concatenate([coordinates.upper, limits])
    triangle: FloatArray = np.asarray(np.linalg.qr(np.column_stack([slopes, residual]), mode="r"))
    size = np.maximum(np.linalg.norm(triangle[:, :-1], axis=0), 1e-300)
    faint = np.column_stack([WEAKEST * np.eye(size.size), np.zeros(size.size)])  # of what the data tell next to nothing
    wide = np.concatenate([triangle / np.append(size, 1.0), faint])
    room = np.minimum((low - solution.x) * size, 0.0), np.maximum((high - solution.x) * size, 1e-300)
    step = lsq_linear(wide[:, :-1], -wide[:, -1], room, method="bvls").x / size
    fall = float(residual @ residual - np.sum((triangle[:, :-1] @ step + triangle[:, -1]) ** 2))
    return step, fall / max(float(residual @ residual), 1e-300)


def _moved(now: Fitted, step: FloatArray) -> Fitted:
    """The fit after a step; what was evaluated is that of before."""
    solution, coordinates = now.solution, now.coordinates
    ny, clocks = len(coordinates.free), solution.clocks.copy()
    y = np.clip(solution.y + step[:ny], coordinates.lower, coordinates.upper)
    clocks[list(solution.clock_index)] += step[ny:] * CLOCK_SCALE_S
    prior = solution.prior_residual + solution.prior_jacobian @ step
    return replace(
        now, solution=replace(solution, par=coordinates.parameters(y), y=y, clocks=clocks, prior_residual=prior)
    )


def _rows_of(part: Observed, whole: Observed, seen: Predicted) -> FloatArray:
    """Residual (rows,) at those frames of a run that a thinned one has."""
    at = np.searchsorted(whole.frame, part.frame)
    thin = {name: getattr(seen, name)[at] for name in ("points", "dpoints", "angle", "dangle")}
    return rows(part, replace(seen, **thin))[0]
