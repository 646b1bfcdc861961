# ruff: noqa: E501 (tables read better whole)
"""A made-up `rfea/` folder with everything a report can show: four experiments, three rungs, clips.

What matters is that every file has the shape, the names and the size of a real one.
``python -m testing.report.sample DIR`` writes one to look at.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import av
import cv2
import numpy as np
import xarray as xr

from rfea_vision.artefacts import Ladder, Recording, Track
from rfea_vision.calibration.storage import save_calibration
from rfea_vision.files import write_datasets
from testing.report.conclusions import calibration, comparison, diagnosis, model_fit
from testing.report.plant import (
    LENGTH_MM,
    NODES,
    NOISE_MM,
    RADIUS_MM,
    RATE_HZ,
    ROLES,
    RUNGS,
    SEGMENTS,
    experiment,
    normals,
    phases,
)


def track_dataset(e: dict) -> xr.Dataset:
    rng, line, count = e["rng"], e["measured"], len(e["time"])
    valid = np.ones(count, np.int8)
    reason = np.full(count, "", dtype=object)
    for start, length, why in ((700, 4, "touches_border"), (1100, 2, "width_off")):
        if start + length < count:
            valid[start : start + length] = 0
            reason[start : start + length] = why
    good = valid.astype(bool)
    out = normals(line) * RADIUS_MM
    edges = np.stack([line - out, line + out], axis=1)
    strain = RADIUS_MM * np.radians(e["theta"]) / (LENGTH_MM / SEGMENTS)
    values = {
        "valid": ("time", valid),
        "reason": ("time", reason.astype(str)),
        "midline": (("time", "node", "xy"), line),
        "midline_sigma": (("time", "node"), np.full((count, NODES), NOISE_MM)),
        "edges": (("time", "side", "node", "xy"), edges),
        "hinge_length": ("time", LENGTH_MM + rng.normal(0, 0.05, count) + 0.001 * e["theta"].sum(axis=1)),
        "seen": ("time", 1 - 0.02 * rng.random(count)),
        "blur": ("time", 1.2 + 0.1 * rng.random(count)),
        "width": (("time", "node"), 2 * RADIUS_MM + rng.normal(0, 0.03, (count, NODES))),
        "tip": (("time", "xy"), line[:, -1]),
        "tip_sigma": (("time", "xy"), np.full((count, 2), NOISE_MM) * (1 + 0.3 * rng.random((count, 1)))),
        "bend_angle": ("time", e["theta"].sum(axis=1) + rng.normal(0, 0.05, count)),
        "bend_angle_sigma": ("time", np.full(count, 0.05)),
        "elongation": (("time", "segment"), strain + rng.normal(0, 0.002, strain.shape)),
        "elongation_sigma": (("time", "segment"), np.full(strain.shape, 0.002)),
    }
    for key, (dims, array) in values.items():
        if np.asarray(array).dtype.kind == "f":
            array = np.array(array)
            array[~good] = np.nan
            values[key] = (dims, array)
    return xr.Dataset(
        values,
        coords={"time": e["time"], "side": ["inner", "outer"], "xy": ["x", "y"]},
        attrs={
            "units": "mm",
            "length_check": "the inextensible side keeps its length within 0.30 % over all postures",
        },
    )


def write_clip(folder: Path, e: dict, per_second: int = 30) -> None:
    step = round(RATE_HZ / per_second)
    x_min, y_max, scale, width, height = -160.0, 60.0, 1.6, 400, 360
    with av.open(str(folder / "clip.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=per_second)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": "27", "g": "8", "bf": "0"}
        shade = np.linspace(205, 160, width)[None, :].repeat(height, 0)
        for i in range(0, len(e["time"]), step):
            image = (shade + e["rng"].normal(0, 2, shade.shape)).astype(np.uint8)
            left, right, bottom = int((-14 - x_min) * scale), int((14 - x_min) * scale), int(y_max * scale)
            cv2.rectangle(image, (left, 0), (right, bottom), 90, -1)
            line = e["measured"][i]
            pixels = np.stack([(line[:, 0] - x_min) * scale, (y_max - line[:, 1]) * scale], axis=-1)
            thick = round(2 * RADIUS_MM * scale)
            cv2.polylines(image, [np.round(pixels * 16).astype(np.int32)], False, 45, thick, cv2.LINE_AA, 4)
            frame = av.VideoFrame.from_ndarray(np.repeat(image[..., None], 3, -1), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    record = {
        "file": "clip.mp4", "times_s": [float(t) for t in e["time"][::step] - e["offset"]], "x_min_mm": x_min,
        "y_max_mm": y_max, "px_per_mm": scale, "width": width, "height": height,
    }  # fmt: skip
    (folder / "clip.json").write_text(json.dumps(record))


def write_measurement(folder: Path, e: dict, *, video: bool) -> None:
    dataset = track_dataset(e)
    folder.mkdir(parents=True, exist_ok=True)
    Track(dataset.assign_coords(time=e["time"] - e["offset"])).save(folder / "track.nc")
    recording = dataset.assign(pressure=("log_time", e["p_log"])).assign_coords(log_time=e["log"])
    offsets = np.linspace(-2, 2, 201)
    recording = recording.assign_coords(sync_offset=offsets)
    recording["sync_explained"] = ("sync_offset", np.exp(-(((offsets - e["offset"]) / 0.2) ** 2)))
    recording["lamp"] = ("time", (np.sin(9 * e["time"]) > 0.4) * 180.0)
    halves = dataset["elongation"].values.reshape(len(e["time"]), 8, -1).mean(axis=2)
    recording["marker_elongation"] = (("time", "gap"), halves)
    recording["marker_elongation_sigma"] = (("time", "gap"), np.full(halves.shape, 0.003))
    recording.attrs |= {
        "experiment": e["name"], "role": ROLES.get(e["name"], "train"), "bends": "left", "sync_method": "motion",
        "offset_s": e["offset"], "offset_stderr_s": 0.0004, "drift_ppm": 3.0, "drift_stderr_ppm": 2.0,
    }  # fmt: skip
    Recording(recording).save(folder / "recording.nc")
    if video:
        write_clip(folder, e)


def prediction(e: dict, rung: int) -> xr.Dataset:
    line, theta = e["models"][rung]
    gap = e["measured"] - line
    lost = e["theta"] - theta
    torque = 2.4 * lost + e["rng"].normal(0, 0.05, lost.shape)
    tip_gap = gap[:, -1]
    return xr.Dataset(
        {
            "tip": (("time", "xy"), line[:, -1]),
            "midline": (("time", "node", "xy"), line),
            "bend_angle": ("time", theta.sum(axis=1)),
            "theta": (("time", "joint"), theta),
            "elongation": (("time", "segment"), RADIUS_MM * np.radians(theta) / (LENGTH_MM / SEGMENTS)),
            "tip_residual": (("time", "xy"), tip_gap),
            "angle_residual": ("time", lost.sum(axis=1)),
            "normal_residual": (("time", "node"), np.sum(gap * normals(line), axis=-1)),
            "phase": ("time", phases(e["p"], e["time"])),
            "residual_torque": (("time", "segment"), torque),
            "residual_torque_sigma": (("time", "segment"), np.full(torque.shape, 0.12)),
        },
        coords={"time": e["time"], "xy": ["x", "y"]},
    )


def write_photos(folder: Path) -> None:
    """The calibration, and a small grey copy of each of its photos but the last."""
    found = calibration()
    save_calibration(folder / "camera.yaml", found)
    (folder / "photos").mkdir(parents=True)
    for photo in found.quality["residual_fields"][:-1]:
        picture = np.full((180, 101), 60, np.uint8)
        cv2.imwrite(str(folder / "photos" / f"{photo['file']}.jpg"), picture)


def write_sample(
    folder: Path, *, seconds: float = 6.0, video: bool = True, names: tuple[str, ...] = tuple(ROLES)
) -> Path:
    """Write a whole `rfea/` folder and return it."""
    experiments = {name: experiment(name, seconds, seed) for seed, name in enumerate(names)}
    for name, e in experiments.items():
        write_measurement(folder / name, e, video=video)
    write_photos(folder / "calibration")
    kept = {name: e for name, e in experiments.items() if ROLES.get(name) != "test"}
    predicted = [{name: prediction(e, rung) for name, e in kept.items()} for rung in range(len(RUNGS))]
    fits = [model_fit(rung, predicted[rung]) for rung in range(len(RUNGS))]
    roles = ["validate" if "validate" in fit.metrics else "train" for fit in fits]
    errors = [float(fit.metrics[role].tip_rmse_mm or 0) for fit, role in zip(fits, roles, strict=True)]
    rows = []
    for rung, fit in enumerate(fits):
        room = folder / "models" / fit.name
        room.mkdir(parents=True, exist_ok=True)
        fit.save(room / "model.json")
        took = {str(row["segments"]): 0.2 * row["segments"] for row in fit.segments_study}
        (room / "timings.json").write_text(json.dumps({"segments_study_s": took}))
        write_datasets(room / "prediction.nc", dict(predicted[rung].items()))
        comparison(rung, kept, predicted[rung]).save(room / "comparison.json")
        verdict = diagnosis(rung, predicted[rung], errors)
        verdict.save(room / "diagnosis.json")
        if verdict.next_experiment:
            lines = [
                f"{t:.2f},{p:.2f}" for t, p in zip(np.arange(0, 8, 0.05), np.repeat([0, 60, 150, 240], 40), strict=True)
            ]
            (room / "next_experiment.csv").write_text("time_s,pressure_kPa\n" + "\n".join(lines) + "\n")
        rows.append({"model": fit.name, "added": fit.effects[-1] if fit.effects else None, "verdict": verdict.verdict,
                     "train_tip_rmse_mm": fit.metrics["train"].tip_rmse_mm, "validate_tip_rmse_mm": errors[rung],
                     "delta_bic": (None, -41200.0, -3100.0)[rung]})  # fmt: skip
    Ladder.model_validate({
        "rungs": rows, "noise_floor_mm": 0.085, "stopped_because": "What is left is at the noise floor.",
        "test": {"model": RUNGS[-1], "tip_rmse_mm": errors[-1] * 1.03, "first_model_tip_rmse_mm": errors[0] * 1.1, "first_model": RUNGS[0], "experiments": {"mixed-250kPa": errors[-1] * 1.03}, "first_model_experiments": {"mixed-250kPa": errors[0] * 1.1}},
        "findings": [
            "The model of the paper lacks two effects: creep (maxwell) and a tilt of gravity (gravity_tilt).",
            f"With both, the tip error on the held-out run falls from {errors[0]:.2f} mm to {errors[-1]:.2f} mm.",
            "The noise floor is 0.085 mm.",
        ],
    }).save(folder / "ladder.json")  # fmt: skip
    return folder


if __name__ == "__main__":
    print(write_sample(Path(sys.argv[1]) / "rfea"))
