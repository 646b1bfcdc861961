"""The fit: start from the steady state and from several guesses, then dynamic least squares on all training runs at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import ModelFit
from rfea_vision.artefacts.measurement import Actuator, Recording
from rfea_vision.artefacts.rows import StartRow, SteadyState
from rfea_vision.dynamics.simulation import Model
from rfea_vision.effects.base import Effect
from rfea_vision.effects.catalogue import parameters_of
from rfea_vision.errors import DataError, InputError
from rfea_vision.fitting.coordinates import Coordinates, base_reference, build
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.problem import Problem, make_model, make_problem, start_vector
from rfea_vision.fitting.profile import profile
from rfea_vision.fitting.ratio import lever_free, with_lever_held
from rfea_vision.fitting.refit import Fitted, coordinates_for, in_long_steps, refit, refit_from
from rfea_vision.fitting.residual_tests import count_jumps
from rfea_vision.fitting.rules import under_rules
from rfea_vision.fitting.scoring import as_artefact
from rfea_vision.fitting.solver import ROUGH_FRAMES, Solution, farthest, solve
from rfea_vision.fitting.starts import from_the_release, observed_scale, without_vanishing_ends
from rfea_vision.fitting.steady_fit import STEADY_SIGMA_M, Plateau, find_plateaus, fit_steady
from rfea_vision.fitting.studies import leave_one_out, with_study
from rfea_vision.options import FitOptions
from rfea_vision.options.given import refuse_impossible_lever
from rfea_vision.progress import Progress

#: Ends whose costs differ by less than this share are one; so many starts that end there leave no doubt, two could by chance.
AGREEING, AGREEING_STARTS = 1e-3, 3
STIFFER_STARTS = (1.5, 3.0, 6.0)  # factors on the stiffness, tried in turn until the tube has a steady state
#: A steady-state fit that misses by more than this (1 mm, or 0.6 deg) may have missed the minimum, as from a slope that is too steep.
GOOD_STEADY = 10.0
#: A start whose tip is off by this share of the length, or this many rad, at some moment is not the only one to try; at half of
#: it a base is bent too much out of shape to be the only place where an effect begins.
FAR_OFF, BENT = 0.1, 0.05
#: A coarse solution whose mean square grows by more than this on the full chain has not been carried over.
CARRIED_WORSE = 1.5


def _stiffer(par: FloatArray) -> Iterator[FloatArray]:
    """A start, and stiffer ones without slope: a tube that is too soft has no steady state under pressure."""
    yield par
    for factor in STIFFER_STARTS:
        trial = par.copy()
        trial[0], trial[1] = par[0] * factor, 0.0
        yield trial


def _steady_start(
    model: Model, problem: Problem, options: FitOptions, par: FloatArray, plateaus: Sequence[Plateau]
) -> tuple[FloatArray, SteadyState]:
    """Stiffness from the plateaus, at the present r_hyd; a sentence where they do not allow it."""
    highest = max(float(np.max(np.abs(item.excitation.pressure))) for item in problem.train)
    loaded = [p for p in plateaus if abs(p.pressure) > 0.15 * highest]
    if all(name in options.fixed for name in ("k_ref", "k_slope")):
        return par, {"note": "the stiffness is given: nothing to fit at rest"}
    if len(loaded) < 2:
        return par, {
            "note": f"{len(loaded)} plateau(s) under pressure: too few for a steady-state fit; dynamic fit from the paper's table"
        }
    wanted = tuple(name for name in ("k_ref", "k_slope") if name not in options.fixed)
    coordinates = build(
        model, problem.actuator, options.segments, problem.bend, only=wanted, held=par, bounds=options.bounds
    )
    fractions = problem.train[0].fractions
    found = []
    for guess in _stiffer(par):
        out = fit_steady(model, plateaus, coordinates, guess, fractions)
        if out is not None:
            found.append(out)
            if np.sqrt(np.mean(out[1] ** 2)) < GOOD_STEADY:
                break
    if not found:
        return par, {"note": "the start has no steady state at the plateaus; dynamic fit from the paper's table"}
    fitted, residual = min(found, key=lambda pair: float(pair[1] @ pair[1]))
    angles = [model.rigged(p.gravity, p.mounting).steady(fitted, p.pressure) for p in plateaus]
    record: SteadyState = {
        "pressure_kPa": [p.pressure / 1e3 for p in plateaus],
        "experiment": [p.experiment for p in plateaus],
        "angle_deg": [float(np.rad2deg(p.angle)) for p in plateaus],
        "fitted_angle_deg": [float(np.rad2deg(s.phi[-1])) if s.found else None for s in angles],
        "rms_mm": float(np.sqrt(np.mean(residual**2)) * STEADY_SIGMA_M / MM) if fractions.size else None,
        "k_ref": float(fitted[0]),
        "k_slope": float(fitted[1]),
    }
    return fitted, record


def fit_base(problem: Problem, options: FitOptions, progress: Progress | None = None) -> Fitted:
    """Fit without a predecessor: steady state, several starts on a coarse chain, then the full one.

    The starts differ in r_hyd (which sets the ringing frequency once the statics are matched) and in damping, so that a
    minimum with the ringing out of phase is found out.

    Raises
    ------
    DataError
        No start leads to a model that can be simulated on the runs.
    """
    coarse = options.with_segments(min(options.segments, 6 if options.joints == "middle" else options.segments))
    model = make_model(problem.actuator, coarse, problem.mirror)
    plateaus = find_plateaus(problem.train)
    reference = start_vector(model, problem.actuator, coarse.segments)
    reference[:6] *= observed_scale(problem.train, problem.actuator)
    thin = [o.rough(ROUGH_FRAMES) for o in in_long_steps(problem, model, reference).train]
    coordinates = coordinates_for(problem, coarse, model)
    reference = from_the_release(model, thin, coordinates, reference)
    rng = np.random.default_rng(options.seed)
    shapes = [(1.0, 1.0), (0.9, 2.0), (1.2, 0.5)]
    shapes += [(float(rng.uniform(0.85, 1.35)), float(np.exp(rng.uniform(-1.2, 1.2)))) for _ in range(options.starts)]
    ends: list[Solution] = []  # of all starts
    solutions: list[Solution] = []  # the best of each shape
    record: SteadyState = {}
    waterfall: list[StartRow] = []
    for index, (arm, damping) in enumerate(shapes):
        guess = reference.copy()
        guess[:2] *= arm
        guess[2:6] *= damping
        guess[6] *= arm
        for name in coarse.fixed.keys() & set(model.names):
            guess[model.names.index(name)] = coarse.fixed[name]
        if not plateaus:  # no steady state tells the stiffness: the start that comes nearest at once is taken
            guess = min(
                _stiffer(guess),
                key=lambda trial: getattr(solve(model, thin, coordinates, trial, most_evaluations=1), "cost", np.inf),
            )
        from_rest, steady = _steady_start(model, problem, coarse, guess, plateaus)
        record = record or steady
        starts = _different(without_vanishing_ends(coordinates, from_rest), from_rest, *_stiffer(guess))
        solution = _best_end(model, thin, coordinates, starts, ends, problem.actuator.length)
        waterfall.append(_attempt(f"r_hyd x {arm:.2f}, damping x {damping:.2f}", solution))
        solutions += [] if solution is None else [solution]
        if progress is not None:
            progress(index + 1, len(shapes) + 2)
        costs = [one.cost for one in solutions]
        if index + 1 >= AGREEING_STARTS and len(costs) == index + 1 and max(costs) < (1 + AGREEING) * min(costs):
            break  # starts this different that end in one place leave no doubt about it
    if not solutions:
        raise DataError(
            "no start could be simulated: at these pressures the model has no steady state with parameters near the paper's; "
            "check the unit of the pressure log and the actuator's dimensions"
        )
    nearest = min(solutions, key=lambda one: one.cost)
    quick = in_long_steps(problem, model, nearest.par, nearest.clocks)
    fitted = _refined(quick, options, model, coarse.segments, solutions)
    if progress is not None:
        progress(len(shapes) + 2, len(shapes) + 2)
    return replace(fitted, steady=record, starts=tuple(waterfall))


def _best_end(
    model: Model,
    items: Sequence[Observed],
    coordinates: Coordinates,
    starts: Iterable[FloatArray],
    ends: list[Solution],
    length_m: float,
) -> Solution | None:
    """The best end of starts (parameters,) that are tried in turn until one ends where another had, or near to what was measured.

    Every end is added to `ends`, those of other starts.
    """
    begun = len(ends)
    for start in starts:
        found = solve(model, items, coordinates, start, most_evaluations=40, tolerance=1e-5)
        if found is None:
            continue
        lowest = min((one.cost for one in ends), default=np.inf)
        ends.append(found)
        again = abs(found.cost - lowest) < AGREEING * lowest
        if again or farthest(items, found, length_m) < FAR_OFF:
            break
    return min(ends[begun:], key=lambda one: one.cost, default=None)


def _different(*starts: FloatArray) -> Iterator[FloatArray]:
    """The starts (parameters,) in turn, without those that stand before."""
    for k, start in enumerate(starts):
        if not any(np.allclose(start, other, rtol=AGREEING, atol=0.0) for other in starts[:k]):
            yield start


def _attempt(label: str, solution: Solution | None) -> StartRow:
    """What `model.json` says of one start."""
    if solution is None:
        return {"start": label, "cost": None, "status": "could not be simulated"}
    return {"start": label, "cost": solution.cost, "status": "converged" if solution.converged else "stopped early"}


def stiff_start(problem: Problem, fitted: Fitted) -> dict[str, float]:
    """Base parameters to begin at where those of a fit are bent out of shape: of the paper's table at this size, stiffer, no slopes."""
    reference = base_reference(problem.actuator, fitted.options.segments)
    reference[:6] *= observed_scale(problem.train, problem.actuator)
    reference[0] *= STIFFER_STARTS[0]
    reference[[1, 3, 5]] = 0.0
    start = dict(zip(fitted.model.names[:7], reference.tolist(), strict=True))
    return {name: value for name, value in start.items() if name not in fitted.options.fixed}


