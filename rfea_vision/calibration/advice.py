"""What the photos lack, as sentences: places never filled, directions never taken, photos that do not belong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rfea_vision.artefacts.rows import Coverage
from rfea_vision.calibration.bundle import Bundle
from rfea_vision.calibration.corners import BoardView

ENOUGH_PHOTOS = 8  # fewer are said to be few
LEAST_TURN_DEG = 15.0  # between two of the boards' normals; below, focal length and distance look alike
FOCAL_UNSURE = 0.02  # standard error over value
TURNED_DEG = 20.0  # photos for the lens are asked for from here on; a camera that looks at a rig seldom stands so far aside
POOR_PHOTO = 3.0  # times the median residual

_ROWS = ("top", "upper part", "middle", "middle", "lower part", "bottom")
_COLUMNS = ("left", "left", "left of the middle", "middle", "middle", "right of the middle", "right", "right")


def coverage(photos: Sequence[BoardView], size: tuple[int, int]) -> Coverage:
    """Corners counted in 6 x 8 fields of the picture."""
    every = np.concatenate([view.pixels for view in photos])
    counts, y_edges, x_edges = np.histogram2d(every[:, 1], every[:, 0], bins=(6, 8), range=((0, size[1]), (0, size[0])))
    return {"counts": counts.astype(int).tolist(), "x_edges_px": x_edges.tolist(), "y_edges_px": y_edges.tolist()}


def where_to_add(counts: Sequence[Sequence[int]]) -> str:
    """Say where in the picture the board has never been."""
    fields = np.array(counts)
    empty = np.argwhere(fields == 0)
    if len(empty) == 0:
        return "the board has been everywhere in the picture"
    named = list(dict.fromkeys(f"{_ROWS[i]} {_COLUMNS[j]}".replace("middle middle", "middle") for i, j in empty))
    return f"add photos with the board at: {', '.join(named[:6])} ({len(empty)} of {fields.size} fields are empty)"


def largest_turn_deg(bundle: Bundle, count: int) -> float:
    """Largest angle between the boards of any two of the first `count` photos."""
    normals = np.array([rotation[:, 2] for rotation in bundle.rotations[:count]])
    cosines = np.clip(np.abs(normals @ normals.T), 0.0, 1.0)
    return float(np.degrees(np.arccos(cosines.min())))


def of_plane(file: str, tilt_deg: float) -> list[str]:
    """Doubt the photo of the plane of motion where the board is turned in it as in photos for the lens."""
    if tilt_deg < TURNED_DEG:
        return []
    return [
        f"{file} shows the board turned by {tilt_deg:.0f} deg from the picture's plane: did it lie in the plane in which the tube "
        "moves? If not, photograph it so (camera.plane); if the camera looks at the tube so aslant, all is well"
    ]


def warnings_of(bundle: Bundle, photos: Sequence[BoardView], scores: dict[str, float]) -> list[str]:
    """Every reason to distrust this calibration, each with what to do; the plane photo is not among `photos`."""
    found = []
    count = len(photos)
    focal = bundle.lens.matrix[0, 0]
    unsure = float(np.sqrt(bundle.lens_covariance[0, 0])) / focal
    turn = largest_turn_deg(bundle, count)
    if turn < LEAST_TURN_DEG:
        found.append(
            f"all photos show the board from nearly the same direction (within {turn:.0f} deg): the focal length, "
            f"{focal:.0f} px, is known to {100 * unsure:.1f} % only; add photos with the board turned by 20 to 40 deg "
            "about both of its sides"
        )
    elif unsure > FOCAL_UNSURE:
        found.append(
            f"the focal length, {focal:.0f} px, is known to {100 * unsure:.1f} % only; "
            "add photos with the board turned by 20 to 40 deg, and some that fill the picture"
        )
    if count < ENOUGH_PHOTOS:
        chosen = "" if scores else ", and the lens model was not compared with others"
        found.append(f"{count} photos are few: errors that they share go unnoticed{chosen}; take 10 to 20")
    rms = np.array([bundle.rms_of(i) for i in range(count)])
    for i in np.argsort(-rms):
        if count >= 4 and rms[i] > POOR_PHOTO * np.median(rms) and rms[i] > 0.1:
            found.append(
                f"{photos[i].file.name} fits far worse than the others ({rms[i]:.2f} px, median "
                f"{np.median(rms):.2f} px): was the board bent or moving? leave it out, or take it again"
            )
    return found
