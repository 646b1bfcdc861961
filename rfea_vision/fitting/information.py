"""How many independent values a residual holds, and what they say of two fits of the same runs."""

from __future__ import annotations

import numpy as np

from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.residual_tests import correlation_time


def effective_count(problem: Problem, fitted: Fitted) -> float:
    """Number of independent residuals: frames over the integrated autocorrelation time of the worst axis, run by run."""
    total = 0.0
    for item, predicted in zip(problem.train, fitted.solution.evaluation.predicted, strict=True):
        gap = item.points[:, -1] - predicted.points[:, -1] if item.has_tip else (item.angle - predicted.angle)[:, None]
        frames = 2 * correlation_time(gap[:, int(np.argmax(gap.std(axis=0)))], 1.0)  # one where the residual is white
        total += gap.shape[0] / frames if frames > 0 else 0.0
    return max(total, 2.0)


def delta_bic(problem: Problem, before: Fitted, after: Fitted) -> float:
    """Change of BIC on the training runs, with the number of independent residuals of the better model."""
    count = max(effective_count(problem, before), effective_count(problem, after))
    added = len(after.coordinates.free) - len(before.coordinates.free)
    ratio = after.solution.cost / max(before.solution.cost, 1e-300)
    return float(count * np.log(max(ratio, 1e-12)) + added * np.log(count))
