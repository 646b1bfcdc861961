"""The plane of motion for a lens that is known already: one photo of the board lying in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rfea_vision.artefacts import Calibration
from rfea_vision.artefacts.rows import CalibrationQuality, PlaneQuality
from rfea_vision.calibration.advice import of_plane
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.bundle import Lens, project_board, solve_pose
from rfea_vision.calibration.calibrate import find_plane, plane_of_motion
from rfea_vision.calibration.projection import rms_distance


def place_in_plane(
    calibration: Calibration, plane: Path, board: Board, *, board_offset_mm: float = 0.0, vertical: str = "board"
) -> Calibration:
    """Return the calibration with the plane of motion that a photo shows.

    Parameters
    ----------
    calibration : lens of an earlier calibration, by this package or another
    plane : photo with the same camera mode, of the board lying in the plane of motion
    board, board_offset_mm, vertical : as for `calibrate`

    Returns
    -------
    Calibration
        Its covariance joins the lens's own (nothing, where a file of another tool does not say) with that of the pose.

    Raises
    ------
    InputError, DataError
        If the photo is of another size or does not show the board.
    """
    view = find_plane(plane, board, (calibration.image_width, calibration.image_height))
    lens = Lens(calibration.model, calibration.camera_matrix, calibration.distortion)
    rotation, translation, residuals = solve_pose(lens, view)
    _, by_lens, by_pose = project_board(lens, rotation, translation, view.board_mm)
    variance = float(np.sum(residuals**2)) / max(residuals.size - 6, 1)
    pull = -np.linalg.pinv(by_pose) @ by_lens  # how an error of the lens moves the pose
    lens_covariance = calibration.intrinsics_covariance
    cross = lens_covariance @ pull.T
    own = variance * np.linalg.inv(by_pose.T @ by_pose)
    joint = np.block([[lens_covariance, cross], [cross.T, pull @ cross + own]])
    placed, described = plane_of_motion(rotation, translation, joint, board_offset_mm)
    plane_quality: PlaneQuality = {"file": view.file.name, "rms_px": rms_distance(residuals), **described}
    warnings = [*calibration.quality.get("warnings", []), *of_plane(view.file.name, placed["plane_tilt_deg"])]
    quality: CalibrationQuality = {
        **calibration.quality,
        "plane": plane_quality,
        "board_offset_mm": board_offset_mm,
        "warnings": warnings,
    }
    return replace(calibration, **placed, vertical=vertical, quality=quality)
