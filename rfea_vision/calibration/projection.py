"""Pixels to millimetres on the plane of motion, and back.

Pixel origin: the centre of the top left pixel is (0, 0). Plane frame: x along the board's rows to the camera's right,
y up, z towards the camera; mm. Distortion in OpenCV's order: (k1, k2, p1, p2, k3[, k4, k5, k6[, s1, s2, s3, s4]]) or fisheye
(k1..k4).

Compiled code takes a camera as one vector of 29 numbers: [kind (0 Brown, 1 fisheye), fx, fy, cx, cy, the first 8 of the
distortion, rotation (9, row by row), translation in mm (3), thin prism (4)].
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration
from rfea_vision.artefacts.lenses import LENSES
from rfea_vision.errors import InputError

CAMERA_SIZE = 29  # see above


def camera_vector(calibration: Calibration) -> FloatArray:
    """Pack lens and plane pose for compiled code, (29,)."""
    lens = lens_vector(calibration.camera_matrix, calibration.distortion)
    return pack_camera(calibration.model, lens, calibration.plane_rotation, calibration.plane_translation_mm)


def lens_vector(matrix: FloatArray, distortion: ArrayLike) -> FloatArray:
    """[fx, fy, cx, cy, distortion...] of a camera matrix (3, 3) and OpenCV's coefficients."""
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(distortion)])


def pack_camera(model: str, lens: FloatArray, rotation: FloatArray, translation_mm: FloatArray) -> FloatArray:
    """Pack a lens vector and a pose for compiled code, (29,)."""
    packed = np.zeros(CAMERA_SIZE)
    packed[0] = float(LENSES[model].fisheye)
    packed[1:5] = lens[:4]
    coefficients = np.zeros(12)
    coefficients[: lens.size - 4] = lens[4:]
    packed[5:13], packed[25:29] = coefficients[:8], coefficients[8:]
    packed[13:22] = np.asarray(rotation).ravel()
    packed[22:25] = np.asarray(translation_mm).ravel()
    return packed


@njit(cache=True, nogil=True, error_model="numpy")
def project_point(camera, x, y):
    """Pixel of the point (x, y) mm on the plane; compiled, scalar."""
    depth = camera[19] * x + camera[20] * y + camera[24]
    a = (camera[13] * x + camera[14] * y + camera[22]) / depth
    b = (camera[16] * x + camera[17] * y + camera[23]) / depth
    if camera[0] > 0.5:
        radius = np.sqrt(a * a + b * b)
        scale = 1.0
        if radius > 1e-9:
            angle = np.arctan(radius)
            q = angle * angle
            scale = angle * (1.0 + q * (camera[5] + q * (camera[6] + q * (camera[7] + q * camera[8])))) / radius
        u, v = a * scale, b * scale
    else:
        q = a * a + b * b
        radial = (1.0 + q * (camera[5] + q * (camera[6] + q * camera[9]))) / (
            1.0 + q * (camera[10] + q * (camera[11] + q * camera[12]))
        )
        u = a * radial + 2.0 * camera[7] * a * b + camera[8] * (q + 2.0 * a * a) + q * (camera[25] + q * camera[26])
        v = b * radial + camera[7] * (q + 2.0 * b * b) + 2.0 * camera[8] * a * b + q * (camera[27] + q * camera[28])
    return camera[1] * u + camera[3], camera[2] * v + camera[4]


@njit(cache=True, nogil=True)
def _project_many(camera, points):
    out = np.empty_like(points)
    for i in range(points.shape[0]):
        out[i, 0], out[i, 1] = project_point(camera, points[i, 0], points[i, 1])
    return out


@njit(cache=True, nogil=True)
def _unproject_many(camera, pixels):
    """Newton on the projection; starts from the undistorted pinhole."""
    out = np.empty_like(pixels)
    # Pinhole homography plane -> picture, inverted.
    h = np.empty((3, 3))
    for row in range(3):
        h[row, 0] = camera[13 + 3 * row]
        h[row, 1] = camera[14 + 3 * row]
        h[row, 2] = camera[22 + row]
    inverse = np.linalg.inv(h)
    for i in range(pixels.shape[0]):
        a = (pixels[i, 0] - camera[3]) / camera[1]
        b = (pixels[i, 1] - camera[4]) / camera[2]
        w = inverse[2, 0] * a + inverse[2, 1] * b + inverse[2, 2]
        x = (inverse[0, 0] * a + inverse[0, 1] * b + inverse[0, 2]) / w
        y = (inverse[1, 0] * a + inverse[1, 1] * b + inverse[1, 2]) / w
        step = 1e-3
        for _ in range(30):
            u, v = project_point(camera, x, y)
            ux, vx = project_point(camera, x + step, y)
            uy, vy = project_point(camera, x, y + step)
            j00, j10, j01, j11 = (ux - u) / step, (vx - v) / step, (uy - u) / step, (vy - v) / step
            determinant = j00 * j11 - j01 * j10
            du, dv = pixels[i, 0] - u, pixels[i, 1] - v
            if not abs(determinant) > 1e-12:
                x, y = np.nan, np.nan
                break
            dx = (j11 * du - j01 * dv) / determinant
            dy = (j00 * dv - j10 * du) / determinant
            x += dx
            y += dy
            if dx * dx + dy * dy < 1e-16:
                break
        u, v = project_point(camera, x, y)
        ahead = h[2, 0] * x + h[2, 1] * y + h[2, 2] > 0  # beyond the horizon a place behind the camera has the same pixel
        if not (ahead and abs(u - pixels[i, 0]) < 1e-3 and abs(v - pixels[i, 1]) < 1e-3):
            x, y = np.nan, np.nan
        out[i, 0], out[i, 1] = x, y
    return out


