"""Millimetres without a board: a known distance in the picture, a few known places, or the tube itself.

What no photo of a board has measured is assumed, and its uncertainty is part of every standard error: how long the
lens is, how far it bends straight lines, and how squarely the camera looks at the plane of motion.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration
from rfea_vision.artefacts.rows import CalibrationQuality
from rfea_vision.calibration.projection import (
    lens_vector,
    pack_camera,
    rms_distance,
    rotation_matrix,
    tilt_deg,
    unproject,
)
from rfea_vision.errors import InputError
from rfea_vision.lines import along

# focal length over the longer side of the picture: 28 mm on 36 mm film, as main cameras of phones have
FOCAL_SHARE = 0.8
FOCAL_SPREAD = 0.25  # 1 s.d. of its logarithm: from 22 to 36 mm, and the crop of a stabilised film
DISTORTION_SPREAD = 0.03  # 1 s.d. of k1: phones correct most of it in the camera
TILT_SPREAD_DEG = 3.0  # how squarely a camera is set up by eye
DEPTH_SPREAD = 0.005  # the scale lies in front of or behind the tube's axis by so much of the distance to the camera
POINTING_PX = 1.5  # how well a person points
READING_MM = 0.5  # how well a ruler is read
TUBE_SPREAD = 0.02  # of its nominal length: what of a tube sticks out of its clamp
BEFORE_CAMERA = 0.2  # of the distance between camera and scale has to be left between camera and tube
JOINT = 9 + 6  # fx, fy, cx, cy, five of the lens; rotation, translation
K1_AT, TILTS_AT = 4, (9, 10)
FACING = np.diag([1.0, -1.0, -1.0])  # plane to camera: x to the right, y up, z towards the camera


def scaled_by_distance(
    size: tuple[int, int], points_px: ArrayLike, distance_mm: float, *, error_mm: float | None = None, behind_mm: float = 0.0
) -> Calibration:
    """Calibration of a camera that looks squarely at the plane of motion, from one distance in it, or `behind_mm` behind it.

    Parameters
    ----------
    size : width and height of the pictures in px
    points_px : (n, 2) pixels of a line whose length is `distance_mm`; two points, or more along a curve
    error_mm : standard error of the distance; by default what reading a ruler leaves
    behind_mm : how far behind the plane of motion the points lie, away from the camera (negative: before it)

    Raises
    ------
    InputError
        If the points lie nearer to each other than a person can point.
    """
    points = np.asarray(points_px, dtype=float)
    pixels = float(along(points)[-1])
    if pixels < 10 * POINTING_PX:
        raise InputError(f"camera.scale.points: they are {pixels:.0f} px apart; take two that are far apart")
    error = READING_MM if error_mm is None else error_mm
    focal = FOCAL_SHARE * max(size)
    depth = _nearer(focal * distance_mm / pixels, behind_mm)
    # Of what lies behind, a longer lens leaves less to set right: its camera stands farther off.
    lens_share = FOCAL_SPREAD * behind_mm / depth
    relative = float(np.sqrt(2 * (POINTING_PX / pixels) ** 2 + (error / distance_mm) ** 2 + DEPTH_SPREAD**2 + lens_share**2))
    described: CalibrationQuality = {
        "note": f"scale from {distance_mm:g} mm over {pixels:.0f} px{_set_back(behind_mm)}; lens and tilt of the camera are assumed",
        "scale_stderr_percent": 100 * relative,
        "tilt_stderr_deg": TILT_SPREAD_DEG,
    }
    square = _calibration(size, focal, FACING, np.array([0.0, 0.0, depth]), described, np.nan)
    lens = lens_vector(square.camera_matrix, square.distortion)
    # A longer lens at a longer distance gives the same scale, and the picture's own axes are those of the plane: what is free is
    # how lines bend, and the tilt. With these the distance to the plane goes, for it is where the points lie that the scale is known.
    joint = np.zeros((JOINT, JOINT))
    joint[-1, -1] = (relative * depth) ** 2
    for at, spread in ((K1_AT, DISTORTION_SPREAD), *((axis, np.radians(TILT_SPREAD_DEG)) for axis in TILTS_AT)):
        axis = np.zeros(JOINT)
        axis[at] = spread
        more, less = (float(along(unproject(_moved(lens, square, sign * axis), points))[-1]) for sign in (1.0, -1.0))
        axis[-1] = -0.5 * depth * np.log(more / less)
        joint += np.outer(axis, axis)
    return _with_errors(square, joint)


def scaled_by_places(
    size: tuple[int, int], points_px: ArrayLike, places_mm: ArrayLike, *, error_mm: float | None = None, behind_mm: float = 0.0
) -> Calibration:
    """Calibration with perspective, from four or more points of the plane whose places are known.

    Parameters
    ----------
    size : width and height of the pictures in px
    points_px, places_mm : (n, 2) pixels, and x to the right and y up (or down: it is seen which) on the plane
    error_mm : standard error of each place; by default what reading a ruler leaves
    behind_mm : how far behind the plane of motion they lie, away from the camera (negative: before it)

    Raises
    ------
    InputError
        If the points lie on one line or do not fit their places.
    """
    pixels, places = np.asarray(points_px, dtype=float), np.array(places_mm, dtype=float)
    homography, _ = cv2.findHomography(places, pixels)
    if homography is None or np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-6 * np.abs(places).max()) < 2:
        raise InputError("camera.scale.places: they lie on one line; take four corners of a rectangle")
    depths = np.column_stack([places, np.ones(len(places))]) @ homography[2]
    if depths.min() * depths.max() <= 0.0:  # some lie behind the camera
        raise InputError("camera.scale.places: they do not fit their points; check the order of both lists")
    # The area of what is seen has the sign of det H / w^3: where that is positive, y was measured downwards, as in the picture.
    if np.linalg.det(homography) * depths[0] > 0:
        places[:, 1] *= -1.0
    focal = FOCAL_SHARE * max(size)
    spread = np.linalg.norm(np.ptp(pixels, axis=0)) / np.linalg.norm(np.ptp(places, axis=0))
    noise_px = float(np.hypot(POINTING_PX, spread * (READING_MM if error_mm is None else error_mm)))
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    depth = focal / spread
    start = np.append(_pose_of(places, (pixels - middle) / focal), [0.0, 0.0])

    def residual(parameters: FloatArray) -> FloatArray:
        length = focal * np.exp(parameters[6])
        there = (rotation_matrix(parameters[:3]) @ FACING)[:, :2] @ places.T + parameters[3:6, None]
        ways = (there[:2] / there[2]).T
        bent = 1.0 + parameters[7] * np.sum(ways**2, axis=1, keepdims=True)
        seen = middle + length * bent * ways
        return np.concatenate([((seen - pixels) / noise_px).ravel(), parameters[6:] / (FOCAL_SPREAD, DISTORTION_SPREAD)])

    found = least_squares(residual, start, x_scale=[0.1, 0.1, 0.1, depth, depth, depth, 0.1, 0.01])
    if not np.all(np.isfinite(found.x)) or found.x[5] <= 0.0:
        raise InputError("camera.scale.places: they do not fit their points; check the order of both lists")
    rms_px = rms_distance((residual(found.x)[:-2] * noise_px).reshape(-1, 2))
    if rms_px > 6 * noise_px:
        raise InputError(
            f"camera.scale.places: they miss their points by {rms_px:.0f} px; check the order of both lists, and the units"
        )
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    length = focal * float(np.exp(found.x[6]))
    pick = np.zeros((JOINT, len(found.x)))
    pick[0, 6] = pick[1, 6] = length
    pick[K1_AT, 7] = 1.0
    pick[9:, :6] = np.eye(6)
    joint = pick @ covariance @ pick.T
    joint[-1, -1] += (DEPTH_SPREAD * found.x[5]) ** 2
    note = f"scale from {len(pixels)} places{_set_back(behind_mm)}; the lens is assumed"
    described: CalibrationQuality = {"note": note, "noise_px": noise_px}
    rotation = rotation_matrix(found.x[:3]) @ FACING
    _nearer(float(found.x[5]), behind_mm)
    translation = found.x[3:6] + behind_mm * rotation[:, 2]
    seen = _calibration(size, length, rotation, translation, described, rms_px, bends=float(found.x[7]))
    return _with_errors(seen, joint)


def _nearer(depth_mm: float, behind_mm: float) -> float:
    """How far off the plane of motion is, where what tells the scale lies `behind_mm` behind it, `depth_mm` from the camera."""
    if depth_mm - behind_mm < BEFORE_CAMERA * depth_mm:
        raise InputError(f"camera.scale.behind: {behind_mm:g} mm lead to the camera, which is some {depth_mm:.0f} mm off; correct it")
    return depth_mm - behind_mm


def _set_back(behind_mm: float) -> str:
    """What is said of a scale that does not lie in the plane of motion."""
    return f", {abs(behind_mm):g} mm {'behind' if behind_mm > 0 else 'before'} the plane of motion" if behind_mm else ""


def _pose_of(places: FloatArray, ways: FloatArray) -> FloatArray:
    """Rotation vector and translation (6,) of a plane whose `places` (n, 2) mm are seen at `ways` (n, 2), at a depth of 1."""
    homography, _ = cv2.findHomography(places, ways)
    columns = homography / np.mean(np.linalg.norm(homography[:, :2], axis=0)) * np.sign(homography[2, 2])
    left, _, right = np.linalg.svd(np.column_stack([columns[:, :2], np.cross(columns[:, 0], columns[:, 1])]))
    return np.concatenate([cv2.Rodrigues(left @ right @ FACING.T)[0][:, 0], columns[:, 2]], dtype=float)


def assumed_pose_covariance(translation_mm: FloatArray) -> FloatArray:
    """Covariance (6, 6) of the pose of a plane that comes without one: that of a camera set up by eye."""
    tilt, shift = np.radians(TILT_SPREAD_DEG) ** 2, (DEPTH_SPREAD * float(translation_mm[2])) ** 2
    return np.diag([tilt, tilt, 0.0, 0.0, 0.0, shift])


def _moved(lens: FloatArray, square: Calibration, change: FloatArray) -> FloatArray:
    """The camera of a calibration whose lens (9,) and pose have changed by (15,)."""
    rotation, translation = rotation_matrix(change[-6:-3]) @ square.plane_rotation, square.plane_translation_mm + change[-3:]
    return pack_camera(square.model, lens + change[:-6], rotation, translation)


def _with_errors(calibration: Calibration, joint: FloatArray) -> Calibration:
    """The same with the covariance (15, 15) of its lens and its pose."""
    return replace(calibration, intrinsics_covariance=joint[:9, :9], plane_pose_covariance=joint[9:, 9:], joint_covariance=joint)


def _calibration(
    size: tuple[int, int],
    focal: float,
    rotation: FloatArray,
    translation: FloatArray,
    quality: CalibrationQuality,
    rms_px: float,
    *,
    bends: float = 0.0,
) -> Calibration:
    """A camera of a lens that `bends` lines (k1), without errors."""
    matrix = np.array([[focal, 0.0, (size[0] - 1) / 2], [0.0, focal, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])
    return Calibration(
        image_width=size[0],
        image_height=size[1],
        camera_matrix=matrix,
        distortion=np.array([bends, 0.0, 0.0, 0.0, 0.0]),
        model="brown5",
        rms_px=rms_px,
        intrinsics_covariance=np.zeros((9, 9)),
        plane_rotation=rotation,
        plane_translation_mm=translation,
        plane_pose_covariance=np.zeros((6, 6)),
        plane_tilt_deg=tilt_deg(rotation),
        vertical="board",
        photos=(),
        quality=quality,
    )
