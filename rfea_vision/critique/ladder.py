"""Fit, diagnose, add one effect, again: rung by rung until a verdict ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from rfea_vision.artefacts.judgement import Comparison, Diagnosis, Ladder, ModelFit, Rung
from rfea_vision.artefacts.measurement import Actuator, Recording
from rfea_vision.critique.comparison import compare
from rfea_vision.critique.diagnosis import Judgement, judge, refit_artefact, refit_named
from rfea_vision.critique.measures import Errors, delta_bic, errors_of, matters
from rfea_vision.critique.refinement import SEGMENTS
from rfea_vision.critique.refinement import TITLE as SEGMENTS_TITLE
from rfea_vision.critique.torque import with_residual_torque
from rfea_vision.critique.trials import Refitted
from rfea_vision.errors import DataError
from rfea_vision.fitting.fit import Fitted, Problem, fit, make_problem, refit
from rfea_vision.fitting.prediction import predict
from rfea_vision.fitting.scoring import as_artefact, score
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.units import rounded

OnRung = Callable[[ModelFit, dict[str, xr.Dataset], Comparison, Diagnosis], None]
MOST_RUNGS = 6


def _look_back(
    problem: Problem, fitted: Fitted, errors: Errors, floor: float, keep: str
) -> tuple[Fitted, Errors, str | None]:
    """Drop an earlier effect whose removal no longer hurts the held-out error."""
    for effect in fitted.options.effects:
        if effect == keep or any(effect in other.goes_with for other in fitted.model.effects):
            continue
        left = tuple(e for e in fitted.options.effects if e != effect)
        options = replace(fitted.options, effects=left, name="+".join(("base", *left)))
        known = dict(zip(fitted.model.names, fitted.par, strict=True))
        try:
            without = refit(problem, options, known, fitted.options.segments, fitted.solution.clocks)
        except DataError:
            continue
        other = errors_of(problem, without)
        if not matters(other, errors, floor):
            return without, other, effect
    return fitted, errors, None


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
) -> Ladder:
    """Climb from the base model to the model that needs nothing more.

    Choosing uses the training and validation runs only; test runs, where there are any, are scored once at the end.
    `on_rung` receives every rung as soon as it stands. `finished` are the rungs of an earlier climb that was interrupted:
    they are climbed again without being fitted or judged anew.
    """
    started = time.monotonic()
    judged = critique or CritiqueOptions()
    chosen = options or FitOptions()
    chosen = replace(chosen, effect_files=judged.effect_files or chosen.effect_files)
    judged = replace(judged, effect_files=chosen.effect_files)
    problem = make_problem(recordings, actuator, chosen.observe, pressure_zero_sd=chosen.pressure_zero_sd)
    in_mm = problem.train[0].has_tip
    fitted = refit_artefact(finished[0][0], problem) if finished else fit(problem, chosen)
    first = fitted
    added: str | None = None
    tied: list[str] = []
    before: Fitted | None = None
    rungs: list[Rung] = []
    floor: float | None = None
    dropped: set[str] = set()
    expected: list[str] = []
    stopped = f"{MOST_RUNGS} rungs were climbed"
    for index in range(MOST_RUNGS):
        refitted: Mapping[str, Refitted] = {}
        if index < len(finished):
            artefact, diagnosis = finished[index]
        else:
            artefact = as_artefact(problem, fitted)
            predictions = with_residual_torque(artefact, recordings, predict(artefact, _without_test(recordings)))
            comparison = compare(artefact, recordings, predictions)
            judgement = judge(
                problem,
                fitted,
                options=judged,
                candidates=candidates,
                where=comparison.where,
                expected=expected,
            )
            diagnosis, refitted = judgement.diagnosis, judgement.refitted
            if on_rung is not None:
                told = diagnosis.model_copy(update={"next_pressure": _as_lists(judgement)})
                on_rung(artefact, predictions, comparison, told)
        floor = diagnosis.noise_floor_mm if in_mm else diagnosis.noise_floor_deg
        rungs.append(_rung(problem, artefact, added, tied, before, fitted, diagnosis))
        if progress is not None:
            progress(index + 1, MOST_RUNGS)
        if diagnosis.verdict != "missing":
            stopped = f"the verdict is {diagnosis.verdict}: {diagnosis.sentence}"
            break
        name = next((n for n in diagnosis.named if n not in dropped), None)
        if name is None:
            stopped = "the only effect named had been dropped before: it does not earn its place"
            break
        if judged.budget_s is not None and time.monotonic() - started > judged.budget_s:
            stopped = f"the time budget of {judged.budget_s:.0f} s is used up; the last diagnosis still names {name}"
            break
        before, added, tied = fitted, name, diagnosis.rivals_of(name)
        expected = [other for other in diagnosis.named if other != name]
        if index + 1 < len(finished):
            following = finished[index + 1][0]
            fitted = refit_artefact(following, problem)
            dropped |= {*before.options.effects, name} - {*following.effects, SEGMENTS}
            continue
        trial = refitted.get(name) or refit_named(problem, fitted, name, judged.effect_files)
        if trial is None:
            stopped = f"{name} is named, but could not be fitted again"
            break
        fitted, _, gone = _look_back(problem, trial.fitted, trial.errors, floor or 0.0, name)
        if gone is not None:
            dropped.add(gone)
    test = _test_score(problem, first, fitted) if problem.test else None
    return Ladder(
        rungs=rungs,
        test=test,
        noise_floor_mm=floor if in_mm else None,
        noise_floor_deg=None if in_mm else floor,
        stopped_because=stopped,
        findings=_findings(rungs, _titles(fitted, rungs), test, floor, "mm" if in_mm else "deg", stopped),
    )


def _as_lists(judgement: Judgement) -> dict[str, Any] | None:
    pressure = judgement.next_pressure
    if pressure is None:
        return None
    return {
        "time_s": pressure["log_time"].values.tolist(),
        "pressure_kPa": pressure["pressure"].values.round(4).tolist(),
    }


def _without_test(recordings: Mapping[str, Recording]) -> dict[str, Recording]:
    return {name: r for name, r in recordings.items() if r.role in ("train", "validate")}


def _rung(
    problem: Problem,
    artefact: ModelFit,
    added: str | None,
    tied: list[str],
    before: Fitted | None,
    fitted: Fitted,
    diagnosis: Diagnosis,
) -> Rung:
    bic = delta_bic(problem, before, fitted) if before is not None else None
    train, validate = artefact.metrics.get("train"), artefact.metrics.get("validate")
    return Rung(
        model=artefact.name,
        added=added,
        tied=tied,
        train_tip_rmse_mm=train.tip_rmse_mm if train else None,
        validate_tip_rmse_mm=validate.tip_rmse_mm if validate else None,
        train_angle_rmse_deg=train.angle_rmse_deg if train else None,
        validate_angle_rmse_deg=validate.angle_rmse_deg if validate else None,
        delta_bic=bic,
        verdict=diagnosis.verdict,
    )


def _test_score(problem: Problem, first: Fitted, last: Fitted) -> dict[str, Any]:
    """Scores of the first and the last model on runs that nothing chose on."""
    key, part = ("tip_rmse_mm", "tip") if problem.train[0].has_tip else ("angle_rmse_deg", "angle")

    def of(fitted: Fitted) -> tuple[float | None, dict[str, float | None]]:
        scores, parts, _ = score(problem, fitted.model, fitted.par, problem.test)
        squares = [getattr(p, part) for p in parts.values() if getattr(p, part) is not None]
        total = float(np.sqrt(np.nanmean(np.concatenate(squares)))) if squares else None
        return total, {name: getattr(s, key) for name, s in scores.items()}

    before, _ = of(first)
    after, each = of(last)
    return {
        "model": last.options.name,
        key: after,
        "first_model": first.options.name,
        f"first_model_{key}": before,
        "experiments": each,
    }


def _titles(last: Fitted, rungs: Sequence[Rung]) -> list[str]:
    """What was added, in words, with the id by which it is asked for and what it cannot be told from."""
    known = {effect.id: effect.title for effect in last.model.effects} | {SEGMENTS: SEGMENTS_TITLE}
    titles = []
    for rung in rungs:
        if rung.added is None:
            continue
        title = f"{known[rung.added]} ({rung.added})" if rung.added in known else rung.added
        title += f", which these data cannot tell from {' or '.join(rung.tied)}" if rung.tied else ""
        titles.append(title)
    return titles


def _findings(
    rungs: Sequence[Rung],
    titles: Sequence[str],
    test: dict[str, Any] | None,
    floor: float | None,
    unit: str,
    stopped: str,
) -> list[str]:
    out = []
    what = "tip error" if unit == "mm" else "error of the bend angle"
    key = "tip_rmse_mm" if unit == "mm" else "angle_rmse_deg"
    if titles and rungs[-1].verdict == "complete":
        out.append(f"Missing from the paper's model, and added in this order: {'; '.join(titles)}.")
    elif titles:
        out.append(f"Added so far, and not yet enough: {'; '.join(titles)}.")
    first, last = (getattr(rung, f"validate_{key}") for rung in (rungs[0], rungs[-1]))
    if titles and first and last:
        fall = f"fell from {rounded(first)} to {rounded(last)} {unit} ({first / last:.1f} times)"
        out.append(f"The {what} on validation runs {fall}.")
    if titles and test and test[key] and test[f"first_model_{key}"]:
        fall = f"fell from {rounded(test[f'first_model_{key}'])} to {rounded(test[key])} {unit}"
        out.append(f"On test runs, on which nothing was chosen, it {fall}.")
    if floor:
        out.append(f"The noise floor is {rounded(floor)} {unit}.")
    out.append(f"Stopped because {stopped}")
    return out
