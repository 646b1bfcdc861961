"""One small file of every kind, made by the libraries that make them, and the reader that it belongs to."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from testing.damage import reading


@dataclass
class Target:
    """A reader, and a file that is right for it; `write` makes the file of another table, where it holds one."""

    name: str
    ending: str
    content: bytes
    read: Callable[[Path], None]
    write: Callable[[pd.DataFrame, Path], object] | None = None
    table: pd.DataFrame | None = None


def targets(folder: Path) -> Iterator[Target]:
    """One small file of every kind; what was made with the same versions of the libraries is the same."""
    yield from _tables(folder)
    yield from _of_other_tools(folder)
    yield from _pictures(folder)
    yield from _results(folder)
    yield from _settings()


def _written(path: Path, write: Callable[[Path], object]) -> bytes:
    write(path)
    return path.read_bytes()


def _tables(folder: Path) -> Iterator[Target]:
    """Logs and tracks in columns, each of which can also be written with numbers that are wrong."""
    time_s = np.arange(40) / 240.0
    log = pd.DataFrame({"time_s": time_s, "pressure_kPa": 100 * np.sin(9 * time_s) ** 2, "lamp": (time_s > 0.1) * 1.0})
    track = pd.DataFrame({"time_s": time_s, "tip_x_mm": -60 * time_s, "tip_y_mm": -155 + 30 * time_s})
    angle = pd.DataFrame({"time_s": time_s, "angle_deg": 200 * time_s})

    def text(table: pd.DataFrame, path: Path) -> None:
        table.to_csv(path, index=False)

    def german(table: pd.DataFrame, path: Path) -> None:
        table.to_csv(path, index=False, sep=";", decimal=",")

    def parquet(table: pd.DataFrame, path: Path) -> None:
        table.to_parquet(path, index=False)

    for name, ending, table, write, read in (
        ("log csv", ".csv", log, text, reading.log()),
        ("log csv, decimal comma", ".csv", log, german, reading.log()),
        ("track csv", ".csv", track, text, reading.track()),
        ("track csv, angle", ".csv", angle, text, reading.track()),
        ("guess csv", ".csv", log, text, reading.guess),
        ("guess csv, tip", ".csv", track, text, reading.guess),
        ("log parquet", ".parquet", log, parquet, reading.log()),
        ("log mat", ".mat", log, partial(_matlab, compressed=False), reading.log()),
        ("log mat, compressed", ".mat", log, partial(_matlab, compressed=True), reading.log()),
        ("log mf4", ".mf4", log, _mdf, reading.log()),
        ("log sqlite", ".db", log, _database, reading.log()),
    ):
        made = _written(folder / f"a{ending}", partial(write, table))
        yield Target(name, ending, made, read, write, table)


def _matlab(table: pd.DataFrame, path: Path, *, compressed: bool) -> None:
    import scipy.io

    scipy.io.savemat(path, {str(name): table[name].to_numpy() for name in table}, do_compression=compressed)


def _mdf(table: pd.DataFrame, path: Path) -> None:
    import asammdf

    first = table.columns[0]
    with asammdf.MDF() as file:
        for name in table.columns[1:]:
            file.append(asammdf.Signal(table[name].to_numpy(), table[first].to_numpy(), name=str(name), unit="kPa"))
        file.save(path, overwrite=True, compression=2)


def _database(table: pd.DataFrame, path: Path) -> None:
    path.unlink(missing_ok=True)
    with sqlite3.connect(path) as connection:
        table.to_sql("log", connection, index=False)
    connection.close()


def _of_other_tools(folder: Path) -> Iterator[Target]:
    """MATLAB 7.3, Simulink's structures, bags, motion capture and poses, as the tests of the readers write them."""
    from testing import written

    for write in (written.write_mat73, written.write_simulink, written.write_simulink73, written.write_bag):
        spec = write(_new(folder / write.__name__))
        yield Target(f"log {write.__name__[6:]}", spec.file.suffix, spec.file.read_bytes(), reading.log(spec))
    for write in written.POSES:
        spec = write(_new(folder / write.__name__))
        named = spec.keys.model_copy(update={"points": spec.keys.points or list(written.MARKS)})
        yield Target(f"poses {write.__name__[6:]}", spec.file.suffix, spec.file.read_bytes(), reading.track(named))


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _pictures(folder: Path) -> Iterator[Target]:
    import av
    import cv2

    picture = np.add.outer(np.arange(48), 3 * np.arange(64)).astype(np.uint8)
    for ending in (".png", ".jpg", ".tif", ".bmp"):
        yield Target(f"picture {ending[1:]}", ending, cv2.imencode(ending, picture)[1].tobytes(), reading.picture)
    for ending, codec in ((".mp4", "libx264"), (".avi", "mjpeg"), (".mkv", "libx264")):
        path = folder / f"a{ending}"
        with av.open(str(path), "w") as container:
            stream = container.add_stream(codec, rate=30)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p" if codec == "mjpeg" else "yuv420p"
            for shift in range(12):
                frame = av.VideoFrame.from_ndarray(np.roll(picture, shift, axis=1), format="gray8").reformat(
                    format=stream.pix_fmt
                )
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        yield Target(f"film {ending[1:]}", ending, path.read_bytes(), reading.film)
    (folder / "one.png").write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    yield Target("frames table", ".frames.csv", b"file,time_s\none.png,0\none.png,0.1\none.png,0.2\n", reading.frames)


