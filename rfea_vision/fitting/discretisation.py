"""How far the parameters would move if the tube were cut into more bodies.

An interval from noise alone says nothing of how coarsely n bodies stand for a tube. A chain twice as fine, run once at the
fitted values, shows by how much the prediction is off; projected on the parameters that is the way they would go.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem, make_model
from rfea_vision.fitting.refit import Fitted, carried
from rfea_vision.fitting.residuals import evaluate
from rfea_vision.fitting.solver import WEAKEST

#: With joints in the middle the error falls with 1/n^2: a chain of 2 n lacks a third of what it has gained.
TO_THE_LIMIT = 4 / 3


def drift(problem: Problem, fitted: Fitted, items: Sequence[Observed]) -> FloatArray:
    """Change of the parameter vector (parameters,) from n bodies to a continuous tube, to first order, in units of n bodies.

    Zero where the chain stands for itself and not for a tube: with joints at the start of the bodies, as in the paper, or where an
    effect names one of the joints; and where the finer chain cannot be simulated.
    """
    nowhere = np.zeros(len(fitted.model.names))
    options, clocks = fitted.options, fitted.solution.clocks
    if options.joints != "middle" or any("@" in effect for effect in options.effects):
        return nowhere
    count = 2 * options.segments
    finer = make_model(problem.actuator, options.with_segments(count), problem.mirror)
    par = carried(finer, problem.actuator, count, fitted.values, options.segments)
    here, there = evaluate(fitted.model, fitted.par, items, (), clocks), evaluate(finer, par, items, (), clocks)
    if here is None or there is None:
        return nowhere
    step = _asked_for(fitted, there.residual - here.residual)
    return np.asarray(TO_THE_LIMIT * (fitted.coordinates.matrix @ step), dtype=np.float64)


def _asked_for(fitted: Fitted, change: FloatArray) -> FloatArray:
    """Gauss-Newton step of the coordinates (free,) that a change of the residual (rows,) asks for at a solved fit.

    Free clocks off their bounds move along; directions of which the data tell next to nothing are not moved along.
    """
    solution, coordinates = fitted.solution, fitted.coordinates
    moves = np.concatenate([coordinates.inside(solution.y), solution.clocks_inside])
    step = np.zeros(moves.size)
    if moves.any():
        weight = np.sqrt(solution.row_weight)
        jacobian = np.concatenate([solution.scaled_jacobian * weight[:, None], solution.prior_jacobian])[:, moves]
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        wanted = np.concatenate([change * weight, np.zeros_like(solution.prior_residual)])
        step[moves] = -np.linalg.lstsq(jacobian / size, wanted, rcond=WEAKEST)[0] / size
    return step[: len(coordinates.free)]
