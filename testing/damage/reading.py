"""How each file is given to its reader, and what counts as a wrong number that was accepted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np


def _in_order(time_s: np.ndarray, *values: np.ndarray) -> None:
    if not (np.all(np.isfinite(time_s)) and np.all(np.diff(time_s) >= 0)):
        raise AssertionError("times that are not finite or not in order were accepted")
    for item in values:
        if not np.all(np.isfinite(item)):
            raise AssertionError("numbers that are not finite were accepted")


def log(spec: Any = None) -> Callable[[Path], None]:
    """Read a pressure log as `spec` says, by default by the usual names of columns."""

    def read(path: Path) -> None:
        from rfea_vision.campaign import PressureSpec
        from rfea_vision.campaign.schema import PressurePart
        from rfea_vision.readers.pressure import read_pressure

        if path.suffix == ".db":
            query = "SELECT time_s, pressure_kPa FROM log"
            found = read_pressure(PressureSpec(None, PressurePart(url=f"sqlite:///{path.name}", query=query), path.parent))
        else:
            found = read_pressure(replace(spec or PressureSpec(), file=path, folder=path.parent))
        _in_order(found.time_s, found.pressure_kPa)

    return read


def track(keys: Any = None) -> Callable[[Path], None]:
    """Read a track of another tool as `keys` say."""

    def read(path: Path) -> None:
        from rfea_vision.readers.tracks import read_track

        found = read_track(path, spec=keys)
        data, valid = found.dataset, found.valid
        _in_order(
            found.time_s, *(data[name].values[valid] for name in ("tip", "midline", "bend_angle") if name in data)
        )

    return read


def guess(path: Path) -> None:
    """Look at a file as ``rfea init --from`` does."""
    from rfea_vision.campaign.guess import look

    if "\n" in look(path).note:
        raise AssertionError("a guess is more than a sentence")


def film(path: Path) -> None:
    from rfea_vision.readers.video import open_video

    source = open_video(path)
    _in_order(source.times_s())
    for number, (_, luma) in enumerate(source.frames()):
        if luma.ndim != 2 or number > 40:
            break


def frames(path: Path) -> None:
    from rfea_vision.readers.video import open_frames

    source = open_frames(path.parent, path, within=path.parent)
    _in_order(source.times_s())


def picture(path: Path) -> None:
    from rfea_vision.calibration.photos import read_photo

    read_photo(path)


def camera(path: Path) -> None:
    from rfea_vision.calibration.storage import load_calibration

    found = load_calibration(path)
    _in_order(np.zeros(1), found.camera_matrix, found.distortion)


def result(path: Path) -> None:
    from rfea_vision.artefacts import Recording, Track

    (Recording if "recording" in path.name else Track).load(path)


def artefact(kind: str) -> Callable[[Path], None]:
    def read(path: Path) -> None:
        import rfea_vision.artefacts

        getattr(rfea_vision.artefacts, kind).load(path)

    return read


def settings(path: Path) -> None:
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


def records(path: Path) -> None:
    from rfea_vision.stages.cache import StageCache

    out = path.with_suffix("")
    (out / ".stages").mkdir(parents=True, exist_ok=True)
    for name in ("fit@base.json", "hashes.json"):
        (out / ".stages" / name).write_bytes(path.read_bytes())
    cache = StageCache(out)
    for record in cache.records("*"):
        cache.is_fresh(record.key, record.digest)
    cache.sha256(path)


def recipe(path: Path) -> None:
    from rfea_vision.stages.recipes import load_recipe

    load_recipe(str(path)).calls()
