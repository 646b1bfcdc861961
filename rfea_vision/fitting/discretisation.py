"""How far the parameters would move if the tube were cut into more bodies.

An interval from noise alone says nothing of how coarsely n bodies stand for a tube. A chain twice as fine, run once at the
fitted values, shows by how much the prediction is off; projected on the parameters that is the way they would go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem, make_model
from rfea_vision.fitting.refine import Refined, gauss_newton_step
from rfea_vision.fitting.refit import Fitted, carried
from rfea_vision.fitting.residuals import evaluate, rows

#: With joints in the middle the error falls with 1/n^2: a chain of 2 n lacks a third of what it has gained.
TO_THE_LIMIT = 4 / 3


def drift(problem: Problem, fitted: Fitted, refined: Refined, items: Sequence[Observed]) -> FloatArray:
    """Change of the parameter vector (parameters,) from n bodies to a continuous tube, to first order, in units of n bodies.

    Zero where the chain is taken at its word: with joints at the start of the bodies, as in the paper, or where an effect
    names one of the joints; and where the finer chain cannot be simulated.
    """
    nowhere = np.zeros(len(fitted.model.names))
    options, coordinates = fitted.options, fitted.coordinates
    if options.joints != "middle" or any("@" in effect for effect in options.effects):
        return nowhere
    count = 2 * options.segments
    known = dict(zip(fitted.model.names, refined.par, strict=True))
    finer = make_model(problem.actuator, options.with_segments(count), problem.mirror)
    finer = replace(finer, order=refined.model.order)  # the number of bodies is to differ, and nothing else
    par = carried(finer, problem.actuator, count, known, options.segments)
    seen = evaluate(finer, par, items, (), refined.clocks)
    if seen is None:
        return nowhere
    here = [rows(item, one)[0] for item, one in zip(items, refined.predicted, strict=True)]
    change = seen.residual - np.concatenate(here)
    step = gauss_newton_step(fitted, change, np.zeros_like(fitted.solution.prior_residual))
    return np.asarray(TO_THE_LIMIT * (coordinates.matrix @ step[: len(coordinates.free)]), dtype=np.float64)
