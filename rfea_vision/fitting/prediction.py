"""Model against measurement, frame by frame: what `prediction.nc` holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from rfea_vision.artefacts.judgement import ModelFit
from rfea_vision.artefacts.measurement import Recording
from rfea_vision.dynamics.simulation import Model
from rfea_vision.fitting.observation import observe_recording
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.residuals import Predicted, predict_observed, why_not
from rfea_vision.fitting.scoring import rebuild
from rfea_vision.fitting.solver import fit_clocks

NODES = 33


def predict(model: ModelFit, recordings: Mapping[str, Recording]) -> dict[str, xr.Dataset]:
    """Prediction of a fitted model for every recording that is not ignored, at every frame within the pressure log.

    A recording on which the model cannot be simulated gets NaN, with the reason in the attribute ``note``.
    """
    simulator, par = rebuild(model)
    out = {}
    for name, recording in recordings.items():
        if recording.role == "ignore":
            continue
        item = replace(observe_recording(recording), pressure_zero_sd=model.given.get("pressure_zero_sd", 0.0))
        score = model.experiments.get(name)
        clock = score.nuisance.get("clock_offset_s") if score is not None else None
        if clock is None:
            clock = float(fit_clocks(simulator, [item], par)[0])
        out[name] = _predict_one(simulator, par, item, recording, clock)
    return out


def _predict_one(simulator: Model, par: np.ndarray, item: Observed, recording: Recording, clock: float) -> xr.Dataset:
    """Prediction for one recording whose clock is `clock` s off; NaN where the model cannot be simulated on it."""
    fractions = np.linspace(0, 1, recording.dataset.sizes.get("node", NODES))
    predicted = predict_observed(simulator, par, item, (), clock, fractions)
    note = "" if predicted is not None else why_not(simulator, par, item, clock)
    return as_dataset(simulator, item, recording, predicted, fractions).assign_attrs(clock_offset_s=clock, note=note)


def as_dataset(
    simulator: Model, item: Observed, recording: Recording, predicted: Predicted | None, fractions: np.ndarray
) -> xr.Dataset:
    """What was simulated for an experiment at `fractions` of the centre line, beside what was measured, on all its frames."""
    data = recording.dataset
    nodes = fractions.size
    frames = data.sizes["time"]
    flip = np.array([item.mirror, 1.0])
    line = np.full((frames, nodes, 2), np.nan)
    if predicted is not None:
        line[item.frame] = predicted.points / MM * flip
    angle = np.full(frames, np.nan)
    theta = np.full((frames, simulator.chain.bodies), np.nan)
    if predicted is not None:
        angle[item.frame] = np.rad2deg(predicted.angle)
        theta[item.frame] = np.rad2deg(predicted.motion.theta)
    variables: dict[str, tuple] = {
        "tip": (("time", "xy"), line[:, -1].astype(np.float32), {"units": "mm"}),
        "midline": (("time", "node", "xy"), line.astype(np.float32), {"units": "mm"}),
        "bend_angle": (("time",), angle.astype(np.float32), {"units": "deg"}),
        "theta": (("time", "joint"), theta.astype(np.float32), {"units": "deg"}),
    }
    radius, arc = simulator.chain.outer_radius, simulator.chain.arc[0]
    elongation = radius * np.deg2rad(theta) / arc
    variables["elongation"] = (("time", "segment"), elongation.astype(np.float32), {"units": "1"})
    if "tip" in data:
        variables["tip_residual"] = (
            ("time", "xy"),
            (data["tip"].values - line[:, -1]).astype(np.float32),
            {"units": "mm"},
        )
    if "midline" in data:
        measured = data["midline"].values
        tangent = np.gradient(measured, axis=1)
        length = np.linalg.norm(tangent, axis=2, keepdims=True)
        normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1) / np.where(length > 0, length, 1.0)
        gap = np.sum(normal * (measured - line), axis=2)
        variables["normal_residual"] = (("time", "node"), gap.astype(np.float32), {"units": "mm"})
    return xr.Dataset(
        variables,
        coords={"time": ("time", data["time"].values, {"units": "s"}), "xy": ["x", "y"]},
        attrs={
            "experiment": item.name,
            "role": item.role,
            "line": "centre line",
        },
    )
