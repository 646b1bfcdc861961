"""What is known before the first frame: the camera for the film's pictures, the hints, and which way is down."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator, Calibration, Hints, bend_sign
from rfea_vision.artefacts.measurement import Vertical
from rfea_vision.calibration.photos import unlike_film
from rfea_vision.calibration.projection import camera_vector, has_plane, unproject
from rfea_vision.errors import InputError
from rfea_vision.lines import rig_axes, scaled
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.find.begin import Scene, scale_at


def matched_to(calibration: Calibration, source: FrameSource) -> Calibration:
    """The calibration for pictures of the source's size: the same, or scaled where the shape is the same."""
    if not has_plane(calibration):
        raise InputError("camera.plane is missing: give a photo of the board lying in the plane of motion")
    w, h = source.size
    if unlike := unlike_film((calibration.image_width, calibration.image_height), source.size):
        raise InputError(f"{source.path}: {unlike}")
    if max(abs(w - calibration.image_width), abs(h - calibration.image_height)) <= 2:
        return calibration
    fx, fy = w / calibration.image_width, h / calibration.image_height
    matrix = calibration.camera_matrix.copy()
    matrix[0, 0] *= fx
    matrix[1, 1] *= fy
    matrix[:2, 2] = scaled(matrix[:2, 2], np.array([fx, fy]))
    factors = np.ones(calibration.intrinsics_covariance.shape[0])
    factors[:4] = fx, fy, fx, fy
    joint = calibration.joint_covariance
    if joint is not None:
        every = np.concatenate([factors, np.ones(joint.shape[0] - len(factors))])
        joint = joint * every[:, None] * every[None, :]
    return replace(
        calibration,
        image_width=w,
        image_height=h,
        camera_matrix=matrix,
        intrinsics_covariance=calibration.intrinsics_covariance * factors[:, None] * factors[None, :],
        joint_covariance=joint,
    )


def make_scene(
    calibration: Calibration,
    actuator: Actuator,
    vertical: Vertical,
    hints: Hints,
    size: tuple[int, int],
    gravity_deg: float | None = 0.0,
) -> Scene:
    """Gather what is known before the first frame."""
    camera = camera_vector(calibration)
    given = {name: getattr(hints, name) for name in ("clamp", "tip", "centre_line")}
    given["corrections"] = [point for later in hints.corrections for point in later.points]
    for name, places in given.items():
        hint = np.asarray(() if places is None else places, dtype=float).reshape(-1, 2)
        if np.any(hint < 0) or np.any(hint > np.array(size)):
            raise InputError(f"camera.{name}: {hint.tolist()} lies outside the picture of {size[0]} x {size[1]} px")
    if hints.corrections and (hints.clamp is None or hints.tip is None):
        raise InputError("camera.corrections: acts where camera.clamp and camera.tip are given, too; give both, in pixels of frame 0")
    middle = np.array([size[0] / 2, size[1] / 2])
    px_per_mm = scale_at(camera, middle)
    if not np.isfinite(px_per_mm):
        raise InputError("camera.plane: the plane of motion is not in front of the camera; take the plane photo again")
    down = turned(down_direction(camera, vertical, middle), gravity_deg or 0.0, actuator.bends)
    return Scene(camera, actuator, down, px_per_mm, hints, gravity_deg=gravity_deg)


def down_direction(camera: FloatArray, vertical: Vertical, middle_px: FloatArray) -> FloatArray:
    """Unit vector of gravity on the plane; for ``rest`` the board's, until the resting tube is known."""
    if isinstance(vertical, Mapping):
        plumb = np.asarray(vertical.get("plumb", []), dtype=float)
        if plumb.shape != (2, 2):
            raise InputError(
                "camera.vertical.plumb: give two points in pixels, such as {plumb: [[100, 50], [102, 900]]}"
            )
        top, bottom = plumb[np.argsort(plumb[:, 1])]
        line = unproject(camera, np.array([top, bottom]))
    elif vertical == "image":
        line = unproject(camera, np.array([middle_px, middle_px + np.array([0.0, 1.0])]))
    elif vertical in ("board", "rest"):
        return np.array([0.0, -1.0])
    else:
        raise InputError(f"camera.vertical: '{vertical}' is unknown; use board, rest, image or plumb")
    down = line[1] - line[0]
    return down / np.linalg.norm(down)


def turned(gravity: FloatArray, gravity_deg: float, bends: str) -> FloatArray:
    """Direction (2,) in which the unloaded tube points, where gravity lies `gravity_deg` from it towards the side of the bend."""
    angle = np.deg2rad(gravity_deg) * bend_sign(bends)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * gravity[0] - s * gravity[1], s * gravity[0] + c * gravity[1]])


def gravity_seen_deg(calibration: Calibration, down: FloatArray, plumb_px: ArrayLike, bends: str) -> float:
    """Direction of gravity from `down` (2,) of the rig on the plane, positive in the direction of the bend.

    Parameters
    ----------
    plumb_px : (2, 2) two points in px on a line that hangs plumb, upper one first
    """
    upper, lower = unproject(camera_vector(calibration), np.asarray(plumb_px, dtype=float))
    gravity, side = lower - upper, bend_sign(bends)
    return float(np.rad2deg(np.arctan2(side * (down[1] * gravity[0] - down[0] * gravity[1]), down @ gravity)))


def rig_axes_mm(
    calibration: Calibration, vertical: Vertical, gravity_deg: float, bends: str
) -> Callable[[FloatArray], FloatArray]:
    """Return what turns pixels (..., 2) into mm (..., 2) along camera-right and up, from an origin of no meaning."""
    camera = camera_vector(calibration)
    middle = np.array([calibration.image_width / 2, calibration.image_height / 2])
    down = turned(down_direction(camera, vertical, middle), gravity_deg, bends)
    return lambda pixels: unproject(camera, pixels) @ rig_axes(down).T
