"""A track as movement's netCDF of poses, which other tools of motion read (https://movement.neuroinformatics.dev)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from rfea_vision.errors import DataError
from rfea_vision.files import write_dataset


def movement_dataset(data: xr.Dataset, *, name: str) -> xr.Dataset:
    """Return the centre line of a track or recording as named keypoints of one individual.

    Parameters
    ----------
    data : with ``midline`` (time, node, xy) or ``tip`` (time, xy), in mm
    name : of the individual

    Returns
    -------
    xarray.Dataset
        ``position`` (time, space, keypoints, individuals) in mm in the rig frame, y up; ``confidence`` 1 where the frame is
        valid, 0 where it was set aside.

    Raises
    ------
    DataError
        If only an angle was measured.
    """
    if "midline" in data:
        places = np.asarray(data["midline"].values, dtype=float)
        keypoints = ["clamp", *(f"node{index:02d}" for index in range(1, places.shape[1] - 1)), "tip"]
    elif "tip" in data:
        places, keypoints = np.asarray(data["tip"].values, dtype=float)[:, None], ["tip"]
    else:
        raise DataError(f"{name}: only its bend angle was measured; poses need the tip or the centre line")
    time_s = np.asarray(data["time"].values, dtype=float)
    sure = np.repeat(data["valid"].values.astype(float)[:, None, None], len(keypoints), axis=1)
    return xr.Dataset(
        {
            "position": (("time", "space", "keypoints", "individuals"), places.transpose(0, 2, 1)[..., None], {"units": "mm"}),
            "confidence": (("time", "keypoints", "individuals"), sure),
        },
        {"time": ("time", time_s, {"units": "s"}), "space": ["x", "y"], "keypoints": keypoints, "individuals": [name]},
        {
            "source_software": "rfea-vision", "ds_type": "poses", "time_unit": "seconds",
            "fps": round(float(1.0 / np.median(np.diff(time_s))), 9),
            "frame": "rig: origin at the clamp, x to the camera's right, y up",
        },
    )  # fmt: skip


def write_movement(path: Path, data: xr.Dataset, *, name: str) -> None:
    """Write the poses of `movement_dataset` as netCDF."""
    write_dataset(path, movement_dataset(data, name=name))
