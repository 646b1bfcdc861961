"""Recordings of a plant, as they come from a track and a log on one clock."""

from __future__ import annotations

import numpy as np
import xarray as xr

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Recording


def recording_of(
    name: str, role: str, frame_s: FloatArray, line_mm: FloatArray, bend: FloatArray, log_s: FloatArray, pressure: FloatArray,
    *, noise_mm: float,
) -> Recording:  # fmt: skip
    """A centre line (frames, nodes, 2) of a body that bends left, its angle (frames,) in rad, and the pressure (samples,) in Pa."""
    frames, nodes = line_mm.shape[:2]
    dataset = xr.Dataset(
        {
            "valid": ("time", np.ones(frames, dtype=np.int8)),
            "reason": ("time", np.full(frames, "", dtype=object)),
            "midline": (("time", "node", "xy"), line_mm),
            "midline_sigma": (("time", "node"), np.full((frames, nodes), noise_mm)),
            "tip": (("time", "xy"), line_mm[:, -1]),
            "tip_sigma": (("time", "xy"), np.full((frames, 2), noise_mm)),
            "bend_angle": ("time", np.rad2deg(bend)),
            "pressure": ("log_time", pressure / 1e3),
        },
        coords={"time": ("time", frame_s, {"units": "s"}), "log_time": ("log_time", log_s), "xy": ["x", "y"]},
        attrs={
            "experiment": name,
            "role": role,
            "bends": "left",
            "sync_method": "offset",
            "offset_s": 0.0,
            "offset_stderr_s": 0.0,
        },
    )
    return Recording(dataset)
