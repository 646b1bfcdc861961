"""Bounded least squares on exact Jacobians; a failed simulation costs a step, not the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.simulation import Model
from rfea_vision.fitting.coordinates import Coordinates
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.residuals import Evaluation, Predicted, by_clock, evaluate, rows
from rfea_vision.scatter import NORMAL

#: Directions whose singular value is below this share of the largest: the data tell next to nothing of them.
WEAKEST = 1e-4
CLOCK_SCALE_S = 0.005  # a clock in units of order one for the optimiser; no result depends on it
#: A clock is moved by at most so many of its standard errors, and never further than runs are ever late.
LARGEST_CLOCK_SIGMAS, LARGEST_CLOCK_S = 4.0, 2.0
#: A clock is moved by so much at once at most: an eighth of the period of fast ringing (4 Hz), beyond which slopes mislead.
CLOCK_STEP_S = 0.03
#: Robust standard deviations beyond which the Huber loss is linear.
HUBER = 5.0
#: Frames of a run that are enough to come near.
ROUGH_FRAMES = 500


@dataclass(frozen=True)
class Solution:
    """Where the optimiser ended: full parameter vector, clocks per experiment, cost (by its loss) and the evaluation there.

    `scaled_jacobian` is with respect to [coordinates, free clocks] in the optimiser's units; `prior_jacobian` and
    `prior_residual` are the rows of what was known beforehand, of the clocks too; `row_weight` is what the robust loss
    leaves of each row (1 with the linear loss).
    """

    par: FloatArray
    y: FloatArray
    clocks: FloatArray
    cost: float
    converged: bool
    evaluation: Evaluation
    scaled_jacobian: FloatArray
    clock_index: tuple[int, ...]
    clock_limits: FloatArray  # s, how far each of those may be moved
    evaluations: int
    prior_jacobian: FloatArray
    prior_residual: FloatArray
    row_weight: FloatArray

    @property
    def mean_square(self) -> float:
        """Cost per row."""
        return self.cost / max(self.evaluation.residual.size, 1)

    @property
    def x(self) -> FloatArray:
        """What the optimiser turned, (unknowns,): coordinates, then the free clocks in units of `CLOCK_SCALE_S`."""
        return np.concatenate([self.y, self.clocks[list(self.clock_index)] / CLOCK_SCALE_S])

    @property
    def clocks_inside(self) -> NDArray[np.bool_]:
        """Which of the free clocks (clocks,) are off their bounds, and so may move either way."""
        return np.abs(self.clocks[list(self.clock_index)]) < (1 - 1e-3) * self.clock_limits


@dataclass(frozen=True)
class _Point:
    """One evaluation as the optimiser sees it: few rows with the same cost, gradient and normal matrix, then those of priors."""

    residual: FloatArray
    jacobian: FloatArray
    evaluation: Evaluation


@dataclass
class _Target:
    """Residual and Jacobian over x = [coordinates, free clocks]; remembers the last point, as both are asked for in turn.

    With `condensed`, the rows of the data are replaced by the triangle of their QR decomposition, which has as many rows as
    there are unknowns: enough for a linear loss.
    """

    model: Model
    items: Sequence[Observed]
    coordinates: Coordinates
    clocks: FloatArray
    clock_index: tuple[int, ...]
    condensed: bool
    count: int = 0
    last: tuple[bytes, _Point | None] | None = None

    def unpack(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        ny = len(self.coordinates.free)
        values = self.clocks.copy()
        values[list(self.clock_index)] = x[ny:] * CLOCK_SCALE_S
        return self.coordinates.parameters(x[:ny]), values

    def priors(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows of what is known beforehand: of the parameters, and of each clock as well as it was found."""
        ny, nc = len(self.coordinates.free), len(self.clock_index)
        known = self.coordinates.prior_targets.size
        scale = np.array([CLOCK_SCALE_S / self.items[i].clock_sigma for i in self.clock_index])
        rows = np.zeros((known + nc, ny + nc))
        if known:
            rows[:known, :ny] = self.coordinates.prior_rows
        rows[known + np.arange(nc), ny + np.arange(nc)] = scale
        return rows @ x - np.concatenate([self.coordinates.prior_targets, np.zeros(nc)]), rows

    def at(self, x: FloatArray) -> _Point | None:
        key = x.tobytes()
        if self.last is None or self.last[0] != key:
            self.count += 1
            par, values = self.unpack(x)
            near = None if self.last is None or self.last[1] is None else self.last[1].evaluation
            result = evaluate(self.model, par, self.items, self.coordinates.free, values, near)
            self.last = (key, None if result is None else self._point(x, result))
        return self.last[1]

    def remember(self, x: FloatArray, evaluation: Evaluation) -> None:
        """Take what was evaluated at `x` before as known."""
        self.last = (x.tobytes(), self._point(x, evaluation))

    def _point(self, x: FloatArray, result: Evaluation) -> _Point:
        ny = len(self.coordinates.free)
        jacobian, rest = result.jacobian, result.residual
        if len(self.clock_index) < len(self.items):
            jacobian = jacobian[:, [*range(ny), *(ny + i for i in self.clock_index)]]
        if self.condensed:
            triangle: FloatArray = np.asarray(np.linalg.qr(np.column_stack([jacobian, rest]), mode="r"))
            jacobian, rest = triangle[:, :-1], triangle[:, -1]
        residual, rows = self.priors(x)
        jacobian = np.concatenate([self._scaled(jacobian), rows])
        return _Point(np.concatenate([rest, residual]), jacobian, result)

    def _scaled(self, jacobian: FloatArray) -> FloatArray:
        """From columns [free parameters, free clocks] in SI to those of x."""
        ny = len(self.coordinates.free)
        sub = self.coordinates.matrix[list(self.coordinates.free)]
        return np.concatenate([jacobian[:, :ny] @ sub, jacobian[:, ny:] * CLOCK_SCALE_S], axis=1)

    def solution(self, x: FloatArray, point: _Point, converged: bool, softness: float) -> Solution:
        par, values = self.unpack(x)
        evaluation, ny = point.evaluation, len(self.coordinates.free)
        residual, rows = self.priors(x)
        picked = evaluation.jacobian[:, [*range(ny), *(ny + i for i in self.clock_index)]]
        return Solution(
            par=par,
            y=x[:ny],
            clocks=values,
            cost=_cost(evaluation.residual, softness),
            converged=converged,
            evaluation=evaluation,
            scaled_jacobian=self._scaled(picked),
            clock_index=self.clock_index,
            clock_limits=np.array([_largest_clock(self.items[i]) for i in self.clock_index]),
            evaluations=self.count,
            prior_jacobian=rows,
            prior_residual=residual,
            row_weight=np.minimum(1.0, softness / np.maximum(np.abs(evaluation.residual), 1e-300)),
        )


