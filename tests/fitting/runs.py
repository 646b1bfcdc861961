"""Short runs of a coarse twin whose chain is the model's, with noise of one's own on them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.options import FitOptions
from rfea_vision.stages import open_campaign
from rfea_vision.twin import TwinOptions, simulate
from rfea_vision.twin.draw import noise_like

SEGMENTS = 4
NOISE_MM = 0.06
OPTIONS = FitOptions(segments=SEGMENTS, joints="start", starts=0)


def exact_runs(folder: Path) -> tuple[dict[str, xr.Dataset], Actuator, dict[str, float]]:
    """Two training runs and one for validation, without noise; and the seven parameters behind them."""
    options = TwinOptions(
        joints=SEGMENTS,
        layout="start",
        roles=("train", "train", "validate"),
        duration_s=2.5,
        rate_Hz=120,
        seed=3,
        noise_mm=0.0,
        pressure_noise_kPa=0.0,
        sync="common_clock",
        step_s=0.0005,
    )
    truth = simulate(folder / "exact", options)
    recordings = open_campaign(folder / "exact").recordings("train", "validate")
    runs = {name: item.dataset.load() for name, item in recordings.items()}
    base = {name: value * (1 if name == "r_hyd" else SEGMENTS / 8) for name, value in truth["base"].items()}
    return runs, options.actuator, base


def noisy(
    runs: dict[str, xr.Dataset], seed: int, correlation: float = 0.0, noise_mm: float = NOISE_MM
) -> dict[str, Recording]:
    """The runs as a tracker of tips would have seen them."""
    generator = np.random.default_rng([9, seed])
    out = {}
    for name, data in runs.items():
        data = data.drop_vars(["midline", "midline_sigma"])
        tip = data["tip"].values + noise_like(data["tip"].shape, noise_mm, correlation, generator)
        sigma = np.full(tip.shape, NOISE_MM)
        out[name] = Recording(data.assign(tip=(("time", "xy"), tip), tip_sigma=(("time", "xy"), sigma)))
    return out


def changed(runs: dict[str, Recording], change: Callable[[xr.Dataset], xr.Dataset | None]) -> dict[str, Recording]:
    """The runs with something done to each."""
    out = {}
    for name, recording in runs.items():
        data = recording.dataset.copy(deep=True)
        done: Any = change(data)
        out[name] = Recording(data if done is None else done)
    return out
