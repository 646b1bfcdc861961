"""Fuzzing: files that were cut, flipped, swapped, blown up or made up, given to every reader and to the artefacts fed back.

Every input is made from a seed and a small file that is right; a reader may return, or raise one sentence meant for people.
Anything else is a fault: another exception, more than 20 s, more than 2 GB, or numbers that are not finite or out of order.
"""

from __future__ import annotations

import io
import json
import random
import sqlite3
import struct
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

MOST_S, MOST_BYTES = 20.0, 2_000_000_000


@dataclass
class Target:
    """A reader, and a file that is right for it."""

    name: str
    ending: str
    content: bytes
    read: Callable[[Path], None]


@dataclass
class Count:
    """What became of the inputs."""

    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    longest_s: float = 0.0
    most_bytes: int = 0
    faults: list[str] = field(default_factory=list)
    by_target: Counter[str] = field(default_factory=Counter)


# -- mutations -----------------------------------------------------------------------------------------------------

_NUMBERS = [
    b"nan",
    b"inf",
    b"-inf",
    b"1e400",
    b"-1",
    b"0",
    b"1e-320",
    b"9" * 400,
    b"0x10",
    b"1,5",
    b"",
    b"\xff",
    b"1_0",
    b"--1",
    b"1e9",
]
_TEXTS = [b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\n\n\n", b'"', b"'", b";", b"\t", b"#", b"%YAML:1.0\n", b"{" * 200, b"[" * 200,
          b"&a [*a]", b"!!python/object/apply:os.system ['true']", b"<<: *x", b"9" * 5000, b"\x1b[2J",
          b"${HOME}", b"../" * 40]  # fmt: skip
_WORDS = [
    struct.pack(kind, number)
    for kind in ("<I", ">I", "<Q", ">Q", "<i", "<d")
    for number in (0, 1, 255, 65535, 10**9, 2**31 - 1)
]


def mutated(content: bytes, chance: random.Random) -> bytes:
    """One to four changes of a file's bytes."""
    data = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        data = chance.choice(_BINARY)(data, chance)
    return bytes(data[:4_000_000])


def _cut(data: bytearray, chance: random.Random) -> bytearray:
    return data[: chance.randrange(len(data) + 1)]


def _flip(data: bytearray, chance: random.Random) -> bytearray:
    for _ in range(chance.choice((1, 2, 8, 64))):
        if data:
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return data


def _word(data: bytearray, chance: random.Random) -> bytearray:
    at, word = chance.randrange(len(data) + 1), chance.choice(_WORDS)
    data[at : at + len(word)] = word
    return data


def _remove(data: bytearray, chance: random.Random) -> bytearray:
    at = chance.randrange(len(data) + 1)
    del data[at : at + chance.choice((1, 4, 64, 4096))]
    return data


def _repeat(data: bytearray, chance: random.Random) -> bytearray:
    at = chance.randrange(len(data) + 1)
    return data[:at] + data[at : at + 256] * chance.choice((2, 16, 256)) + data[at:]


def _insert(data: bytearray, chance: random.Random) -> bytearray:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.choice(_TEXTS) + data[at:]


def _number(data: bytearray, chance: random.Random) -> bytearray:
    """Put something else in place of a run of digits."""
    at = next((i for i in range(chance.randrange(len(data) + 1), len(data)) if chr(data[i]).isdigit()), None)
    if at is None:
        return data
    end = at
    while end < len(data) and (chr(data[end]).isdigit() or data[end] in b".eE+-"):
        end += 1
    return data[:at] + chance.choice(_NUMBERS) + data[end:]


def _swap_lines(data: bytearray, chance: random.Random) -> bytearray:
    lines = data.split(b"\n")
    first, second = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[first], lines[second] = lines[second], lines[first]
    return bytearray(b"\n".join(lines))


def _drop_cell(data: bytearray, chance: random.Random) -> bytearray:
    lines = data.split(b"\n")
    at = chance.randrange(len(lines))
    cells = lines[at].split(b",")
    cells.pop(chance.randrange(len(cells)))
    lines[at] = b",".join(cells)
    return bytearray(b"\n".join(lines))


def _noise(data: bytearray, chance: random.Random) -> bytearray:
    return bytearray(chance.randbytes(chance.choice((0, 1, 8, 512, 20_000))))


