"""Synchronisation by motion: is the offset right, and does its interval say so? Tracks of the twin, their clocks known."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.campaign.specs import PressureSpec
from rfea_vision.readers.pressure import read_pressure
from rfea_vision.readers.tracks import read_track
from rfea_vision.sync import synchronise
from rfea_vision.twin import TwinOptions
from rfea_vision.twin import simulate as make

CAMPAIGNS = 8
JOINTS = 10
NOISE_MM = 0.03  # white, of every node: more than a tracked midline has after smoothing


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    errors, claimed = [], []
    for seed in range(CAMPAIGNS):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "twin"
            options = TwinOptions(seed=100 + seed, joints=JOINTS, noise_mm=NOISE_MM, roles=("train",) * 5)
            truth = make(folder, options)
            for run_name, known in truth["experiments"].items():
                track = read_track(folder / run_name / "track.csv", bends="left")
                log = read_pressure(PressureSpec(file=folder / run_name / "pressure.csv", folder=folder))
                found = synchronise(track, log, experiment=run_name, role="train", bends="left").dataset.attrs
                errors.append(1e3 * (float(found["offset_s"]) - known["offset_s"]))
                claimed.append(1e3 * float(found["offset_stderr_s"]))
    error, sigma = np.abs(errors), np.array(claimed)
    said = f"{len(error)} runs of 6 s, five kinds of excitation, {NOISE_MM:g} mm noise per node"
    within, inside = 100 * float(np.mean(error < 1.0)), 100 * float(np.mean(error < 1.96 * sigma))
    return [
        {
            "name": "offset between the clocks, median error",
            "value": round(float(np.median(error)), 2),
            "unit": "ms",
            "target": "<= 1",
            "met": float(np.median(error)) <= 1.0,
            "against": said,
        },
        {
            "name": "offset within 1 ms of the truth",
            "value": round(within, 0),
            "unit": "%",
            "target": ">= 95",
            "met": within >= 95,
            "against": said,
        },
        {
            "name": "95 % interval of the offset contains the truth",
            "value": round(inside, 0),
            "unit": "%",
            "target": "90 to 99",
            "met": 90 <= inside <= 99,
            "against": said,
        },
    ]
