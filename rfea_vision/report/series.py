"""What the page draws: the series of every experiment and rung, thinned to what a screen can show."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from rfea_vision.arrays import stretches
from rfea_vision.artefacts import Comparison
from rfea_vision.artefacts.reasons import reason_of
from rfea_vision.report.collect import Evidence, Experiment, LadderStep
from rfea_vision.report.formatting import inner_title, listing
from rfea_vision.report.pack import Pack, nearest
from rfea_vision.report.shown import error_over_time, errors_of, offsets_tried

MOST_SAMPLES = 2400  # rows of a time series
MOST_COLUMNS = 600  # time steps of a carpet
MOST_POSES = 900  # tube outlines, one per frame of the clip where there is one
MOST_LOG = 4000  # samples of the pressure log

_NOUNS = {
    "midline": "centre line",
    "elongation": "elongation of its segments",
    "width": "width of the tube",
    "hinge_length": "length of the tube's inner side",
    "tip_sigma": "standard error of the tip",
    "seen": "share of the edges that was seen",
    "blur": "blur of its edges",
}
_UNASKED = ("edges", "elongation_sigma", "markers", "markers_sigma", "lamp")  # series of which nobody is told that they are missing


def pack_experiment(experiment: Experiment, pack: Pack) -> dict[str, Any]:
    """Measured series of one experiment, with a sentence under ``why`` for each that is missing."""
    data = experiment.measured
    record: dict[str, Any] = {
        "name": experiment.name, "role": experiment.role, "why": dict(experiment.absent), "clip": None, "gaps": [],
    }  # fmt: skip
    if data is None:
        return record
    time = data["time"].values
    rows, columns = pack.rows(len(time), MOST_SAMPLES), pack.rows(len(time), MOST_COLUMNS)
    poses = _pose_rows(experiment, data, pack)
    record |= {"span": [float(time[0]), float(time[-1])], "t": pack.add(time[rows]), "tc": pack.add(time[columns])}
    record |= {"tp": pack.add(time[poses]), "gaps": _gaps(data), "repeat_of": data.attrs.get("repeat_of"), "turned": _turned(data)}
    for key, name, chosen in (
        ("tip", "tip", rows), ("tip_sigma", "tip_sigma", rows), ("angle", "bend_angle", rows), ("midline", "midline", poses),
        ("edges", "edges", poses), ("elongation", "elongation", columns), ("elongation_sigma", "elongation_sigma", columns),
        ("markers", "marker_elongation", columns), ("markers_sigma", "marker_elongation_sigma", columns), ("lamp", "lamp", rows),
        ("width", "width", columns), ("hinge", "hinge_length", columns), ("seen", "seen", rows), ("blur", "blur", rows),
    ):  # fmt: skip
        if name in data and np.isfinite(data[name].values).any():
            record[key] = pack.add(data[name].values[chosen])
        elif key not in _UNASKED:
            record["why"][key] = _lacking(experiment.name, name, data)
    if "pressure" in data:
        log_time, pressure = data["log_time"].values, data["pressure"].values
        kept = pack.rows(len(log_time), MOST_LOG)
        record |= {"lt": pack.add(log_time[kept]), "lp": pack.add(pressure[kept])}
        record["p"] = pack.add(pressure[nearest(log_time, time[rows])])
    else:
        named = "name its log (`pressure: {file: pressure.csv}`) and run `rfea sync`"
        record["why"]["pressure"] = f"{experiment.name} has no pressure on its clock yet: {named}."
    if (offsets := offsets_tried(data)) is not None:
        chosen_ms, error_ms = (1000 * float(data.attrs.get(key, 0.0)) for key in ("offset_s", "offset_stderr_s"))
        record["offsets"] = {"ms": pack.add(offsets[0]), "explained": pack.add(offsets[1]), "chosen": chosen_ms, "error": error_ms}
    else:
        method = str(data.attrs.get("sync_method", "")).replace("_", " ")
        record["why"]["offsets"] = (
            f"{experiment.name} was aligned by {method or 'nothing yet'}: only an alignment by motion tries offsets."
        )
    if "midline" not in data and "tip" not in data:
        record["why"]["clip"] = "Only the bend angle was measured, so the tube drawn is the modelled one."
    if experiment.clip is not None:
        record["clip"] = {
            key: experiment.clip_info[key] for key in ("x_min_mm", "y_max_mm", "px_per_mm", "width", "height")
        }
        record["clip"] |= {"frames": len(experiment.clip_info["times_s"]), "step": _clip_step(experiment, pack)}
    return record


def _turned(data: xr.Dataset) -> str:
    """That the picture is not as the rig stood, in the reader's words; empty where the tube hangs, or nothing pulls in its plane."""
    down = np.deg2rad(float(data.attrs.get("gravity_deg", 0.0)))
    if np.cos(down) > np.sqrt(0.5):
        return ""
    aside = "left" if (np.sin(down) > 0) == (data.attrs.get("bends") != "right") else "right"
    way = "up" if np.cos(down) < -np.sqrt(0.5) else f"to the {aside}"
    return f"Drawn with the tube at rest pointing down: gravity points {way} here."


