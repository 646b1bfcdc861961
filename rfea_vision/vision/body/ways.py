"""Cheapest ways over a picture, and the thin lines of a mask."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from rfea_vision.arrays import FloatArray


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


#: The eight neighbours of a pixel as the bits of a number, clockwise from the one above.
_BITS = np.array([[128, 1, 2], [64, 0, 4], [32, 16, 8]], dtype=np.float32)


def _going() -> list[NDArray[np.uint8]]:
    """Which neighbourhoods (256,) lose their pixel, in passes from above, below, right and left (Rosenfeld 1975).

    Those go that hold nothing together (Yokoi's number is 1) and end nothing: an end has two neighbours at most.
    """
    empty = ~(np.arange(256)[:, None] >> np.arange(8) & 1).astype(bool)
    holds = sum((empty[:, k] & ~(empty[:, k + 1] & empty[:, (k + 2) % 8])).astype(int) for k in (0, 2, 4, 6))
    inner = (holds == 1) & (np.count_nonzero(~empty, axis=1) > 2)
    return [(inner & empty[:, side]).astype(np.uint8) for side in (0, 4, 2, 6)]


def thinned(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The lines (h, w) of one pixel that a mask (h, w) thins to, in one piece where it was in one piece."""
    line = np.pad(mask, 1).astype(np.uint8)
    passes = _going()
    left = -1
    while left != (left := np.count_nonzero(line)):
        for going in passes:
            line &= 1 - cv2.LUT(cv2.filter2D(line, cv2.CV_8U, _BITS, borderType=cv2.BORDER_CONSTANT), going)
    return line[1:-1, 1:-1].astype(bool)
