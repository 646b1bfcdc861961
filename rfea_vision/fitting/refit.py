"""One solved fit, and how to get from it to the next: from an earlier fit's values, by dynamic least squares on the training runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.artefacts.rows import StartRow, SteadyState, StudyRow
from rfea_vision.dynamics.simulation import Model
from rfea_vision.effects.catalogue import split_joint
from rfea_vision.errors import DataError
from rfea_vision.fitting.coordinates import Coordinates, build
from rfea_vision.fitting.observation import SLOWEST_STEP_S
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem, make_model, start_vector
from rfea_vision.fitting.residuals import evaluate
from rfea_vision.fitting.solver import ROUGH_FRAMES, Solution, solve
from rfea_vision.fitting.starts import without_vanishing_ends
from rfea_vision.options import FitOptions

#: Relative fall of the cost at which the first, rough solution ends: no misfit is followed less closely.
ROUGH_TOLERANCE = 1e-4
#: Steps of thinned runs are doubled so often at most (8 ms of a log of 1 kHz), each time only if that changes what the model leaves
#: by less than this share of it: far less than the refits that follow are to tell apart.
LONGER_STEPS, TOLERATED_SHARE = 2, 0.02
#: All frames: the step is doubled while that moves what is seen by less than this share of its standard error, root mean square: it
#: adds a 2500th to the squared error of noise alone.
NEGLIGIBLE = 0.02
#: Or by less than this share of what the model leaves, if only so few frames change by more: at the start of a run, where a model
#: that is far off rings as no tube does.
NEGLIGIBLE_SHARE, FEW = 0.01, 0.01
#: Bodies of thinned runs at most: twice as many move the paper's tube by 0.03 mm, a step of 2 ms by 0.08.
ROUGH_SEGMENTS = 8
#: Change of an angle (rad) at which a long step is solved: one iteration for nearly all; it moves the tip by a micrometre.
ROUGH_NEWTON = 1e-5


@dataclass(frozen=True)
class Fitted:
    """A solved fit, before it becomes an artefact."""

    model: Model
    options: FitOptions
    coordinates: Coordinates
    solution: Solution
    steady: SteadyState = field(default_factory=SteadyState)
    starts: tuple[StartRow, ...] = ()
    jumps: Mapping[str, int] = field(default_factory=dict)
    ratio_only: bool = False  # whether r_hyd was held because the runs tell its ratio to the stiffness alone
    study: tuple[StudyRow, ...] = ()
    study_seconds: dict[str, float] = field(default_factory=dict)

    @property
    def par(self) -> FloatArray:
        """Parameters (parameters,) in SI, in the order of `model.names`."""
        return self.solution.par

    @property
    def values(self) -> dict[str, float]:
        """Every parameter by its name."""
        return dict(zip(self.model.names, self.par.tolist(), strict=True))


def with_solution(fitted: Fitted, found: Fitted) -> Fitted:
    """The same record with another solved fit in it."""
    return replace(
        fitted, model=found.model, options=found.options, coordinates=found.coordinates, solution=found.solution
    )


def coordinates_for(problem: Problem, options: FitOptions, model: Model) -> Coordinates:
    """Coordinates of the optimiser under these options."""
    return build(
        model,
        problem.actuator,
        options.segments,
        problem.bend,
        options.fixed,
        bounds=options.bounds,
        priors=options.priors,
    )


def carried(
    model: Model, actuator: Actuator, segments: int, previous: Mapping[str, float], previous_segments: int
) -> FloatArray:
    """Start (parameters,) in SI from an earlier fit: its values where it has them, scaled to this number of segments."""
    par = start_vector(model, actuator, segments)
    for k, name in enumerate(model.names):
        if name in previous:
            par[k] = previous[name] * (segments / previous_segments if k < 6 else 1.0)
    return par


def on_few_bodies(options: FitOptions) -> FitOptions:
    """The chain of thinned runs; the same where an effect sits in one joint of it, or where the joints' places go with their number."""
    placed = any(split_joint(one)[1] for one in options.effects)
    few = ROUGH_SEGMENTS if options.joints == "middle" and not placed else options.segments
    return options.with_segments(min(options.segments, few))


def rough_runs(problem: Problem, fitted: Fitted) -> list[Observed]:
    """Training runs thinned, in the longest steps whose error is small beside the residual: the larger that, the longer."""

    def left(items: list[Observed]) -> FloatArray | None:
        found = evaluate(fitted.model, fitted.par, items, (), fitted.solution.clocks)
        return None if found is None else found.residual

    items = [item.rough(ROUGH_FRAMES) for item in problem.train]
    before = left(items)
    if before is None:
        return items
    for _ in range(LONGER_STEPS):
        longer = [item.coarser() for item in items]
        after = left(longer)
        if after is None or np.linalg.norm(after - before) > TOLERATED_SHARE * np.linalg.norm(before):
            break
        items = longer
    return items


