"""From board photos to a `Calibration`: photos in, lens chosen by cross-validation, plane of motion, uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration
from rfea_vision.artefacts.lenses import LENSES
from rfea_vision.artefacts.rows import CalibrationQuality, PhotoRecord, PlaneQuality
from rfea_vision.calibration.advice import of_plane
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.bundle import Bundle, Lens, first_fisheye, solve_bundle, solve_pose
from rfea_vision.calibration.corners import BoardView, Refused, find_corners
from rfea_vision.calibration.misfits import doubt_of_plane, refuse_part_of_larger, same_picture, without_misfits
from rfea_vision.calibration.photos import Photo, read_photo, reference_photo
from rfea_vision.calibration.projection import has_plane, tilt_deg
from rfea_vision.calibration.quality import assess
from rfea_vision.calibration.region import middle_of, over_region, reach_of
from rfea_vision.errors import DataError, InputError
from rfea_vision.progress import Progress

MINIMUM_PHOTOS = 3  # three orientations determine a camera matrix (Zhang 2000, doi:10.1109/34.888718)
# A richer lens must predict unseen photos this much better: less, and it may be modelling an uneven print;
BETTER_BY = 0.2
# and the gain must stand out of its scatter over the photos by so many standard errors.
SURE_BY = 2.5
SIZE_TOLERANCE_PX = 2  # some programs write one row or column more
OUTLIER_SIGMA = 6.0  # times the median distance of a photo's corners: of Gaussian errors one in 2^36 is so far off (Rayleigh)
SPLITS = 3  # times that the photos are parted into halves, of which either predicts the other
LEAST_FOR_HALVES = 2 * MINIMUM_PHOTOS
WIDE_DEG = 35.0  # half diagonal beyond which the Brown polynomial begins to fail
# px over which a photo's edges rise, and times those of the others, from which it is blurred: corners are found to a part of a rise
SOFT_PX, SOFTER = 6.0, 3.0


def calibrate(
    photos: Sequence[Path],
    plane: Path | None,
    board: Board,
    *,
    vertical: str = "board",
    board_offset_mm: float = 0.0,
    lens: str = "auto",
    clamp_px: Sequence[Sequence[float]] | None = None,
    tube_length_mm: float | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate a camera and the plane of motion.

    Parameters
    ----------
    photos : board photos; those of another size, blurred, without a whole board, or that do not agree with the others
        are left out and named
    plane : photo of the board lying in the plane of motion; without it pixels cannot become mm
    board : what is printed
    vertical : carried along for the track stage (``board``, ``rest``, ``image`` or ``plumb``)
    board_offset_mm : how far the board's printed face lies in front (towards the camera) of the tube's axis
    lens : ``auto`` (cross-validation), or one of `LENSES`
    clamp_px : pixels of the clamp, to say the quality where the tube is; else around the middle of the picture
    tube_length_mm : to say the quality over the reach of the tube, and as a share of its length
    progress : called with (done, total) photos

    Raises
    ------
    InputError
        If a photo is unreadable, or `lens` unknown.
    DataError
        If fewer than three photos show the board, a larger one is seen, or they do not determine the lens.
    """
    if lens != "auto" and lens not in LENSES:
        raise InputError(f"camera.lens: '{lens}' is unknown; use auto, {' or '.join(LENSES)}")
    like = reference_photo(photos, plane)
    views, refused, size = find_views(photos, board, progress, like)
    refuse_part_of_larger(views, board, like)
    if len(views) < MINIMUM_PHOTOS:
        raise DataError(_why_too_few(views, refused, board))
    plane_view = find_plane(plane, board, size) if plane is not None else None
    views, dropped = without_outliers(views, size)
    views, misfits = without_misfits(views, size, _candidates(views, size) if lens == "auto" else [lens])
    refused = [*refused, *misfits]
    model, scores, reason = choose_lens(views, size, lens)
    doubt = _check_plane(plane_view, views, size, model) if plane_view is not None else ""
    every, joint_view = (views, None) if plane_view is None else ([*views, plane_view], len(views))
    bundle = solve_bundle(every, size, model, joint_view=joint_view)
    extra, inflate = assess(every, bundle, size, model, has_plane=plane_view is not None, scores=scores)
    quality: CalibrationQuality = {
        "lens_scores_px": scores,
        "lens_reason": reason,
        "sigma_px": bundle.sigma_px,
        "board_offset_mm": board_offset_mm,
        "corners_left_out": dropped,
        **extra,
        "warnings": [*extra.get("warnings", []), *filter(None, [doubt])],
    }
    used = [PhotoRecord(file=v.file.name, used=True, reason="", rms_px=bundle.rms_of(i)) for i, v in enumerate(views)]
    left = [PhotoRecord(file=item.file.name, used=False, reason=item.reason, rms_px=None) for item in refused]
    found = _assemble(bundle, size, plane_view, [*used, *left], quality, vertical, board_offset_mm, inflate)
    return found if tube_length_mm is None else with_region(found, clamp_px, tube_length_mm)