_BINARY = [
    _cut,
    _flip,
    _flip,
    _word,
    _word,
    _remove,
    _repeat,
    _insert,
    _number,
    _number,
    _number,
    _swap_lines,
    _drop_cell,
    _noise,
]


# -- what is read --------------------------------------------------------------------------------------------------


def _in_order(time_s: np.ndarray, *values: np.ndarray) -> None:
    if not (np.all(np.isfinite(time_s)) and np.all(np.diff(time_s) >= 0)):
        raise AssertionError("times that are not finite or not in order were accepted")
    for item in values:
        if not np.all(np.isfinite(item)):
            raise AssertionError("numbers that are not finite were accepted")


def _read_log(path: Path) -> None:
    from rfea_vision.campaign import PressureSpec
    from rfea_vision.readers.pressure import read_pressure

    if path.suffix == ".db":
        spec = PressureSpec(
            url=f"sqlite:///{path.name}", query="SELECT time_s, pressure_kPa FROM log", folder=path.parent
        )
    else:
        spec = PressureSpec(file=path, folder=path.parent)
    log = read_pressure(spec)
    _in_order(log.time_s, log.pressure_kPa)


def _read_track(path: Path) -> None:
    from rfea_vision.readers.tracks import read_track

    found = read_track(path)
    _in_order(found.time_s, *(found.dataset["tip"].values[found.valid] if "tip" in found.dataset else ()))


def _read_film(path: Path) -> None:
    from rfea_vision.readers.video import open_video

    source = open_video(path)
    _in_order(source.times_s())
    for number, (_, luma) in enumerate(source.frames()):
        if luma.ndim != 2 or number > 40:
            break


def _read_frames(path: Path) -> None:
    from rfea_vision.readers.video import open_frames

    source = open_frames(path.parent, path, within=path.parent)
    _in_order(source.times_s())


def _read_picture(path: Path) -> None:
    from rfea_vision.calibration.photos import read_grey

    read_grey(path)


def _read_camera(path: Path) -> None:
    from rfea_vision.calibration import load_calibration

    found = load_calibration(path)
    _in_order(np.zeros(1), found.camera_matrix, found.distortion)


def _read_result(path: Path) -> None:
    from rfea_vision.artefacts import Recording, Track

    (Recording if "recording" in path.name else Track).load(path)


