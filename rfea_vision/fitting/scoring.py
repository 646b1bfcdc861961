"""From a solved fit to `model.json`: metrics by role, intervals, the paper's parameters, warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts.judgement import ExperimentScore, Metrics, ModelFit, Parameter
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.parameters import PAPER_UNITS, as_paper, as_paper_matrix
from rfea_vision.effects.base import BASE_UNITS
from rfea_vision.fitting.fit import FitOptions, Fitted, Problem, make_model
from rfea_vision.fitting.observation import MM, Observed, noise_floor_mm
from rfea_vision.fitting.residual_tests import examine_residuals
from rfea_vision.fitting.residuals import Predicted, predict_observed
from rfea_vision.fitting.solver import fit_clocks
from rfea_vision.fitting.uncertainty import Uncertainty, sandwich

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Gaps:
    """Squared errors of one experiment, per frame: tip, tip y, mean over the midline (mm^2) and angle (deg^2); None if not measured."""

    tip: FloatArray | None
    tip_y: FloatArray | None
    midline: FloatArray | None
    angle: FloatArray | None
    tip_variance: float


def gaps(item: Observed, predicted: Predicted) -> Gaps:
    """Squared errors per frame on the centre line."""
    gap = (item.points - predicted.points) / MM if item.has_tip else None
    tip = None if gap is None else np.sum(gap[:, -1] ** 2, axis=1)
    midline = None if gap is None or not item.has_midline else np.mean(np.sum(gap**2, axis=2), axis=1)
    angle = np.rad2deg(item.angle - predicted.angle) ** 2 if np.any(np.isfinite(item.angle)) else None
    variance = 0.0 if gap is None else float(np.sum(np.var(item.points[:, -1] / MM, axis=0)))
    return Gaps(tip, None if gap is None else gap[:, -1, 1] ** 2, midline, angle, variance)


def pooled(parts: Sequence[Gaps], length_mm: float) -> Metrics:
    """Metrics over several experiments, every frame with the same weight."""
    notes: dict[str, str] = {}

    def root(key: str, reason: str, metric: str) -> float | None:
        arrays = [getattr(p, key) for p in parts if getattr(p, key) is not None]
        if not arrays:
            notes[metric] = reason
            return None
        return float(np.sqrt(np.nanmean(np.concatenate(arrays))))

    tip = root("tip", "the track has no tip", "tip_rmse_mm")
    fit_percent = None
    with_tip = [p for p in parts if p.tip is not None]
    if with_tip:
        spread = sum(p.tip_variance * p.tip.size for p in with_tip if p.tip is not None)
        error = sum(float(np.sum(p.tip)) for p in with_tip if p.tip is not None)
        fit_percent = 100 * (1 - float(np.sqrt(error / spread))) if spread > 0 else None
    return Metrics(
        tip_rmse_mm=tip,
        tip_y_rmse_mm=root("tip_y", "the track has no tip", "tip_y_rmse_mm"),
        midline_rmse_mm=root("midline", "the track has no midline", "midline_rmse_mm"),
        angle_rmse_deg=root("angle", "the track has no bend angle", "angle_rmse_deg"),
        tip_rmse_percent_of_length=None if tip is None else 100 * tip / length_mm,
        normalised_fit_percent=fit_percent,
        notes=notes,
    )


def score(
    problem: Problem, model: Any, par: FloatArray, items: Sequence[Observed], clocks: FloatArray | None = None
) -> tuple[dict[str, ExperimentScore], dict[str, Gaps], dict[str, float]]:
    """Score each experiment; its clock is adjusted where it was found from the motion."""
    offsets = fit_clocks(model, items, par) if clocks is None else clocks
    scores, parts, used = {}, {}, {}
    length_mm = problem.actuator.length / MM
    for item, clock in zip(items, offsets, strict=True):
        predicted = predict_observed(model, par, item, (), float(clock))
        if predicted is None:
            scores[item.name] = ExperimentScore(
                role=item.role, notes={"tip_rmse_mm": "the model could not be simulated on this run"}
            )
            continue
        parts[item.name] = gaps(item, predicted)
        used[item.name] = float(clock)
        metrics = pooled([parts[item.name]], length_mm)
        nuisance = {"clock_offset_s": float(clock)} if item.clock_free else {}
        scores[item.name] = ExperimentScore(
            role=item.role, frames_used=int(item.time.size), nuisance=nuisance, **metrics.model_dump()
        )
    return scores, parts, used


def metrics_by_role(problem: Problem, scores: dict[str, ExperimentScore], parts: dict[str, Gaps]) -> dict[str, Metrics]:
    """Pooled metrics for each role that was scored."""
    out = {}
    for role in ("train", "validate", "test"):
        names = [name for name, s in scores.items() if s.role == role]
        if not names:
            continue
        if any(name not in parts for name in names):
            out[role] = Metrics(notes={"tip_rmse_mm": "the model could not be simulated on every run of this role"})
        else:
            out[role] = pooled([parts[name] for name in names], problem.actuator.length / MM)
    return out


def _parameters(problem: Problem, fitted: Fitted, uncertainty: Uncertainty) -> tuple[dict[str, Parameter], FloatArray]:
    """Parameters with intervals, and the covariance of the full vector."""
    coordinates, model = fitted.coordinates, fitted.model
    ny = len(coordinates.free)
    matrix = coordinates.matrix
    covariance = matrix @ uncertainty.covariance[:ny, :ny] @ matrix.T
    doubtful = np.zeros(len(model.names), dtype=bool)
    for column in range(ny):
        if uncertainty.undetermined[column]:
            doubtful |= matrix[:, column] != 0
    y = fitted.solution.y
    # Coordinates are of order one; a generous upper bound must not make a small amplitude look like none.
    near = 1e-3 * np.minimum(coordinates.upper - coordinates.lower, 1.0)
    at_bound = {
        coordinates.free[i]: "lower" if y[i] - coordinates.lower[i] < near[i] else "upper"
        for i in range(ny)
        if min(y[i] - coordinates.lower[i], coordinates.upper[i] - y[i]) < near[i]
    }
    out = {}
    for k, name in enumerate(model.names):
        unit, lower, upper = _unit_and_bounds(fitted, k)
        value, error = float(fitted.par[k]), float(np.sqrt(max(covariance[k, k], 0.0)))
        note, known = "", k in coordinates.free
        if not known:
            note = "held fixed"
        elif doubtful[k]:
            note, known = "these data do not determine it: no interval", False
        elif k in at_bound:
            note, known = f"at its {at_bound[k]} bound: no interval", False
        half = uncertainty.quantile * error
        out[name] = Parameter(
            value=value,
            unit=unit,
            stderr=error if known else None,
            interval_95=(value - half, value + half) if known else None,
            lower=lower,
            upper=upper,
            fixed=k not in coordinates.free,
            note=note,
        )
    return out, covariance


def _unit_and_bounds(fitted: Fitted, k: int) -> tuple[str, float | None, float | None]:
    name = fitted.model.names[k]
    if k < 7:
        if k == 6 and k in fitted.coordinates.free:
            column = fitted.coordinates.free.index(k)
            size = fitted.coordinates.matrix[k, column]
            return (
                BASE_UNITS[name],
                float(fitted.coordinates.lower[column] * size),
                float(fitted.coordinates.upper[column] * size),
            )
        return BASE_UNITS[name], 0.0 if k % 2 == 0 else None, None
    effect, parameter = name.split(".")
    spec = next(e for e in fitted.model.effects if e.id == effect).parameters[parameter]
    return spec.unit, spec.lower, spec.upper


def _paper(fitted: Fitted, actuator: Actuator, covariance: FloatArray, quantile: float) -> dict[str, Parameter]:
    """k_0, m_k, ... per joint and per degree, so that both tables can be compared."""
    inner = actuator.inner_radius
    values = as_paper(fitted.par[:7], inner)
    matrix = as_paper_matrix(inner)
    spread = np.sqrt(np.maximum(np.diag(matrix @ covariance[:7, :7] @ matrix.T), 0.0))
    return {
        name: Parameter(
            value=values[name],
            unit=unit,
            stderr=float(s),
            interval_95=(values[name] - quantile * s, values[name] + quantile * s),
        )
        for (name, unit), s in zip(PAPER_UNITS.items(), spread, strict=True)
    }


def _sentences(parameters: dict[str, Parameter], correlation: FloatArray, names: Sequence[str]) -> list[str]:
    out = []
    for i in range(len(names)):
        for j in range(i):
            if abs(correlation[i, j]) > 0.995:
                out.append(
                    f"{names[j]} and {names[i]} cannot be told apart by these data (correlation {correlation[i, j]:+.4f}): "
                    "only their combination is determined."
                )
    for name, parameter in parameters.items():
        if "bound" in parameter.note:
            out.append(f"{name} ended {parameter.note.split(':')[0]}: the data pull it out of what physics allows.")
    return out


def _message(fitted: Fitted) -> str:
    solution = fitted.solution
    runs = f"{solution.evaluations} evaluations"
    if solution.converged:
        return f"Converged after {runs}."
    return f"Stopped after {runs} without converging; more data, fewer effects or other bounds may help."


def _laws(fitted: Fitted) -> dict[str, dict[str, str]]:
    from rfea_vision.effects.typeset import typeset

    return {effect.id: typeset(effect) for effect in fitted.model.effects}


def as_artefact(problem: Problem, fitted: Fitted, *, with_test: bool = False) -> ModelFit:
    """Score a fit on the training and validation runs (and the test runs only if asked to) and write it down."""
    solution = fitted.solution
    items = list(problem.with_roles("train", "validate", *(("test",) if with_test else ())))
    train_clocks = {item.name: clock for item, clock in zip(problem.train, solution.clocks, strict=True)}
    others = [o for o in items if o.role != "train"]
    other_clocks = fit_clocks(fitted.model, others, fitted.par)
    clocks = np.array([train_clocks[o.name] for o in problem.train] + [float(c) for c in other_clocks])
    scores, parts, _ = score(problem, fitted.model, fitted.par, [*problem.train, *others], clocks)
    uncertainty = sandwich(
        list(problem.train), solution.evaluation.residual, solution.scaled_jacobian, solution.evaluation.slices
    )
    parameters, covariance = _parameters(problem, fitted, uncertainty)
    free = list(fitted.coordinates.free)
    spread = np.sqrt(np.maximum(np.diag(covariance)[free], 1e-300))
    correlation = covariance[np.ix_(free, free)] / np.outer(spread, spread)
    floor, source = noise_floor_mm(list(problem.with_roles("train", "validate")), problem.recordings)
    options: FitOptions = fitted.options
    observe = problem.train[0].observe
    return ModelFit(
        name=options.name,
        segments=options.segments,
        joints=options.joints,
        effects=list(options.effects),
        observe=observe,
        status="converged" if solution.converged else "not_converged",
        message=_message(fitted),
        actuator=problem.actuator.as_dict(),
        parameters=parameters,
        paper_parameters=_paper(fitted, problem.actuator, covariance, uncertainty.quantile),
        correlation={"names": list(fitted.coordinates.names), "matrix": correlation.round(6).tolist()},
        metrics=metrics_by_role(problem, scores, parts),
        noise_floor_mm=floor,
        noise_floor_source=source,
        experiments=scores,
        warnings=_sentences(parameters, correlation, fitted.coordinates.names),
        steady_state=fitted.steady,
        starts=list(fitted.starts),
        residual_tests=examine_residuals(problem.train, solution.evaluation.predicted),
        laws=_laws(fitted),
        effect_files=[str(p) for p in options.effect_files],  # type: ignore[call-arg]
    )


def rebuild(artefact: ModelFit) -> tuple[Any, FloatArray]:
    """The model and its parameter vector from `model.json`."""
    from pathlib import Path

    actuator = Actuator(**artefact.actuator)
    files = tuple(Path(p) for p in (artefact.model_extra or {}).get("effect_files", ()))
    options = FitOptions(
        name=artefact.name,
        segments=artefact.segments,
        joints=artefact.joints,
        effects=tuple(artefact.effects),
        effect_files=files,
    )
    model = make_model(actuator, options, -1.0 if actuator.bends == "right" else 1.0)
    return model, np.array([artefact.parameters[name].value for name in model.names])
