"""Photos as grey levels, all turned the same way: as the plane photo is, or as most of them are.

A lens belongs to the sensor. A camera held upright writes the same pixels and a remark (EXIF) on how to turn them;
photos that were taken with the camera held differently are therefore turned back to the sensor and then all alike.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfea_vision.readers import pictures
from rfea_vision.readers.pictures import Picture

SAME_SHAPE = 0.003  # of width over height: two rows of 640, which encoders add or leave out


@dataclass(frozen=True)
class Photo:
    """Grey levels as the sensor saw them, and how the file says to show them: quarter turns, then a mirror."""

    file: Path
    sensor: Picture
    turns: int = 0
    mirrored: bool = False

    def shown(self, like: Photo | None = None) -> Picture:
        """The picture turned as its file says, or as that of another photo says."""
        how = like or self
        picture = np.rot90(self.sensor, how.turns)
        return np.ascontiguousarray(picture[:, ::-1] if how.mirrored else picture)


def read_photo(path: Path) -> Photo | None:
    """Read a picture; None if it cannot be read."""
    sensor, shown = pictures.read_grey(path, as_stored=True), pictures.read_grey(path)
    if sensor is None or shown is None:
        return None
    for turns in range(4):
        for mirrored in (False, True):
            photo = Photo(path, sensor, turns, mirrored)
            if np.array_equal(photo.shown(), shown):
                return photo
    return Photo(path, shown)


def reference_photo(photos: Sequence[Path], plane: Path | None) -> Photo | None:
    """The photo that the others are turned like: that of the plane; without one, the first of the commonest kind."""
    if plane is not None:
        return read_photo(plane)
    first: dict[tuple[int, bool], Photo] = {}
    kinds: Counter[tuple[int, bool]] = Counter()
    for path in photos:
        photo = read_photo(path)
        if photo is not None:
            kinds[photo.turns, photo.mirrored] += 1
            first.setdefault((photo.turns, photo.mirrored), photo)
    return first[kinds.most_common(1)[0][0]] if kinds else None


def unlike_film(own_px: tuple[int, int], film_px: tuple[int, int], *, photos: bool = False) -> str:
    """Why a calibration of one size (width, height), by the campaign's `photos` or not, holds for no film of another; else empty."""
    (width, height), (w, h) = own_px, film_px
    if max(abs(w - width), abs(h - height)) <= 2 or abs(w * height / (h * width) - 1) <= SAME_SHAPE:
        return ""
    what, again = "its camera was calibrated for", "calibrate with the camera held as for it"
    remedy = "calibrate in the video's camera mode, or point at camera.scale in the video"
    if photos:
        what, again = "camera.photos have", "photograph the board with the camera held as for it"
        remedy = "calibrate in the video's camera mode"
    if abs(w * width / (h * height) - 1) <= SAME_SHAPE:
        remedy = f"one of them is turned: turn the video, or {again}"
    return f"the video has {w} x {h} px, {what} {width} x {height}; {remedy}"
