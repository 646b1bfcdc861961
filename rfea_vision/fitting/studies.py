"""Studies beside a fit: errors over the number of segments, and fits without each of the runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from rfea_vision.artefacts.rows import LeaveOneOut, LeftOutRun, StudyRow, TipPath
from rfea_vision.errors import DataError, InputError
from rfea_vision.fitting.noise import noise_floor_mm
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted, refit, refit_from, with_solution
from rfea_vision.fitting.residuals import predict_observed
from rfea_vision.fitting.scoring import metrics_by_role, score
from rfea_vision.fitting.solver import fit_clocks
from rfea_vision.units import rounded

SEGMENTS = (2, 4, 8, 16, 32)  # doubled each time: the error of a chain falls with the square of their number
#: A chain is fine enough when a finer one would lower the error by less than this share of the noise floor.
CONVERGED = 0.1
PATH_POINTS = 100
FRAMES_PER_RUN = 500


def segments_study(
    problem: Problem, fitted: Fitted, segments: Sequence[int] = SEGMENTS
) -> tuple[list[StudyRow], dict[str, float]]:
    """Errors over the number of segments, each chain fitted from this fit; and apart from them the seconds each took.

    Numbers whose chain cannot be simulated at these pressures are left out. The path of the tip is that of the first
    validation run (else training run), mm in the rig frame.
    """
    _refuse_places(fitted)
    thin = [o.thinned(max(1, o.time.size // FRAMES_PER_RUN)) for o in problem.train]
    rows: list[StudyRow] = []
    seconds = {}
    for count in segments:
        begun = time.perf_counter()
        one = _refitted(problem, fitted, count, thin)
        if one is None:
            continue
        seconds[str(count)] = round(time.perf_counter() - begun, 3)
        clocks = np.concatenate([one.solution.clocks, fit_clocks(one.model, problem.validate, one.par)])
        scores, parts = score(problem, one.model, one.par, problem.scored, clocks)
        row: dict[str, Any] = {"segments": count}
        for role, metrics in metrics_by_role(problem, scores, parts).items():
            for key in ("tip", "tip_x", "tip_y", "midline"):
                row[f"{role}_{key}_rmse_mm"] = getattr(metrics, f"{key}_rmse_mm")
            row[f"{role}_angle_rmse_deg"] = metrics.angle_rmse_deg
        rows.append(cast(StudyRow, {**row, "tip_path_mm": _tip_path(problem, one)}))
    return rows, seconds


def _refuse_places(fitted: Fitted) -> None:
    placed = [effect for effect in fitted.options.effects if "@" in effect]
    if placed:
        raise InputError(
            f"--study-segments: {placed[0]} names a joint of this chain; leave the place out, or the study"
        )


def _refitted(problem: Problem, fitted: Fitted, count: int, items: Sequence[Observed]) -> Fitted | None:
    if count == fitted.options.segments:
        return fitted
    options, clocks = fitted.options.with_segments(count), fitted.solution.clocks
    start = (problem, options, fitted.values, fitted.options.segments, clocks)
    try:
        return refit(*start, most_evaluations=20, tolerance=1e-5, items=items)
    except DataError:
        return None


def _tip_path(problem: Problem, fitted: Fitted) -> TipPath:
    item = (*problem.validate, *problem.train)[0]
    thin = item.thinned(max(1, item.time.size // PATH_POINTS))
    clock = float(fit_clocks(fitted.model, [item], fitted.par)[0])
    predicted = predict_observed(fitted.model, fitted.par, thin, (), clock, np.array([1.0]))
    if predicted is None:
        return {}
    tip = predicted.points[:, -1] / MM * np.array([item.mirror, 1.0])
    return {"experiment": item.name, "x": tip[:, 0].round(3).tolist(), "y": tip[:, 1].round(3).tolist()}


def enough_segments(rows: Sequence[StudyRow], floor_mm: float | None) -> int:
    """Return the smallest number of segments whose error comes near the best of the study: convergence against the noise floor.

    Raises
    ------
    DataError
        The study is empty.
    """
    if not rows:
        raise DataError("--segments auto: no chain could be simulated at these pressures; give a number")

    def error(row: StudyRow) -> float:
        keys = ("validate_tip_rmse_mm", "train_tip_rmse_mm", "validate_angle_rmse_deg", "train_angle_rmse_deg")
        return next((value for key in keys if (value := row.get(key)) is not None), np.inf)

    best = min(error(row) for row in rows)
    slack = CONVERGED * floor_mm if floor_mm else 0.02 * best
    return min(int(row["segments"]) for row in rows if error(row) <= best + slack)


def with_study(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with its study; with `auto_segments` the fit of the chain that is fine enough."""
    rows, seconds = segments_study(problem, fitted)
    if fitted.options.auto_segments:
        floor, _ = noise_floor_mm(problem.scored, problem.recordings)
        count = enough_segments(rows, floor)
        if count != fitted.options.segments:
            fitted = with_solution(fitted, refit_from(problem, fitted.options.with_segments(count), fitted))
    return replace(fitted, study=tuple(rows), study_seconds=seconds)


def leave_one_out(problem: Problem, fitted: Fitted) -> LeaveOneOut:
    """Fit without each training run in turn, and score that run with the fit that has not seen it.

    Raises
    ------
    DataError
        There is one training run only.
    """
    if len(problem.train) < 2:
        raise DataError("--leave-one-out: there is one training run only; give a second one the role 'train'")
    experiments: dict[str, LeftOutRun] = {}
    errors, values, without = [], [], []
    for index, left in enumerate(problem.train):
        rest = [o for o in problem.train if o is not left]
        clocks = np.delete(fitted.solution.clocks, index)
        try:
            one = refit(problem, fitted.options, fitted.values, fitted.options.segments, clocks, items=rest)
        except DataError as error:
            experiments[left.name] = {"tip_rmse_mm": None, "note": str(error)}
            continue
        scores, parts = score(problem, one.model, one.par, [left])
        errors_of_it = scores[left.name].model_dump(mode="json", exclude={"role", "nuisance"})
        experiments[left.name] = cast(LeftOutRun, {**errors_of_it, "parameters": one.values})
        values.append(one.par)
        without.append(left.name)
        if left.name in parts and parts[left.name].tip is not None:
            errors.append(parts[left.name].tip)
    pooled = float(np.sqrt(np.mean(np.concatenate(errors)))) if errors else None
    free = list(fitted.coordinates.free)
    spread = np.ptp(np.array(values), axis=0) / np.maximum(np.abs(fitted.par), 1e-300) if values else np.zeros(0)
    sentence = "no fit without one of the runs could be simulated"
    if values and free:
        worst = free[int(np.argmax(spread[free]))]
        sentence = f"{fitted.model.names[worst]} moves most when a run is left out: by {rounded(100 * spread[worst], 2)} %"
        if len(values) > 2:  # of two fits neither is the odd one
            found = np.array(values)[:, worst]
            sentence += f", farthest without {without[int(np.argmax(np.abs(found - np.median(found))))]}"
        if pooled is not None:
            sentence += f"; the tip error on runs left out is {rounded(pooled)} mm"
    return {
        "experiments": experiments,
        "tip_rmse_mm": pooled,
        "relative_spread": {fitted.model.names[k]: float(spread[k]) for k in free} if values else {},
        "sentence": f"{sentence}.",
    }