def _refined(
    problem: Problem, options: FitOptions, model: Model, segments: int, solutions: Sequence[Solution]
) -> Fitted:
    """Carry the coarse solutions over to the full chain, best first, until one of them ends about as well there.

    A chain on the edge of buckling with few segments may be beyond it with more.
    """
    failure = DataError(f"model {options.name}: no solution")
    best: Fitted | None = None
    for solution in sorted(solutions, key=lambda s: s.cost):
        known = dict(zip(model.names, solution.par, strict=True))
        try:
            fitted = refit(problem, options, known, segments, clocks=solution.clocks)
        except DataError as error:
            failure = error
            continue
        if best is None or fitted.solution.cost < best.solution.cost:
            best = fitted
        if best.solution.mean_square < CARRIED_WORSE * solution.mean_square:
            break
    if best is None:
        raise failure
    return best


def _starts_of(effects: Iterable[Effect]) -> list[dict[str, float]]:
    """Starts for the parameters of effects just added: each grid value of what vanishes with the amplitude."""
    starts: list[dict[str, float]] = [{}]
    for name, spec in parameters_of(effects).items():
        values = spec.grid if spec.absent is None else (spec.start,)
        starts = [{**start, name: value} for start in starts for value in values] if values else starts
    return starts


def fit_added(problem: Problem, options: FitOptions, previous: Fitted, progress: Progress | None = None) -> Fitted:
    """Fit a model that has more effects than `previous`, from several starts for the new parameters, compared on thinned runs.

    Raises
    ------
    DataError
        None of the starts can be simulated.
    """
    model = make_model(problem.actuator, options, problem.mirror)
    had = {effect.id for effect in previous.model.effects}
    starts = _starts_of(effect for effect in model.effects if effect.id not in had)
    # The base may have absorbed what an effect does, as its damping a lag, or be bent out of shape: a second base has done neither.
    starts += [{**stiff_start(problem, previous), **start} for start in starts]
    best: Fitted | None = None
    waterfall = []
    for index, start in enumerate(starts):
        label = ", ".join(f"{k} = {v:g}" for k, v in start.items()) or "previous model"
        try:
            trial = _tried(problem, options, {**previous.values, **start}, previous, 15 if len(starts) > 2 else 30)
        except DataError:
            waterfall.append(_attempt(label, None))
            continue
        waterfall.append(_attempt(label, trial.solution))
        if best is None or trial.solution.cost < best.solution.cost:
            best = trial
        if progress is not None:
            progress(index + 1, len(starts) + 1)
    if best is None:
        raise DataError(f"model {options.name}: none of its starts could be simulated")
    return replace(
        with_lever_held(problem, refit_from(problem, options, best)),
        steady=previous.steady,
        starts=tuple(waterfall),
        jumps=previous.jumps,
    )