def project(camera: FloatArray, points_mm: ArrayLike) -> FloatArray:
    """Pixels (..., 2) of points (..., 2) mm on the plane, for a packed camera."""
    points = np.asarray(points_mm, dtype=float)
    return _project_many(camera, np.ascontiguousarray(points.reshape(-1, 2))).reshape(points.shape)


def unproject(camera: FloatArray, pixels: ArrayLike) -> FloatArray:
    """Points (..., 2) mm on the plane of pixels (..., 2), for a packed camera; NaN where no ray meets the plane."""
    places = np.asarray(pixels, dtype=float)
    return _unproject_many(camera, np.ascontiguousarray(places.reshape(-1, 2))).reshape(places.shape)


def has_plane(calibration: Calibration) -> bool:
    """Whether the pose of the plane of motion is known."""
    return bool(np.all(np.isfinite(calibration.plane_translation_mm)))


def _camera_on_plane(calibration: Calibration) -> FloatArray:
    if not has_plane(calibration):
        raise InputError("camera.plane is missing: give a photo of the board lying in the plane of motion")
    return camera_vector(calibration)


def plane_mm_to_pixels(calibration: Calibration, plane_mm: ArrayLike) -> FloatArray:
    """Pixels (..., 2) of points (..., 2) mm on the plane of motion."""
    return project(_camera_on_plane(calibration), plane_mm)


def pixels_to_plane_mm(calibration: Calibration, pixels: ArrayLike) -> FloatArray:
    """Points (..., 2) mm on the plane of motion seen at pixels (..., 2); NaN where there is none."""
    return unproject(_camera_on_plane(calibration), pixels)


def perturbed_cameras(calibration: Calibration) -> FloatArray:
    """Cameras moved by one standard error along each principal axis of the calibration's joint covariance, (k, 29)."""
    lens, pose = lens_vector(calibration.camera_matrix, calibration.distortion), calibration.plane_rotation
    return moved_cameras(
        calibration.model, lens, pose, calibration.plane_translation_mm, _joint_covariance(calibration)
    )


def moved_cameras(
    model: str, lens: FloatArray, rotation: FloatArray, translation_mm: FloatArray, joint: FloatArray
) -> FloatArray:
    """Cameras moved by one standard error along each principal axis of their joint covariance, (k, 29).

    A quantity's covariance from the calibration is the sum over k of the outer product of its change with itself
    (first order).

    Parameters
    ----------
    joint : covariance of [lens vector, rotation vector, translation], (lens + 6, lens + 6)
    """
    values, vectors = np.linalg.eigh(joint)
    axes = (vectors * np.sqrt(np.clip(values, 0.0, None))).T
    keep = values > 1e-14 * values.max() if values.max() > 0 else np.zeros(len(values), dtype=bool)
    moved = [
        pack_camera(model, lens + change[:-6], rotation_matrix(change[-6:-3]) @ rotation, translation_mm + change[-3:])
        for change in axes[keep]
    ]
    return np.array(moved).reshape(-1, CAMERA_SIZE)


def _joint_covariance(calibration: Calibration) -> FloatArray:
    joint = calibration.joint_covariance
    if joint is not None:
        return joint
    m = calibration.intrinsics_covariance.shape[0]
    block = np.zeros((m + 6, m + 6))
    block[:m, :m] = calibration.intrinsics_covariance
    block[m:, m:] = calibration.plane_pose_covariance
    return block


def rms_distance(residual: FloatArray) -> float:
    """Root mean square distance between corners and model, as OpenCV counts it, of residuals (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def tilt_deg(rotation: FloatArray) -> float:
    """Angle (deg) between the optical axis and the normal of a plane with these axes (3, 3)."""
    return float(np.degrees(np.arccos(np.clip(-rotation[2, 2], -1, 1))))


def rotation_matrix(vector: ArrayLike) -> FloatArray:
    """Rotation (3, 3) about `vector` (3,) by its length (rad)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float))[0], dtype=float)
