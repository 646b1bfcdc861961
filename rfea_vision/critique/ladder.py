"""Fit, diagnose, add one effect, again: rung by rung until a verdict ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from rfea_vision.artefacts.judgement import Comparison, Diagnosis, Ladder, ModelFit, Rung
from rfea_vision.artefacts.measurement import Actuator, Recording
from rfea_vision.critique.comparison import compare
from rfea_vision.critique.diagnosis import Judgement, judge
from rfea_vision.critique.measures import Errors, delta_bic, errors_of, matters
from rfea_vision.critique.torque import with_residual_torque
from rfea_vision.errors import DataError
from rfea_vision.fitting.fit import FitOptions, Fitted, Problem, fit, make_problem, refit
from rfea_vision.fitting.prediction import predict
from rfea_vision.fitting.scoring import as_artefact, score

OnRung = Callable[[ModelFit, dict[str, xr.Dataset], Comparison, Diagnosis], None]
MOST_RUNGS = 6


def _look_back(
    problem: Problem, fitted: Fitted, errors: Errors, floor: float, keep: str
) -> tuple[Fitted, Errors, str | None]:
    """Drop an earlier effect whose removal no longer hurts the held-out error."""
    for effect in fitted.options.effects:
        if effect == keep:
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
    *,
    budget_s: float = 300.0,
    on_rung: OnRung | None = None,
    candidates: Sequence[str] | None = None,
    effect_files: Sequence[Path] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Ladder:
    """Climb from the base model to the model that needs nothing more.

    Choosing uses the training and validation runs only; test runs, where there are any, are scored once at the end.
    `on_rung` receives every rung as soon as it stands.
    """
    started = time.monotonic()
    chosen = options or FitOptions()
    files = tuple(effect_files) or chosen.effect_files
    chosen = replace(chosen, effect_files=files)
    problem = make_problem(recordings, actuator, chosen.observe)
    fitted = fit(problem, chosen)
    first = fitted
    added: str | None = None
    before: Fitted | None = None
    rungs: list[Rung] = []
    floor = None
    dropped: set[str] = set()
    stopped = f"{MOST_RUNGS} rungs were climbed"
    for index in range(MOST_RUNGS):
        artefact = as_artefact(problem, fitted)
        floor = artefact.noise_floor_mm
        predictions = with_residual_torque(artefact, recordings, predict(artefact, _without_test(recordings)))
        comparison = compare(artefact, recordings, predictions)
        judgement = judge(
            problem, fitted, candidates=candidates, effect_files=files, where=comparison.where, seed=chosen.seed
        )
        rungs.append(_rung(problem, artefact, added, before, fitted, judgement))
        if on_rung is not None:
            on_rung(
                artefact,
                predictions,
                comparison,
                judgement.diagnosis.model_copy(update={"next_pressure": _as_lists(judgement)}),
            )
        if progress is not None:
            progress(index + 1, MOST_RUNGS)
        diagnosis = judgement.diagnosis
        if diagnosis.verdict != "missing":
            stopped = f"the verdict is {diagnosis.verdict}: {diagnosis.sentence}"
            break
        name = next((n for n in diagnosis.named if n not in dropped), None)
        if name is None:
            stopped = "the only effect named had been dropped before: it does not earn its place"
            break
        if time.monotonic() - started > budget_s:
            stopped = f"the time budget of {budget_s:.0f} s is used up; the last diagnosis still names {name}"
            break
        before, added = fitted, name
        fitted = judgement.refitted[name].fitted
        errors = judgement.refitted[name].errors
        fitted, errors, gone = _look_back(problem, fitted, errors, judgement.floor, name)
        if gone is not None:
            dropped.add(gone)
    test = _test_score(problem, first, fitted) if problem.test else None
    return Ladder(
        rungs=rungs,
        test=test,
        noise_floor_mm=floor,
        stopped_because=stopped,
        findings=_findings(rungs, test, floor, stopped),
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
    problem: Problem, artefact: ModelFit, added: str | None, before: Fitted | None, fitted: Fitted, judgement: Judgement
) -> Rung:
    bic = delta_bic(problem, before, fitted) if before is not None else None
    train, validate = artefact.metrics.get("train"), artefact.metrics.get("validate")
    return Rung(
        model=artefact.name,
        added=added,
        train_tip_rmse_mm=train.tip_rmse_mm if train else None,
        validate_tip_rmse_mm=validate.tip_rmse_mm if validate else None,
        delta_bic=bic,
        verdict=judgement.diagnosis.verdict,
    )


def _test_score(problem: Problem, first: Fitted, last: Fitted) -> dict[str, Any]:
    """Scores of the first and the last model on runs that nothing chose on."""
    import numpy as np

    def of(fitted: Fitted) -> tuple[float | None, dict[str, float | None]]:
        scores, parts, _ = score(problem, fitted.model, fitted.par, problem.test)
        tips = [p.tip for p in parts.values() if p.tip is not None]
        total = float(np.sqrt(np.mean(np.concatenate(tips)))) if tips else None
        return total, {name: s.tip_rmse_mm for name, s in scores.items()}

    before, _ = of(first)
    after, each = of(last)
    return {
        "model": last.options.name,
        "tip_rmse_mm": after,
        "first_model": first.options.name,
        "first_model_tip_rmse_mm": before,
        "experiments": each,
    }


def _findings(rungs: Sequence[Rung], test: dict[str, Any] | None, floor: float | None, stopped: str) -> list[str]:
    out = []
    added = [r.added for r in rungs if r.added]
    if added:
        out.append(f"Missing from the paper's model, and added in this order: {', '.join(added)}.")
    first, last = rungs[0], rungs[-1]
    if added and first.validate_tip_rmse_mm and last.validate_tip_rmse_mm:
        factor = first.validate_tip_rmse_mm / last.validate_tip_rmse_mm
        out.append(
            f"The tip error on validation runs fell from {first.validate_tip_rmse_mm:.3f} to "
            f"{last.validate_tip_rmse_mm:.3f} mm ({factor:.1f} times)."
        )
    if added and test and test["tip_rmse_mm"] and test["first_model_tip_rmse_mm"]:
        out.append(
            f"On test runs, on which nothing was chosen, it fell "
            f"from {test['first_model_tip_rmse_mm']:.3f} to {test['tip_rmse_mm']:.3f} mm."
        )
    if floor:
        out.append(f"The noise floor is {floor:.3f} mm.")
    out.append(f"Stopped because {stopped}")
    return out
