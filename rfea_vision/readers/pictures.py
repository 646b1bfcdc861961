"""Pictures as grey levels; what cannot be read is None, whatever the decoder makes of it."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.errors import InputError
from rfea_vision.readers.apart import ask, isolated

Picture = NDArray[np.uint8]
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


def numbered_pictures(folder: Path, endings: tuple[str, ...] = PICTURES) -> tuple[Path, ...]:
    """Return the pictures of a folder in order of the numbers in their names: 10.png comes after 9.png."""
    files = (path for path in folder.iterdir() if path.suffix.lower() in endings)
    return tuple(
        sorted(
            files, key=lambda path: [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]
        )
    )


def read_grey(path: Path, *, as_stored: bool = False) -> Picture | None:
    """Read a picture, turned as its file says or, `as_stored`, as the sensor saw it; None if it cannot be read."""
    return decode(path, cv2.IMREAD_GRAYSCALE | (cv2.IMREAD_IGNORE_ORIENTATION if as_stored else 0))


def read_colour(path: Path) -> Picture | None:
    """Read a picture (h, w, 3) in blue, green and red, turned as its file says; None if it cannot be read."""
    return decode(path, cv2.IMREAD_COLOR)


def decode(path: Path, how: int) -> Picture | None:
    """Read a picture with OpenCV's flags; it returns nothing for what it does not know and raises for what is damaged."""
    if isolated():
        try:
            return ask("picture", path, how=how)
        except InputError:
            return None
    try:
        data = np.fromfile(path, dtype=np.uint8)
        found = cv2.imdecode(data, how) if data.size else None
    except (OSError, cv2.error, MemoryError):
        return None
    return None if found is None else np.asarray(found, dtype=np.uint8)


def scaled(picture: Picture, scale: float) -> Picture:
    """Scale the sides of a picture down, each pixel the mean of those that it covers."""
    if scale >= 1.0:
        return picture
    size = (max(round(scale * picture.shape[1]), 2), max(round(scale * picture.shape[0]), 2))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
