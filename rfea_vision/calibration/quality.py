"""How far a calibration can be trusted, in mm on the plane of motion.

The test of model error is mrcal's: solve each half of the photos alone; the two solutions should differ by what their
uncertainties predict. Where they differ by more than chance allows, the lens model or the board is wrong, and every
uncertainty is scaled up by that ratio. A field of differences has few free modes (tilt, scale, bend), so its size
scatters widely by chance: it is compared mode by mode with the covariance that the two solutions claim.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.rows import CalibrationQuality, CrossValidation, PhotoResiduals
from rfea_vision.calibration import advice
from rfea_vision.calibration.bundle import Bundle, solve_bundle
from rfea_vision.calibration.corners import BoardView
from rfea_vision.calibration.projection import moved_cameras, pack_camera, unproject
from rfea_vision.errors import DataError
from rfea_vision.units import rounded

LARGEST_INFLATION = 10.0  # of standard errors, at most
SPLITS = 3  # into halves, at random
CHANCE = 0.99  # level at which halves differ by more than chance
MODE_SHARE = 0.02  # of the largest mode's variance: smaller ones are below what matters and above rounding


def assess(
    views: Sequence[BoardView],
    bundle: Bundle,
    size: tuple[int, int],
    model: str,
    *,
    has_plane: bool,
    scores: dict[str, float] | None = None,
) -> tuple[CalibrationQuality, float]:
    """Coverage, residual fields, uncertainty map and cross-validated difference; and the factor on the uncertainties.

    `views` are the photos, the plane photo last if `has_plane`.
    """
    photos = views[:-1] if has_plane else views
    covered = advice.coverage(photos, size)
    quality: CalibrationQuality = {
        "coverage": covered,
        "residual_fields": _residual_fields(views, bundle),
        "warnings": advice.warnings_of(bundle, photos, scores or {}),
        "largest_turn_deg": advice.largest_turn_deg(bundle, len(photos)),
        "advice": advice.where_to_add(covered["counts"]),
    }
    if not has_plane or bundle.joint_covariance is None:
        return quality, 1.0
    grid = _grid(size)
    inflation = 1.0
    if len(photos) < 6:
        quality["cross_validation"] = {"note": "too few photos to compare halves"}
    else:
        quality["cross_validation"], inflation = _cross_validate(photos, views[-1], size, model, grid)
    fields = _fields(bundle, len(views) - 1, grid, bundle.joint_covariance)
    quality["uncertainty_map"] = {
        "x_px": grid[0, :, 0].tolist(),
        "y_px": grid[:, 0, 1].tolist(),
        "sigma_mm": np.round(inflation * np.sqrt(np.sum(fields**2, axis=(0, -1))), 6).tolist(),
        "caption": "standard error of a point on the plane of motion relative to the middle of the picture",
    }
    return quality, inflation


def _cross_validate(
    photos: Sequence[BoardView], plane_view: BoardView, size: tuple[int, int], model: str, grid: FloatArray
) -> tuple[CrossValidation, float]:
    """Compare halves over several splits; the factor on the uncertainties comes from the split in the middle."""
    found = []
    for seed in range(SPLITS):
        try:
            found.append(_compare_halves(photos, plane_view, size, model, grid, seed))
        except (DataError, np.linalg.LinAlgError):
            return {"note": "half of the photos do not determine the lens"}, 1.0
    difference = float(np.sqrt(np.mean([row.apart_mm**2 for row in found])))
    expected = float(np.sqrt(np.mean([row.expected_mm**2 for row in found])))
    excess = float(np.median([row.chi2 / row.modes for row in found]))
    allowed = float(np.median([chi2.ppf(CHANCE, row.modes) / row.modes for row in found]))
    inflation = float(np.clip(np.sqrt(excess), 1.0, LARGEST_INFLATION)) if excess > allowed else 1.0
    by_chance = float(np.median([chi2.sf(row.chi2, row.modes) for row in found]))
    said = f"two halves of the photos give lenses {rounded(difference)} mm apart over the picture, {rounded(expected)} mm expected"
    if inflation > 1.0:
        said += f": more than chance, the lens model or the board are not perfect; uncertainties are scaled up by {inflation:.1f}"
    else:
        said += f"; chance alone puts them as far apart in {100 * by_chance:.2g} % of calibrations, so nothing is scaled up"
    return {
        "difference_mm": difference,
        "predicted_mm": expected,
        "ratio": difference / max(expected, 1e-12),
        "inflation": inflation,
        "halves": [camera.tolist() for camera in found[0].cameras],
        "sentence": said,
    }, inflation


class _Halves(NamedTuple):
    """Two packed cameras (29,), the distance of the places that they give, as found and expected, and its square over `modes` modes."""

    cameras: list[FloatArray]
    apart_mm: float
    expected_mm: float
    chi2: float
    modes: int


def _compare_halves(
    photos: Sequence[BoardView], plane_view: BoardView, size: tuple[int, int], model: str, grid: FloatArray, seed: int
) -> _Halves:
    order = np.random.default_rng(seed).permutation(len(photos))
    cameras, fields = [], []
    for start in (0, 1):
        half = [photos[i] for i in order[start::2]] + [plane_view]
        bundle = solve_bundle(half, size, model, joint_view=len(half) - 1)
        cameras.append(_camera_of(bundle, len(half) - 1))
        fields.append(_fields(bundle, len(half) - 1, grid, _lens_part(bundle)))
    apart = (_relative(unproject(cameras[0], grid)) - _relative(unproject(cameras[1], grid))).ravel()
    spread = np.concatenate(fields).reshape(-1, apart.size)  # (axes, places): covariance is spread' spread
    good = np.isfinite(apart) & np.all(np.isfinite(spread), axis=0)
    apart, spread = apart[good], spread[:, good]
    _, sizes, modes = np.linalg.svd(spread, full_matrices=False)
    keep = sizes**2 > MODE_SHARE * sizes[0] ** 2
    scores = (modes[keep] @ apart) / sizes[keep]
    places = apart.size / 2
    by_chance = float(np.sqrt(np.sum(spread**2) / places))
    return _Halves(cameras, float(np.sqrt(np.sum(apart**2) / places)), by_chance, float(scores @ scores), int(keep.sum()))


def _camera_of(bundle: Bundle, view: int) -> FloatArray:
    return pack_camera(bundle.lens.model, bundle.lens.vector, bundle.rotations[view], bundle.translations_mm[view])


def _relative(points: FloatArray) -> FloatArray:
    """Differences to the middle of the grid: the rig's origin is itself measured in the picture."""
    return points - points[points.shape[0] // 2, points.shape[1] // 2]


def _lens_part(bundle: Bundle) -> FloatArray:
    """Joint covariance without the noise of the plane photo, which is common to both halves."""
    assert bundle.joint_covariance is not None
    count = len(bundle.lens.vector)
    joint = bundle.joint_covariance
    gain = joint[count:, :count] @ np.linalg.pinv(joint[:count, :count])
    transfer = np.vstack([np.eye(count), gain])
    return transfer @ joint[:count, :count] @ transfer.T


def _fields(bundle: Bundle, view: int, grid: FloatArray, joint: FloatArray) -> FloatArray:
    """How plane points move, relative to the middle, by one standard error along each axis of `joint`, (axes, ..., 2)."""
    lens, rotation, translation = bundle.lens, bundle.rotations[view], bundle.translations_mm[view]
    here = _relative(unproject(_camera_of(bundle, view), grid))
    cameras = moved_cameras(lens.model, lens.vector, rotation, translation, joint)
    return np.array([_relative(unproject(camera, grid)) - here for camera in cameras])


def _grid(size: tuple[int, int]) -> FloatArray:
    w, h = size
    return np.stack(np.meshgrid(np.linspace(0.08 * w, 0.92 * w, 9), np.linspace(0.08 * h, 0.92 * h, 9)), axis=-1)


def _residual_fields(views: Sequence[BoardView], bundle: Bundle) -> list[PhotoResiduals]:
    fields: list[PhotoResiduals] = [
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
