"""Which effect is missing: screen all, refit the best, judge them on runs that were not used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rfea_vision.artefacts.judgement import Candidate, Diagnosis, ModelFit, NextExperiment, Parameter, Tie, WorstPlace
from rfea_vision.artefacts.measurement import Recording
from rfea_vision.critique.next_experiment import design_next
from rfea_vision.critique.screening import Screened, offered, screen
from rfea_vision.effects.base import Effect
from rfea_vision.errors import DataError
from rfea_vision.fitting.fit import FitOptions, Fitted, Problem, fit_added, make_problem, parse_effects, refit
from rfea_vision.fitting.observation import MM, Observed, noise_floor_mm
from rfea_vision.fitting.residuals import predict_observed
from rfea_vision.fitting.scoring import gaps
from rfea_vision.fitting.solver import fit_clocks
from rfea_vision.fitting.uncertainty import sandwich

FloatArray = NDArray[np.float64]
#: An effect matters if it lowers the held-out error by this share and by this many noise floors (docs/formats.md).
MATTERS_SHARE = 0.10
MATTERS_FLOORS = 0.2
#: Structure below half a noise floor does not change the verdict.
STRUCTURE_FLOORS = 0.5
#: A name needs at least this share of the explainable error; else what is left is called unexplained.
NAMED_SHARE = 0.35
TIE_FLOORS = 0.12
TIE_SHARE = 0.06
MOST_TIED = 3
REFITS = 6


@dataclass(frozen=True)
class Errors:
    """RMS errors of a model: tip and midline (mm) or angle (deg) on training and on held-out runs."""

    train: float
    held: float
    held_midline: float | None
    train_midline: float | None


@dataclass(frozen=True)
class Refitted:
    """A candidate that was refitted."""

    screened: Screened
    fitted: Fitted
    errors: Errors
    delta_bic: float
    allowed: bool


@dataclass(frozen=True)
class Judgement:
    """Diagnosis with what it was made from, so that the ladder need not fit again."""

    diagnosis: Diagnosis
    refitted: dict[str, Refitted]
    errors: Errors
    next_pressure: xr.Dataset | None


def held_out(problem: Problem) -> tuple[Observed, ...]:
    """Runs on which candidates are judged: validation runs, or the training runs where there are none."""
    return problem.validate or problem.train


def _rms(fitted: Fitted, items: Sequence[Observed], clocks: FloatArray | None = None) -> tuple[float, float | None]:
    offsets = fit_clocks(fitted.model, items, fitted.par) if clocks is None else clocks
    tips, lines = [], []
    for item, clock in zip(items, offsets, strict=True):
        predicted = predict_observed(fitted.model, fitted.par, item, (), float(clock))
        if predicted is None:
            return float("inf"), float("inf")
        part = gaps(item, predicted)
        tips.append(part.tip if part.tip is not None else part.angle)
        if part.midline is not None:
            lines.append(part.midline)
    tip = float(np.sqrt(np.nanmean(np.concatenate(tips))))  # type: ignore[arg-type]
    return tip, float(np.sqrt(np.nanmean(np.concatenate(lines)))) if lines else None


def errors_of(problem: Problem, fitted: Fitted) -> Errors:
    train, train_line = _rms(fitted, problem.train, fitted.solution.clocks)
    held, held_line = _rms(fitted, held_out(problem))
    return Errors(train, held, held_line, train_line)


def effective_count(problem: Problem, fitted: Fitted) -> float:
    """Number of independent residuals: rows over the integrated autocorrelation time of the tip residual, frame by frame."""
    total = 0.0
    for item, predicted in zip(problem.train, fitted.solution.evaluation.predicted, strict=True):
        gap = (
            (item.points[:, -1] - predicted.points[:, -1]) if item.has_tip else (item.angle - predicted.angle)[:, None]
        )
        for axis in range(gap.shape[1]):
            series = gap[:, axis] - gap[:, axis].mean()
            spectrum = np.abs(np.fft.rfft(series, 2 * series.size)) ** 2
            correlation = np.fft.irfft(spectrum)[: series.size]
            if correlation[0] <= 0:
                continue
            correlation = correlation / correlation[0]
            negative = np.flatnonzero(correlation < 0.05)
            stop = int(negative[0]) if negative.size else series.size
            total += series.size / (1 + 2 * float(correlation[1:stop].sum()))
    return max(total, 10.0)


def _delta_bic(problem: Problem, before: Fitted, after: Fitted, count: float) -> float:
    """Change of BIC on the training runs, with the number of independent residuals of the better model."""
    added = len(after.coordinates.free) - len(before.coordinates.free)
    ratio = after.solution.evaluation.cost / max(before.solution.evaluation.cost, 1e-300)
    return float(count * np.log(max(ratio, 1e-12)) + added * np.log(count))


def _physical(fitted: Fitted, effect_id: str) -> bool:
    """Whether the amplitudes of the effect stayed off their bounds (other than the bound at which it is absent)."""
    effect = next(e for e in fitted.model.effects if e.id == effect_id)
    for name in effect.amplitudes():
        spec = effect.parameters[name]
        value = fitted.value(f"{effect_id}.{name}")
        span = spec.upper - spec.lower
        if spec.upper - value < 2e-3 * span or (value - spec.lower < 2e-3 * span and spec.lower != spec.absent):
            return False
    return True


def matters(before: Errors, after: Errors, floor: float) -> bool:
    """The rule of docs/formats.md, on the tip or on the midline."""

    def better(old: float | None, new: float | None) -> bool:
        return (
            old is not None
            and new is not None
            and old - new >= MATTERS_SHARE * old
            and old - new >= MATTERS_FLOORS * floor
        )

    return better(before.held, after.held) or (
        better(before.held_midline, after.held_midline) and after.held <= before.held * 1.02 + 0.05 * floor
    )


def _excess(rms: float, floor: float) -> float:
    """Squared error above the noise floor."""
    return max(rms**2 - floor**2, 0.0)


def structure(rms: float, floor: float) -> float:
    """What is left above the noise, in noise floors."""
    return float(np.sqrt(_excess(rms, floor))) / floor if floor > 0 else float("inf")


def _start(effect: Effect, screened: Screened) -> dict[str, float]:
    """Start of a refit: the linear step, kept within the bounds, at the screened point of the grid."""
    out = {f"{effect.id}.{name}": value for name, value in screened.grid.items()}
    for name, step in screened.step.items():
        spec = effect.parameters[name]
        absent = spec.absent or 0.0
        value = absent + step if step else absent + 0.1 * (spec.start - absent)
        out[f"{effect.id}.{name}"] = float(np.clip(value, spec.lower, spec.upper))
    return out


def choose_for_refit(screened: Sequence[Screened], misfit_floors: float) -> dict[str, list[Screened]]:
    """Effects worth a refit, each with its two best points of the grid: more of them where the misfit is large."""
    by_effect: dict[str, list[Screened]] = {}
    for item in screened:
        by_effect.setdefault(item.effect, []).append(item)
    best = {name: rows[0].explained for name, rows in by_effect.items()}
    top = max(best.values(), default=0.0)
    count = REFITS + (2 if misfit_floors > 8 else 0)
    ranked = sorted(best, key=lambda name: -best[name])
    chosen = [n for i, n in enumerate(ranked) if i < 3 or (i < count and best[n] > 0.1 * top)]
    return {name: by_effect[name][:2] for name in chosen if best[name] > 1e-4}


def judge(
    problem: Problem,
    fitted: Fitted,
    *,
    candidates: Sequence[str] | None = None,
    effect_files: Sequence[Path] = (),
    where: Sequence[WorstPlace] = (),
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Judgement:
    """Diagnose a solved fit."""
    floor_mm, _ = noise_floor_mm(list(problem.with_roles("train", "validate")), problem.recordings)
    errors = errors_of(problem, fitted)
    floor = floor_mm if floor_mm else _angle_floor(problem)
    effects = offered(problem, fitted, candidates, effect_files)
    steps = REFITS + 2
    screened = screen(problem, fitted, effects)
    if progress is not None:
        progress(1, steps)
    left = structure(errors.held, floor)
    refitted: dict[str, Refitted] = {}
    count = effective_count(problem, fitted)
    by_id = {effect.id: effect for effect in effects}
    chosen = choose_for_refit(screened, left) if left > 0.3 or _midline_structure(problem, errors, floor) > 0.3 else {}
    for done, (name, rows) in enumerate(chosen.items()):
        starts = [_start(by_id[name], row) for row in rows]
        try:
            options = replace(
                fitted.options,
                effects=(*fitted.options.effects, name),
                name=f"{fitted.options.name}+{name}",
                effect_files=tuple(effect_files) or fitted.options.effect_files,
            )
            trial = fit_added(problem, options, fitted, starts=starts)
        except DataError:
            continue
        refitted[name] = Refitted(
            rows[0],
            trial,
            errors_of(problem, trial),
            _delta_bic(problem, fitted, trial, max(count, effective_count(problem, trial))),
            _physical(trial, name),
        )
        if progress is not None:
            progress(min(done + 2, steps), steps)
    diagnosis, extra = _verdict(problem, fitted, errors, floor, screened, refitted, by_id, where, seed)
    if progress is not None:
        progress(steps, steps)
    return Judgement(diagnosis, refitted, errors, extra)


def _angle_floor(problem: Problem) -> float:
    return float(np.rad2deg(np.median(np.concatenate([o.angle_sigma for o in problem.train]))))


def _midline_structure(problem: Problem, errors: Errors, floor: float) -> float:
    return structure(errors.held_midline, floor) if errors.held_midline is not None else 0.0


def _merit(item: Refitted) -> float:
    return (
        item.errors.held
        if item.errors.held_midline is None
        else float(np.hypot(item.errors.held, item.errors.held_midline))
    )


def _verdict(
    problem: Problem,
    fitted: Fitted,
    errors: Errors,
    floor: float,
    screened: Sequence[Screened],
    refitted: Mapping[str, Refitted],
    by_id: Mapping[str, Effect],
    where: Sequence[WorstPlace],
    seed: int,
) -> tuple[Diagnosis, xr.Dataset | None]:
    winners = [n for n, r in refitted.items() if matters(errors, r.errors, floor) and r.delta_bic < 0 and r.allowed]
    winners.sort(key=lambda n: _merit(refitted[n]))
    left = max(structure(errors.held, floor), _midline_structure(problem, errors, floor))
    named: list[str] = []
    tied: list[Tie] = []
    explained = None
    following, pressure = None, None
    if winners:
        best = refitted[winners[0]]
        before = _excess(errors.held, floor) + _excess(errors.held_midline or 0.0, floor)
        after = _excess(best.errors.held, floor) + _excess(best.errors.held_midline or 0.0, floor)
        explained = 1 - after / before if before > 0 else 1.0
        group = [n for n in winners if _tied(best, refitted[n], floor)]
        if explained >= NAMED_SHARE:
            named = [winners[0]]
            if len(group) > 1:
                group = group[:MOST_TIED]
                tied = [Tie(effects=group, split_by=by_id[group[0]].split_by)]
                following, pressure = design_next(problem, [refitted[n].fitted for n in group[:2]], group[:2], seed)
    if named:
        verdict = "missing"
        sentence = _missing_sentence(by_id[named[0]], errors, refitted[named[0]].errors, tied, bool(problem.validate))
    elif left < STRUCTURE_FLOORS or (not winners and left < 1.0):
        verdict = "complete"
        sentence = (
            f"Nothing is missing that matters: the held-out error is {errors.held:.3f} mm, the noise floor {floor:.3f} mm."
            if left < STRUCTURE_FLOORS
            else f"The held-out error ({errors.held:.3f} mm, noise floor {floor:.3f} mm) is not lowered by 10 % by any effect on offer."
        )
    else:
        verdict = "unexplained"
        sentence = (
            f"Structure of {np.sqrt(_excess(errors.held, floor)):.3f} mm is left above the noise floor, and no effect of the catalogue "
            "explains it: see the residual torque and what it depends on."
        )
    candidates = _candidates(screened, refitted, errors, floor, problem)
    diagnosis = Diagnosis(
        model=fitted.options.name,
        verdict=verdict,
        sentence=sentence,
        named=named,
        tied=tied,
        candidates=candidates,
        where=list(where),
        noise_floor_mm=floor,
        explained_fraction=explained,
        next_experiment=following,
        warnings=_swallowed(problem, fitted, refitted[named[0]].fitted, by_id[named[0]]) if named else [],
    )
    return diagnosis, pressure


def _tied(best: Refitted, other: Refitted, floor: float) -> bool:
    gap = _merit(other) - _merit(best)
    train = other.fitted.solution.evaluation.cost / best.fitted.solution.evaluation.cost - 1
    return gap <= max(TIE_FLOORS * floor, TIE_SHARE * _merit(best)) and train <= 2 * TIE_SHARE


def _missing_sentence(effect: Effect, before: Errors, after: Errors, tied: Sequence[Tie], held: bool) -> str:
    runs = "runs that were not used" if held else "the training runs (there are no validation runs)"
    text = (
        f"{effect.title} is missing: adding it takes the error on {runs} from {before.held:.3f} to {after.held:.3f} mm."
    )
    if tied:
        text += f" These data cannot tell it from {', '.join(tied[0].effects[1:])}."
    return text


def _candidates(
    screened: Sequence[Screened], refitted: Mapping[str, Refitted], errors: Errors, floor: float, problem: Problem
) -> list[Candidate]:
    rows, seen = [], set()
    for item in screened:
        if item.effect in seen:
            continue
        seen.add(item.effect)
        done = refitted.get(item.effect)
        predicted = errors.train * float(np.sqrt(max(1 - item.explained, 0.0)))
        best_p = min(s.score_p for s in screened if s.effect == item.effect)
        if done is None:
            rows.append(Candidate(effect=item.effect, score_p=best_p, predicted_rmse_mm=predicted))
            continue
        rows.append(
            Candidate(
                effect=item.effect,
                score_p=best_p,
                predicted_rmse_mm=predicted,
                train_rmse_mm=done.errors.train,
                validate_rmse_mm=done.errors.held if problem.validate else None,
                delta_bic=done.delta_bic,
                parameters=_effect_parameters(problem, done.fitted, item.effect),
                refitted=True,
                matters=matters(errors, done.errors, floor),
                note="" if done.allowed else "ended at a bound: not a value that physics allows",
            )
        )
    return sorted(
        rows,
        key=lambda c: (
            not c.refitted,
            c.validate_rmse_mm if c.validate_rmse_mm is not None else c.predicted_rmse_mm or 0,
        ),
    )


def _effect_parameters(problem: Problem, fitted: Fitted, effect_id: str) -> dict[str, Parameter]:
    solution = fitted.solution
    spread = sandwich(
        list(problem.train), solution.evaluation.residual, solution.scaled_jacobian, solution.evaluation.slices
    )
    ny = len(fitted.coordinates.free)
    covariance = fitted.coordinates.matrix @ spread.covariance[:ny, :ny] @ fitted.coordinates.matrix.T
    effect = next(e for e in fitted.model.effects if e.id == effect_id)
    out = {}
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


def _swallowed(problem: Problem, before: Fitted, after: Fitted, effect: Effect) -> list[str]:
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
                f"{before.model.names[k]} had moved to make up for {effect.id}: {old:.4g} before, {new:.4g} with it "
                f"({abs(new - old) / error:.0f} of its former standard errors)."
            )
    return out


def refit_artefact(model: ModelFit, problem: Problem) -> Fitted:
    """The solved fit behind a `model.json`, by a last step of the optimiser from its values."""
    files = tuple(Path(p) for p in (model.model_extra or {}).get("effect_files", ()))
    fixed = {n: p.value for n, p in model.parameters.items() if p.fixed}
    options = FitOptions(
        name=model.name,
        segments=model.segments,
        joints=model.joints,
        effects=tuple(model.effects),
        observe=model.observe,  # type: ignore[arg-type]
        effect_files=files,
        fixed=fixed,
    )
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
    *,
    candidates: Sequence[str] | None = None,
    effect_files: Sequence[Path] = (),
    where: Sequence[WorstPlace] = (),
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Diagnosis, xr.Dataset | None]:
    """Name the effect that is missing from a fitted model, or say that none is, or that none on offer explains what is left.

    Returns the diagnosis and, where it names a tie, the pressure of the next experiment (`pressure` in kPa over `log_time`).
    """
    from rfea_vision.artefacts.measurement import Actuator

    problem = make_problem(recordings, Actuator(**model.actuator), model.observe)  # type: ignore[arg-type]
    fitted = refit_artefact(model, problem)
    files = tuple(effect_files) or fitted.options.effect_files
    judgement = judge(
        problem, fitted, candidates=candidates, effect_files=files, where=where, seed=seed, progress=progress
    )
    return judgement.diagnosis, judgement.next_pressure


__all__ = ["MM", "NextExperiment", "diagnose", "judge"]
