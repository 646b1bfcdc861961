"""Blurred grey levels of a picture, what they are between pixels, and how they slope there: compiled, as it is read in every frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rfea_vision.scatter import NORMAL
from rfea_vision.vision.compiled import compiled, inlined

Level = NDArray[np.float32]  # a picture (h, w) of grey levels, blurred


@inlined
def _between(picture, x, y):
    """The level between four pixels; beyond the border that of the border."""
    x, y = min(max(x, 0.0), picture.shape[1] - 1.0), min(max(y, 0.0), picture.shape[0] - 1.0)
    left, above = min(int(x), picture.shape[1] - 2), min(int(y), picture.shape[0] - 2)
    right, down = x - left, y - above
    over = (1.0 - right) * picture[above, left] + right * picture[above, left + 1]
    under = (1.0 - right) * picture[above + 1, left] + right * picture[above + 1, left + 1]
    return (1.0 - down) * over + down * under


@compiled
def sampled(picture, places):
    """Grey levels (n,) at places (n, 2) px."""
    out = np.empty(places.shape[0])
    for i in range(places.shape[0]):
        out[i] = _between(picture, places[i, 0], places[i, 1])
    return out


@compiled
def sloping(picture, places):
    """Grey levels (n,) at places (n, 2) px, and by how much (n, 2) a pixel to the right and one downwards changes them."""
    levels, slopes = np.empty(places.shape[0]), np.empty((places.shape[0], 2))
    for i in range(places.shape[0]):
        x, y = places[i, 0], places[i, 1]
        levels[i] = _between(picture, x, y)
        slopes[i, 0] = 0.5 * (_between(picture, x + 1.0, y) - _between(picture, x - 1.0, y))
        slopes[i, 1] = 0.5 * (_between(picture, x, y + 1.0) - _between(picture, x, y - 1.0))
    return levels, slopes


@compiled
def similarity_equations(picture, first, places, middle, pose, noise, together):
    """Matrix (4, 4) and right-hand side (4,) of the change of a pose (px, px, radians, share) that makes a picture what it was.

    It shows `first` (n,) at places (n, 2) px about its `middle`, once these have moved, turned and grown by the pose. What lies far
    off in levels is another thing, and counts little; `noise` is the least scatter, alike over `together` px.
    """
    count = places.shape[0]
    c, s = (1.0 + pose[3]) * math.cos(pose[2]), (1.0 + pose[3]) * math.sin(pose[2])
    rows, off = np.empty((count, 4)), np.empty(count)
    for i in range(count):
        across, down = c * places[i, 0] - s * places[i, 1], s * places[i, 0] + c * places[i, 1]
        x, y = across + middle[0] + pose[0], down + middle[1] + pose[1]
        off[i] = first[i] - _between(picture, x, y)
        rows[i, 0] = 0.5 * (_between(picture, x + 1.0, y) - _between(picture, x - 1.0, y))
        rows[i, 1] = 0.5 * (_between(picture, x, y + 1.0) - _between(picture, x, y - 1.0))
        rows[i, 2] = rows[i, 1] * across - rows[i, 0] * down
        rows[i, 3] = rows[i, 0] * across + rows[i, 1] * down
    scatter = max(noise, np.median(np.abs(off)) / NORMAL)
    matrix, vector = np.zeros((4, 4)), np.zeros(4)
    for i in range(count):
        weight = 1.0 / (1.0 + off[i] ** 2 / (4.0 * scatter**2)) ** 2 / (scatter * together) ** 2
        for a in range(4):
            vector[a] += weight * rows[i, a] * off[i]
            for b in range(4):
                matrix[a, b] += weight * rows[i, a] * rows[i, b]
    return matrix, vector
