"""Pictures as grey levels; what cannot be read is None, whatever the decoder makes of it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.errors import InputError
from rfea_vision.readers.apart import ask, isolated

Picture = NDArray[np.uint8]
DEPTHS = (8, 10, 12, 14, 16)  # bits of cameras; all but the first are written into pictures of 16
LOOKED_AT = 9  # pictures of a folder, from the first to the last, for how many bits they use
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


def numbered_pictures(folder: Path, endings: tuple[str, ...] = PICTURES) -> tuple[Path, ...]:
    """Return the pictures of a folder in order of the numbers in their names: 10.png comes after 9.png."""
    files = (path for path in folder.iterdir() if path.suffix.lower() in endings)
    return tuple(
        sorted(
            files, key=lambda path: [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]
        )
    )


def places_in_series(files: Sequence[Path]) -> NDArray[np.float64]:
    """Place (files,) of each picture in its series, from 0: a number that is missing among the names counts as a missing picture.

    Where the names form no series the places are 0, 1, 2, ...
    """
    found = [re.split(r"(\d+)(?=\D*$)", path.stem) for path in files]
    if len(files) > 2 and all(len(parts) == 3 for parts in found) and len({(a, b) for a, _, b in found}) == 1:
        steps = np.diff([int(number) for _, number, _ in found])
        usual = int(np.median(steps))
        if usual > 0 and np.all(steps > 0) and np.all(steps % usual == 0):
            return np.concatenate([[0.0], np.cumsum(steps / usual)])
    return np.arange(len(files), dtype=float)


def read_grey(path: Path, *, as_stored: bool = False, bits: int = 16) -> Picture | None:
    """Read a picture, turned as its file says or, `as_stored`, as the sensor saw it; None if it cannot be read.

    Of a picture of 16 bits, white is that of `bits`.
    """
    return decode(path, cv2.IMREAD_GRAYSCALE | (cv2.IMREAD_IGNORE_ORIENTATION if as_stored else 0), bits)


def read_colour(path: Path, *, bits: int = 16) -> Picture | None:
    """Read a picture (h, w, 3) in blue, green and red, turned as its file says; None if it cannot be read."""
    return decode(path, cv2.IMREAD_COLOR, bits)


def decode(path: Path, how: int, bits: int = 16) -> Picture | None:
    """Read a picture with OpenCV's flags; it returns nothing for what it does not know and raises for what is damaged.

    All are read as deep as they are: asked for 8 bits, it does not know a TIFF whose pixels are packed in 10, 12 or 14.
    """
    if isolated():
        try:
            return ask("picture", path, how=how)
        except InputError:
            return None
    found = _decoded(path, how | cv2.IMREAD_ANYDEPTH)
    if found is not None and found.dtype == np.uint16:
        found = np.minimum(found >> (bits - DEPTHS[0]), 255).astype(np.uint8)
    return found if found is not None and found.dtype == np.uint8 else None


def _decoded(path: Path, how: int) -> NDArray[Any] | None:
    try:
        data = np.fromfile(path, dtype=np.uint8)
        return cv2.imdecode(data, how) if data.size else None
    except (OSError, cv2.error, MemoryError):
        return None


def bits_of(files: Sequence[Path]) -> int:
    """How many of their 16 bits pictures use, as cameras have them: of 12 bits, white is 4095 and not 65535.

    Some are looked at, from the first to the last, so that all are read alike.
    """
    used = 0
    for number in np.unique(np.linspace(0, len(files) - 1, LOOKED_AT).astype(int)):
        found = _decoded(files[number], cv2.IMREAD_UNCHANGED)
        if found is None or found.dtype != np.uint16:
            return DEPTHS[-1]
        used = max(used, int(found.max()))
    return next(depth for depth in DEPTHS if used < 1 << depth)


def pages_of(path: Path) -> int:
    """Pictures in a file: a TIFF may hold a stack of them."""
    try:
        return int(cv2.imcount(str(path))) if path.suffix.lower() in (".tif", ".tiff") else 1
    except (cv2.error, MemoryError):
        return 1


def scaled(picture: Picture, scale: float) -> Picture:
    """Scale the sides of a picture: down, each pixel is the mean of those that it covers; up, cubically."""
    if scale == 1.0:
        return picture
    size = (max(round(scale * picture.shape[1]), 2), max(round(scale * picture.shape[0]), 2))
    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size, interpolation=how), dtype=np.uint8)
