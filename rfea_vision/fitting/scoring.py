"""From a solved fit to `model.json`: metrics by role, intervals, the paper's parameters, warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import JsonValue

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import ExperimentScore, Metrics, ModelFit, Parameter
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.simulation import Model
from rfea_vision.errors import InputError
from rfea_vision.fitting.alarms import alarms, runaway
from rfea_vision.fitting.discretisation import drift
from rfea_vision.fitting.intervals import intervals, without_intervals
from rfea_vision.fitting.noise import noise_floor_deg, noise_floor_mm
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.odd_pressure import about_odd_pressure, odd_pressure
from rfea_vision.fitting.other_unit import about_psi
from rfea_vision.fitting.problem import Problem, make_model
from rfea_vision.fitting.ratio import about_ratio
from rfea_vision.fitting.refit import Fitted, in_long_steps
from rfea_vision.fitting.residual_tests import examine_residuals
from rfea_vision.fitting.residuals import Predicted, left_of, predict_observed, why_not
from rfea_vision.fitting.rules import CONSTANT_PA, held_by_rule, pushed
from rfea_vision.fitting.solver import fit_clocks
from rfea_vision.options import FitOptions
from rfea_vision.options.asking import as_record, asked_by
from rfea_vision.units import counted

METRICS = ("tip_rmse_mm", "tip_x_rmse_mm", "tip_y_rmse_mm", "midline_rmse_mm", "angle_rmse_deg")


@dataclass(frozen=True)
class Gaps:
    """Squared errors of one experiment, per frame: tip, its x and y, mean over the midline (mm^2), angle (deg^2).

    None where something was not measured. `spread` is the variance of the tip, or of the angle where there is no tip.
    """

    tip: FloatArray | None
    tip_x: FloatArray | None
    tip_y: FloatArray | None
    midline: FloatArray | None
    angle: FloatArray | None
    spread: float

    @property
    def main(self) -> FloatArray | None:
        """Of the tip (frames,) in mm^2, or of the angle in deg^2 where there is no tip."""
        return self.angle if self.tip is None else self.tip


def gaps(item: Observed, predicted: Predicted) -> Gaps:
    """Squared errors per frame on the centre line."""
    gap = (item.points - predicted.points) / MM if item.has_tip else None
    tip = None if gap is None else np.sum(gap[:, -1] ** 2, axis=1)
    midline = None if gap is None or not item.has_midline else np.mean(np.sum(gap**2, axis=2), axis=1)
    angle = np.rad2deg(item.angle - predicted.angle) ** 2 if np.any(np.isfinite(item.angle)) else None
    shown = item.tip_or_angle
    variance = float(np.sum(np.nanvar(shown, axis=0))) if np.isfinite(shown).any() else 0.0
    x, y = (None, None) if gap is None else (gap[:, -1, 0] ** 2, gap[:, -1, 1] ** 2)
    return Gaps(tip, x, y, midline, angle, variance)


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
    alike = [p for p in parts if p.tip is not None] or parts  # of mm or of degrees, never of both
    spread = sum(p.spread * np.isfinite(p.main).sum() for p in alike if p.main is not None)
    error = sum(float(np.nansum(p.main)) for p in alike if p.main is not None)
    fit_percent = 100 * (1 - float(np.sqrt(error / spread))) if spread > 0 else None
    return Metrics(
        tip_rmse_mm=tip,
        tip_x_rmse_mm=root("tip_x", "the track has no tip", "tip_x_rmse_mm"),
        tip_y_rmse_mm=root("tip_y", "the track has no tip", "tip_y_rmse_mm"),
        midline_rmse_mm=root("midline", "the track has no centre line", "midline_rmse_mm"),
        angle_rmse_deg=root("angle", "the track has no bend angle", "angle_rmse_deg"),
        tip_rmse_percent_of_length=None if tip is None else 100 * tip / length_mm,
        normalised_fit_percent=fit_percent,
        notes=notes,
    )


def score(
    problem: Problem, model: Model, par: FloatArray, items: Sequence[Observed], clocks: FloatArray | None = None
) -> tuple[dict[str, ExperimentScore], dict[str, Gaps]]:
    """Score each experiment, and its squared errors where it could be simulated; its clock is adjusted where motion gave it.

    par : (parameters,) in SI; clocks : (experiments,) offset of each clock in s, fitted here by default
    """
    offsets = fit_clocks(model, items, par) if clocks is None else clocks
    scores, parts = {}, {}
    length_mm = problem.actuator.length / MM
    for item, clock in zip(items, offsets, strict=True):
        predicted = predict_observed(model, par, item, (), float(clock))
        if predicted is None:
            why = f"left out: {why_not(model, par, item, float(clock))}"
            scores[item.name] = ExperimentScore(role=item.role, notes=dict.fromkeys(METRICS, why))
            continue
        parts[item.name] = gaps(item, predicted)
        metrics = pooled([parts[item.name]], length_mm)
        nuisance = {"clock_offset_s": float(clock)} if item.clock_free else {}
        nuisance |= predicted.nuisance
        scores[item.name] = ExperimentScore(
            role=item.role,
            frames_used=int(item.time.size),
            step_s=item.excitation.step_s,
            nuisance=nuisance,
            **metrics.model_dump(),
        )
    return scores, parts


def metrics_by_role(problem: Problem, scores: dict[str, ExperimentScore], parts: dict[str, Gaps]) -> dict[str, Metrics]:
    """Pooled metrics for each role that was scored, over the runs that could be simulated; a note names the others."""
    out = {}
    for role in ("train", "validate", "test"):
        names = [name for name, s in scores.items() if s.role == role]
        if not names:
            continue
        without = [name for name in names if name not in parts]
        if len(without) == len(names):
            why = f"the model could not be simulated on {', '.join(names)}"
            out[role] = Metrics(notes=dict.fromkeys(METRICS, why))
            continue
        out[role] = pooled([parts[name] for name in names if name in parts], problem.actuator.length / MM)
        if without:
            out[role].notes["runs"] = f"without {', '.join(without)}, where the model could not be simulated"
    return out


def _message(fitted: Fitted) -> str:
    solution = fitted.solution
    runs = counted(solution.evaluations, "evaluation")
    if solution.converged:
        return f"Converged after {runs}."
    return f"Stopped after {runs} without converging; more data, fewer effects or other bounds may help."


def _laws(fitted: Fitted) -> dict[str, dict[str, str]]:
    from rfea_vision.effects.typeset import typeset

    return {effect.id: typeset(effect) for effect in fitted.model.effects}


def as_artefact(problem: Problem, fitted: Fitted) -> ModelFit:
    """Score a fit on the training and validation runs, test runs left alone, and write it down.

    In the longest steps whose error is small beside the noise; they stand in the scores (`step_s`), for `in_its_steps`.
    """
    problem = in_long_steps(problem, fitted.model, fitted.par, fitted.solution.clocks)
    predicted = fitted.solution.evaluation.predicted
    clocks = np.concatenate([fitted.solution.clocks, fit_clocks(fitted.model, problem.validate, fitted.par)])
    scores, parts = score(problem, fitted.model, fitted.par, problem.scored, clocks)
    for name, times in odd_pressure(fitted.model, fitted.par, problem.scored, clocks).items():
        scores[name] = scores[name].model_copy(update={"pressure_times": times})
    found = intervals(fitted, problem.train, problem.actuator, drift(problem, fitted, problem.train))
    left = {o.name: left_of(o, one) for o, one in zip(problem.train, predicted, strict=True)}
    errors = {name: part.tip for name, part in parts.items() if part.tip is not None}
    floor, source = noise_floor_mm(problem.scored, problem.recordings, left=left, errors=errors)
    floor_deg = noise_floor_deg(problem.scored, problem.recordings, left=left) if floor is None else None
    source = "standard errors of the angle" if floor_deg else source
    options = fitted.options
    refused = runaway(fitted, problem.actuator)
    parameters, paper = found.parameters, found.paper
    if refused:
        parameters, paper = without_intervals(parameters), without_intervals(paper)
    return ModelFit(
        name=options.name,
        segments=options.segments,
        joints=options.joints,
        effects=list(options.effects),
        observe=problem.train[0].observe,
        loss="huber" if options.loss == "huber" else "linear",
        order=fitted.model.order,
        status="refused" if refused else "converged" if fitted.solution.converged else "not_converged",
        message=refused or _message(fitted),
        actuator=problem.actuator.as_dict(),
        parameters=parameters,
        paper_parameters=paper,
        correlation={
            "names": list(fitted.coordinates.names),
            "matrix": found.correlation.round(9).tolist(),
            "stderr": np.sqrt(np.diag(found.covariance)[list(fitted.coordinates.free)]).tolist(),
        },
        metrics=metrics_by_role(problem, scores, parts),
        noise_floor_mm=floor,
        noise_floor_deg=floor_deg,
        noise_floor_source=source,
        experiments=scores,
        ratio_only=fitted.ratio_only,
        warnings=[
            *_ruled(problem, fitted, found.parameters),
            *found.sentences,
            *alarms(fitted, problem.actuator),
            *about_psi(problem, fitted),
            *about_odd_pressure(scores),
            *_about_runs(problem, fitted),
            *worse_than_nothing(scores),
        ],
        steady_state=fitted.steady,
        starts=list(fitted.starts),
        residual_tests=examine_residuals(problem.train, predicted),
        given=_given(options),
        segments_study=list(fitted.study),
        timings=fitted.study_seconds,
        laws=_laws(fitted),
        effect_files=[str(p) for p in options.effect_files],
    )


def _ruled(problem: Problem, fitted: Fitted, parameters: Mapping[str, Parameter]) -> list[str]:
    """What was held by rule, each fact once."""
    _, said = held_by_rule(problem.train, problem.actuator, fitted.options.segments)
    if fitted.ratio_only:
        said.append(about_ratio(parameters["k_ref"], parameters["r_hyd"].value))
    return said


def _about_runs(problem: Problem, fitted: Fitted) -> list[str]:
    """What a reader must know of the runs to trust the fit."""
    out = []
    moving = [o.name for o in problem.scored if o.unknown_before_s is not None]
    if moving:
        out.append(
            f"{', '.join(moving)}: the tube moves when the log begins; what drove it before was fitted along, "
            "record the log from rest to know it."
        )
    for name, count in fitted.jumps.items():
        if count:
            out.append(
                f"{name}: its track leaves the model in {count} jumps; fitted with the robust loss, look at the frames."
            )
    if not problem.validate:
        out.append(
            "No experiment has the role 'validate': nothing says how the model does on runs it was not fitted to."
        )
    for item in problem.train if pushed(problem.train) else ():
        spread = float(np.ptp(item.excitation.pressure))
        if spread < CONSTANT_PA and item.held is None:
            out.append(
                f"{item.name}: the pressure stays within {spread / 1e3:.2g} kPa; such a run tells little of the tube."
            )
    return out


def worse_than_nothing(scores: Mapping[str, ExperimentScore]) -> list[str]:
    """Say where a tube that never moves from its mean would be nearer to what was measured."""
    worse = [
        name for name, s in scores.items() if s.normalised_fit_percent is not None and s.normalised_fit_percent < 0
    ]
    if not worse:
        return []
    return [
        f"{', '.join(worse)}: the model is farther from the track than a tube that never moves from its mean place: check length, "
        "mounting (rig.gravity), the side it bends to, where the track begins, and the clocks, before any value is believed."
    ]


def _given(options: FitOptions) -> dict[str, JsonValue]:
    """What else was asked that holds for further fits, in SI, so that the fit can be taken up again from the artefact."""
    # The loss that a fit took and the one that was asked for are two: `auto` may take another one in a further fit.
    stated = set(ModelFit.model_fields) - {"loss"}
    lasting = {option.name for option in asked_by("improve", FitOptions)} - stated
    return {name: value for name, value in as_record(options).items() if name in lasting}


def options_of(artefact: ModelFit) -> FitOptions:
    """The options with which a `model.json` was fitted."""
    own: dict[str, Any] = {
        name: getattr(artefact, name) for name in ("name", "segments", "joints", "effects", "observe", "effect_files")
    }
    fixed = {name: p.value for name, p in artefact.parameters.items() if p.fixed}
    return FitOptions(**{**artefact.given, **own, "fixed": fixed})


def in_its_steps(problem: Problem, artefact: ModelFit) -> Problem:
    """The runs, training and validation, in the steps in which a `model.json` was scored on them."""
    steps = {name: score.step_s for name, score in artefact.experiments.items()}
    train, validate = (
        tuple(item.in_steps_of(steps.get(item.name)) for item in items) for items in (problem.train, problem.validate)
    )
    return replace(problem, train=train, validate=validate)


def rebuild(artefact: ModelFit) -> tuple[Model, FloatArray]:
    """The model, with the integrator that its values were found with, and its parameters (parameters,) in SI from `model.json`.

    Raises
    ------
    InputError
        The fit lacks a parameter of the model, or names an effect that nobody declares.
    """
    actuator = Actuator(**artefact.actuator)
    model = make_model(actuator, options_of(artefact), actuator.mirror)
    missing = [name for name in model.names if name not in artefact.parameters]
    if missing:
        raise InputError(
            f"model '{artefact.name}': model.json lacks the parameter {missing[0]}; fit it again with --force"
        )
    return replace(model, order=artefact.order), np.array([artefact.parameters[name].value for name in model.names])
