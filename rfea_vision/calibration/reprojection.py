"""Board points to pixels and the derivatives by lens and pose, by OpenCV.

A lens is one vector [fx, fy, cx, cy, distortion...], with OpenCV's order of coefficients.
"""

from __future__ import annotations

import cv2
import numpy as np

from rfea_vision.arrays import FloatArray


def rms_distance(residual: FloatArray) -> float:
    """Root mean square distance between corners and model, as OpenCV counts it, of residuals (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def board_pixels(
    fisheye: bool, lens: FloatArray, rotation: FloatArray, translation: FloatArray, board: FloatArray
) -> FloatArray:
    """Pixels (n, 2) of board points (n, 2) mm for a lens vector and a pose (rotation (3, 3), translation (3,) mm)."""
    return seen(fisheye, lens, rotation, np.concatenate([np.zeros(3), translation]), board)[0]


def seen(
    fisheye: bool, lens: FloatArray, rotation: FloatArray, move: FloatArray, board: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels (n, 2) of board points (n, 2) mm, and their derivatives by the lens (2n, lens parameters) and the move (2n, 6).

    The board is turned by `rotation` (3, 3), then by the rotation vector `move[:3]`, and shifted by `move[3:]` in mm.
    """
    turned = np.ascontiguousarray(board @ rotation[:, :2].T).reshape(-1, 1, 3)
    matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1.0]])
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    pixels, found = project(turned, move[:3], move[3:], matrix, lens[4:])[:2]
    pixels, found, count = np.asarray(pixels, dtype=float).reshape(-1, 2), np.asarray(found, dtype=float), lens.size - 4
    if fisheye:  # OpenCV's order: f, c, distortion, rotation, translation, skew
        return pixels, found[:, : 4 + count], found[:, 8:14]
    return pixels, found[:, 6 : 10 + count], found[:, :6]  # rotation, translation, f, c, distortion
