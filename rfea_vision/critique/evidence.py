"""The evidence behind a diagnosis: every candidate as a row, and base parameters that had moved to absorb physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rfea_vision.artefacts.judgement import Candidate, Parameter
from rfea_vision.critique.measures import matters, share
from rfea_vision.critique.search import Search
from rfea_vision.critique.trials import Trial, plain
from rfea_vision.critique.verdict import Verdict, title
from rfea_vision.dynamics.parameters import scaled
from rfea_vision.effects.base import BASE_UNITS, Effect
from rfea_vision.fitting.information import delta_bic
from rfea_vision.fitting.intervals import intervals
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.solver import with_slopes
from rfea_vision.units import rounded


def candidate_rows(search: Search, verdict: Verdict) -> list[Candidate]:
    """Every effect that was screened, those that were refitted alone first; p values allow for the number of effects tried."""
    tests = len({item.effect for item in search.screened})
    alone = {item.added[0]: item.trial for item in verdict.weighed if len(item.added) == 1}
    rows = []
    for name in dict.fromkeys([*(item.effect for item in search.screened), *alone]):
        own = [item for item in search.screened if item.effect == name]
        scores = [item.score_p for item in own if item.score_p is not None]
        unit = search.floors.unit
        shown: dict[str, Any] = {"score_p": min(1.0, tests * min(scores)) if scores else None}
        if own:
            shown[f"predicted_rmse_{unit}"] = search.present.errors.train * float(
                np.sqrt(max(1 - own[0].explained, 0.0))
            )
        done = alone.get(name)
        if done is not None:
            shown |= _refitted(search, name, done)
        shown["form"] = form = form_of(name, verdict)
        in_form = search.trials.done.get(search.present.effects | {f"{name}:{form}" if form else name})
        shown["values"] = {} if in_form is None else in_form.fitted.values
        shown["probability"] = verdict.probability.get(name, search.rule.unseen)
        rows.append(Candidate(effect=name, title=title(search, name), **shown))

    def error(row: Candidate) -> float:
        found = (row.validate_rmse_mm, row.validate_rmse_deg, row.predicted_rmse_mm, row.predicted_rmse_deg)
        return next((value for value in found if value is not None), 0.0)

    return sorted(rows, key=lambda row: (not row.refitted, -(row.probability or 0.0), error(row)))


def form_of(name: str, verdict: Verdict) -> str | None:
    """The form of an effect that the best set prefers; None for the usual one."""
    own = next((one for one in verdict.best.effects if plain(one) == name), name)
    return own.partition("@")[0].partition(":")[2] or None


def _refitted(search: Search, name: str, done: Trial) -> dict[str, Any]:
    problem, unit, before = search.trials.problem, search.floors.unit, search.present
    names = set(before.errors.runs) & set(done.errors.runs)
    return {
        f"train_rmse_{unit}": done.errors.train,
        f"validate_rmse_{unit}": done.errors.validate,
        "share": share(before.errors.on(names), done.errors.on(names), search.floor),
        "delta_bic": delta_bic(problem, before.fitted, done.fitted),
        "parameters": effect_parameters(problem, done.fitted, name),
        "refitted": True,
        "matters": matters(before.errors.on(names), done.errors.on(names), search.floor),
        "note": "ended at a bound of what physics allows" if done.at_bound else "",
    }


def effect_parameters(problem: Problem, fitted: Fitted, name: str) -> dict[str, Parameter]:
    """Fitted values of an effect with the intervals that the data can give; none for what is no effect but a finer chain."""
    solution = with_slopes(fitted.model, problem.train, fitted.coordinates, fitted.solution)
    found = intervals(replace(fitted, solution=solution), problem.train, problem.actuator).parameters
    return {key: value for key, value in found.items() if key.partition(".")[0] == plain(name)}


def to_rule_out(effects: Sequence[Effect], named: Sequence[str], values: Mapping[str, float]) -> list[str]:
    """What a named fault of the measurement is easily mistaken for, with its `values` in SI: a look at the files may settle it."""
    out = []
    for effect in effects:
        if effect.kind == "measurement" and effect.id in map(plain, named):
            units = {key: spec.unit for key, spec in effect.parameters.items() if f"{effect.id}.{key}" in values}
            told = ", ".join(
                f"{key} = {values[f'{effect.id}.{key}']:.3g} {unit}".removesuffix(" 1") for key, unit in units.items()
            )
            fitted = f" ({told})" if told else ""
            out.append(f"{effect.id}{fitted} is easily mistaken for {effect.mistaken_for}: rule that out first.")
    return out


def absorbed(problem: Problem, before: Fitted, after: Fitted, effects: Sequence[str]) -> list[str]:
    """Base parameters that had moved to make up for the missing effects: value and z-score before and after.

    Where the runs tell no more than the ratio to the lever, both are given at the lever of the fit, `before`, as its table has them.
    """
    covariance = intervals(before, problem.train, problem.actuator).covariance
    out = []
    with_it = scaled(after.par, after.options.segments, before.options.segments)
    at = ""
    if before.ratio_only:
        with_it[:6] *= before.par[6] / after.par[6]
        at = f", both at r_hyd = {rounded(1e3 * before.par[6])} mm"
    for k in range(7):
        old, new, error = float(before.par[k]), float(with_it[k]), float(np.sqrt(max(covariance[k, k], 0)))
        if error > 0 and abs(new - old) > 3 * error and abs(new - old) > 0.03 * abs(old):
            name = before.model.names[k]
            out.append(
                f"{name} had moved to make up for {' and '.join(effects)}: {old:.4g} {BASE_UNITS[name]} before, {new:.4g} with it "
                f"({abs(new - old) / error:.0f} of its former standard errors{at})."
            )
    return out