def with_region(
    calibration: Calibration, clamp_px: Sequence[Sequence[float]] | None, tube_length_mm: float
) -> Calibration:
    """Add what the uncertainties mean where the tube can be."""
    if not has_plane(calibration) or not np.any(calibration.intrinsics_covariance):
        return calibration
    if clamp_px is None:
        places, origin = middle_of(calibration, tube_length_mm)
        where = "around the middle of the picture"
    else:
        places, origin = reach_of(calibration, np.asarray(clamp_px, dtype=float), tube_length_mm)
        where = "within reach of a tube clamped at camera.clamp"
    region = over_region(calibration, places, origin, tube_length_mm, where)
    return replace(calibration, quality={**calibration.quality, "region": region})


def _why_too_few(views: Sequence[BoardView], refused: Sequence[Refused], board: Board) -> str:
    """Say what is wrong with the photos; if many show one other grid of corners, that inner_corners should name it."""
    total = len(views) + len(refused)
    shown = Counter(item.shown for item in refused if item.shown is not None).most_common(1)
    columns, rows = board.inner_corners
    if shown and shown[0][1] >= max(2, 0.4 * total):
        (across, down), count = shown[0]
        return (
            f"camera.board.inner_corners: [{columns}, {rows}] fits {len(views)} of {total} photos, but {count} of them "
            f"show {across} x {down} inner corners; write [{across}, {down}] if that is the board"
        )
    why = "; ".join(f"{item.file.name}: {item.reason}" for item in refused[:4])
    needed = f"{MINIMUM_PHOTOS} are needed" + (f" ({why})" if why else "")
    return f"camera.photos: {len(views)} of {total} photos show the board, {needed}; take more photos"


def find_views(
    photos: Sequence[Path], board: Board, progress: Progress | None, like: Photo | None = None
) -> tuple[list[BoardView], list[Refused], tuple[int, int]]:
    """Corners of every usable photo, the refused ones, and the picture size (width, height) px that most photos share.

    Raises
    ------
    InputError
        If there is no photo, or one is no picture.
    """
    sizes: dict[Path, tuple[int, int]] = {}
    found: list[BoardView | Refused] = []
    seen: dict[str, Path] = {}
    for done, path in enumerate(photos):
        photo = read_photo(path)
        if photo is None:
            raise InputError(f"{path}: not a readable picture; remove it from camera.photos")
        grey = photo.shown(like)
        sizes[path] = (grey.shape[1], grey.shape[0])
        found.append(same_picture(path, grey, seen) or find_corners(path, grey, board))
        if progress is not None:
            progress(done + 1, len(photos))
    if not sizes:
        raise InputError("camera.photos: no photo found; give a pattern such as calibration/board_*.png")
    every = list(sizes.values())
    common = max(set(every), key=every.count)
    views: list[BoardView] = []
    refused: list[Refused] = []
    for item in found:
        w, h = sizes[item.file]
        if max(abs(w - common[0]), abs(h - common[1])) > SIZE_TOLERANCE_PX:
            other = "" if isinstance(item, BoardView) else f"; {item.reason}"
            turned = ": turned by a quarter" if max(abs(h - common[0]), abs(w - common[1])) <= SIZE_TOLERANCE_PX else ""
            said = f"another size: {w} x {h} px, the others have {common[0]} x {common[1]}{turned}{other}"
            refused.append(Refused(item.file, said))
        elif isinstance(item, Refused):
            refused.append(item)
        else:
            views.append(item)
    return _leave_out_blurred(views, refused), refused, common


def _leave_out_blurred(views: list[BoardView], refused: list[Refused]) -> list[BoardView]:
    """Drop photos far softer than the rest; they are appended to `refused`."""
    rises = np.array([v.rise_px for v in views])
    if np.isfinite(rises).sum() < 4:
        return views
    usual = float(np.nanmedian(rises))
    soft = rises > max(SOFT_PX, SOFTER * usual)
    for view in compress(views, soft):
        said = f"blurred: its edges rise over {view.rise_px:.1f} px, the others' over {usual:.1f} px"
        refused.append(Refused(view.file, said))
    return list(compress(views, ~soft))


