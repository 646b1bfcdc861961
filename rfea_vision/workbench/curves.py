"""A pressure curve of a few points, written as a log that commands read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.errors import InputError
from rfea_vision.files import write_text

STEP_S = 0.01  # of the file: a hundredth of a second is finer than any valve of these rigs moves


def write_curve(out: Path, model: str, points: Any) -> Path:
    """Write ``next-experiment-edited.csv`` beside a model: straight lines between `points`, pairs of s and kPa.

    Raises
    ------
    InputError
        If there is no such model, or the points are no curve.
    """
    folder = out / "models" / model
    if model not in {path.parent.name for path in out.glob("models/*/model.json")}:
        raise InputError(f"{model}: no such model")
    knots = np.asarray(points, dtype=float)
    if (
        knots.ndim != 2
        or knots.shape[1] != 2
        or len(knots) < 2
        or not np.isfinite(knots).all()
        or (np.diff(knots[:, 0]) <= 0).any()
    ):
        raise InputError("a curve needs two points or more, in the order of their times")
    time = np.arange(knots[0, 0], knots[-1, 0] + STEP_S / 2, STEP_S)
    rows = [f"{t:.3f},{p:.3f}" for t, p in zip(time, np.interp(time, *knots.T), strict=True)]
    file = folder / "next-experiment-edited.csv"
    write_text(file, "time_s,pressure_kPa\n" + "\n".join(rows) + "\n")
    return file
