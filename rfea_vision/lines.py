"""Lines of points: how far each point lies along them, what lies at a given distance, where they point, and in larger pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rfea_vision.arrays import FloatArray


def along(points: ArrayLike) -> FloatArray:
    """Length (..., n) of lines of points (..., n, d) up to each of these, in their unit; NaN from a point that is NaN on."""
    points = np.asarray(points, dtype=float)
    steps = points[..., 1:, :] - points[..., :-1, :]
    steps = np.sqrt(np.einsum("...i,...i->...", steps, steps))  # in every frame, many times: norm takes three times as long
    lengths = np.zeros(points.shape[:-1])
    np.cumsum(steps, axis=-1, out=lengths[..., 1:])
    return lengths


def at(points: FloatArray, lengths: FloatArray) -> FloatArray:
    """Places (m, d) that lie `lengths` (m,) along a line of points (n, d), straight between them; before and beyond it its ends."""
    steps = along(points)
    return np.column_stack([np.interp(lengths, steps, coordinate) for coordinate in points.T])


def evenly(points: FloatArray, count: int) -> FloatArray:
    """`count` places (count, d) on a line of points (n, d), at even distances from its first point to its last."""
    return at(points, np.linspace(0.0, 1.0, count) * along(points)[-1])


def scaled(pixels: FloatArray, scale: float | FloatArray) -> FloatArray:
    """Places (..., 2) of a picture in one that is `scale` times as large; they are counted from the middle of the first pixel."""
    return (pixels + 0.5) * scale - 0.5


def leftwards(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 2), y up, turned to their left by a quarter."""
    return vectors[..., ::-1] * (-1.0, 1.0)


def rig_axes(down: FloatArray) -> FloatArray:
    """The rig's x and y (2, 2), to the camera's right and up, as directions in the plane in which `down` (2,) is down."""
    return np.array([[-down[1], down[0]], [-down[0], -down[1]]])


def from_down(vectors: FloatArray, sign: float) -> FloatArray:
    """Angles (...) in rad of vectors (..., 2), y up: 0 straight down, positive towards the bend; `sign` is that of `bend_sign`."""
    return np.arctan2(-sign * vectors[..., 0], -vectors[..., 1])
