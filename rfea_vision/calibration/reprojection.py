"""Board points to pixels and the derivatives by lens and pose, by OpenCV.

A lens is one vector [fx, fy, cx, cy, distortion...], with OpenCV's order of coefficients.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def board_pixels(
    fisheye: bool, lens: FloatArray, rotation: FloatArray, translation: FloatArray, board: FloatArray
) -> FloatArray:
    """Pixels (n, 2) of board points (n, 2) mm for a lens vector and a pose (rotation (3, 3), translation (3,) mm)."""
    return _project(fisheye, lens, rotation, translation, board)[0]


def jacobians(
    fisheye: bool, lens: FloatArray, rotation: FloatArray, translation: FloatArray, board: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives by the lens (2n, lens parameters), and by the pose (2n, 6): a turn applied from the left, and a shift."""
    _, found = _project(fisheye, lens, rotation, translation, board)
    count = lens.size - 4
    if fisheye:  # OpenCV's order: f, c, distortion, rotation, translation, skew
        return found[:, : 4 + count], found[:, 8:14]
    return found[:, 6 : 10 + count], found[:, :6]  # rotation, translation, f, c, distortion


def _project(
    fisheye: bool, lens: FloatArray, rotation: FloatArray, translation: FloatArray, board: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels, and OpenCV's derivatives at no further rotation: the board is turned first, so a turn acts from the left."""
    turned = np.ascontiguousarray(board @ rotation[:, :2].T).reshape(-1, 1, 3)
    matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1.0]])
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    pixels, found = project(turned, np.zeros(3), np.asarray(translation, dtype=float), matrix, lens[4:])[:2]
    return np.asarray(pixels, dtype=float).reshape(-1, 2), np.asarray(found, dtype=float)
