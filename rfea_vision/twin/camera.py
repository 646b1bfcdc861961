"""The twin's camera: a pinhole with a Brown lens, looking not quite squarely at the plane of motion.

Frames: rig (mm; x right, y up, z towards the camera), camera (mm; x right, y down, z forward), pixels (origin in the
centre of the top left pixel).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rfea_vision.arrays import FloatArray


@dataclass(frozen=True)
class Camera:
    """Where the camera stands and how its lens bends light.

    Attributes
    ----------
    width, height : pixels
    matrix : (3, 3) pixels
    distortion : (5,) k1, k2, p1, p2, k3 of Brown's model
    rotation, translation : rig to camera, X_cam = rotation X_rig + translation
    """

    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray
    rotation: FloatArray
    translation: FloatArray

    def project_camera_frame(self, points: FloatArray) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) in the camera's frame."""
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        k1, k2, p1, p2, k3 = self.distortion
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        bent_x = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
        bent_y = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
        return np.stack(
            [self.matrix[0, 0] * bent_x + self.matrix[0, 2], self.matrix[1, 1] * bent_y + self.matrix[1, 2]], axis=-1
        )

    def project_plane(self, points_mm: FloatArray) -> FloatArray:
        """Pixels (..., 2) of points (..., 2) in the plane of motion."""
        return self.project_camera_frame(points_mm @ self.rotation[:, :2].T + self.translation)


def turn(x: float, y: float, z: float) -> FloatArray:
    """Rotation (3, 3) by angles in rad, small or large, about x, then y, then z."""
    cx, sx, cy, sy, cz, sz = np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(z), np.sin(z)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def camera_over(
    lower_mm: FloatArray, upper_mm: FloatArray, size: tuple[int, int], generator: np.random.Generator
) -> Camera:
    """Draw a camera whose picture holds a rectangle of the plane of motion.

    Parameters
    ----------
    lower_mm, upper_mm : (2,) corners of the rectangle
    size : width and height of the picture, pixels
    """
    width, height = size
    focal = generator.uniform(1.05, 1.25) * max(size)
    centre = 0.5 * (lower_mm + upper_mm)
    extent = upper_mm - lower_mm
    scale = 0.97 * min(width / extent[0], height / extent[1])  # px per mm
    matrix = np.array(
        [
            [focal, 0, width / 2 - 0.5 + generator.uniform(-8, 8)],
            [0, focal * generator.uniform(0.998, 1.002), height / 2 - 0.5 + generator.uniform(-8, 8)],
            [0, 0, 1],
        ]
    )
    k1 = generator.uniform(-0.16, -0.08)
    distortion = np.array([k1, -0.35 * k1, *generator.uniform(-6e-4, 6e-4, 2), generator.uniform(-0.01, 0.01)])
    tilt = generator.uniform(0.8, 2.0, 2) * generator.choice([-1.0, 1.0], 2)
    roll = generator.uniform(-0.8, 0.8)
    rotation = turn(*np.radians([tilt[0], tilt[1], roll])) @ np.diag([1.0, -1.0, -1.0])
    # the optical axis meets the plane in the rectangle's middle
    translation = np.array([0.0, 0.0, focal / scale]) - rotation @ np.array([*centre, 0.0])
    return Camera(width, height, matrix, distortion, rotation, translation)