def _read_json(kind: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        import rfea_vision.artefacts

        getattr(rfea_vision.artefacts, kind).load(path)

    return read


def _read_settings(path: Path) -> None:
    """A campaign with this file as its campaign.yaml, or an experiment with it."""
    from rfea_vision.campaign import read_campaign

    folder = path.with_suffix("")
    (folder / "run").mkdir(parents=True, exist_ok=True)
    target = folder / "campaign.yaml" if "campaign" in path.name else folder / "run" / "experiment.yaml"
    (folder / "campaign.yaml").write_text("name: x\n")
    target.write_bytes(path.read_bytes())
    for problem in read_campaign(folder).problems:
        if "Traceback" in str(problem) or "\n" in problem.message:
            raise AssertionError(f"more than a sentence: {problem}")


def _read_records(path: Path) -> None:
    from rfea_vision.stages.cache import StageCache

    out = path.with_suffix("")
    (out / ".stages").mkdir(parents=True, exist_ok=True)
    for name in ("fit@base.json", "hashes.json"):
        (out / ".stages" / name).write_bytes(path.read_bytes())
    cache = StageCache(out)
    for record in cache.records("*"):
        cache.is_fresh(record.key, record.digest)
    cache.sha256(path)


def _read_recipe(path: Path) -> None:
    from rfea_vision.stages.recipes import load_recipe

    load_recipe(str(path)).calls()


# -- files that are right ------------------------------------------------------------------------------------------


def targets(folder: Path) -> Iterator[Target]:
    """One small file of every kind, made by the libraries that make them."""
    time_s = np.arange(40) / 240.0
    log = pd.DataFrame({"time_s": time_s, "pressure_kPa": 100 * np.sin(9 * time_s) ** 2, "lamp": (time_s > 0.1) * 1})
    track = pd.DataFrame({"time_s": time_s, "tip_x_mm": -60 * time_s, "tip_y_mm": -155 + 30 * time_s})
    yield Target("log csv", ".csv", log.to_csv(index=False).encode(), _read_log)
    yield Target("log csv, decimal comma", ".csv", log.to_csv(index=False, sep=";", decimal=",").encode(), _read_log)
    yield Target("track csv", ".csv", track.to_csv(index=False).encode(), _read_track)
    yield Target("log parquet", ".parquet", _written(folder / "a.parquet", log.to_parquet), _read_log)
    yield from _logs(folder, log)
    yield from _pictures(folder)
    yield from _results(folder, time_s)
    yield from _settings()


def _written(path: Path, write: Callable[[Path], object]) -> bytes:
    write(path)
    return path.read_bytes()


def _logs(folder: Path, log: pd.DataFrame) -> Iterator[Target]:
    import asammdf
    import scipy.io

    columns = {name: log[name].to_numpy() for name in log}
    for compressed in (False, True):
        content = _written(
            folder / "a.mat", lambda path, on=compressed: scipy.io.savemat(path, columns, do_compression=on)
        )
        yield Target(f"log mat{', compressed' * compressed}", ".mat", content, _read_log)

    def mdf(path: Path) -> None:
        with asammdf.MDF() as file:
            file.append(asammdf.Signal(columns["pressure_kPa"], columns["time_s"], name="pressure_kPa", unit="kPa"))
            file.save(path, overwrite=True, compression=2)

    yield Target("log mf4", ".mf4", _written(folder / "a.mf4", mdf), _read_log)

    def database(path: Path) -> None:
        with sqlite3.connect(path) as connection:
            log.to_sql("log", connection, index=False)

    yield Target("log sqlite", ".db", _written(folder / "a.db", database), _read_log)


def _pictures(folder: Path) -> Iterator[Target]:
    import av
    import cv2

    picture = np.add.outer(np.arange(48), 3 * np.arange(64)).astype(np.uint8)
    for ending in (".png", ".jpg", ".tif", ".bmp"):
        yield Target(f"picture {ending[1:]}", ending, cv2.imencode(ending, picture)[1].tobytes(), _read_picture)
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
        yield Target(f"film {ending[1:]}", ending, path.read_bytes(), _read_film)
    (folder / "one.png").write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    yield Target("frames table", ".frames.csv", b"file,time_s\none.png,0\none.png,0.1\none.png,0.2\n", _read_frames)


def _results(folder: Path, time_s: np.ndarray) -> Iterator[Target]:
    import xarray as xr

    from rfea_vision.artefacts import Track

    shape = len(time_s)
    data = xr.Dataset(
        {"valid": ("time", np.ones(shape, np.int8)), "reason": ("time", np.full(shape, "", dtype=object)),
         "tip": (("time", "xy"), np.ones((shape, 2)))}, coords={"time": time_s, "xy": ["x", "y"]},
    )  # fmt: skip
    yield Target("track.nc", ".nc", _written(folder / "a.nc", Track(data).save), _read_result)
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
        yield Target(f"{name} json", ".json", json.dumps(value, indent=1).encode(), _read_json(name))
    record = {"key": "fit/base", "digest": "0" * 64, "options": {"fit": {"segments": 4}}, "outputs": {"models/base/model.json": "0"},
              "inputs": {"a.csv": "0"}, "order": 3}  # fmt: skip
    yield Target(".stages", ".json", json.dumps(record).encode(), _read_records)


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
_RECIPE = b"""format: rfea-recipe/1
title: a
steps:
  - track
  - fit: {segments: 4, add: [maxwell], prior: {payload.m: 2g}, seed: 3}
  - report
"""


def _settings() -> Iterator[Target]:
    yield Target("campaign.yaml", ".campaign.yaml", _CAMPAIGN, _read_settings)
    yield Target("experiment.yaml", ".experiment.yaml", _EXPERIMENT, _read_settings)
    yield Target("recipe", ".yaml", _RECIPE, _read_recipe)
    yield Target("camera OpenCV", ".yaml", _CAMERA, _read_camera)
    yield Target("camera ROS", ".yaml", _ROS, _read_camera)


# -- files made up to hurt -----------------------------------------------------------------------------------------


def bombs() -> Iterator[tuple[str, bytes]]:
    """Contents that announce or unpack to far more than they are."""
    yield (
        "yaml aliases",
        b"a0: &a0 [x,x,x,x,x,x,x,x,x]\n"
        + b"".join(f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]\n".encode() for i in range(1, 12)),
    )
    yield "deep yaml", b"a: " + b"[" * 50_000
    yield "deep json", b'{"a":' * 50_000
    yield "long number", b"time_s,pressure_kPa\n" + b"9" * 1_000_000 + b",1\n2,3\n"
    yield "one long line", b"time_s,pressure_kPa" + b",x" * 500_000 + b"\n1,2\n"
    yield "many empty lines", b"time_s,pressure_kPa\n" + b"\n" * 1_000_000

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    yield "png", b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(bytes(10_000_000))) + chunk(b"IEND", b"")
    inner = zlib.compress(struct.pack("<II", 14, 2_000_000_000) + bytes(10_000_000))
    yield "mat", b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(inner)) + inner
    yield "hls", b"#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n"
    yield "concat", b"ffconcat version 1.0\nfile /etc/hostname\n"
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = io.BytesIO()
    column = pa.DictionaryArray.from_arrays(np.zeros(60_000_000, dtype=np.int8), pa.array([1.0]))
    pq.write_table(pa.table({"time_s": column, "pressure_kPa": column}), sink, compression="zstd")
    yield "parquet", sink.getvalue()


