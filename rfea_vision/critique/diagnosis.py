"""Which effects are missing: screen all, refit the best sets, weigh them on runs that were not used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from rfea_vision.artefacts.judgement import Diagnosis, ModelFit, Rung, WorstPlace
from rfea_vision.artefacts.measurement import Actuator, Recording
from rfea_vision.artefacts.rows import GoesWith, Refit
from rfea_vision.critique.evidence import absorbed, candidate_rows, to_rule_out
from rfea_vision.critique.measures import Errors, errors_of, in_another_unit
from rfea_vision.critique.next_experiment import design_next
from rfea_vision.critique.refinement import SEGMENTS, screen_segments
from rfea_vision.critique.screening import offered
from rfea_vision.critique.search import Search
from rfea_vision.critique.trials import Trials, plain
from rfea_vision.critique.verdict import Verdict, decide, hides, remainder_of, sets_of, unseen
from rfea_vision.errors import DataError
from rfea_vision.fitting.odd_pressure import about_odd_pressure
from rfea_vision.fitting.problem import Problem, make_problem
from rfea_vision.fitting.ratio import lever_free
from rfea_vision.fitting.refit import Fitted, in_long_steps, refit
from rfea_vision.fitting.scoring import in_its_steps, options_of, worse_than_nothing
from rfea_vision.options import CritiqueOptions
from rfea_vision.units import rounded

#: What a bar of progress is told to expect: about so many refits.
EXPECTED_REFITS = 20


@dataclass(frozen=True)
class Judgement:
    """Diagnosis with what it was made from, for what looks at it more closely."""

    diagnosis: Diagnosis
    search: Search
    verdict: Verdict
    next_pressure: xr.Dataset | None


def judge(
    problem: Problem,
    fitted: Fitted,
    options: CritiqueOptions | None = None,
    *,
    candidates: Sequence[str] | None = None,
    where: Sequence[WorstPlace] = (),
    goes_with: Sequence[GoesWith] = (),
    scored: float | None = None,
    known: Sequence[Refit] = (),
    refused: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> Judgement:
    """Diagnose a solved fit: training runs fit, validation runs judge, test runs are not looked at.

    `goes_with` is what the residual torque depends on; `scored` is the held-out error that `model.json` has; `known` is what the
    search from a smaller model on the same chain has refitted: where it is met again, it is taken up and not begun anew.
    `refused` is why nothing that is said of a fit is to be rested on (`none_to_rest_on`).
    """
    asked = options or CritiqueOptions()
    problem = in_long_steps(problem, fitted.model, fitted.par, fitted.solution.clocks)
    steps = 0

    def step() -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(min(steps, EXPECTED_REFITS - 1), EXPECTED_REFITS)

    at = {frozenset(one["effects"]): one["values"] for one in known}
    trials = Trials(problem, asked.effect_files, step, known=at)
    effects = offered(problem, fitted, candidates, asked.effect_files)
    base = _errors_without_effects(problem, fitted, at.get(frozenset())) if fitted.options.effects else None
    search = Search(trials, trials.adopt(fitted), effects, wide=asked.stand_ins, scored=scored, base=base)
    if candidates is None and screen_segments(
        problem, fitted, search.floor
    ):  # what needs no law is tried before any law
        trials.refit(search.present, (SEGMENTS,), {})
    verdict = decide(search, search.run(), refused)
    following, pressure = None, None
    if verdict.rivals:
        following, pressure = design_next(
            problem, [t.fitted for t in verdict.rivals[:2]], verdict.tied[0].effects[:2], asked.seed, search.floor
        )
    if progress is not None:
        progress(EXPECTED_REFITS, EXPECTED_REFITS)
    diagnosis = _diagnosis(search, verdict, goes_with, fitted).model_copy(
        update={"where": list(where), "next_experiment": following}
    )
    return Judgement(diagnosis, search, verdict, pressure)


def _errors_without_effects(problem: Problem, fitted: Fitted, known: Mapping[str, float] | None) -> Errors | None:
    """Errors of the base model below one that has effects, begun where it is `known`; None where it cannot be simulated."""
    free = lever_free(fitted)
    fixed = {name: value for name, value in free.fixed.items() if "." not in name}
    options = replace(free, effects=(), fixed=fixed, name="base")
    try:
        base = refit(problem, options, known or fitted.values, options.segments, fitted.solution.clocks)
    except DataError:
        return None
    return errors_of(problem, base)


def _left_out(problem: Problem) -> list[str]:
    names = in_another_unit(problem)
    if not names:
        return []
    has, unit = ("an angle", "mm") if problem.train[0].has_tip else ("a tip", "deg")
    return [f"{', '.join(names)}: fitted, but not used to judge: only {has} was measured, and errors are compared in {unit}"]


def _hidden(search: Search, verdict: Verdict) -> list[str]:
    """That a track which shows one thing missing may hide another."""
    if verdict.verdict != "missing" or not hides(search):
        return []
    floor = f"the floor is {rounded(search.floor)} {search.floors.unit}"
    return [f"this track is too uncertain to say whether more is missing: {floor}, and {unseen(search).removesuffix('.')}"]


def _diagnosis(search: Search, verdict: Verdict, goes_with: Sequence[GoesWith], fitted: Fitted) -> Diagnosis:
    in_mm = search.floors.unit == "mm"
    best = verdict.best.fitted
    return Diagnosis(
        model=fitted.options.name,
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        named=[plain(one) for one in verdict.named],
        stand_ins=list(verdict.stand_ins),
        tied=verdict.tied,
        candidates=candidate_rows(search, verdict),
        sets=sets_of(search, verdict.weighed),
        sufficient=verdict.sufficient,
        asks_less=verdict.asks_less,
        uncertain=bool(verdict.uncertain_because),
        uncertain_because=verdict.uncertain_because,
        remainder=remainder_of(search, verdict, goes_with),
        floors=search.floors,
        noise_floor_mm=search.floor if in_mm else None,
        noise_floor_deg=None if in_mm else search.floor,
        explained_fraction=verdict.share if verdict.named else None,
        refits=search.trials.refits(),
        warnings=[
            *(absorbed(search.trials.problem, fitted, best, verdict.named) if verdict.named else []),
            *to_rule_out(search.effects, verdict.named, best.values),
            *_hidden(search, verdict),
            *_left_out(search.trials.problem),
        ],
    )


def none_to_rest_on(model: ModelFit) -> str:
    """Why whatever is said of a fit is uncertain: it was refused, or one run's pressure is not that of the others; else empty."""
    return model.refused or next(iter(about_odd_pressure(model.experiments)), "")


