"""The calibration that `camera.scale` gives, without a board, and for which films."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rfea_vision.artefacts.measurement import Calibration, Hints
from rfea_vision.campaign.schema import ScalePart
from rfea_vision.campaign.specs import CameraSpec

if TYPE_CHECKING:
    from rfea_vision.arrays import FloatArray


def calibrated_by_scale(camera: CameraSpec, size: tuple[int, int], length_mm: float) -> Calibration:
    """Calibration by `camera.scale` of pictures of a `size` in px, in which the tube is `length_mm` long.

    Raises
    ------
    InputError
        If its points do not tell a scale.
    """
    from rfea_vision.calibration.scale import TUBE_SPREAD, scaled_by_distance, scaled_by_places

    scale = camera.scale
    if isinstance(scale, ScalePart):
        error_mm, behind_mm = None if scale.error is None else 1e3 * scale.error, 1e3 * scale.behind
        if scale.distance is not None:
            return scaled_by_distance(size, scale.points, 1e3 * scale.distance, error_mm=error_mm, behind_mm=behind_mm)
        places_mm = [(1e3 * x, 1e3 * y) for x, y in scale.places or ()]
        return scaled_by_places(size, scale.points, places_mm, error_mm=error_mm, behind_mm=behind_mm)
    return scaled_by_distance(size, pointed_line(camera.hints), length_mm, error_mm=TUBE_SPREAD * length_mm)


def pointed_line(hints: Hints) -> FloatArray:
    """Points (n, 2) px from the clamp's middle to the tip."""
    return np.array([np.mean(np.array(hints.clamp), axis=0), *hints.centre_line, hints.tip], dtype=float)


def one_scale(one: CameraSpec | None, other: CameraSpec | None) -> bool:
    """Whether two runs have the pixels of one scale: it was pointed at in one film, and holds for films of the same size alone."""
    if one is None or other is None or one.scale is None:
        return False
    return one == other or (isinstance(one.scale, ScalePart) and one.scale == other.scale)


def of_sizes(sizes: Mapping[str, tuple[int, int]]) -> str:
    """Why one scale cannot hold for films of these `sizes` (px) by their runs; empty where it can."""
    first = dict[tuple[int, int], str]()
    for name, size in sizes.items():
        first.setdefault(size, name)
    if len(first) < 2:
        return ""
    (one, name), (other, elsewhere) = list(first.items())[:2]
    unlike = f"the pictures of {name} have {one[0]} x {one[1]} px, and those of {elsewhere} {other[0]} x {other[1]}"
    return f"{unlike}; write it into the experiment.yaml of the film that it was pointed at in, and one of its own for the other"
