"""Cheapest ways over a picture, and the way through the middle of a body."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along

DEEP = 0.9  # of the half width that a way has in the median: chosen, rounded and blunt ends are shallower

class Ways:
    """Cheapest ways from some pixels to all others, over the eight neighbours of each.

    A step costs the mean cost of the two pixels times its length; a pixel of infinite cost is never entered.

    Parameters
    ----------
    cost : (h, w) of each pixel, above 0
    starts : (n, 2) rows and columns
    """

    def __init__(self, cost: FloatArray, starts: ArrayLike) -> None:
        height, width = cost.shape
        open_ = np.flatnonzero(np.isfinite(cost))
        number = np.full(cost.shape, -1, dtype=np.int32)
        number.flat[open_] = np.arange(len(open_))
        steps = []
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            one = np.s_[: height - down, max(0, -right) : width - max(0, right)]
            other = np.s_[down:, max(0, right) : width + min(0, right)]
            both = (number[one] >= 0) & (number[other] >= 0)
            price = 0.5 * np.hypot(down, right) * (cost[one][both] + cost[other][both])
            steps.append((price, number[one][both], number[other][both]))
        price, a, b = (np.concatenate(parts) for parts in zip(*steps, strict=True))
        graph = coo_array((price, (a, b)), shape=(len(open_), len(open_))).tocsr()
        first = np.unique(number[tuple(np.atleast_2d(np.asarray(starts)).T)])
        total, came, _ = dijkstra(graph, directed=False, indices=first, min_only=True, return_predecessors=True)
        self._number, self._open, self._came = number, open_, came
        #: (h, w), infinite where no way leads.
        self.total: FloatArray = np.full(cost.shape, np.inf)
        self.total.flat[open_] = total

    def to(self, end: ArrayLike) -> NDArray[np.int64]:
        """Rows and columns (n, 2) of the way from a start to `end` (2,), both included."""
        way = [int(self._number[tuple(np.asarray(end))])]
        while self._came[way[-1]] >= 0:
            way.append(int(self._came[way[-1]]))
        shape: Any = self._number.shape
        return np.column_stack(np.unravel_index(self._open[way[::-1]], shape)).astype(np.int64)


def middle_way(inside: NDArray[np.uint8], start: tuple[int, int], half_px: float) -> FloatArray | None:
    """The way (n, 2) px through the middle of a body, from a pixel of it to where what hangs together with that reaches farthest.

    From where it would run into a corner of the end it goes straight on to the outline. None where the pixel is outside, or nothing is.

    Parameters
    ----------
    inside : (h, w), 0 where the body is not
    start : row and column of the pixel
    half_px : about half its width
    """
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, 3)
    if depth[start] == 0.0 or inside.all():
        return None
    ways = Ways(np.where(depth > 0.0, np.maximum(depth, 0.5) ** -2.0, np.inf), [start])
    found = ways.to(np.unravel_index(int(np.argmax(np.where(np.isfinite(ways.total), ways.total, -1.0))), depth.shape))
    deep = depth[found[:, 0], found[:, 1]]
    usual = float(np.median(deep))
    way = found[: int(np.flatnonzero(deep >= DEEP * usual)[-1]) + 1, ::-1].astype(np.float64)
    lengths = along(way)
    ahead = way[-1] - way[int(np.searchsorted(lengths, lengths[-1] - half_px))]
    return np.vstack([way, way[-1] + usual * ahead / max(float(np.linalg.norm(ahead)), 1e-9)])
