"""The evidence behind a diagnosis: every candidate as a row, and base parameters that had moved to swallow physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rfea_vision.artefacts.judgement import Candidate, Parameter
from rfea_vision.critique.refinement import SEGMENTS
from rfea_vision.critique.screening import Screened
from rfea_vision.critique.trials import Refitted, Trials
from rfea_vision.fitting.fit import Fitted, Problem
from rfea_vision.fitting.uncertainty import sandwich


def candidate_rows(trials: Trials, screened: Sequence[Screened], refitted: Mapping[str, Refitted]) -> list[Candidate]:
    """Every effect that was screened, those that were refitted first; p values allow for the number of effects tried."""
    errors, problem = trials.errors, trials.problem
    unit = "mm" if trials.in_mm else "deg"
    tests = len({item.effect for item in screened})
    rows, seen = [], set()
    for item in (*screened, *(trial.screened for trial in refitted.values())):  # a fresh look needs no score
        if item.effect in seen:
            continue
        seen.add(item.effect)
        done = refitted.get(item.effect)
        predicted = errors.train * float(np.sqrt(max(1 - item.explained, 0.0)))
        scores = [s.score_p for s in screened if s.effect == item.effect and s.score_p is not None]
        best_p = min(1.0, tests * min(scores)) if scores else None
        title = trials.title(item.effect)
        if done is None:
            shown: dict[str, Any] = {f"predicted_rmse_{unit}": predicted}
            rows.append(Candidate(effect=item.effect, title=title, score_p=best_p, **shown))
            continue
        shown = {f"predicted_rmse_{unit}": predicted, f"train_rmse_{unit}": done.errors.train}
        if problem.validate:
            shown[f"validate_rmse_{unit}"] = done.errors.held
        rows.append(
            Candidate(
                effect=item.effect,
                title=title,
                score_p=best_p,
                **shown,
                share=done.explained,
                delta_bic=done.delta_bic,
                parameters=effect_parameters(problem, done.fitted, item.effect),
                refitted=True,
                matters=done.matters,
                note="" if done.allowed else "ended at a bound: not a value that physics allows",
            )
        )

    def error(row: Candidate) -> float:
        held_out = row.validate_rmse_mm if trials.in_mm else row.validate_rmse_deg
        predicted = row.predicted_rmse_mm if trials.in_mm else row.predicted_rmse_deg
        return held_out if held_out is not None else predicted or 0.0

    return sorted(rows, key=lambda row: (not row.refitted, error(row)))


def effect_parameters(problem: Problem, fitted: Fitted, effect_id: str) -> dict[str, Parameter]:
    """Fitted values of an effect with their intervals; none for what is no effect but a finer chain."""
    if effect_id == SEGMENTS:
        return {}
    solution = fitted.solution
    spread = sandwich(
        list(problem.train), solution.evaluation.residual, solution.scaled_jacobian, solution.evaluation.slices
    )
    ny = len(fitted.coordinates.free)
    covariance = fitted.coordinates.matrix @ spread.covariance[:ny, :ny] @ fitted.coordinates.matrix.T
    effect = next(e for e in fitted.model.effects if e.id == effect_id)
    out: dict[str, Parameter] = {}
    for name, spec in effect.parameters.items():
        k = fitted.model.names.index(f"{effect_id}.{name}")
        error = float(np.sqrt(max(covariance[k, k], 0)))
        out[f"{effect_id}.{name}"] = Parameter(
            value=float(fitted.par[k]),
            unit=spec.unit,
            stderr=error,
            lower=spec.lower,
            upper=spec.upper,
            interval_95=(
                float(fitted.par[k] - spread.quantile * error),
                float(fitted.par[k] + spread.quantile * error),
            ),
        )
    return out


def swallowed(problem: Problem, before: Fitted, after: Fitted, effects: Sequence[str]) -> list[str]:
    """Base parameters that had moved to make up for the missing effect: value and z-score before and after."""
    solution = before.solution
    spread = sandwich(
        list(problem.train), solution.evaluation.residual, solution.scaled_jacobian, solution.evaluation.slices
    )
    ny = len(before.coordinates.free)
    covariance = before.coordinates.matrix @ spread.covariance[:ny, :ny] @ before.coordinates.matrix.T
    out = []
    for k in range(7):
        old, new, error = float(before.par[k]), float(after.par[k]), float(np.sqrt(max(covariance[k, k], 0)))
        if error > 0 and abs(new - old) > 3 * error and abs(new - old) > 0.03 * abs(old):
            out.append(
                f"{before.model.names[k]} had moved to make up for {' and '.join(effects)}: {old:.4g} before, {new:.4g} with it "
                f"({abs(new - old) / error:.0f} of its former standard errors)."
            )
    return out
