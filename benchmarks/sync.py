"""Synchronisation by motion: is the offset right, and does its interval say so? Tracks of the twin, their clocks known."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.campaign.specs import PressureSpec
from rfea_vision.readers.pressure import read_pressure
from rfea_vision.readers.tracks import read_track
from rfea_vision.sync import synchronise
from rfea_vision.twin import TwinOptions
from rfea_vision.twin import simulate as make
from rfea_vision.twin.options import with_partners

CAMPAIGNS = 8
JOINTS = 10
NOISE_MM = 0.03  # white, of every node: more than a tracked midline has after smoothing
EFFECTS = (
    {"maxwell.k1": 0.05},
    {"hysteresis.tau_h": 5e-4},
    {"damping_profile.a1": 0.4},
    {"coulomb.tau_c": 3e-4},
)


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    plain = [_campaign(100 + seed, {}) for seed in range(CAMPAIGNS)]
    hiding = [_campaign(120 + seed, effect) for seed, effect in enumerate(EFFECTS)]
    said = f"{5 * CAMPAIGNS} runs of 6 s, five kinds of excitation, {NOISE_MM:g} mm noise per node"
    names = ", ".join(next(iter(effect)).split(".")[0] for effect in EFFECTS)
    hidden = f"{5 * len(EFFECTS)} such runs, each campaign with one of {names}"
    return [*_rows(plain, said, ""), *_rows(hiding, hidden, ", an effect hidden in the tube")]


def _campaign(seed: int, hidden: dict[str, float]) -> NDArray[np.float64]:
    """Errors and claimed standard errors, ms, (runs, 2)."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "twin"
        options = TwinOptions(
            seed=seed, joints=JOINTS, noise_mm=NOISE_MM, roles=("train",) * 5, hidden=with_partners(hidden)
        )
        truth = make(folder, options)
        for run_name, known in truth["experiments"].items():
            track = read_track(folder / run_name / "track.csv", bends="left")
            log = read_pressure(PressureSpec(file=folder / run_name / "pressure.csv", folder=folder))
            said = synchronise(track, log, experiment=run_name, role="train", bends="left").dataset.attrs
            found.append([float(said["offset_s"]) - known["offset_s"], float(said["offset_stderr_s"])])
    return 1e3 * np.array(found)


def _rows(found: list[NDArray[np.float64]], said: str, beside: str) -> list[dict[str, Any]]:
    error, sigma = np.abs(np.concatenate(found)[:, 0]), np.concatenate(found)[:, 1]
    median = float(np.median(error))
    within, inside = 100 * float(np.mean(error < 1.0)), 100 * float(np.mean(error < 1.96 * sigma))
    return [
        {
            "name": f"offset between the clocks, median error{beside}",
            "value": round(median, 2),
            "unit": "ms",
            "target": "<= 1",
            "met": median <= 1.0,
            "against": said,
        },
        {
            "name": f"offset within 1 ms of the truth{beside}",
            "value": round(within, 0),
            "unit": "%",
            "target": ">= 95",
            "met": within >= 95,
            "against": said,
        },
        {
            "name": f"95 % interval of the offset contains the truth{beside}",
            "value": round(inside, 0),
            "unit": "%",
            "target": "90 to 99",
            "met": 90 <= inside <= 99,
            "against": said,
        },
    ]