def _results(folder: Path) -> Iterator[Target]:
    import xarray as xr

    from rfea_vision.artefacts import Track

    time_s = np.arange(40) / 240.0
    shape = len(time_s)
    data = xr.Dataset(
        {"valid": ("time", np.ones(shape, np.int8)), "reason": ("time", np.full(shape, "", dtype=object)),
         "tip": (("time", "xy"), np.ones((shape, 2)))}, coords={"time": time_s, "xy": ["x", "y"]},
    )  # fmt: skip
    yield Target("track.nc", ".nc", _written(folder / "a.nc", Track(data).save), reading.result)
    parameter = {"value": 0.1, "unit": "N*m/rad", "stderr": 0.01, "interval_95": [0.08, 0.12]}
    model = {"format": "rfea-model/1", "name": "base", "segments": 4, "parameters": {"k_ref": parameter}, "effects": ["maxwell"],
             "metrics": {"train": {"tip_rmse_mm": 0.4}}, "experiments": {"a": {"role": "train", "tip_rmse_mm": 0.4}}}  # fmt: skip
    diagnosis = {
        "model": "base",
        "verdict": "missing",
        "named": ["maxwell"],
        "candidates": [{"effect": "maxwell", "score_p": 0.01}],
    }
    rung = {
        "model": "base",
        "added": None,
        "train_tip_rmse_mm": 1.0,
        "validate_tip_rmse_mm": 1.1,
        "delta_bic": None,
        "verdict": "missing",
    }
    for name, value in (("ModelFit", model), ("Diagnosis", diagnosis), ("Ladder", {"rungs": [rung]})):
        yield Target(f"{name} json", ".json", json.dumps(value, indent=1).encode(), reading.artefact(name))
    record = {"key": "fit/base", "digest": "0" * 64, "options": {"fit": {"segments": 4}}, "outputs": {"models/base/model.json": "0"},
              "inputs": {"a.csv": "0"}, "order": 3}  # fmt: skip
    yield Target(".stages", ".json", json.dumps(record).encode(), reading.records)


_CAMERA = b"""%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 800., 0., 320., 0., 800., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, 0.01, 0., 0., 0. ]
"""
_ROS = b"""image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [800, 0, 320, 0, 800, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0.01, 0, 0, 0]}
"""
_CAMPAIGN = b"""format: rfea-campaign/1
name: tube-A
actuator: {outer_radius: 4 mm, inner_radius: 3 mm, length: 155 mm, density: 965 kg/m^3, bends: left}
camera:
  board: {kind: checkerboard, inner_corners: [9, 6], square: 12 mm}
  photos: 'calibration/*.png'
  vertical: {plumb: [[1, 2], [3, 4]]}
sync: {method: offset, value: 12 ms}
"""
_EXPERIMENT = b"""format: rfea-experiment/1
name: steps
role: train
track: {file: track.csv}
pressure: {file: pressure.csv, time: t, pressure: p, unit: kPa, reference: absolute, ambient: 101.3 kPa}
sync: {method: led, box: [1, 2, 3, 4], channel: lamp}
"""
_RECIPE = """format: rfea-recipe/1
title: a
steps:
  - track
  - fit: {segments: 4, add: [maxwell], prior: {payload.m: 2g±0.1g}, seed: 3}
  - report
""".encode()


def _settings() -> Iterator[Target]:
    yield Target("campaign.yaml", ".campaign.yaml", _CAMPAIGN, reading.settings)
    yield Target("experiment.yaml", ".experiment.yaml", _EXPERIMENT, reading.settings)
    yield Target("recipe", ".yaml", _RECIPE, reading.recipe)
    yield Target("camera OpenCV", ".yaml", _CAMERA, reading.camera)
    yield Target("camera ROS", ".yaml", _ROS, reading.camera)
