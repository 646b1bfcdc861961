"""Where another program saw the body: masks or key points of every frame, as the coarse step of the fit.

SAM 2, CoTracker, DeepLabCut, SLEAP and the like say about where the body is; its edges, end and skin say where exactly.
Their code is never run here: what they wrote is read.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Hints
from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import unseen
from rfea_vision.readers.pictures import numbered_pictures, read_grey
from rfea_vision.readers.tables import read_table
from rfea_vision.vision.body.ways import middle_way

Guide = Callable[[int], FloatArray | None]  # number of a frame to points (n, 2) px from clamp to tip

PICTURES = (".png", ".bmp", ".tif", ".tiff")
LEAST_POINTS = 3
LEAST_SURE = 0.6  # of a point's likelihood: DeepLabCut's own limit (pcutoff)


def guide_of(hints: Hints, clamp_px: FloatArray) -> Guide | None:
    """Reader of the masks or key points that the hints name; None where they name none.

    Raises
    ------
    InputError
        If the folder holds no mask, or the file no points.
    """
    clamp = clamp_px.mean(axis=0)
    if hints.keypoints is not None:
        rows = _rows(hints.keypoints, clamp)
        return lambda frame: _enough(rows.get(frame))
    return None if hints.masks is None else _by_masks(hints.masks, clamp, 0.5 * float(np.linalg.norm(clamp_px[1] - clamp_px[0])))


def _rows(path: Path, clamp: FloatArray) -> dict[int, FloatArray]:
    """Points (n, 2) px of every frame, from the clamp on, of a file of any tracker of points."""
    if path.suffix.lower() == ".npy":
        return dict(enumerate(_outwards(_array(path), clamp)))
    table = read_table(path)
    bodies = [unseen(found.positions, found.confidence, LEAST_SURE) for found in table.points.values()]
    bodies = [_outwards(body, clamp) for body in bodies if body.shape[1] >= LEAST_POINTS and body.shape[2] == 2]
    if bodies:  # of several animals the one that begins at the clamp
        return dict(enumerate(min(bodies, key=lambda body: _apart(body[:, 0], clamp))))
    names = [name for name in table.columns if re.fullmatch(r"[xy]\d+", name)]
    if "frame" not in table.columns or len(names) < 2 * LEAST_POINTS or len(names) % 2:
        raise InputError(
            f"{path}: camera.keypoints holds no line of points; give a file of DeepLabCut, SLEAP or movement, an array (frame, "
            f"point, xy) as .npy, or a CSV with the columns frame,x0,y0,... of at least {LEAST_POINTS} points"
        )
    points = np.stack([table.numbers(name) for name in names], axis=1).reshape(-1, len(names) // 2, 2)
    return {int(frame): row for frame, row in zip(table.numbers("frame"), points, strict=True) if np.isfinite(frame)}


def _array(path: Path) -> FloatArray:
    """CoTracker's tracks (frame, point, xy), with or without its leading axis of one."""
    try:
        points = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: camera.keypoints is no array of numbers; save the tracks with numpy.save") from error
    points = points[0] if points.ndim == 4 and len(points) == 1 else points
    if points.ndim != 3 or points.shape[2] != 2 or points.shape[1] < LEAST_POINTS or points.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: camera.keypoints is {points.shape}, not (frame, point of {LEAST_POINTS} or more, xy)"
        )
    return points.astype(float)


def _outwards(body: FloatArray, clamp: FloatArray) -> FloatArray:
    """Points (frame, n, 2) in the order in which the first of them is at the clamp."""
    return body if _apart(body[:, 0], clamp) <= _apart(body[:, -1], clamp) else body[:, ::-1]


def _apart(points: FloatArray, clamp: FloatArray) -> float:
    """Median distance of points (frame, 2) from the clamp where they were seen; infinite where never."""
    away = np.linalg.norm(points - clamp, axis=1)
    return float(np.median(away[np.isfinite(away)])) if np.isfinite(away).any() else np.inf


def _enough(found: FloatArray | None) -> FloatArray | None:
    seen = None if found is None else found[np.isfinite(found).all(axis=1)]
    return seen if seen is not None and len(seen) >= LEAST_POINTS else None


def _by_masks(folder: Path, clamp: FloatArray, half_px: float) -> Guide:
    files = numbered_pictures(folder, PICTURES)
    if not files:
        raise InputError(f"{folder}: camera.masks holds no picture ({', '.join(PICTURES)}); give one mask per frame")

    def points(frame: int) -> FloatArray | None:
        picture = read_grey(files[frame]) if frame < len(files) else None
        # Programs write a body as 255, as 1, or in the colour of its number.
        inside = np.empty((0, 0), dtype=np.uint8) if picture is None else np.asarray(picture > picture.max() / 2, dtype=np.uint8)
        places = np.argwhere(inside)
        if len(places) == 0:
            return None
        row, column = places[int(np.argmin(np.linalg.norm(places[:, ::-1] - clamp, axis=1)))].tolist()
        return middle_way(inside, (row, column), half_px)

    return points