def find_plane(plane: Path, board: Board, size: tuple[int, int]) -> BoardView:
    """Corners of the photo that shows the board in the plane of motion; `size` (width, height) px is that of the lens.

    Raises
    ------
    InputError
        If it is no picture, or of another size.
    DataError
        If it does not show the board.
    """
    photo = read_photo(plane)
    if photo is None:
        raise InputError(f"{plane}: camera.plane is not a readable picture")
    grey = photo.shown()
    if max(abs(grey.shape[1] - size[0]), abs(grey.shape[0] - size[1])) > SIZE_TOLERANCE_PX:
        raise InputError(
            f"{plane}: camera.plane has {grey.shape[1]} x {grey.shape[0]} px, the lens was calibrated at {size[0]} x {size[1]}; "
            "use pictures of the same camera mode"
        )
    view = find_corners(plane, grey, board)
    if isinstance(view, Refused):
        raise DataError(f"{plane}: camera.plane: {view.reason}; take it again with the whole board in sight")
    return view


def _check_plane(plane_view: BoardView, views: Sequence[BoardView], size: tuple[int, int], model: str) -> str:
    """Refuse a plane photo that is turned against the others; a sentence if it fits far worse than they."""
    turned, doubt = doubt_of_plane(plane_view, views, size, model)
    if turned:
        raise DataError(
            f"{plane_view.file}: camera.plane: {turned} against camera.photos; turn it back, or take it again as the "
            "camera films"
        )
    return doubt


def choose_lens(views: Sequence[BoardView], size: tuple[int, int], lens: str) -> tuple[str, dict[str, float], str]:
    """Choose the model that best predicts photos that it has not seen; the simpler one where they are alike.

    Returns the model, the held-out RMS of every candidate in px, and a sentence.

    Raises
    ------
    DataError
        If no model fits the photos.
    """
    if lens != "auto":
        return lens, {}, f"{lens} was asked for"
    candidates = _candidates(views, size)
    if len(views) < LEAST_FOR_HALVES:
        return _choose_from_few(views, size, candidates)
    held_out = {model: held_out_squares(views, size, model) for model in candidates}
    scores = {
        model: float(np.sqrt(np.mean(squares))) for model, squares in held_out.items() if np.all(np.isfinite(squares))
    }
    if not scores:
        raise DataError("calibration: no lens model fits the photos; check camera.board.inner_corners")
    best = "brown5" if "brown5" in scores else min(scores, key=lambda name: scores[name])
    for model, score in sorted(scores.items(), key=lambda item: item[1]):
        # As ratios: where a lens fails, it fails by far on a few photos, and a mean gain would drown in its scatter.
        gain = np.log(np.maximum(held_out[best], 1e-12) / np.maximum(held_out[model], 1e-12))
        sure = gain.mean() > SURE_BY * gain.std(ddof=1) / np.sqrt(len(gain))
        if score < (1 - BETTER_BY) * scores[best] and sure:
            best = model
            break
    listed = ", ".join(f"{name} {value:.3f} px" for name, value in scores.items())
    return best, scores, f"{best}: predicts unseen photos best, the simpler lens where the gain is in doubt ({listed})"


def _choose_from_few(
    views: Sequence[BoardView], size: tuple[int, int], candidates: Sequence[str]
) -> tuple[str, dict[str, float], str]:
    """Too few photos to predict some from others: the plain lens, unless a wide one fits them far better."""
    said = f"{len(views)} photos are too few to compare lens models by prediction"
    if "fisheye" in candidates:
        try:
            sigma = {name: solve_bundle(views, size, name, reweight=False).sigma_px for name in ("brown5", "fisheye")}
            if sigma["fisheye"] < 0.8 * sigma["brown5"]:
                return "fisheye", {}, f"fisheye: {said}, but it fits them better than brown5 with fewer coefficients"
        except (DataError, np.linalg.LinAlgError):
            pass
    return "brown5", {}, f"brown5: {said}"


def _candidates(views: Sequence[BoardView], size: tuple[int, int]) -> list[str]:
    """Lens models worth trying; a narrow picture cannot tell a fisheye from another lens."""
    return [model for model, lens in LENSES.items() if lens.tried and (not lens.fisheye or _is_wide(views, size))]


def _is_wide(views: Sequence[BoardView], size: tuple[int, int]) -> bool:
    """Whether the half diagonal spans so much that a fisheye can be told from another lens."""
    focal = first_fisheye(views, size).matrix[0, 0]
    return float(np.degrees(np.hypot(*size) / 2 / focal)) > WIDE_DEG


