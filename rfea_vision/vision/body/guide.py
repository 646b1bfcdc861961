"""Where another program saw the body: masks or key points of every frame, as the coarse step of the fit.

SAM 2, CoTracker, DeepLabCut, SLEAP and the like say about where the body is; its edges, end and skin say where exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Hints
from rfea_vision.errors import InputError
from rfea_vision.readers.pictures import read_grey
from rfea_vision.vision.body.midline import Refusal, midline_from_mask

Guide = Callable[[int], FloatArray | None]  # number of a frame to points (n, 2) px from clamp to tip

PICTURES = (".png", ".bmp", ".tif", ".tiff")
LIGHT = 127  # above it a pixel of a mask is body
LEAST_POINTS = 3


def guide_of(hints: Hints, clamp_px: FloatArray) -> Guide | None:
    """Reader of the masks or key points that the hints name; None where they name none.

    Raises
    ------
    InputError
        If the folder holds no mask, or the table is none.
    """
    if hints.keypoints is not None:
        return _by_keypoints(hints.keypoints)
    return None if hints.masks is None else _by_masks(hints.masks, clamp_px.mean(axis=0))


def mask_files(folder: Path) -> list[Path]:
    """The masks of a folder, in order of name."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)


def _by_keypoints(path: Path) -> Guide:
    try:
        table = np.atleast_2d(np.genfromtxt(path, delimiter=",", skip_header=1, dtype=float))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: camera.keypoints is no table; give a CSV with 'frame,x0,y0,x1,y1,...'") from error
    if table.shape[1] < 1 + 2 * LEAST_POINTS or table.shape[1] % 2 == 0:
        raise InputError(
            f"{path}: camera.keypoints needs the columns frame,x0,y0,... of at least {LEAST_POINTS} points"
        )
    rows = {int(row[0]): row[1:].reshape(-1, 2) for row in table if np.isfinite(row[0])}

    def points(frame: int) -> FloatArray | None:
        found = rows.get(frame)
        seen = None if found is None else found[np.isfinite(found).all(axis=1)]
        return seen if seen is not None and len(seen) >= LEAST_POINTS else None

    return points


def _by_masks(folder: Path, clamp: FloatArray) -> Guide:
    files = mask_files(folder)
    if not files:
        raise InputError(f"{folder}: camera.masks holds no picture ({', '.join(PICTURES)}); give one mask per frame")

    def points(frame: int) -> FloatArray | None:
        picture = read_grey(files[frame]) if frame < len(files) else None
        found = midline_from_mask(picture > LIGHT) if picture is not None else Refusal("no mask")
        if isinstance(found, Refusal):
            return None
        ends = np.linalg.norm(found.points[[0, -1]] - clamp, axis=1)
        return found.points if ends[0] <= ends[1] else found.points[::-1].copy()

    return points