def _lacking(run: str, name: str, data: xr.Dataset) -> str:
    """Why a series is not there, in the reader's words."""
    noun = _NOUNS.get(name, name.replace("_", " "))
    if name == "elongation" and (absent := str(data.attrs.get("elongation_assumption", ""))).startswith("absent: "):
        return f"The track of {run} does not give the {noun}: {absent.removeprefix('absent: ')}."
    if "tip" not in data and "midline" not in data:
        return f"{run} has no {noun}: only its bend angle was measured."
    return f"The track of {run} does not give the {noun}{'' if 'edges' in data else ': it came from another tool'}."


def _clip_step(experiment: Experiment, pack: Pack) -> int:
    return max(1, -(-len(experiment.clip_info["times_s"]) // round(pack.detail * MOST_POSES)))


def _pose_rows(experiment: Experiment, data: xr.Dataset, pack: Pack) -> np.ndarray:
    """Rows whose outlines are kept: the frames of the clip, found by the camera's clock, or an even choice."""
    if experiment.clip is None:
        return pack.rows(data.sizes["time"], MOST_POSES // 3)
    frames = np.asarray(experiment.clip_info["times_s"], dtype=float)[:: _clip_step(experiment, pack)]
    offset_s, drift = float(data.attrs.get("offset_s", 0.0)), 1e-6 * float(data.attrs.get("drift_ppm", 0.0))
    return nearest((data["time"].values - offset_s) / (1 + drift), frames)  # on the camera's clock


def _gaps(data: xr.Dataset) -> list[dict[str, object]]:
    """Stretches of frames that were set aside for one reason."""
    time, valid, reason = data["time"].values, data["valid"].values.astype(bool), data["reason"].values.astype(str)
    out = []
    for start, stop in zip(*stretches(~valid), strict=True):
        splits = [start, *(start + 1 + np.flatnonzero(reason[start + 1 : stop] != reason[start : stop - 1])), stop]
        for a, b in pairwise(splits):
            why = reason_of(str(reason[a])).words
            out.append({"from": float(time[a]), "to": float(time[b - 1]), "frames": int(b - a), "reason": why})
    return out


def pack_prediction(step: LadderStep, experiment: Experiment, pack: Pack) -> dict[str, Any]:
    """Modelled series of one experiment on one rung, on the same rows as the measured ones."""
    why: dict[str, str] = dict(step.absent)
    modelled = step.predictions.get(experiment.name)
    data = experiment.measured
    if modelled is None or data is None:
        note = "was not predicted"
        if experiment.role == "test":
            note = "was kept for the final score of the first and the last rung; it was not predicted"
        why.setdefault("prediction", f"{experiment.name} {note} by {step.rung.model}.")
        return {"why": why}
    return pack_modelled(modelled, data, experiment, pack, why, step.rung.model)


def pack_modelled(
    modelled: xr.Dataset, data: xr.Dataset, experiment: Experiment, pack: Pack, why: dict[str, str], model: str
) -> dict[str, Any]:
    """Series of one prediction for an experiment whose measurement is `data`; `why` is added to."""
    time = data["time"].values
    kinds = {"series": pack.rows(len(time), MOST_SAMPLES), "carpet": pack.rows(len(time), MOST_COLUMNS)}
    kinds["pose"] = _pose_rows(experiment, data, pack)
    where = {kind: nearest(modelled["time"].values, time[rows]) for kind, rows in kinds.items()}
    shown = np.flatnonzero(np.isfinite(modelled["bend_angle"].values)) if "bend_angle" in modelled else np.zeros(0, int)
    if shown.size:  # frames that the fit left out have no modelled tube: the nearest that has is drawn
        where["pose"] = shown[nearest(modelled["time"].values[shown], time[kinds["pose"]])]
    record: dict[str, Any] = {"why": why}
    for key, name, kind in (
        ("tip", "tip", "series"),
        ("angle", "bend_angle", "series"),
        ("gap", "tip_residual", "series"),
        ("midline", "midline", "pose"),
        ("carpet", "normal_residual", "carpet"),
        ("torque", "residual_torque", "carpet"),
        ("torque_sigma", "residual_torque_sigma", "carpet"),
        ("elongation", "elongation", "carpet"),
    ):
        if name in modelled and np.isfinite(modelled[name].values).any():
            record[key] = pack.add(modelled[name].values[where[kind]])
        else:
            why[key] = f"prediction.nc of {model} has no {name.replace('_', ' ')} for {experiment.name}."
            if key in ("carpet", "gap", "midline") and "midline" not in data:
                why[key] = (
                    f"{experiment.name} was measured without a centre line, so its error along the tube is unknown."
                )
    for key, name in (("tip_band", "tip_stderr"), ("angle_band", "bend_angle_stderr")):
        if name in modelled:  # a result of an earlier version has none
            half = modelled[name].values * modelled[name].attrs["quantile_95"]
            record[key] = pack.add(half[where["series"]])
    if (error := error_over_time(modelled)) is not None:
        record |= {"error": pack.add(error[0][where["series"]]), "unit": error[1]}
    else:
        why["error"] = f"{experiment.name} has neither tip nor bend angle in prediction.nc of {model}."
    if "phase" in modelled:
        record["phase"] = _stretches(modelled["phase"].values.astype(str), modelled["time"].values)
    return record


def _stretches(labels: np.ndarray, time: np.ndarray) -> list[list[object]]:
    """Runs of equal labels as [label, from, to]."""
    starts = np.concatenate([[0], 1 + np.flatnonzero(labels[1:] != labels[:-1])])
    stops = np.concatenate([starts[1:], [len(labels) - 1]])
    return [[str(labels[a]), float(time[a]), float(time[b])] for a, b in zip(starts, stops, strict=True)]


def pack_step(step: LadderStep, evidence: Evidence, pack: Pack, titles: Mapping[str, str]) -> dict[str, Any]:
    """One rung: what it is called, how well it does, its tables for the bar charts, and its series."""
    fit, shown = step.fit, errors_of(step, evidence)
    comparison = step.comparison or Comparison(model=step.rung.model)
    return {
        "model": step.rung.model,
        "name": rung_name(step, titles),
        "ladder": step.on_ladder,
        "verdict": step.outcome,
        "unit": shown.unit,
        "train": shown.train,
        "validate": shown.validate,
        "floor": shown.floor,
        "tested": list((evidence.ladder.test or {}).get("experiments") or {}) if evidence.ladder else [],
        "phases": comparison.by_phase,
        "pressures": comparison.by_pressure,
        "segments": comparison.by_segment,
        "worst": [place.model_dump(mode="json") for place in comparison.where],
        "torque": comparison.residual_torque,
        "profiles": comparison.elongation.get("profiles", []),
        "correlation": fit.correlation,
        "steady": fit.steady_state,
        "starts": fit.starts,
        "next": step.next_pressure,
        "study": fit.segments_study,
        "likelihood": fit.profiles,
        "seconds": dict(step.study_seconds),
        "why": dict(step.absent),
        "experiments": {e.name: pack_prediction(step, e, pack) for e in evidence.experiments},
    }


def with_rivals(step: LadderStep, titles: Mapping[str, str]) -> str:
    """The effect that a rung adds, with those that the data cannot tell it from; a stand-in is called one."""
    added = step.rung.added or ""
    rivals = [inner_title(titles.get(effect, effect.replace("_", " "))) for effect in step.rung.tied]
    name = titles.get(added, added) + (f" ({step.fit.segments})" if added == "segments" else "")
    name += f", or {listing(rivals, 'or')}" if rivals else ""
    return f"{name} (a stand-in)" if step.rung.grade == "stand-in" else name


def rung_name(step: LadderStep, titles: Mapping[str, str]) -> str:
    """In the reader's words: the paper's model first, then what each rung adds."""
    if step.on_ladder:
        return with_rivals(step, titles) if step.rung.added else "The model of the paper"
    added = " and ".join(inner_title(titles.get(effect, effect)) for effect in step.fit.effects)
    name = f"With {added}" if added else "The model of the paper"
    usual = "+".join(("base", *step.fit.effects))
    return name if step.rung.model == usual else f"{name} ({step.rung.model})"