def held_out_squares(views: Sequence[BoardView], size: tuple[int, int], model: str) -> FloatArray:
    """Fit each half of the photos and predict the other, with only its board poses free.

    Returns the mean squared distance of each photo in px^2, (photos,); infinite where the fit fails.
    """
    squares = np.zeros(len(views))
    for split in range(SPLITS):
        order = np.random.default_rng(split).permutation(len(views))
        for start in (0, 1):
            try:
                lens = solve_bundle([views[i] for i in order[start::2]], size, model, reweight=False).lens
                for i in order[1 - start :: 2]:
                    residual = solve_pose(lens, views[i])[2]
                    squares[i] += float(np.mean(np.sum(residual**2, axis=1))) / SPLITS
            except (DataError, np.linalg.LinAlgError):
                return np.full(len(views), np.inf)
    return squares


def without_outliers(views: Sequence[BoardView], size: tuple[int, int]) -> tuple[list[BoardView], dict[str, int]]:
    """Drop single corners that a first solution puts far off (a reflection, a finger), and count them per photo."""
    bundle = solve_bundle(views, size, "brown5")
    clean, dropped = [], {}
    for view, residual in zip(views, bundle.residuals, strict=True):
        distance = np.linalg.norm(residual, axis=1)
        keep = distance < OUTLIER_SIGMA * max(float(np.median(distance)), 0.02)
        if 0 < np.sum(~keep) <= 0.15 * len(keep):
            dropped[view.file.name] = int(np.sum(~keep))
            view = replace(view, board_mm=view.board_mm[keep], pixels=view.pixels[keep])
        clean.append(view)
    return clean, dropped


def levelled(rotation: FloatArray) -> FloatArray:
    """Turn board axes, a rotation (3, 3), so that x lies along its rows to the camera's right, y up, z towards the camera."""
    axes = [rotation[:, 0], -rotation[:, 0], rotation[:, 1], -rotation[:, 1]]
    x = max(axes, key=lambda axis: float(axis[0]))
    y = max((axis for axis in axes if abs(float(axis @ x)) < 0.5), key=lambda axis: float(-axis[1]))
    return np.column_stack([x, y, np.cross(x, y)])


def plane_of_motion(
    rotation: FloatArray, translation_mm: FloatArray, joint: FloatArray, board_offset_mm: float
) -> tuple[dict[str, Any], PlaneQuality]:
    """What a `Calibration` and its quality say of the plane of motion, from the pose of the board that lies in it.

    Parameters
    ----------
    rotation, translation_mm : of the board in the camera's frame, (3, 3) and (3,)
    joint : covariance of lens and pose, (lens + 6, lens + 6)
    board_offset_mm : as for `calibrate`
    """
    axes, pose = levelled(rotation), joint[-6:, -6:]
    translation = translation_mm - board_offset_mm * axes[:, 2]
    plane = {
        "plane_rotation": axes,
        "plane_translation_mm": translation,
        "plane_pose_covariance": pose,
        "plane_tilt_deg": tilt_deg(axes),
        "joint_covariance": joint,
    }
    stderr_deg = float(np.degrees(np.sqrt(np.trace(pose[:2, :2]) / 2)))
    return plane, {"tilt_stderr_deg": stderr_deg, "distance_mm": float(np.linalg.norm(translation))}


def _assemble(
    bundle: Bundle,
    size: tuple[int, int],
    plane_view: BoardView | None,
    records: Sequence[PhotoRecord],
    quality: CalibrationQuality,
    vertical: str,
    board_offset_mm: float,
    inflate: float,
) -> Calibration:
    lens: Lens = bundle.lens
    plane: dict[str, Any] = {
        "plane_rotation": np.eye(3),
        "plane_translation_mm": np.full(3, np.nan),
        "plane_pose_covariance": np.full((6, 6), np.nan),
        "plane_tilt_deg": float("nan"),
    }
    if plane_view is not None and bundle.joint_covariance is not None:
        pose, joint = (bundle.rotations[-1], bundle.translations_mm[-1]), bundle.joint_covariance * inflate**2
        plane, described = plane_of_motion(*pose, joint, board_offset_mm)
        quality["plane"] = {"file": plane_view.file.name, "rms_px": bundle.rms_of(-1), **described}
        quality["warnings"] = [*quality.get("warnings", []), *of_plane(plane_view.file.name, plane["plane_tilt_deg"])]
    return Calibration(
        image_width=size[0],
        image_height=size[1],
        camera_matrix=lens.matrix,
        distortion=lens.distortion,
        model=lens.model,
        rms_px=bundle.rms_px,
        intrinsics_covariance=bundle.lens_covariance * inflate**2,
        vertical=vertical,
        photos=tuple(records),
        quality=quality,
        **plane,
    )