def held_of(model: ModelFit) -> float | None:
    """Error of a fit on the runs that judge, as it was scored."""
    rung = Rung.of(model, added=None, verdict="")
    return rung.error("train") if rung.error("validate") is None else rung.error("validate")


def refit_artefact(model: ModelFit, problem: Problem) -> Fitted:
    """The solved fit behind a `model.json` by a last step of the optimiser from its values, on runs as `in_its_steps` gives them."""
    options = options_of(model)
    values = {name: p.value for name, p in model.parameters.items()}
    clocks = np.array([model.clock_s(item.name) or 0.0 for item in problem.train])
    fitted = refit(problem, options, values, model.segments, clocks, most_evaluations=15)
    return replace(fitted, ratio_only=model.ratio_only)


def reopened(model: ModelFit, recordings: Mapping[str, Recording]) -> tuple[Problem, Fitted]:
    """Runs in the steps in which a `model.json` was scored, and the solved fit behind it."""
    problem = in_its_steps(make_problem(recordings, Actuator(**model.actuator), options_of(model)), model)
    return problem, refit_artefact(model, problem)


def diagnose(
    model: ModelFit,
    recordings: Mapping[str, Recording],
    options: CritiqueOptions | None = None,
    *,
    candidates: Sequence[str] | None = None,
    where: Sequence[WorstPlace] = (),
    goes_with: Sequence[GoesWith] = (),
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Diagnosis, xr.Dataset | None]:
    """Name the effects that are missing from a fitted model, each with its probability and share of the misfit.

    Returns the diagnosis and, where it names a tie, the pressure of the next experiment (`pressure` in kPa over `log_time`).
    """
    problem, fitted = reopened(model, recordings)
    asked = options or CritiqueOptions()
    asked = replace(asked, effect_files=asked.effect_files or fitted.options.effect_files)
    judgement = judge(
        problem, fitted, asked, candidates=candidates, where=where, goes_with=goes_with, progress=progress,
        scored=held_of(model), refused=none_to_rest_on(model),
    )  # fmt: skip
    said = [*about_odd_pressure(model.experiments), *worse_than_nothing(model.experiments), *judgement.diagnosis.warnings]
    return judgement.diagnosis.model_copy(update={"warnings": said}), judgement.next_pressure


__all__ = ["Judgement", "diagnose", "held_of", "judge", "none_to_rest_on", "refit_artefact", "reopened"]
