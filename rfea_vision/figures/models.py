"""The figures of a model over all runs, of the ladder, and of the camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rfea_vision.figures.plates import Axis, Bars, Map, Plate, Role, Series, lines
from rfea_vision.figures.runs import run_plates, tip_path
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
    sets = tuple(
        (label, np.array([np.nan if (v := getattr(item, key)) is None else v for item in shown], dtype=float))
        for label, key in kinds
    )
    return [Bars("ladder", "The ladder of models", names, Axis("error", shown[-1].unit), sets, log_y=True, wide=True)]


def _paths(evidence: Evidence, step: LadderStep) -> list[Plate]:
    found: list[Plate] = []
    for name, role, title in (("train", "train", "training runs"), ("validate", "validate", "held-out runs")):
        series: list[Series | None] = []
        for experiment in evidence.experiments:
            if experiment.role == role and experiment.measured is not None:
                series.append(tip_path(experiment.measured, f"{experiment.name}, measured", "measured"))
                series.append(
                    tip_path(step.predictions.get(experiment.name), f"{experiment.name}, modelled", "modelled")
                )
        found += lines(
            f"paths-{name}", f"Path of the tip, {title}", Axis("x", "mm"), Axis("y", "mm"), series, equal=True
        )
    return found


def _by_kind(step: LadderStep, evidence: Evidence) -> list[Plate]:
    """The error by phase, by pressure and by place."""
    comparison = step.comparison
    if comparison is None:
        return []
    unit = errors_of(step, evidence).unit
    axis = Axis("error", unit)
    found: list[Plate] = []
    rows = comparison.by_phase
    if rows:
        phases = tuple(dict.fromkeys(str(row["phase"]) for row in rows))
        runs = tuple(dict.fromkeys(str(row["experiment"]) for row in rows))
        sets = tuple(
            (run, np.array([_error(rows, unit, experiment=run, phase=phase) for phase in phases])) for run in runs
        )
        found.append(Bars("phases", "Error by phase of the pressure", phases, axis, sets, Axis("phase"), wide=True))
    if comparison.by_pressure:
        bands = tuple(f"{round(row['from_kPa'])} to {round(row['to_kPa'])}" for row in comparison.by_pressure)
        values = np.array([_number(row, unit) for row in comparison.by_pressure])
        found.append(Bars("pressures", "Error by pressure", bands, axis, (("error", values),), Axis("pressure", "kPa")))
    if comparison.by_segment:
        places = tuple(f"{(row['from_sigma'] + row['to_sigma']) / 2:.2f}" for row in comparison.by_segment)
        values = np.array([_number(row, "mm") for row in comparison.by_segment])
        place = Axis("place along the tube, clamp 0, tip 1")
        found.append(
            Bars("segments", "Error by place along the tube", places, Axis("error", "mm"), (("error", values),), place)
        )
    return found + _profiles(comparison.elongation.get("profiles") or [])


def _number(row: Mapping[str, Any], unit: str) -> float:
    value = row.get(f"rmse_{unit}")
    return np.nan if value is None else float(value)


def _error(rows: Sequence[Mapping[str, Any]], unit: str, **wanted: str) -> float:
    fitting = [row for row in rows if all(row[key] == value for key, value in wanted.items())]
    return _number(fitting[0], unit) if fitting else np.nan


def _profiles(profiles: Sequence[Mapping[str, Any]]) -> list[Plate]:
    series: list[Series | None] = []
    for item in profiles:
        label, place = f"{item['pressure_kPa']:.0f} kPa", np.asarray(item["position"], dtype=float)
        strokes: tuple[tuple[str, Role], ...] = (("measured", "dots"), ("modelled", "modelled"))
        for key, role in strokes:
            if item.get(key) is not None:
                series.append(Series(f"{label}, {key}", role, place, 100.0 * np.asarray(item[key], dtype=float)))
    place = Axis("place along the tube, clamp 0, tip 1")
    return lines("profiles", "Elongation along the tube", place, Axis("elongation", "%"), series, wide=True)


def _fit(step: LadderStep) -> list[Plate]:
    """What is known of the fit itself: correlations, steady state, starts, studies."""
    fit, found = step.fit, []
    if fit.correlation.get("matrix"):
        names, matrix = tuple(fit.correlation.get("names", ())), np.asarray(fit.correlation.get("matrix"), dtype=float)
        count, nothing = np.arange(len(names), dtype=float), Axis("")
        value = Axis("correlation")
        found.append(
            Map("correlation", "Correlations", nothing, nothing, value, count, count, matrix, True, True, names)
        )
    rest = [np.asarray(fit.steady_state.get(key, []), dtype=float) for key in ("pressure_kPa", "angle_deg", "fitted_angle_deg")]
    if all(values.size for values in rest):
        pressure, measured, fitted = (values[np.argsort(rest[0])] for values in rest)
        both = [Series("measured", "dots", pressure, measured), Series("fitted", "rings", pressure, fitted)]
        found += lines("steady", "Steady state", Axis("pressure", "kPa"), Axis("bend angle at rest", "deg"), both)
    if fit.starts:
        costs = np.sort([cost for item in fit.starts if (cost := item["cost"]) is not None])
        start = [Series("cost", "dots", np.arange(1.0, len(costs) + 1), costs / costs[0])]
        found += lines(
            "starts",
            "Starts of the fit",
            Axis("start, best first"),
            Axis("final cost"),
            start,
            log_y=True,
            whole_x=True,
        )
    found += _study(fit.segments_study or [])
    for name, profile in fit.profiles.items():
        axis, rise = Axis(name, str(profile["unit"])), np.asarray(profile["delta"], dtype=float)
        curve = [Series("rise of the misfit", "measured", np.asarray(profile["value"], dtype=float), rise)]
        title = f"Profile likelihood of {name}"
        found += lines(f"likelihood-{name.replace('.', '-')}", title, axis, Axis("rise of the misfit"), curve)
    if step.next_pressure is not None:
        time, pressure = (np.asarray(item, dtype=float) for item in step.next_pressure)
        command = [Series("pressure", "modelled", time, pressure)]
        found += lines(
            "next", "The experiment to run next", Axis("time", "s"), Axis("pressure", "kPa"), command, wide=True
        )
    return found


def _study(rows: Sequence[Mapping[str, Any]]) -> list[Plate]:
    """The error over the number of segments: of the tip, or where only angles were measured, of the angle."""
    tip = any(np.isfinite(_nested(row, role, "tip_rmse_mm")) for row in rows for role in ("train", "validate"))
    key, error = ("tip_rmse_mm", Axis("tip error", "mm")) if tip else ("angle_rmse_deg", Axis("angle error", "deg"))
    count = np.array([float(row["segments"]) for row in rows])
    series: list[Series | None] = []
    marks: tuple[tuple[str, Role], ...] = (("train", "rings"), ("validate", "dots"))
    for role, mark in marks:
        values = np.array([_nested(row, role, key) for row in rows])
        series.append(Series("training" if role == "train" else "held out", mark, count, values))
    title, segments = "Error against the number of segments", Axis("number of segments")
    return lines("study", title, segments, error, series, log_y=True, whole_x=True) if rows else []


def _nested(row: Mapping[str, Any], role: str, key: str) -> float:
    value = row.get(f"{role}_{key}") if f"{role}_{key}" in row else (row.get(role) or {}).get(key)
    return np.nan if value is None else float(value)


def _camera(evidence: Evidence) -> list[Plate]:
    quality = (evidence.camera or {}).get("quality") or {}
    x, y, found = Axis("x", "px"), Axis("y", "px"), []
    field = quality.get("uncertainty_map")
    if field:
        values, value = np.asarray(field["sigma_mm"], dtype=float), Axis("standard error", "mm")
        across, down = (np.asarray(field[key], dtype=float) for key in ("x_px", "y_px"))
        found.append(
            Map("uncertainty", "Uncertainty of a point in the plane", x, y, value, across, down, values, y_down=True)
        )
    seen = quality.get("coverage")
    if seen:
        middles = [np.asarray(seen[key], dtype=float) for key in ("x_edges_px", "y_edges_px")]
        across, down = [(edges[1:] + edges[:-1]) / 2 for edges in middles]
        counts = np.asarray(seen["counts"], dtype=float)
        found.append(
            Map("coverage", "Places of the board", x, y, Axis("corners seen"), across, down, counts, y_down=True)
        )
    photos = quality.get("residual_fields") or []
    if photos:
        errors = np.array([float(item["rms_px"]) for item in photos])
        names = tuple(str(item["file"]) for item in photos)
        found.append(Bars("photos", "Corners that do not fit", names, Axis("RMS", "px"), (("RMS", errors),), wide=True))
    return found
