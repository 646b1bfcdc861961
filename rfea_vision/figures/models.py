"""The figures of a model over all runs, of the ladder, and of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import pandas as pd

from rfea_vision.artefacts.rows import CalibrationQuality, ElongationProfile, StudyRow
from rfea_vision.figures.plates import Axis, Bars, Map, Plate, Role, Series, lines
from rfea_vision.figures.runs import ALONG, run_plates, tip_path
from rfea_vision.report.collect import Evidence, LadderStep
from rfea_vision.report.prose import effect_titles
from rfea_vision.report.series import rung_name
from rfea_vision.report.shown import errors_of


def plates(evidence: Evidence, model: str | None = None) -> list[Plate]:
    """Every figure of a campaign for one model, the last of the ladder unless another is named."""
    steps = [step for step in evidence.steps if model is None or step.rung.model == model]
    climbed = [step for step in steps if step.on_ladder] or steps
    step = climbed[-1] if climbed else None
    found = [plate for experiment in evidence.experiments for plate in run_plates(experiment, step)]
    if step is not None:
        found += [*_ladder(evidence), *_paths(evidence, step), *_by_kind(step, evidence), *_fit(step)]
    return found + _camera(evidence)


def _ladder(evidence: Evidence) -> list[Plate]:
    """Errors by rung, training and held out, beside the noise floor; fits beside the ladder are none of it."""
    titles = effect_titles(evidence)
    shown = [errors_of(step, evidence) for step in evidence.climbed]
    if not shown:
        return []
    names = tuple(rung_name(step, titles) for step in evidence.climbed)
    kinds = (("training", "train"), ("held out", "validate"), ("noise floor", "floor"))
    sets = tuple((label, np.array([getattr(item, key) for item in shown], dtype=float)) for label, key in kinds)
    return [Bars("ladder", "The ladder of models", names, Axis("error", shown[-1].unit), sets, log_y=True, wide=True)]


def _paths(evidence: Evidence, step: LadderStep) -> list[Plate]:
    found: list[Plate] = []
    for name, role, title in (("train", "train", "training runs"), ("validate", "validate", "held-out runs")):
        series: list[Series | None] = []
        for experiment in evidence.experiments:
            if experiment.role == role and experiment.measured is not None:
                run, modelled = experiment.name, step.predictions.get(experiment.name)
                series.append(tip_path(experiment.measured, f"{run}, measured", "measured"))
                series.append(tip_path(modelled, f"{run}, modelled", "modelled"))
        path = f"Path of the tip, {title}"
        found += lines(f"paths-{name}", path, Axis("x", "mm"), Axis("y", "mm"), series, equal=True)
    return found


def _by_kind(step: LadderStep, evidence: Evidence) -> list[Plate]:
    """The error by phase, by pressure and by place."""
    comparison = step.comparison
    if comparison is None:
        return []
    axis, found = Axis("error", errors_of(step, evidence).unit), []
    key: Literal["rmse_deg", "rmse_mm"] = "rmse_deg" if axis.unit == "deg" else "rmse_mm"
    if comparison.by_phase:
        errors = {(row["experiment"], row["phase"]): row[key] for row in comparison.by_phase}
        runs, phases = (tuple(dict.fromkeys(names)) for names in zip(*errors, strict=True))
        sets = tuple((run, np.array([errors.get((run, phase)) for phase in phases], dtype=float)) for run in runs)
        found.append(Bars("phases", "Error by phase of the pressure", phases, axis, sets, Axis("phase"), wide=True))
    if comparison.by_pressure:
        bands = tuple(f"{round(row['from_kPa'])} to {round(row['to_kPa'])}" for row in comparison.by_pressure)
        values = np.array([row[key] for row in comparison.by_pressure], dtype=float)
        found.append(Bars("pressures", "Error by pressure", bands, axis, (("error", values),), Axis("pressure", "kPa")))
    if comparison.by_segment:
        places = tuple(f"{(row['from_sigma'] + row['to_sigma']) / 2:.2f}" for row in comparison.by_segment)
        sets = (("error", np.array([row["rmse_mm"] for row in comparison.by_segment], dtype=float)),)
        found.append(Bars("segments", "Error by place along the tube", places, Axis("error", "mm"), sets, ALONG))
    return found + _profiles(comparison.elongation.get("profiles", []))


def _profiles(profiles: Sequence[ElongationProfile]) -> list[Plate]:
    series = []
    for item in profiles:
        label, place = f"{item['pressure_kPa']:.0f} kPa", np.array(item["position"])
        measured, modelled = (100.0 * np.array(item[key], dtype=float) for key in ("measured", "modelled"))
        series.append(Series(f"{label}, measured", "dots", place, measured))
        series.append(Series(f"{label}, modelled", "modelled", place, modelled))
    return lines("profiles", "Elongation along the tube", ALONG, Axis("elongation", "%"), series, wide=True)


def _fit(step: LadderStep) -> list[Plate]:
    """What is known of the fit itself: correlations, steady state, starts, studies."""
    fit, found = step.fit, []
    if fit.correlation.get("matrix"):
        names, matrix = tuple(fit.correlation.get("names", ())), np.array(fit.correlation.get("matrix"), dtype=float)
        count, nothing, value = np.arange(len(names), dtype=float), Axis(""), Axis("correlation")
        shown = Map("correlation", "Correlations", nothing, nothing, value, count, count, matrix, True, True, names)
        found.append(shown)
    rest = [np.array(fit.steady_state.get(key, []), dtype=float) for key in ("pressure_kPa", "angle_deg", "fitted_angle_deg")]
    if all(values.size for values in rest):
        pressure, measured, fitted = (values[np.argsort(rest[0])] for values in rest)
        both = [Series("measured", "dots", pressure, measured), Series("fitted", "rings", pressure, fitted)]
        found += lines("steady", "Steady state", Axis("pressure", "kPa"), Axis("bend angle at rest", "deg"), both)
    if fit.starts:
        costs = np.sort([cost for item in fit.starts if (cost := item["cost"]) is not None])
        start = [Series("cost", "dots", np.arange(1.0, len(costs) + 1), costs / costs[0])]
        x, y = Axis("start, best first"), Axis("final cost")
        found += lines("starts", "Starts of the fit", x, y, start, log_y=True, whole_x=True)
    found += _study(fit.segments_study)
    for name, profile in fit.profiles.items():
        axis, rise = Axis(name, str(profile["unit"])), np.asarray(profile["delta"], dtype=float)
        curve = [Series("rise of the misfit", "measured", np.asarray(profile["value"], dtype=float), rise)]
        title = f"Profile likelihood of {name}"
        found += lines(f"likelihood-{name.replace('.', '-')}", title, axis, Axis("rise of the misfit"), curve)
    if step.next_pressure is not None:
        time, pressure = (np.asarray(item, dtype=float) for item in step.next_pressure)
        command = [Series("pressure", "modelled", time, pressure)]
        title, x, y = "The experiment to run next", Axis("time", "s"), Axis("pressure", "kPa")
        found += lines("next", title, x, y, command, wide=True)
    return found


def _study(rows: Sequence[StudyRow]) -> list[Plate]:
    """The error over the number of segments: of the tip, or where only angles were measured, of the angle."""
    table = pd.DataFrame(rows)
    tip = table.filter(["train_tip_rmse_mm", "validate_tip_rmse_mm"]).notna().any(axis=None)
    key, error = ("tip_rmse_mm", Axis("tip error", "mm")) if tip else ("angle_rmse_deg", Axis("angle error", "deg"))
    sets: tuple[tuple[str, str, Role], ...] = (("train", "training", "rings"), ("validate", "held out", "dots"))
    series = [
        Series(name, mark, table["segments"].to_numpy(float), table[f"{role}_{key}"].to_numpy(float))
        for role, name, mark in sets
        if f"{role}_{key}" in table
    ]
    title, segments = "Error against the number of segments", Axis("number of segments")
    return lines("study", title, segments, error, series, log_y=True, whole_x=True)


def _camera(evidence: Evidence) -> list[Plate]:
    quality: CalibrationQuality = (evidence.camera or {}).get("quality") or {}
    x, y, found = Axis("x", "px"), Axis("y", "px"), []
    if field := quality.get("uncertainty_map"):
        title, value = "Uncertainty of a point in the plane", Axis("standard error", "mm")
        across, down, sigma = (np.array(field[key], dtype=float) for key in ("x_px", "y_px", "sigma_mm"))
        most = 10.0 * float(np.nanmedian(sigma)) if np.isfinite(sigma).any() else None  # beyond the photos it grows without end
        found.append(Map("uncertainty", title, x, y, value, across, down, sigma, y_down=True, most=most))
    if seen := quality.get("coverage"):
        across, down, counts = (np.array(seen[key], dtype=float) for key in ("x_edges_px", "y_edges_px", "counts"))
        across, down = ((edges[1:] + edges[:-1]) / 2 for edges in (across, down))
        found.append(Map("coverage", "Places of the board", x, y, Axis("corners seen"), across, down, counts, y_down=True))
    if photos := quality.get("residual_fields"):
        names, rms = tuple(photo["file"] for photo in photos), np.array([photo["rms_px"] for photo in photos])
        found.append(Bars("photos", "Corners that do not fit", names, Axis("RMS", "px"), (("RMS", rms),), wide=True))
    return found
