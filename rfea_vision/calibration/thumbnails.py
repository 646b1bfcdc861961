"""Small copies of the photos of the board, turned as the calibration saw them, for the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2

from rfea_vision.calibration.photos import read_photo, reference_photo
from rfea_vision.files import whole_file

LONGEST_SIDE_PX = 360  # twelve beside one another on a page
QUALITY = 60  # of JPEG


def save_thumbnails(folder: Path, photos: Sequence[Path], plane: Path | None) -> list[Path]:
    """Write ``<name of the photo, with its ending>.jpg`` for every photo that can be read, and return what was written."""
    like = reference_photo(photos, plane)
    written = []
    for path in [*photos, *([plane] if plane is not None else [])]:
        photo = read_photo(path)
        if photo is None:
            continue
        picture = photo.shown(like)
        scale = min(1.0, LONGEST_SIDE_PX / max(picture.shape))
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        target = folder / f"{path.name}.jpg"
        with whole_file(target) as temporary:
            cv2.imwrite(str(temporary), small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        written.append(target)
    return written
