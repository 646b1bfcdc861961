"""How far a calibration can be trusted, in mm on the plane of motion.

The test of model error is mrcal's: solve each half of the photos alone; the two solutions should differ by what their
uncertainties predict. Where they differ by more, the lens model or the board is wrong, and every uncertainty is scaled
up by that ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.calibration.bundle import Bundle, solve_bundle
from rfea_vision.calibration.corners import BoardView
from rfea_vision.calibration.projection import pack_camera, rotation_matrix, unproject
from rfea_vision.errors import DataError

FloatArray = NDArray[np.float64]
LARGEST_INFLATION = 5.0


def assess(
    views: Sequence[BoardView],
    bundle: Bundle,
    size: tuple[int, int],
    model: str,
    *,
    has_plane: bool,
    around_px: Sequence[Sequence[float]] | None = None,
) -> tuple[dict[str, Any], float]:
    """Coverage, residual fields, uncertainty map and cross-validated difference; and the factor on the uncertainties.

    `views` are the photos, the plane photo last if `has_plane`. `around_px` narrows the region to its surroundings.
    """
    photos = views[:-1] if has_plane else views
    quality: dict[str, Any] = {"coverage": _coverage(photos, size), "residual_fields": _residual_fields(views, bundle)}
    quality["advice"] = _advice(quality["coverage"])
    if not has_plane or bundle.joint_covariance is None:
        return quality, 1.0
    grid = _grid(size, around_px)
    camera = _camera_of(bundle, len(views) - 1)
    spread = _spread_mm(bundle, len(views) - 1, camera, grid)
    quality["uncertainty_map"] = {
        "x_px": grid[0, :, 0].tolist(),
        "y_px": grid[:, 0, 1].tolist(),
        "sigma_mm": np.round(spread, 6).tolist(),
        "caption": "standard error of a point on the plane of motion relative to the middle of the picture",
    }
    if len(photos) < 6:
        quality["cross_validation"] = {"note": "too few photos to compare halves"}
        return quality, 1.0
    return _cross_validate(photos, views[-1], size, model, grid, quality)


def _cross_validate(photos, plane_view, size, model, grid, quality) -> tuple[dict[str, Any], float]:
    order = np.random.default_rng(0).permutation(len(photos))
    cameras, predicted = [], []
    try:
        for start in (0, 1):
            half = [photos[i] for i in order[start::2]] + [plane_view]
            bundle = solve_bundle(half, size, model, joint_view=len(half) - 1)
            camera = _camera_of(bundle, len(half) - 1)
            cameras.append(camera)
            predicted.append(_spread_mm(bundle, len(half) - 1, camera, grid, lens_only_plane=True))
    except (DataError, np.linalg.LinAlgError):
        quality["cross_validation"] = {"note": "half of the photos do not determine the lens"}
        return quality, 1.0
    a, b = (_relative(unproject(camera, grid)) for camera in cameras)
    difference = float(np.sqrt(np.nanmean(np.sum((a - b) ** 2, axis=-1))))
    expected = float(np.sqrt(np.nanmean(predicted[0] ** 2 + predicted[1] ** 2)))
    ratio = difference / max(expected, 1e-12)
    quality["cross_validation"] = {
        "difference_mm": difference,
        "predicted_mm": expected,
        "ratio": ratio,
        "sentence": "the two halves of the photos differ by what their uncertainties say"
        if ratio < 1.5
        else "the two halves differ by more than their uncertainties say: lens model or board are not perfect; "
        "uncertainties are scaled up",
    }
    return quality, float(np.clip(ratio, 1.0, LARGEST_INFLATION))


def _camera_of(bundle: Bundle, view: int) -> FloatArray:
    return pack_camera(
        bundle.lens.model,
        bundle.lens.matrix,
        bundle.lens.distortion,
        bundle.rotations[view],
        bundle.translations_mm[view],
    )


def _relative(points: FloatArray) -> FloatArray:
    """Differences to the middle of the grid: the rig's origin is itself measured in the picture."""
    middle = points[points.shape[0] // 2, points.shape[1] // 2]
    return points - middle


def _spread_mm(
    bundle: Bundle, view: int, camera: FloatArray, grid: FloatArray, *, lens_only_plane: bool = False
) -> FloatArray:
    """Standard error of plane points relative to the middle of the grid.

    With `lens_only_plane` the noise of the shared plane photo is left out: it is common to both halves.
    """
    assert bundle.joint_covariance is not None
    count = len(bundle.lens.vector)
    joint = bundle.joint_covariance
    if lens_only_plane:
        gain = joint[count:, :count] @ np.linalg.pinv(joint[:count, :count])
        transfer = np.vstack([np.eye(count), gain])
        joint = transfer @ joint[:count, :count] @ transfer.T
    values, vectors = np.linalg.eigh(joint)
    here = _relative(unproject(camera, grid))
    total = np.zeros(grid.shape[:2])
    for value, vector in zip(values, vectors.T, strict=True):
        if value <= 0:
            continue
        change = np.sqrt(value) * vector
        lens = type(bundle.lens).from_vector(bundle.lens.model, bundle.lens.vector + change[:count])
        rotation = rotation_matrix(change[count : count + 3]) @ bundle.rotations[view]
        moved = pack_camera(
            lens.model, lens.matrix, lens.distortion, rotation, bundle.translations_mm[view] + change[count + 3 :]
        )
        total += np.sum((_relative(unproject(moved, grid)) - here) ** 2, axis=-1)
    return np.sqrt(total)


def _grid(size: tuple[int, int], around_px: Sequence[Sequence[float]] | None) -> FloatArray:
    w, h = size
    left, right, top, bottom = 0.08 * w, 0.92 * w, 0.08 * h, 0.92 * h
    if around_px is not None:
        x, y = np.mean(np.asarray(around_px, dtype=float), axis=0)
        left, right, top, bottom = max(left, x - 0.4 * w), min(right, x + 0.4 * w), max(top, y - 0.1 * h), bottom
    return np.stack(np.meshgrid(np.linspace(left, right, 9), np.linspace(top, bottom, 9)), axis=-1)


def _coverage(photos: Sequence[BoardView], size: tuple[int, int]) -> dict[str, Any]:
    every = np.concatenate([v.pixels for v in photos])
    counts, y_edges, x_edges = np.histogram2d(every[:, 1], every[:, 0], bins=(6, 8), range=((0, size[1]), (0, size[0])))
    return {"counts": counts.astype(int).tolist(), "x_edges_px": x_edges.tolist(), "y_edges_px": y_edges.tolist()}


def _residual_fields(views: Sequence[BoardView], bundle: Bundle) -> list[dict[str, Any]]:
    fields = [
        {
            "file": view.file.name,
            "rms_px": round(bundle.rms_of(i), 4),
            "x_px": np.round(view.pixels[:, 0], 2).tolist(),
            "y_px": np.round(view.pixels[:, 1], 2).tolist(),
            "dx_px": np.round(bundle.residuals[i][:, 0], 4).tolist(),
            "dy_px": np.round(bundle.residuals[i][:, 1], 4).tolist(),
        }
        for i, view in enumerate(views)
    ]
    return sorted(fields, key=lambda field: -field["rms_px"])


def _advice(coverage: dict[str, Any]) -> str:
    counts = np.array(coverage["counts"])
    rows = ("top", "upper middle", "middle", "middle", "lower middle", "bottom")
    columns = ("left", "left", "left of the middle", "middle", "middle", "right of the middle", "right", "right")
    empty = np.argwhere(counts == 0)
    if len(empty) == 0:
        return "the board has been everywhere in the picture"
    named = list(dict.fromkeys(f"{rows[i]} {columns[j]}" for i, j in empty))
    return f"add photos with the board at: {', '.join(named[:6])} ({len(empty)} of {counts.size} fields are empty)"