def solve(
    model: Model,
    items: Sequence[Observed],
    coordinates: Coordinates,
    start: FloatArray,
    clocks: FloatArray | None = None,
    *,
    most_evaluations: int = 60,
    tolerance: float = 1e-7,
    loss: Literal["auto", "linear", "huber"] = "linear",
    known: Evaluation | None = None,
) -> Solution | None:
    """Minimise from `start` (full parameter vector, SI); None where not even the start can be simulated.

    clocks : (experiments,) offset of each clock in s at the start, 0 by default
    known : the evaluation at the start, where it has been made
    most_evaluations, tolerance : of residual and Jacobian; relative change of the sum of squares at which it ends
    Experiments whose clock was found from their motion get it as a nuisance parameter. The robust loss is that of Huber
    (doi:10.1214/aoms/1177703732), linear beyond five robust standard deviations of the residual at the start; ``auto`` is
    for the caller to decide, and linear here.
    """
    clock_index = tuple(i for i, item in enumerate(items) if item.clock_free)
    begin = np.zeros(len(items)) if clocks is None else clocks.copy()
    target = _Target(model, items, coordinates, begin, clock_index, condensed=loss != "huber")
    limits = np.array([_largest_clock(items[i]) for i in clock_index])
    target.clocks[list(clock_index)] = np.clip(target.clocks[list(clock_index)], -limits, limits)
    x0 = np.concatenate([coordinates.coordinates(start), target.clocks[list(clock_index)] / CLOCK_SCALE_S])
    if known is not None:
        target.remember(x0, known)
    first = target.at(x0)
    if first is None:
        return None
    if x0.size == 0:
        return target.solution(x0, first, True, np.inf)
    bad = np.full(first.residual.size, 1e3 * float(np.linalg.norm(first.residual)) + 1e3)

    def fun(x: FloatArray) -> FloatArray:
        point = target.at(x)
        return bad if point is None else point.residual

    def jac(x: FloatArray) -> FloatArray:
        point = target.at(x)
        return np.zeros((bad.size, x.size)) if point is None else point.jacobian

    softness = HUBER * max(1.0, float(np.median(np.abs(first.evaluation.residual))) / NORMAL)
    limit = limits / CLOCK_SCALE_S
    result = least_squares(
        fun,
        x0,
        jac,  # type: ignore[arg-type]
        bounds=(np.concatenate([coordinates.lower, -limit]), np.concatenate([coordinates.upper, limit])),
        method="trf",
        x_scale="jac",
        ftol=tolerance,
        xtol=1e-9,
        gtol=1e-12,
        max_nfev=most_evaluations,
        loss="huber" if loss == "huber" else "linear",
        f_scale=softness,
    )
    point = target.at(result.x)
    if point is None:
        return None
    return target.solution(result.x, point, result.status > 0, softness if loss == "huber" else np.inf)


