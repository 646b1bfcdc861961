"""The sums of a frame's normal equations along the body, compiled: of B-splines only four are not nought at a station.

`first` (parts, S) is the unknown at which each part's four splines begin, `value` (parts, S, 4) what they are there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.compiled import compiled, lean
from rfea_vision.vision.curve import basis_matrix


def at_stations(shares: FloatArray, parts: tuple[tuple[int, int], ...]) -> tuple[NDArray[np.int64], FloatArray]:
    """`first` and `value` of parts, each given as where its unknowns begin and how many they are."""
    first = np.empty((len(parts), len(shares)), dtype=np.int64)
    value = np.empty((len(parts), len(shares), 4))
    for k, (begin, count) in enumerate(parts):
        low = np.clip(np.floor(shares * (count - 3)).astype(int), 0, count - 4)
        first[k] = begin + low
        value[k] = np.take_along_axis(basis_matrix(shares, count), low[:, None] + np.arange(4), axis=1)
    return first, value


@lean
def add_row(matrix, vector, first, row, value, stderr):
    """Add one equation: the unknowns from `first` on, weighted by `row`, come to `value`, which is known to `stderr`."""
    weight = 1.0 / (stderr * stderr)
    for a in range(row.shape[0]):
        vector[first + a] += weight * row[a] * value
        for b in range(row.shape[0]):
            matrix[first + a, first + b] += weight * row[a] * row[b]


@lean
def add_skin(matrix, vector, information, pull, share, first, value):
    """Add `share` (S,) of the skin's `information` (S, 6) nn, nt, tt, nw, tw, ww and `pull` (S, 3)."""
    for s in range(share.shape[0]):
        if share[s] <= 0.0:
            continue
        for i in range(3):
            for j in range(3):
                low, high = min(i, j), max(i, j)
                weight = share[s] * information[s, high * (high + 1) // 2 + low]
                for a in range(4):
                    for b in range(4):
                        matrix[first[i, s] + a, first[j, s] + b] += weight * value[i, s, a] * value[j, s, b]
            for a in range(4):
                vector[first[i, s] + a] += share[s] * pull[s, i] * value[i, s, a]


@compiled
def add_edges(matrix, vector, edges, share_seen, correlated, limit, first, value):
    """Add the edges (S, 2, 2) to both sides, value and variance: the left one moves with the first part, the right one against it.

    Parts: across, in width, and how far the middle between the edges lies off the material; the second alone moves both
    sides outwards. `limit` is in standard errors off the median of a side: what lies farther off counts less.
    """
    count = edges.shape[0]
    seen = np.empty(count)
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        found = 0
        for s in range(count):
            if np.isfinite(edges[s, side, 1]):
                seen[found] = edges[s, side, 0]
                found += 1
        if found == 0:
            continue
        middle = np.median(seen[:found])
        for s in range(count):
            if not np.isfinite(edges[s, side, 1]):
                continue
            weight = share_seen[s] / (edges[s, side, 1] * correlated)
            off = abs(edges[s, side, 0] - middle) * math.sqrt(weight)
            weight *= min(1.0, limit / max(off, 1e-9))
            for i in range(first.shape[0]):
                si = 1.0 if i == 1 else sign
                for a in range(4):
                    row = weight * si * value[i, s, a]
                    vector[first[i, s] + a] += row * edges[s, side, 0]
                    for j in range(first.shape[0]):
                        sj = 1.0 if j == 1 else sign
                        for b in range(4):
                            matrix[first[i, s] + a, first[j, s] + b] += row * sj * value[j, s, b]
