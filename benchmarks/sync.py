"""Synchronisation by motion: is the offset right, and does its interval say so? Twins' tracks and films, their clocks known."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, chi2

from rfea_vision.campaign.specs import PressureSpec
from rfea_vision.readers.pressure import read_pressure
from rfea_vision.readers.tracks import read_track
from rfea_vision.stages.workspace import open_campaign
from rfea_vision.sync import synchronise
from rfea_vision.twin import TwinOptions
from rfea_vision.twin import simulate as make
from rfea_vision.twin.options import with_partners
from rfea_vision.twin.stress import Stress

CAMPAIGNS = 8
JOINTS = 10
NOISE_MM = 0.03  # white, of every node: more than a tracked midline has after smoothing
LASTING = 0.9  # correlation from frame to frame where noise lasts
EFFECTS = (
    {"maxwell.k1": 0.05},
    {"hysteresis.tau_h": 5e-4},
    {"damping_profile.a1": 0.4},
    {"coulomb.tau_c": 3e-4},
    {"drag.c": 600.0},
    {"drag.c": 600.0, "nonlinear_damping.c": 0.5},
    {"payload.m": 0.004},
)
FILMS: tuple[dict[str, Any], ...] = (
    {"seed": 12},
    {"seed": 41, "codec_qp": 30, "image_noise": 3.0},
    {"seed": 21, "scene": Stress(vfr=True, dropped=0.05, duplicated=0.03)},
    {"seed": 71, "scene": Stress(highlight=60.0, shadow=0.5, uneven=0.3)},
    {"seed": 31, "rate_Hz": 120.0},
)
SLOW_FILMS: tuple[dict[str, Any], ...] = ({"seed": 81, "rate_Hz": 30.0},)


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    cv2.setNumThreads(1)
    plain = [_tracks(100 + seed) for seed in range(CAMPAIGNS)]
    lasting = [_tracks(140 + seed, noise_mm=0.02, noise_correlation=LASTING) for seed in range(CAMPAIGNS // 4)]
    hiding = [_tracks(120 + seed, hidden=with_partners(effect)) for seed, effect in enumerate(EFFECTS)]
    films = [_films(**kind) for kind in FILMS]
    slow = [_films(**kind) for kind in SLOW_FILMS]
    tracks = f"{5 * CAMPAIGNS} runs of 6 s, five kinds of excitation, {NOISE_MM:g} mm noise per node"
    lasts = f"{5 * len(lasting)} such runs, 0.02 mm noise with a correlation of {LASTING:g} from frame to frame"
    names = ", ".join("+".join(dict.fromkeys(key.split(".")[0] for key in effect)) for effect in EFFECTS)
    hidden = f"{5 * len(EFFECTS)} such runs, each campaign with one of {names}"
    rendered = (
        f"{5 * len(FILMS)} rendered, calibrated and tracked H.264 films of 5 s, 360 x 640 px: plain, "
        "coarse codec and noise, uneven and lost and repeated frames, highlight and hard shadow, 120 frames/s"
    )
    return [
        *_rows(plain, tracks, ""),
        *_rows(lasting, lasts, ", noise that lasts over frames"),
        *_rows(hiding, hidden, ", an effect hidden in the tube"),
        *_rows(films, rendered, ", tracked films"),
        *_rows(slow, f"{5 * len(slow)} such films, 30 frames/s", ", tracked films at 30 frames/s", least=50),
    ]


def _tracks(seed: int, **kind: Any) -> NDArray[np.float64]:
    """Errors and claimed standard errors, ms, (runs, 2), of generated tracks."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "twin"
        options = {"joints": JOINTS, "noise_mm": NOISE_MM, "roles": ("train",) * 5, **kind}
        truth = make(folder, TwinOptions(seed=seed, **options))
        for run_name, known in truth["experiments"].items():
            track = read_track(folder / run_name / "track.csv", bends="left")
            log = read_pressure(PressureSpec(file=folder / run_name / "pressure.csv", folder=folder))
            said = synchronise(track, log, experiment=run_name, role="train", bends="left").dataset.attrs
            found.append([float(said["offset_s"]) - known["offset_s"], float(said["offset_stderr_s"])])
    return 1e3 * np.array(found)


def _films(**kind: Any) -> NDArray[np.float64]:
    """The same of rendered films: calibrated from their board photos, tracked, and put on the log's clock."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "twin"
        options = {"duration_s": 5.0, "frame_size": (360, 640), "joints": 2 * JOINTS, "roles": ("train",) * 5, **kind}
        truth = make(folder, TwinOptions(video=True, **options))
        for run_name, recording in open_campaign(folder).sync().items():
            said, known = recording.dataset.attrs, truth["experiments"][run_name]
            found.append([float(said["offset_s"]) - known["offset_s"], float(said["offset_stderr_s"])])
    return 1e3 * np.array(found)


def chance_band(count: int) -> tuple[float, float]:
    """Between which percentages the share of so many intervals of 95 % lies in 95 of 100 such benchmarks (binomial)."""
    low, high = binom.interval(0.95, count, 0.95)
    return 100 * low / count, 100 * high / count


def _rows(found: list[NDArray[np.float64]], said: str, beside: str, *, least: float = 95.0) -> list[dict[str, Any]]:
    error, sigma = np.abs(np.concatenate(found)[:, 0]), np.concatenate(found)[:, 1]
    median = float(np.median(error))
    within, inside = 100 * float(np.mean(error < 1.0)), 100 * float(np.mean(error < 1.96 * sigma))
    low, high = chance_band(error.size)
    # So few intervals may all hold the truth by chance; that they are too wide shows in how small the errors are beside them.
    spread = float(np.sqrt(np.mean((error / sigma) ** 2)))
    narrow, wide = np.sqrt(np.array(chi2.interval(0.95, error.size)) / error.size)
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
            "target": f">= {least:g}",
            "met": within >= least,
            "against": said,
        },
        {
            "name": f"95 % interval of the offset contains the truth{beside}",
            "value": round(inside, 0),
            "unit": "%",
            "target": f"95, {low:.0f} to {high:.0f} by chance",
            "met": bool(low <= inside <= high),
            "against": said,
        },
        {
            "name": f"error of the offset over its standard error, root mean square{beside}",
            "value": round(spread, 2),
            "unit": "1",
            "target": f"1, {narrow:.2f} to {wide:.2f} by chance",
            "met": bool(narrow <= spread <= wide),
            "against": said,
        },
    ]
