"""Campaign folders for the tests: one that is right, to be spoilt in one place."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pandas as pd

CAMPAIGN = """\
format: rfea-campaign/1
name: tube-A
actuator: {outer_radius: 4 mm, inner_radius: 3 mm, length: 155 mm, density: 965 kg/m^3, bends: left}
"""
EXPERIMENT = """\
format: rfea-experiment/1
name: {name}
role: {role}
track: {{file: track.csv}}
pressure: {{file: pressure.csv}}
sync: {{method: common_clock}}
"""


def write_campaign(folder: Path, roles: dict[str, str] | None = None) -> Path:
    """Write a small campaign of tracks that needs no camera."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    for name, role in (roles or {"steps": "train", "sine": "validate"}).items():
        write_experiment(folder / name, name, role)
    return folder


def write_experiment(folder: Path, name: str, role: str = "train") -> Path:
    """Write one experiment: half a second of a pressure step, and the tip that follows it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "experiment.yaml").write_text(EXPERIMENT.format(name=name, role=role))
    log_s = np.arange(0.0, 0.5, 0.001)
    top_kPa = 100.0 + 0.1 * (zlib.crc32(name.encode()) % 100)  # no two runs have the same log or track, row by row
    pressure_kPa = top_kPa * (1.0 - np.exp(-log_s / 0.1))
    pd.DataFrame({"time_s": log_s, "pressure_kPa": pressure_kPa}).to_csv(folder / "pressure.csv", index=False)
    time_s = np.arange(0.0, 0.5, 1 / 240)
    bend = 0.8 * (1.0 - np.exp(-time_s / 0.1))
    noise = np.random.default_rng(zlib.crc32(name.encode())).normal(0.0, 0.05, (2, len(time_s)))
    track = {"time_s": time_s, "tip_x_mm": -60.0 * bend + noise[0], "tip_y_mm": -155.0 + 30.0 * bend**2 + noise[1]}
    pd.DataFrame(track).to_csv(folder / "track.csv", index=False)
    return folder
