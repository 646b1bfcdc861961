"""Fit, diagnose, add one effect, again: rung by rung until nothing more is named."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray as xr

from rfea_vision.artefacts.judgement import Candidate, Comparison, Diagnosis, Ladder, ModelFit, Rung
from rfea_vision.artefacts.measurement import CHOOSING_ROLES, Actuator, Recording
from rfea_vision.artefacts.rows import Refit, TestScore
from rfea_vision.critique.comparison import compare, goes_with
from rfea_vision.critique.diagnosis import held_of, judge, none_to_rest_on, refit_artefact
from rfea_vision.critique.findings import findings_of, finer_of, titles_of
from rfea_vision.critique.measures import errors_of, matters, on_common_runs, share
from rfea_vision.critique.refinement import SEGMENTS, refit_segments
from rfea_vision.critique.screening import sensitivities
from rfea_vision.critique.subsets import Combinations
from rfea_vision.critique.torque import with_residual_torque
from rfea_vision.critique.trials import FULL_EVALUATIONS, FULL_GAIN, Trial, Trials, plain
from rfea_vision.effects.catalogue import find_effects
from rfea_vision.errors import DataError
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.information import delta_bic
from rfea_vision.fitting.odd_pressure import about_odd_pressure
from rfea_vision.fitting.prediction import predict
from rfea_vision.fitting.problem import Problem, make_problem
from rfea_vision.fitting.ratio import lever_free, with_lever_held
from rfea_vision.fitting.refit import Fitted, refit
from rfea_vision.fitting.scoring import as_artefact, in_its_steps, score, worse_than_nothing
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.units import counted

#: Model, its predictions, its comparison, its diagnosis, and the pressure to play next (time in s, kPa) if there is one.
OnRung = Callable[[ModelFit, dict[str, xr.Dataset], Comparison, Diagnosis, xr.Dataset | None], None]
#: No more than so many effects are added: with more, the parameters of an RSDA model outnumber what a bend can tell.
MOST_RUNGS = 8


@dataclass(frozen=True)
class Step:
    """What is added next, why, and how surely; nothing where `why` says so."""

    added: str | None = None
    grade: str | None = None
    probability: float | None = None
    tied: list[str] = field(default_factory=list)
    why: str = ""


def next_step(diagnosis: Diagnosis, dropped: Collection[str], stand_ins: bool, begun: Sequence[str] = ()) -> Step:
    """The first effect that is named; with `stand_ins`, else the next of a set that lowers the held-out error.

    `begun` are the members of such a set that are still to be added, once its first one was.
    """
    rows = {row.effect: row for row in diagnosis.candidates}

    def of(name: str, grade: str) -> Step:
        row = rows.get(name)
        tied = diagnosis.rivals_of(name)
        if row is None:
            return Step(name, grade, tied=tied)
        return Step(f"{name}:{row.form}" if row.form else name, grade, row.probability, tied)

    for name in diagnosis.named:
        if name not in dropped:
            return of(name, "named")
    if diagnosis.named:
        return Step(why="the effect that is named now was dropped before, as the fit did as well without it")
    if stand_ins and not diagnosis.sufficient:
        for name in (*begun, *diagnosis.stand_ins):
            if name not in dropped:
                return of(name, "stand-in")
    return Step(why=f"the verdict is {diagnosis.said}: {diagnosis.sentence}")


def rest_of_set(begun: Sequence[str], diagnosis: Diagnosis, step: Step) -> list[str]:
    """Members of a set of stand-ins that are still to be added after a step, which may have begun the set."""
    whole = begun or (diagnosis.stand_ins if step.grade == "stand-in" else ())
    return [name for name in whole if plain(name) != plain(str(step.added))]


def _with_one_more(
    problem: Problem, below: Fitted, name: str, row: Candidate | None, files: Sequence[Path]
) -> Fitted | None:
    """The model with one effect more, under a law of its own, from where the search has found it best."""
    named = f"{below.options.name}+{plain(name)}"
    if name == SEGMENTS:
        finer = refit_segments(problem, below, named)
        return None if finer is None else with_lever_held(problem, finer)
    values = row.values if row is not None else {}
    if not values:
        trials = Trials(problem, tuple(files))
        trial = _tried_alone(trials, trials.adopt(below), name)
        values = {} if trial is None else trial.fitted.values
    try:
        return _with_effects(problem, below, values, (*below.options.effects, name), named, files) if values else None
    except DataError:
        return None


def _with_effects(
    problem: Problem,
    below: Fitted,
    values: Mapping[str, float],
    effects: Sequence[str],
    name: str,
    files: Sequence[Path] = (),
    **limits: Any,
) -> Fitted:
    """A model of the ladder with these effects, under a law of its own and the options of the model below; `limits` as for `refit`."""
    options = replace(
        lever_free(below), effects=tuple(effects), name=name, effect_files=tuple(files) or below.options.effect_files
    )
    return with_lever_held(problem, refit(problem, options, values, options.segments, below.solution.clocks, **limits))


def _without_needless(problem: Problem, fitted: Fitted, floor: float, keep: str) -> Fitted:
    """The model without an earlier effect whose removal no longer hurts the held-out error."""
    whole = errors_of(problem, fitted)
    for effect in fitted.options.effects:
        needed = any(plain(effect) in other.goes_with for other in fitted.model.effects)
        if effect == keep or needed:
            continue
        rest = [one for one in fitted.options.effects if one != effect]
        first, *added = fitted.options.name.split("+")
        name = "+".join((first, *(one for one in added if one != plain(effect))))
        limits = {"most_evaluations": FULL_EVALUATIONS, "tolerance": FULL_GAIN}  # enough to see whether it is missed
        try:
            without = _with_effects(problem, fitted, fitted.values, rest, name, **limits)
            if not matters(*on_common_runs(errors_of(problem, without), whole), floor):
                return _with_effects(problem, fitted, without.values, rest, name)
        except DataError:
            continue
    return fitted


def _tried_alone(trials: Trials, base: Trial, name: str) -> Trial | None:
    """A refit with one effect more, from its linear step."""
    (effect,) = find_effects([plain(name)], trials.effect_files)
    proposals = Combinations(list(sensitivities(trials.problem, base.fitted, (effect,)))).best(frozenset(), 1, 1)
    return trials.refit(base, (name,), proposals[0][0].start if proposals and proposals[0] else {})


@dataclass
class _Climb:
    """Where a climb stands: on the model of its last rung, as anyone reads it from its file."""

    problem: Problem
    effect_files: tuple[Path, ...]
    model: ModelFit
    fitted: Fitted = field(init=False)
    scored: Problem = field(init=False)  # in the steps in which that model was scored
    rungs: list[Rung] = field(default_factory=list)
    dropped: set[str] = field(default_factory=set)
    known: list[Refit] = field(default_factory=list)  # what was refitted so far, on the chain as it stands
    last: Step = field(default_factory=Step)
    before: Fitted | None = None
    floor: float = 0.0
    doubts: list[str] = field(default_factory=list)
    failed: str = ""

    def __post_init__(self) -> None:
        self._stand_on(self.model)

    def _stand_on(self, model: ModelFit) -> None:
        self.model, self.scored = model, in_its_steps(self.problem, model)
        self.fitted = refit_artefact(model, self.scored)

    def note(self, diagnosis: Diagnosis) -> None:
        """Write a rung down."""
        self.floor = diagnosis.noise_floor_mm or diagnosis.noise_floor_deg or 0.0
        self.doubts = [*about_odd_pressure(self.model.experiments), *worse_than_nothing(self.model.experiments)]
        worst = diagnosis.where[0].sentence if diagnosis.where else ""
        self.failed = self.failed or worst
        if diagnosis.verdict == "unexplained" and self.failed:  # in later models added effects hide a part of it
            self.doubts.insert(0, f"Where it shows: {worst}" if worst else f"Where it showed before anything was added: {self.failed}")
        bic, gone = None, None
        if self.before is not None:
            bic = delta_bic(self.problem, self.before, self.fitted)
            errors = on_common_runs(*(errors_of(self.problem, one) for one in (self.before, self.fitted)))
            gone = share(*errors, self.floor)
        self.known = diagnosis.refits
        self.rungs.append(
            Rung.of(
                self.model,
                added=plain(self.last.added) if self.last.added else None,
                tied=self.last.tied,
                delta_bic=bic,
                verdict=diagnosis.verdict,
                asks_less=diagnosis.asks_less,
                uncertain=diagnosis.uncertain,
                uncertain_because=diagnosis.uncertain_because,
                grade=self.last.grade,  # type: ignore[arg-type]
                probability=self.last.probability,
                share=gone,
            )
        )

    def next_model(self, step: Step, diagnosis: Diagnosis) -> ModelFit | None:
        """The model that a step leads to, less what no longer earns its place; None where it could not be fitted."""
        name = str(step.added)
        row = next((row for row in diagnosis.candidates if row.effect == plain(name)), None)
        found = _with_one_more(self.scored, self.fitted, name, row, self.effect_files)
        if found is None:
            return None
        # a set of stand-ins helps together: what one of them does alone is no reason to drop it
        if step.grade != "stand-in":
            found = _without_needless(self.scored, found, self.floor, name)
        return as_artefact(self.problem, replace(found, steady=self.model.steady_state))

    def take(self, step: Step, model: ModelFit) -> None:
        """Stand on the model that a step has led to."""
        had = {*map(plain, self.fitted.options.effects), plain(str(step.added))}
        self.dropped |= had - {*map(plain, model.effects), SEGMENTS}
        self.before, self.last = self.fitted, step
        self.known = self.known if model.segments == self.model.segments else []
        self._stand_on(model)

    def ladder(self, first: Fitted, stopped: str, over: str) -> Ladder:
        """What came of it; test runs are scored here, once."""
        in_mm = self.problem.train[0].has_tip
        test = _test_score(self.problem, first, self.fitted) if self.problem.test else None
        titles, finer = titles_of(self.fitted, self.rungs), finer_of(first, self.fitted, self.rungs)
        unit = "mm" if in_mm else "deg"
        return Ladder(
            rungs=self.rungs,
            test=test,
            noise_floor_mm=self.floor if in_mm else None,
            noise_floor_deg=None if in_mm else self.floor,
            stopped_because=stopped,
            findings=findings_of(self.rungs, titles, finer, test, self.floor, unit, stopped, [*filter(None, (over,)), *self.doubts]),
        )


def improve(
    recordings: Mapping[str, Recording],
    actuator: Actuator,
    options: FitOptions | None = None,
    critique: CritiqueOptions | None = None,
    *,
    on_rung: OnRung | None = None,
    candidates: Sequence[str] | None = None,
    finished: Sequence[tuple[ModelFit, Diagnosis]] = (),
    progress: Callable[[int, int], None] | None = None,
    say: Callable[[str], None] = lambda sentence: None,
) -> Ladder:
    """Climb from the base model to the model that needs nothing more.

    Choosing uses the training and validation runs only; test runs, where there are any, are scored once at the end.
    `on_rung` receives every rung as soon as it stands. `finished` are the rungs of an earlier climb that was interrupted:
    they are climbed again without being fitted or judged anew. A rung follows from the model and the diagnosis of the one
    below and from nothing else, so that an interrupted climb ends as one that was left alone. With `stand_ins` the climb goes
    on with what lowers the held-out error though it is hardly the cause. Work is counted, not timed; a budget, where one is
    given, ends the climb between two rungs, but not before what was named is added: `say` is told when it is used up.
    """
    started = time.monotonic()
    asked = critique or CritiqueOptions()
    chosen = options or FitOptions()
    chosen = replace(chosen, effect_files=asked.effect_files or chosen.effect_files)
    asked = replace(asked, effect_files=chosen.effect_files)
    problem = make_problem(recordings, actuator, chosen)
    model = finished[0][0] if finished else as_artefact(problem, fit(problem, chosen))
    climb = _Climb(problem, chosen.effect_files, model)
    first = climb.fitted
    stopped = f"{MOST_RUNGS} rungs were climbed"
    begun: list[str] = []
    over = ""
    for index in range(MOST_RUNGS):
        if index < len(finished):
            diagnosis = finished[index][1]
        else:
            diagnosis = _judged(climb, recordings, candidates, asked, on_rung)
        climb.note(diagnosis)
        if progress is not None:
            progress(index + 1, MOST_RUNGS)
        step = next_step(diagnosis, climb.dropped, asked.stand_ins, begun)
        begun = rest_of_set(begun, diagnosis, step)
        late = asked.budget_s is not None and time.monotonic() - started > asked.budget_s
        if step.added is None or (late and step.grade != "named"):
            if step.added is not None:
                over = ""
                stopped = f"the time budget of {asked.budget_s:.0f} s is used up; nothing more is named, and {step.added} is left out"
            stopped = step.why or stopped
            break
        if late and not over:
            used = f"The time budget of {asked.budget_s:.0f} s was used up after {counted(index + 1, 'rung')}"
            say(f"{used}: the climb goes on only for what is named ({step.added}), which no budget leaves out")
            over = f"{used}: what was named was added all the same, and nothing was left out for it."
        if index + 1 == MOST_RUNGS:
            break
        following = finished[index + 1][0] if index + 1 < len(finished) else climb.next_model(step, diagnosis)
        if following is None:
            stopped = f"{step.added} was to be added, but could not be fitted again"
            break
        climb.take(step, following)
    return climb.ladder(first, stopped, over)


def _judged(
    climb: _Climb,
    recordings: Mapping[str, Recording],
    candidates: Sequence[str] | None,
    options: CritiqueOptions,
    on_rung: OnRung | None,
) -> Diagnosis:
    """Compare and diagnose the model as it stands, as the commands do one by one; the rung is handed on as soon as it is known."""
    model = climb.model
    predictions = with_residual_torque(model, recordings, predict(model, _without_test(recordings)))
    comparison = compare(model, recordings, predictions)
    judgement = judge(
        climb.scored,
        climb.fitted,
        options=options,
        candidates=candidates,
        where=comparison.where,
        goes_with=goes_with(comparison),
        scored=held_of(model),
        known=climb.known,
        refused=none_to_rest_on(model),
    )
    if on_rung is not None:
        on_rung(model, predictions, comparison, judgement.diagnosis, judgement.next_pressure)
    return judgement.diagnosis


def _without_test(recordings: Mapping[str, Recording]) -> dict[str, Recording]:
    return {name: r for name, r in recordings.items() if r.role in CHOOSING_ROLES}


def _test_score(problem: Problem, first: Fitted, last: Fitted) -> TestScore:
    """Scores of the first and the last model on runs that nothing chose on."""
    key, part = ("tip_rmse_mm", "tip") if problem.train[0].has_tip else ("angle_rmse_deg", "angle")

    def of(fitted: Fitted) -> tuple[float | None, dict[str, float | None]]:
        scores, parts = score(problem, fitted.model, fitted.par, problem.test)
        squares = [getattr(p, part) for p in parts.values() if getattr(p, part) is not None]
        total = float(np.sqrt(np.nanmean(np.concatenate(squares)))) if squares else None
        return total, {name: getattr(s, key) for name, s in scores.items()}

    before, before_each = of(first)
    after, each = of(last)
    errors = {key: after, "first_model": first.options.name, f"first_model_{key}": before}
    both = {"experiments": each, "first_model_experiments": before_each}
    return cast(TestScore, {"model": last.options.name, **errors, **both})
