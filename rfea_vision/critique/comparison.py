"""Where a model fails: by phase, pressure, place and experiment, beside the noise floor, and the worst places in words."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, TypedDict

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import chdtri

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import Comparison, Metrics, ModelFit, WorstPlace
from rfea_vision.artefacts.measurement import CHOOSING_ROLES, Recording
from rfea_vision.artefacts.rows import LEFT_BY_A_MODEL, GoesWith, PhaseRow, PressureRow, SegmentRow
from rfea_vision.critique.elongation import describe_elongation
from rfea_vision.critique.phases import label_phases
from rfea_vision.critique.torque import all_residual_torques, summarise_torque
from rfea_vision.fitting.noise import white_noise_mm
from rfea_vision.fitting.odd_pressure import about_odd_pressure
from rfea_vision.fitting.scoring import worse_than_nothing
from rfea_vision.units import rounded

WORST_PLACES = 5  # listed; a page has room for no more
WINDOW_S = 0.25  # over which the error is averaged: about one swing of the paper's tube
LEAST_FRAMES = 3  # in a window
STANDS_OUT = 1.2  # times what is left elsewhere
BY_CHANCE = 0.01  # share of runs of nothing but white noise in which a window would stand out
PRESSURE_BANDS = 6  # of the error over pressure; each still has frames of every phase in a run of 6 s
PLACES = 8  # parts of the tube, for its error along it: bars that can be read beside one another


def _gap(dataset: xr.Dataset, recording: xr.Dataset) -> FloatArray:
    """Measured minus modelled (frames, nodes, 2) in mm of the centre line, of the tip alone (nodes 1), or (.., 1, 1) the angle in deg.

    NaN in frames that are not scored.
    """
    seen = next(key for key in ("midline", "tip", "bend_angle") if key in recording)
    gap = recording[seen].values - dataset[seen].values
    gap = gap if seen == "midline" else gap.reshape(len(gap), 1, -1)
    return np.where(dataset["scored"].values.astype(bool)[:, None, None], gap, np.nan)


def _row_means(square: FloatArray) -> FloatArray:
    """Mean over the finite nodes of each frame; NaN where there is none."""
    good = np.isfinite(square)
    count = good.sum(axis=1)
    return np.where(count > 0, np.where(good, square, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


def _rms(values: FloatArray) -> float | None:
    good = values[np.isfinite(values)]
    return float(np.sqrt(good.mean())) if good.size else None


def _worst(
    name: str,
    time: FloatArray,
    square: FloatArray,
    sigma: FloatArray,
    phase: NDArray[np.str_],
    floor: float | None,
    noise: float,
    unit: str,
) -> list[WorstPlace]:
    """Stretches of time whose error stands out: windows of a quarter second, neighbours in the same phase joined.

    Of the noise `floor`, or, where that is not known, of the run's other windows and of its white `noise`: what a model leaves is no
    floor out of which its own error could stand.
    """
    last, per_frame = time[-1], _row_means(square)
    windows = []
    for start in np.arange(time[0], last, WINDOW_S):
        inside = (time >= start) & (time < start + WINDOW_S) & np.isfinite(per_frame)
        if (count := int(inside.sum())) >= LEAST_FRAMES:
            values, counts = np.unique(phase[inside], return_counts=True)
            error = float(np.sqrt(per_frame[inside].mean()))
            windows.append((error, start, min(start + WINDOW_S, last), str(values[counts.argmax()]), count))
    if not windows:
        return []
    usual = float(np.median([window[0] for window in windows]))
    joined: list[tuple[float, float, Any]] = []  # from, to (s), and the phase
    for error, start, stop, label, count in windows:
        numbers = count * (2 if unit == "mm" else 1)
        by_chance = np.sqrt(chdtri(numbers, BY_CHANCE / len(windows)) / numbers) * (floor or noise)
        if error < max(STANDS_OUT * usual, by_chance):
            continue
        if joined and joined[-1][2] == label and start - joined[-1][1] < 1e-6:
            joined[-1] = (joined[-1][0], stop, label)
        else:
            joined.append((start, stop, label))
    places = []
    for start, stop, label in joined:
        rows = square[(time >= start) & (time <= stop)]
        rms = _rms(_row_means(rows))
        if rms is None:
            continue
        along = _row_means(rows.T)
        bad = np.flatnonzero(along >= 0.5 * np.nanmax(along))
        low, high = float(sigma[bad[0]]), float(sigma[bad[-1]])
        times = f", {rounded(rms / floor)} times the noise floor" if floor else ""
        if not floor and usual > 0:
            times = f", {rounded(rms / usual)} times the median of this run"
        where = f"from {100 * low:.0f} to {100 * high:.0f} % of the tube's length"
        if low > 0.9:
            where = "at the tip" if unit == "mm" else "in the bend angle"
        article = {"ringing": "while ringing", "reversal": "at a reversal", "rest": "at rest"}.get(
            label, f"during a {label}"
        )
        norm = "RMS along the tube" if unit == "mm" and sigma.size > 1 else "RMS"
        sentence = (
            f"{name}: {rounded(rms)} {unit} {norm} between {start:.2f} and {stop:.2f} s {article}, {where}{times}."
        )
        places.append(
            WorstPlace(
                experiment=name,
                from_s=float(start),
                to_s=float(stop),
                from_sigma=low,
                to_sigma=high,
                **_in_unit(rms, unit),
                phase=label,
                sentence=sentence,
            )  # type: ignore[arg-type]
        )
    return places


def compare(model: ModelFit, recordings: Mapping[str, Recording], predictions: Mapping[str, xr.Dataset]) -> Comparison:
    """Compare a fitted model with the training and validation recordings (test runs are left alone)."""
    by_phase: list[PhaseRow] = []
    where = []
    pressures, squares, places, biases, noises = [], [], [], [], []
    compared = [name for name in predictions if recordings[name].role in CHOOSING_ROLES]
    units = {name: "mm" if {"tip", "midline"} & set(recordings[name].dataset) else "deg" for name in compared}
    unit = units[compared[0]] if compared else "mm"
    floor = model.noise_floor_mm if unit == "mm" else model.noise_floor_deg
    floor = None if model.noise_floor_source == LEFT_BY_A_MODEL else floor
    for name in compared:
        if units[name] != unit:  # mm and deg are not pooled: such a run has its scores alone
            continue
        dataset, recording = predictions[name], recordings[name]
        data = recording.dataset
        gap = _gap(dataset, data)
        square, sigma = np.sum(gap**2, axis=2), np.linspace(0, 1, gap.shape[1]) if gap.shape[1] > 1 else np.ones(1)
        time = data["time"].values
        pressure = np.interp(time, data["log_time"].values, data["pressure"].values)
        phase = label_phases(time, pressure, np.nan_to_num(dataset["bend_angle"].values.astype(float)))
        per_frame = _row_means(square)
        total = float(np.nansum(per_frame))
        for label in dict.fromkeys(phase.tolist()):
            inside = phase == label
            by_phase.append(
                {
                    "experiment": name,
                    "role": recording.role,
                    "phase": label,
                    **_in_unit(_rms(per_frame[inside]), unit),
                    "share": float(np.nansum(per_frame[inside])) / total if total > 0 else 0.0,
                    "frames": int(inside.sum()),
                }
            )
        noises.append(white_noise_mm(gap[:, -1]))
        where += _worst(name, time, square, sigma, phase, floor, noises[-1], unit)
        pressures.append(pressure)
        squares.append(per_frame)
        if "normal_residual" in dataset:
            places.append(square)
            biases.append(dataset["normal_residual"].values)
    torque = summarise_torque(list(all_residual_torques(model, recordings).values()))
    where.sort(key=lambda p: -p.rmse)
    comparison = Comparison(
        model=model.name,
        noise_floor_mm=model.noise_floor_mm,
        by_phase=by_phase,
        by_pressure=_by_pressure(pressures, squares, unit),
        by_segment=_by_segment(places, biases),
        where=where[:WORST_PLACES],
        residual_torque=torque,
        elongation=describe_elongation(recordings, predictions),
    )
    noise = floor or float(np.sqrt(np.mean(np.square(noises or [0.0]))))
    return comparison.model_copy(update={"sentences": _sentences(model, comparison, unit, noise)})


#: A dependence that explains less than this share of the residual torque's variance is not worth a word.
WORTH_A_WORD = 0.05


def goes_with(comparison: Comparison) -> list[GoesWith]:
    """What the residual torque depends on, as a diagnosis says it, best first."""
    ranked = comparison.residual_torque.get("depends_on") or []
    return [{"what": row["what"], "r2": row["score"]} for row in ranked if row["score"] >= WORTH_A_WORD]


class _InUnit(TypedDict):
    rmse_mm: float | None
    rmse_deg: float | None


def _in_unit(error: float | None, unit: str) -> _InUnit:
    """An error under the name of its unit; the other is null."""
    return {"rmse_mm": error if unit == "mm" else None, "rmse_deg": error if unit == "deg" else None}


def _by_pressure(pressures: list[FloatArray], squares: list[FloatArray], unit: str) -> list[PressureRow]:
    if not pressures:
        return []
    pressure, square = np.concatenate(pressures), np.concatenate(squares)
    edges = np.linspace(pressure.min(), pressure.max(), PRESSURE_BANDS + 1)
    rows: list[PressureRow] = []
    for low, high in pairwise(edges):
        inside = (pressure >= low) & (pressure <= high)
        rows.append(
            {
                "from_kPa": float(low),
                "to_kPa": float(high),
                **_in_unit(_rms(square[inside]), unit),
                "frames": int(inside.sum()),
            }
        )
    return rows


def _by_segment(squares: list[FloatArray], residuals: list[FloatArray]) -> list[SegmentRow]:
    if not squares:
        return []
    nodes = min(s.shape[1] for s in squares)
    square, residual = (
        np.concatenate([s[:, :nodes] for s in squares]),
        np.concatenate([r[:, :nodes] for r in residuals]),
    )
    parts = np.array_split(np.arange(nodes), min(PLACES, nodes))
    return [
        {  # a node stands for the line halfway to its neighbours
            "from_sigma": max((float(part[0]) - 0.5) / (nodes - 1), 0.0),
            "to_sigma": min((float(part[-1]) + 0.5) / (nodes - 1), 1.0),
            "rmse_mm": _rms(square[:, part]),
            "bias_mm": float(np.nanmean(residual[:, part])),
        }
        for part in parts
    ]


def _at_the_floor(scores: Metrics | None, noise: float, unit: str) -> bool:
    """Whether no more is left than noise, of which a torque is no gap to be closed."""
    error = scores and (scores.tip_rmse_mm if unit == "mm" else scores.angle_rmse_deg)
    return error is not None and error < STANDS_OUT * noise


def _sentences(model: ModelFit, comparison: Comparison, unit: str, noise: float) -> list[str]:
    out = []
    held = model.metrics.get("validate") or model.metrics.get("train")
    kind = "held-out" if "validate" in model.metrics else "training"
    if held is not None and held.tip_rmse_mm is not None:
        share = held.tip_rmse_percent_of_length or 0.0
        out.append(
            f"The tip of model {model.name} is off by {rounded(held.tip_rmse_mm)} mm RMS on {kind} runs "
            f"({rounded(share)} % of the length)."
        )
    elif held is not None and held.angle_rmse_deg is not None:
        out.append(f"The angle of model {model.name} is off by {rounded(held.angle_rmse_deg)} deg RMS on {kind} runs.")
    totals: dict[str, float] = {}
    for row in comparison.by_phase:
        if (error := row["rmse_mm" if unit == "mm" else "rmse_deg"]) is not None:
            totals[row["phase"]] = totals.get(row["phase"], 0.0) + error**2 * row["frames"]
    if totals and sum(totals.values()) > 0:
        worst = max(totals, key=lambda key: totals[key])
        out.append(
            f"{100 * totals[worst] / sum(totals.values()):.0f} % of the squared error falls into the phase '{worst}'."
        )
    out += [place.sentence for place in comparison.where[:2]]
    out += about_odd_pressure(model.experiments)
    ranked = comparison.residual_torque.get("depends_on") or []
    torque = comparison.residual_torque.get("rms_mNm")
    if model.meets_no_run:  # a torque by such parameters tells nothing
        out += worse_than_nothing(model.experiments)
    elif ranked and torque is not None and ranked[0]["score"] > 0.15 and not _at_the_floor(held, noise, unit):
        out.append(f"The torque that would close the gap is {rounded(torque)} mN m RMS; " + ranked[0]["sentence"])
    return out