# -- the run -------------------------------------------------------------------------------------------------------


def fuzz(inputs: int, seed: int = 0, only: str = "") -> Count:
    """Give every reader its share of `inputs`, in this process; a hang or a crash of a library ends it, and is seen."""
    import resource

    total = Count()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name)
        made_up = list(bombs())
        every = [target for target in targets(folder) if only in target.name]
        share = -(-inputs // len(every))
        for target in every:
            chance = random.Random(f"{seed} {target.name}")
            made: list[tuple[str, bytes]] = [(str(number), mutated(target.content, chance)) for number in range(share)]
            for what, content in [("as it is", target.content), *made_up, *made]:
                _one(total, target, folder, what, content)
            total.by_target[target.name] += len(made)
        used = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        total.most_bytes = 1024 * max(used)
    return total


def _one(total: Count, target: Target, folder: Path, what: str, content: bytes) -> None:
    from rfea_vision.errors import RfeaError

    path = folder / f"x{target.ending}"
    path.write_bytes(content)
    total.inputs += 1
    begun = time.monotonic()
    try:
        target.read(path)
        total.accepted += 1
    except RfeaError as error:
        total.refused += 1
        if "\n" in str(error) or not str(error):
            total.faults.append(f"{target.name}, {what}: more than a sentence: {str(error)[:200]!r}")
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        total.faults.append(f"{target.name}, {what}: {type(error).__name__}: {str(error)[:200]}")
    took = time.monotonic() - begun
    total.longest_s = max(total.longest_s, took)
    if took > MOST_S:
        total.faults.append(f"{target.name}, {what}: {took:.1f} s")


def run() -> list[dict[str, Any]]:
    """Every row of this group: 22,000 inputs, half of them in the process that reads the files of strangers."""
    from rfea_vision.readers import apart

    found = [fuzz(11_000, seed=1)]
    apart.isolate()
    found.append(fuzz(11_000, seed=2))
    apart.isolate(False)
    faults = [text for part in found for text in part.faults]
    for text in faults:
        sys.stderr.write(f"  {text}\n")
    return [
        {"name": "damaged and made up inputs", "value": sum(part.inputs for part in found), "unit": "inputs", "target": ">= 20000",
         "met": sum(part.inputs for part in found) >= 20_000},
        {"name": "inputs that were no single sentence, or a wrong number accepted", "value": len(faults), "unit": "inputs",
         "target": "0", "met": not faults},
        {"name": "longest reading", "value": round(max(part.longest_s for part in found), 1), "unit": "s", "target": "< 20",
         "met": max(part.longest_s for part in found) < MOST_S},
        {"name": "most memory", "value": round(max(part.most_bytes for part in found) / 1e9, 2), "unit": "GB", "target": "< 2",
         "met": max(part.most_bytes for part in found) < MOST_BYTES},
    ]  # fmt: skip
