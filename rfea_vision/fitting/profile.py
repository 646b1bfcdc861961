"""Profile likelihood: how the error grows as one parameter is held off its best value and all others follow.

Where the error is no parabola, or a bound is near, this is the interval to believe (Venzon and Moolgavkar 1988,
doi:10.2307/2347496). The threshold is widened by as much as correlated residuals widen the other intervals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from rfea_vision.artefacts.judgement import Parameter
from rfea_vision.artefacts.rows import Profile
from rfea_vision.errors import DataError, InputError
from rfea_vision.fitting.intervals import limits
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted, refit

STEPS = 8  # points per side at most
THRESHOLD = float(chi2.ppf(0.95, 1))


def profile(problem: Problem, fitted: Fitted, name: str, parameters: Mapping[str, Parameter]) -> Profile:
    """Profile of one parameter about a solved fit.

    Parameters
    ----------
    parameters : as reported, for the unit and the first step

    Returns
    -------
    Profile
        ``value`` and ``delta`` (rise of the misfit, 3.84 at the ends of a 95 % interval), ``interval_95`` with null at a
        side where the misfit does not rise far enough, ``unit`` and a ``sentence``.

    Raises
    ------
    InputError
        The model has no such free parameter.
    """
    if name not in fitted.coordinates.names:
        free = ", ".join(fitted.coordinates.names)
        raise InputError(f"--profile {name}: not a free parameter of this model; it has {free}")
    parameter, best = parameters[name], fitted.values[name]
    scale, step = _scale_and_step(fitted, name, parameter)
    sides = [_side(problem, fitted, name, best, sign * step, scale) for sign in (-1, 1)]
    low, high = (_crossing(best, side) for side in sides)
    points = sorted([*sides[0], (best, 0.0), *sides[1]])
    if low is None or high is None:
        open_side = "below" if low is None else "above"
        open_side = "on either side" if low is None and high is None else open_side
        sentence = f"These data do not bound {name} {open_side}."
    else:
        sentence = f"{name} lies between {low:.6g} and {high:.6g} {parameter.unit} (95 %, profile likelihood)."
    return {
        "unit": parameter.unit,
        "value": [value for value, _ in points],
        "delta": [delta for _, delta in points],
        "interval_95": [low, high],
        "sentence": sentence,
    }


def _scale_and_step(fitted: Fitted, name: str, parameter: Parameter) -> tuple[float, float]:
    """Misfit that counts as one, and the first step of the parameter (a standard error)."""
    solution = fitted.solution
    weight = np.sqrt(solution.row_weight)
    rows = np.concatenate([solution.scaled_jacobian * weight[:, None], solution.prior_jacobian])
    size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    inverse = np.linalg.pinv((rows / size).T @ (rows / size)) / np.outer(size, size)
    ny = len(fitted.coordinates.free)
    direction = fitted.coordinates.matrix[fitted.model.names.index(name)]
    information = float(direction @ inverse[:ny, :ny] @ direction)
    residual = solution.evaluation.residual * weight
    variance = float(residual @ residual) / max(residual.size - rows.shape[1], 1)
    classical = np.sqrt(max(variance * information, 0.0))
    error = parameter.stderr or classical or 0.01 * abs(parameter.value)
    widened = max(1.0, (error / classical) ** 2) if classical > 0 else 1.0
    return variance * widened, error


def _side(
    problem: Problem, fitted: Fitted, name: str, best: float, step: float, scale: float
) -> list[tuple[float, float]]:
    """Points on one side, from the best value outwards, until the misfit has risen by the threshold."""
    known, options, base = fitted.values, fitted.options, _misfit(fitted)
    low, high = limits(fitted, name)
    found: list[tuple[float, float]] = []
    clocks = fitted.solution.clocks
    for k in range(STEPS):
        value = best + step * (1.0, 2.0, 3.0, 5.0, 9.0, 17.0, 33.0, 65.0)[k]
        if not low <= value <= high:
            break
        held = replace(options, fixed={**options.fixed, name: value})
        try:
            one = refit(problem, held, {**known, name: value}, options.segments, clocks, tolerance=1e-8)
        except DataError:
            break
        known, clocks = one.values, one.solution.clocks
        found.append((value, max(0.0, (_misfit(one) - base) / scale)))
        if found[-1][1] > THRESHOLD:
            break
    return found


def _misfit(fitted: Fitted) -> float:
    return fitted.solution.cost + float(fitted.solution.prior_residual @ fitted.solution.prior_residual)


def _crossing(best: float, side: list[tuple[float, float]]) -> float | None:
    """Where the root of the misfit crosses the root of the threshold; None where it does not."""
    values = np.array([best, *(value for value, _ in side)])
    roots = np.sqrt([0.0, *(delta for _, delta in side)])
    wanted = np.sqrt(THRESHOLD)
    if roots[-1] < wanted:
        return None
    return float(np.interp(wanted, np.maximum.accumulate(roots), values))