def _tried(
    problem: Problem, options: FitOptions, values: Mapping[str, float], previous: Fitted, most_evaluations: int
) -> Fitted:
    """Fit to thinned runs from `values`, in long steps; in those of the log where the start survives no longer ones."""
    segments, clocks = previous.options.segments, previous.solution.clocks
    rough = [o.rough(ROUGH_FRAMES) for o in problem.train]
    thin = [o.thinned(max(1, o.time.size // ROUGH_FRAMES)) for o in problem.train]
    limits: dict[str, Any] = {"most_evaluations": most_evaluations, "tolerance": 1e-4}
    try:
        return refit(problem, options, values, segments, clocks, items=rough, **limits)
    except DataError:
        return refit(problem, options, values, segments, clocks, items=thin, **limits)


def fit(problem: Problem, options: FitOptions, progress: Progress | None = None) -> Fitted:
    """Base model first, then the effects asked for, all together; then other numbers of segments where they are asked for.

    Where the options say at which values to begin, the whole model is fitted from there, and from nowhere else.
    """
    options = under_rules(options, problem.train, problem.actuator)
    if options.start:
        fitted = _without_jumps(problem, refit(problem, options, options.start, options.segments))
    else:
        fitted = fit_base(problem, replace(options, effects=()), progress)
        problem = in_long_steps(problem, fitted.model, fitted.par, fitted.solution.clocks)
        fitted = _without_jumps(problem, with_lever_held(problem, fitted))
        if options.effects:
            found = lever_free(fitted)
            fitted = fit_added(problem, replace(options, loss=found.loss, fixed=found.fixed), fitted, progress=progress)
        else:
            options = replace(options, loss=fitted.options.loss, fixed=fitted.options.fixed)
            fitted = replace(fitted, options=options)
    if options.study_segments or options.auto_segments:
        fitted = with_study(problem, fitted)
    return fitted


def _without_jumps(problem: Problem, fitted: Fitted) -> Fitted:
    """Take the robust loss where the track of a run leaves the model in jumps, unless a loss was chosen."""
    if fitted.options.loss != "auto":
        return fitted
    seen = fitted.solution.evaluation.predicted
    jumps = {item.name: count_jumps(item, one) for item, one in zip(problem.train, seen, strict=True)}
    if not any(jumps.values()):
        return fitted
    options = replace(fitted.options, loss="huber")
    robust = refit_from(problem, options, fitted)
    return replace(fitted, options=options, solution=robust.solution, jumps=jumps)


def _refuse_unknown_names(model: Model, options: FitOptions) -> None:
    """Refuse what is given of parameters that the model does not have."""
    given = {*options.fixed, *options.start, *options.bounds, *options.priors, *options.profile} - {"modulus"}
    unknown = sorted(given - set(model.names))
    if unknown:
        raise InputError(f"{unknown[0]}: is no parameter of model {options.name}; it has {', '.join(model.names)}")


def fit_model(
    recordings: Mapping[str, Recording],
    actuator: Actuator,
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> ModelFit:
    """Fit the RSDA model to the training recordings and score it on the others (test runs are left alone).

    With the profiles, and the fits without one of the runs, that the options ask for.

    Parameters
    ----------
    recordings : by the name of the experiment; those with the role `ignore` are passed over
    actuator : the tube at rest, SI
    options : what to fit and how; the model without effects where they are left out
    progress : called with (done, total) starts

    Raises
    ------
    DataError
        No training recording, or no start that can be simulated.
    InputError
        An unknown effect, a profile of a parameter that the model does not have, or a lever that is held beyond the tube.
    """
    chosen = options or FitOptions()
    refuse_impossible_lever(chosen.fixed, actuator)
    problem = make_problem(recordings, actuator, chosen)
    _refuse_unknown_names(make_model(actuator, chosen, problem.mirror), chosen)
    fitted = fit(problem, chosen, progress)
    model = as_artefact(problem, fitted)
    if not (chosen.profile or chosen.leave_one_out):
        return model
    more: dict[str, Any] = {
        "profiles": {name: profile(problem, fitted, name, model.parameters) for name in chosen.profile}
    }
    if chosen.leave_one_out:
        more["leave_one_out"] = leave_one_out(problem, fitted)
    return model.model_copy(update=more)