def with_slopes(model: Model, items: Sequence[Observed], coordinates: Coordinates, solution: Solution) -> Solution:
    """A solution with the slopes of these items where it has those of others; as it was where it cannot be simulated on them."""
    if solution.evaluation.jacobian.shape[1] > len(items):
        return solution
    target = _Target(model, items, coordinates, solution.clocks.copy(), solution.clock_index, condensed=True)
    point = target.at(solution.x)
    return solution if point is None else target.solution(solution.x, point, solution.converged, np.inf)


def farthest(items: Sequence[Observed], solution: Solution, length_m: float) -> float:
    """By how much the modelled tube is somewhere else at the worst moment: of the tip as a share of the length, or rad."""
    gaps = [
        np.linalg.norm(item.points[:, -1] - one.points[:, -1], axis=1) / length_m
        if item.has_tip
        else np.abs(item.angle - one.angle)
        for item, one in zip(items, solution.evaluation.predicted, strict=True)
    ]
    return max(float(np.max(gap)) for gap in gaps)


def _cost(residual: FloatArray, softness: float) -> float:
    """Sum of squares (rows,), of which what is beyond `softness` counts linearly."""
    size = np.abs(residual)
    inner = np.minimum(size, softness)
    return float(np.sum(inner * (2 * size - inner)))


def _largest_clock(item: Observed) -> float:
    return min(LARGEST_CLOCK_SIGMAS * item.clock_sigma, LARGEST_CLOCK_S)


def fit_clocks(model: Model, items: Sequence[Observed], par: FloatArray) -> FloatArray:
    """Clock offset (experiments,) in s for fixed parameters: what a held-out run may adjust, and nothing else."""
    return np.array([_clock(item, by_clock(model, par, item)) if item.clock_free else 0.0 for item in items])


def at_own_clock(model: Model, item: Observed, par: FloatArray) -> Predicted | None:
    """What the camera would have seen of a run at fixed parameters (parameters,) in SI, its clock as `fit_clocks` finds it.

    None if the simulation fails.
    """
    look = by_clock(model, par, item)
    return look(_clock(item, look) if item.clock_free else 0.0)


def _clock(item: Observed, look: Callable[[float], Predicted | None]) -> float:
    limit, clock = _largest_clock(item), 0.0
    for _ in range(6 + int(limit / CLOCK_STEP_S)):
        seen = look(clock)
        if seen is None:
            break
        residual, slope = rows(item, seen)
        j, known = slope[:, 0], item.clock_sigma**-2
        step = -(float(j @ residual) + known * clock) / (float(j @ j) + known)
        if not np.isfinite(step):  # a motion that runs away
            break
        clock = float(np.clip(clock + np.clip(step, -CLOCK_STEP_S, CLOCK_STEP_S), -limit, limit))
        if abs(step) < 1e-6:
            break
    return clock
