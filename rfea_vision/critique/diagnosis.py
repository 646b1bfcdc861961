"""Which effect is missing: screen all, refit the best, judge them on runs that were not used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rfea_vision.artefacts.judgement import Diagnosis, EffectSet, Floors, ModelFit, Remainder, WorstPlace
from rfea_vision.artefacts.measurement import Actuator, Recording
from rfea_vision.critique.evidence import candidate_rows, swallowed
from rfea_vision.critique.measures import STRUCTURE_FLOORS, Errors, errors_of, floor_of, structure
from rfea_vision.critique.next_experiment import design_next
from rfea_vision.critique.refinement import SEGMENTS, screen_segments
from rfea_vision.critique.screening import Screened, available, offered, screen
from rfea_vision.critique.trials import (
    FAR,
    REFITS,
    Refitted,
    Trials,
    try_expected,
    try_fresh,
    try_one,
    try_singles,
    try_together,
)
from rfea_vision.critique.verdict import Verdict, decide
from rfea_vision.fitting.fit import Fitted, Problem, make_problem, parse_effects, refit
from rfea_vision.fitting.scoring import options_of
from rfea_vision.options import CritiqueOptions

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Judgement:
    """Diagnosis with what it was made from, so that the ladder need not fit again."""

    diagnosis: Diagnosis
    refitted: dict[str, Refitted]
    errors: Errors
    floor: float
    next_pressure: xr.Dataset | None


def judge(
    problem: Problem,
    fitted: Fitted,
    *,
    options: CritiqueOptions,
    candidates: Sequence[str] | None = None,
    where: Sequence[WorstPlace] = (),
    expected: Sequence[str] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Judgement:
    """Diagnose a solved fit: training runs fit, validation runs judge, test runs are not looked at.

    `expected` are effects that a diagnosis one rung below named beside the one that was added: they are tried first.
    """
    steps = 0

    def step() -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(min(steps, REFITS + 1), REFITS + 2)

    errors, floor = errors_of(problem, fitted), floor_of(problem, fitted)
    effects = offered(problem, fitted, candidates, options.effect_files)
    present = available(effects, {e.id for e in fitted.model.effects})
    screened: list[Screened] = screen(problem, fitted, present) if present else []
    step()
    trials = Trials(problem, fitted, errors, floor, effects, options.effect_files, options.enough, step)
    left = structure(errors, floor)
    if left >= STRUCTURE_FLOORS and candidates is None and (finer := screen_segments(problem, fitted, floor)):
        screened.append(finer)
    hopes = [name for name in expected if any(e.id == name for e in effects)]
    singles = try_singles(trials, screened, hopes) if left >= STRUCTURE_FLOORS else {}
    alone = any(r.wins and r.reaches for r in singles.values())
    together = try_expected(trials, screened, singles, hopes) if len(hopes) > 1 and not alone else []
    if left >= FAR and not together and not any(trials.settles(r) for r in singles.values()):
        singles = try_fresh(trials, screened, singles)
        alone = any(r.wins and r.reaches for r in singles.values())
    if left >= 1.0 and not alone and not together:
        together = try_together(trials, singles)
    verdict = decide(trials, singles, together)
    following, pressure = None, None
    if verdict.rivals:
        pair = verdict.rivals[:2]
        names = [next(e for e in r.added if e in verdict.tied[0].effects) for r in pair]
        following, pressure = design_next(problem, [r.fitted for r in pair], names, options.seed)
    diagnosis = _diagnosis(trials, verdict, screened, singles).model_copy(
        update={"where": list(where), "next_experiment": following}
    )
    if progress is not None:
        progress(REFITS + 2, REFITS + 2)
    return Judgement(diagnosis, singles, errors, floor, pressure)


def refit_named(problem: Problem, fitted: Fitted, name: str, effect_files: Sequence[Path] = ()) -> Refitted | None:
    """The refit behind a name that an earlier diagnosis of the same fit has given."""
    errors, floor = errors_of(problem, fitted), floor_of(problem, fitted)
    effects = offered(problem, fitted, [] if name == SEGMENTS else [name], effect_files)
    return try_one(Trials(problem, fitted, errors, floor, effects, tuple(effect_files)), name)


def _diagnosis(
    trials: Trials, verdict: Verdict, screened: Sequence[Screened], singles: Mapping[str, Refitted]
) -> Diagnosis:
    best = verdict.best
    return Diagnosis(
        model=trials.before.options.name,
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        named=list(best.added) if best is not None else [],
        tied=verdict.tied,
        candidates=candidate_rows(trials, screened, singles),
        **_grades(trials, verdict, singles),
        noise_floor_mm=trials.floor if trials.in_mm else None,
        noise_floor_deg=None if trials.in_mm else trials.floor,
        explained_fraction=verdict.explained,
        enough=trials.enough,
        warnings=swallowed(trials.problem, trials.before, best.fitted, best.added) if best is not None else [],
    )


def _grades(trials: Trials, verdict: Verdict, singles: Mapping[str, Refitted]) -> dict[str, Any]:
    """Shares of the sets that were refitted, what the best of them leaves, and the floors."""
    unit = "mm" if trials.in_mm else "deg"
    rows = {tuple(r.added): r for r in (*verdict.rivals, *singles.values(), *([verdict.best] if verdict.best else []))}
    sets = [
        EffectSet(effects=list(added), share=r.explained, **{f"validate_rmse_{unit}": r.errors.held})
        for added, r in rows.items()
    ]  # type: ignore[arg-type]
    sets.append(EffectSet(effects=[], share=0.0, **{f"validate_rmse_{unit}": trials.errors.held}))  # type: ignore[arg-type]
    errors = verdict.best.errors if verdict.best is not None else trials.errors
    left = verdict.best.explained if verdict.best is not None else 0.0
    return {
        "sets": sorted(sets, key=lambda row: -(row.share or 0.0)),
        "sufficient": structure(errors, trials.floor) < max(STRUCTURE_FLOORS, trials.small),
        "remainder": Remainder(share=1 - left, **{f"rmse_{unit}": errors.held}),  # type: ignore[arg-type]
        "floors": Floors(measurement=trials.floor, unit=unit),  # type: ignore[arg-type]
    }


def refit_artefact(model: ModelFit, problem: Problem) -> Fitted:
    """The solved fit behind a `model.json`, by a last step of the optimiser from its values."""
    options = options_of(model)
    values = {name: p.value for name, p in model.parameters.items()}
    clocks = np.array(
        [
            model.experiments[o.name].nuisance.get("clock_offset_s", 0.0) if o.name in model.experiments else 0.0
            for o in problem.train
        ]
    )
    parse_effects(options.effects, options.segments)
    return refit(problem, options, values, model.segments, clocks, most_evaluations=15)


def diagnose(
    model: ModelFit,
    recordings: Mapping[str, Recording],
    options: CritiqueOptions | None = None,
    *,
    candidates: Sequence[str] | None = None,
    where: Sequence[WorstPlace] = (),
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Diagnosis, xr.Dataset | None]:
    """Name the effect that is missing from a fitted model, or say that none is, or that none on offer explains what is left.

    Returns the diagnosis and, where it names a tie, the pressure of the next experiment (`pressure` in kPa over `log_time`).
    """
    zero_sd = float(model.given.get("pressure_zero_sd", 0.0))
    problem = make_problem(recordings, Actuator(**model.actuator), model.observe, pressure_zero_sd=zero_sd)  # type: ignore[arg-type]
    fitted = refit_artefact(model, problem)
    asked = options or CritiqueOptions()
    asked = replace(asked, effect_files=asked.effect_files or fitted.options.effect_files)
    judgement = judge(problem, fitted, options=asked, candidates=candidates, where=where, progress=progress)
    return judgement.diagnosis, judgement.next_pressure


__all__ = ["Judgement", "diagnose", "judge", "refit_artefact", "refit_named"]
