"""The candidate that needs no law: more segments, where the chain is too coarse for the bend (docs/physics.md 5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rfea_vision.critique.screening import Screened
from rfea_vision.errors import DataError
from rfea_vision.fitting.problem import Problem, make_model
from rfea_vision.fitting.ratio import lever_free
from rfea_vision.fitting.refit import Fitted, carried, refit
from rfea_vision.fitting.residuals import predict_observed

SEGMENTS = "segments"
TITLE = "More segments: the chain is too coarse"
SPLIT_BY = "no experiment: the same fit with more segments"
MOST_SEGMENTS = 64  # a finer chain costs minutes
#: A finer chain that changes the prediction by less than this many noise floors is no candidate.
LEAST_FLOORS = 0.2


def screen_segments(problem: Problem, fitted: Fitted, floor: float) -> Screened | None:
    """What twice the segments would change at the present parameters; None where nobody would notice."""
    finer = 2 * fitted.options.segments
    if finer > MOST_SEGMENTS:
        return None
    model = make_model(problem.actuator, fitted.options.with_segments(finer), problem.mirror)
    known = dict(zip(fitted.model.names, fitted.par, strict=True))
    par = carried(model, problem.actuator, finer, known, fitted.options.segments)
    change, left, before = 0.0, 0.0, 0.0
    for item, old, clock in zip(
        problem.train, fitted.solution.evaluation.predicted, fitted.solution.clocks, strict=True
    ):
        new = predict_observed(model, par, item, (), float(clock))
        if new is None:
            return None
        if item.has_tip:
            seen, then, now = (1e3 * points[:, -1] for points in (item.points, old.points, new.points))
        else:
            seen, then, now = (np.rad2deg(angle)[:, None] for angle in (item.angle, old.angle, new.angle))
        share = 1 / len(problem.train)
        change += share * float(np.mean(np.sum((now - then) ** 2, axis=1)))
        before += share * float(np.mean(np.sum((seen - then) ** 2, axis=1)))
        left += share * float(np.mean(np.sum((seen - now) ** 2, axis=1)))
    if np.sqrt(change) < LEAST_FLOORS * floor:
        return None
    return Screened(SEGMENTS, {}, {}, max(0.0, 1 - left / before) if before > 0 else 0.0, None)


def refit_segments(problem: Problem, base: Fitted, name: str) -> Fitted | None:
    """The same model on twice the segments, its lever free; None where it cannot be simulated."""
    options = replace(lever_free(base).with_segments(2 * base.options.segments), name=name)
    known = dict(zip(base.model.names, base.par, strict=True))
    try:
        return refit(problem, options, known, base.options.segments, base.solution.clocks)
    except DataError:
        return None


__all__ = ["SEGMENTS", "SPLIT_BY", "TITLE", "refit_segments", "screen_segments"]