def in_long_steps(problem: Problem, model: Model, par: FloatArray, clocks: FloatArray | None = None) -> Problem:
    """The same runs, each in the longest steps whose error is small beside its noise; held-out runs in the shortest of these.

    A log of 1 kHz before a camera of 25 Hz would else cost eight times what the motion asks for.

    Parameters
    ----------
    par, clocks : (parameters,) in SI and (training runs,) in s, by default 0, near to those that are to be found
    """
    offsets = np.zeros((len(problem.train), 1)) if clocks is None else clocks[:, None]
    train = tuple(_in_long_steps(item, model, par, own) for item, own in zip(problem.train, offsets, strict=True))
    longest_s = min(item.excitation.step_s for item in train)
    validate = tuple(item.in_steps_of(longest_s) for item in problem.validate)
    return replace(problem, train=train, validate=validate)


def _in_long_steps(item: Observed, model: Model, par: FloatArray, clock: FloatArray) -> Observed:
    before = evaluate(model, par, [item], (), clock)
    while before is not None and 2 * item.excitation.step_s < SLOWEST_STEP_S * (1 + 1e-9):
        longer = item.coarser()
        after = evaluate(model, par, [longer], (), clock)
        if after is None or not _negligible(after.residual - before.residual, before.residual):
            break
        item = longer
    return item


def _negligible(moved: FloatArray, residual: FloatArray) -> bool:
    """Whether a change (rows,) of a residual (rows,), in standard errors, is small beside noise, or beside what the model leaves."""
    size = np.sort(np.abs(moved))
    most = size[: int((1 - FEW) * size.size)]
    little = np.linalg.norm(size) <= NEGLIGIBLE_SHARE * np.linalg.norm(residual)
    return any(np.linalg.norm(part) <= NEGLIGIBLE * np.sqrt(part.size) for part in ((size, most) if little else (size,)))


def refit(
    problem: Problem,
    options: FitOptions,
    previous: Mapping[str, float],
    previous_segments: int,
    clocks: FloatArray | None = None,
    *,
    most_evaluations: int = 60,
    tolerance: float = 1e-7,
    items: Sequence[Observed] | None = None,
    newton: float = Model.tolerance,
) -> Fitted:
    """Fit from an earlier fit's values.

    Parameters
    ----------
    previous, previous_segments : parameters by name, SI, of a chain of so many segments; what is missing starts as declared
    clocks : (runs,) offsets in s to start from
    most_evaluations, tolerance : where the optimiser stops at the latest, and the relative fall of the cost at which it does
        where noise alone is left
    items : runs to fit to, in place of all training runs
    newton : change of an angle (rad) at which a step of the simulation is solved

    Raises
    ------
    DataError
        The start cannot be simulated.
    """
    model = replace(make_model(problem.actuator, options, problem.mirror), tolerance=newton)
    coordinates = coordinates_for(problem, options, model)
    start = carried(model, problem.actuator, options.segments, previous, previous_segments)
    used = problem.train if items is None else items
    solution = None
    # A misfit may push a damper or a spring to nothing at one end of the reach, where a finer chain cannot be simulated.
    for first in (start, without_vanishing_ends(coordinates, start)):
        solution = _solved(model, used, coordinates, first, clocks, most_evaluations, tolerance, options.loss)
        if solution is not None:
            break
    if solution is None:
        raise DataError(f"model {options.name}: the start could not be simulated; try fewer segments or other effects")
    return Fitted(model, options, coordinates, solution)


def _solved(
    model: Model,
    items: Sequence[Observed],
    coordinates: Coordinates,
    start: FloatArray,
    clocks: FloatArray | None,
    most_evaluations: int,
    tolerance: float,
    loss: Literal["auto", "linear", "huber"],
) -> Solution | None:
    """Solve roughly first, then to a tolerance that follows from the residual.

    A misfit of r standard deviations of the noise widens the intervals of all parameters about r-fold: its last digits are r^2
    times as idle as those of noise.
    """
    first, most = max(tolerance, ROUGH_TOLERANCE), most_evaluations
    solution = solve(model, items, coordinates, start, clocks, most_evaluations=most, tolerance=first, loss=loss)
    if solution is None or (closely := tolerance * max(1.0, solution.mean_square)) >= first:
        return solution
    par, clocks, known = solution.par, solution.clocks, solution.evaluation
    again = solve(
        model, items, coordinates, par, clocks, most_evaluations=most, tolerance=closely, loss=loss, known=known
    )
    return again if again is not None else solution


def refit_from(problem: Problem, options: FitOptions, fitted: Fitted, *, tolerance: float = 1e-7) -> Fitted:
    """Fit with other options from where a fit ended, its clocks too; `tolerance` and errors as of `refit`."""
    clocks = fitted.solution.clocks
    return refit(problem, options, fitted.values, fitted.options.segments, clocks, tolerance=tolerance)
