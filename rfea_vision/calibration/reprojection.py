"""Board points to pixels and the derivatives by lens and pose, compiled.

A lens is one vector [fx, fy, cx, cy, distortion...], with OpenCV's order of coefficients.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True)
def board_pixels(fisheye, lens, rotation, translation, board):
    """Pixels (n, 2) of board points (n, 2) mm for one lens vector and pose."""
    out = np.empty_like(board)
    d = np.zeros(8)
    count = min(len(lens) - 4, 8)
    d[:count] = lens[4 : 4 + count]
    for i in range(len(board)):
        x = rotation[0, 0] * board[i, 0] + rotation[0, 1] * board[i, 1] + translation[0]
        y = rotation[1, 0] * board[i, 0] + rotation[1, 1] * board[i, 1] + translation[1]
        z = rotation[2, 0] * board[i, 0] + rotation[2, 1] * board[i, 1] + translation[2]
        a, b = x / z, y / z
        q = a * a + b * b
        if fisheye:
            radius = np.sqrt(q)
            angle = np.arctan2(np.sqrt(x * x + y * y), z)
            t = angle * angle
            scale = angle * (1 + t * (d[0] + t * (d[1] + t * (d[2] + t * d[3])))) / max(radius, 1e-12)
            u, v = a * scale, b * scale
        else:
            radial = (1 + q * (d[0] + q * (d[1] + q * d[4]))) / (1 + q * (d[5] + q * (d[6] + q * d[7])))
            u = a * radial + 2 * d[2] * a * b + d[3] * (q + 2 * a * a)
            v = b * radial + d[2] * (q + 2 * b * b) + 2 * d[3] * a * b
        out[i, 0], out[i, 1] = lens[0] * u + lens[2], lens[1] * v + lens[3]
    return out


@njit(cache=True, nogil=True)
def turned(change, rotation):
    """Rotation by a small vector (rad), applied from the left (Rodrigues' formula)."""
    angle = np.sqrt(np.sum(change * change))
    k = np.array([[0.0, -change[2], change[1]], [change[2], 0.0, -change[0]], [-change[1], change[0], 0.0]])
    if angle < 1e-12:
        return (np.eye(3) + k) @ rotation
    return (np.eye(3) + np.sin(angle) / angle * k + (1 - np.cos(angle)) / angle**2 * (k @ k)) @ rotation


@njit(cache=True, nogil=True)
def jacobians(fisheye, lens, rotation, translation, board):
    """Derivatives by the lens (2n, lens parameters) and by the pose (2n, 6), by central differences."""
    n = len(board)
    by_lens, by_pose = np.empty((2 * n, len(lens))), np.empty((2 * n, 6))
    for k in range(len(lens)):
        step = 1e-2 if k < 4 else 1e-6
        up, down = lens.copy(), lens.copy()
        up[k] += step
        down[k] -= step
        change = board_pixels(fisheye, up, rotation, translation, board) - board_pixels(
            fisheye, down, rotation, translation, board
        )
        by_lens[:, k] = change.ravel() / (2 * step)
    for k in range(6):
        move = np.zeros(6)
        step = 1e-5 if k < 3 else 1e-3
        move[k] = step
        change = board_pixels(fisheye, lens, turned(move[:3], rotation), translation + move[3:], board) - board_pixels(
            fisheye, lens, turned(-move[:3], rotation), translation - move[3:], board
        )
        by_pose[:, k] = change.ravel() / (2 * step)
    return by_lens, by_pose
