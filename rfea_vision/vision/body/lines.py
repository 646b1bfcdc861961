"""Lines in pictures: the skeleton of a mask, and the cheapest way over a picture of costs."""

from __future__ import annotations

from functools import cache
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.compiled import compiled

# The eight neighbours of a pixel, once round from the one above: row, column.
_ROUND = np.array([(-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1)])


def skeleton_of(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Thin a mask (h, w) to lines one pixel wide, after Guo and Hall (doi:10.1145/62065.62074): no body parts or vanishes."""
    thinned = np.pad(np.asarray(mask, dtype=np.uint8), 1)
    _thin(thinned, _removable())
    return thinned[1:-1, 1:-1].astype(bool)


@cache
def _removable() -> NDArray[np.uint8]:
    """For each of the 256 neighbourhoods, in which of the two passes (bits 1 and 2) its middle may go."""
    table = np.zeros(256, dtype=np.uint8)
    for code in range(256):
        up, up_right, right, down_right, down, down_left, left, up_left = ring = [code >> k & 1 for k in range(8)]
        parts = sum(not ring[k] and (ring[k + 1] or ring[(k + 2) % 8]) for k in (0, 2, 4, 6))
        pairs = min(sum(ring[k] or ring[(k + shift) % 8] for k in (0, 2, 4, 6)) for shift in (1, -1))
        if parts == 1 and 2 <= pairs <= 3:
            first = not ((down or down_left or not up_left) and left)
            second = not ((up or up_right or not down_right) and right)
            table[code] = first + 2 * second
    return table


@compiled
def _thin(mask, removable):  # type: ignore[no-untyped-def]  # compiled
    """Thin `mask` (h, w), whose rim is empty, in place."""
    rows, columns = np.nonzero(mask)
    left = len(rows)
    gone = np.empty(left, dtype=np.int64)
    changed = True
    while changed:
        changed = False
        for part in (1, 2):
            count = 0
            for k in range(left):
                r, c = rows[k], columns[k]
                code = 0
                for n in range(8):
                    code |= mask[r + _ROUND[n, 0], c + _ROUND[n, 1]] << n
                if removable[code] & part:
                    gone[count] = k
                    count += 1
            for k in range(count):
                mask[rows[gone[k]], columns[gone[k]]] = 0
            if count:
                changed = True
                kept = 0
                for k in range(left):
                    if mask[rows[k], columns[k]]:
                        rows[kept], columns[kept] = rows[k], columns[k]
                        kept += 1
                left = kept


def ways_from(
    cost: FloatArray, starts: NDArray[np.int64], end: tuple[int, int] | None = None
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Cost of the cheapest way from the starts to every pixel, by steps to the eight neighbours.

    A step costs the mean of its two pixels times its length; a pixel that costs infinity is never entered.

    Parameters
    ----------
    cost : (h, w), not negative
    starts : (n, 2) row and column, where ways begin
    end : row and column at which the search may stop

    Returns
    -------
    total : (h, w), infinite where no way leads or the search has stopped before
    before : (h, w) the pixel before on the way, as row times width plus column; -1 at the starts and where no way leads
    """
    stop = -1 if end is None else int(end[0]) * cost.shape[1] + int(end[1])
    return _search(np.ascontiguousarray(cost, dtype=np.float64), np.asarray(starts, dtype=np.int64), stop)


def way_to(end: tuple[int, int], before: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows and columns (n, 2) of the way from a start to `end`, from the second result of `ways_from`."""
    width = before.shape[1]
    steps = [end[0] * width + end[1]]
    while (last := int(before[steps[-1] // width, steps[-1] % width])) >= 0:
        steps.append(last)
    return np.array([(step // width, step % width) for step in reversed(steps)])


@compiled
def _search(cost, starts, stop):  # type: ignore[no-untyped-def]  # compiled
    """Dijkstra's search; see `ways_from`."""
    height, width = cost.shape
    total = np.full((height, width), np.inf)
    before = np.full((height, width), -1, dtype=np.int64)
    heap = [(0.0, np.int64(starts[0, 0] * width + starts[0, 1]))]
    for k in range(len(starts)):
        total[starts[k, 0], starts[k, 1]] = 0.0
        if k:
            heappush(heap, (0.0, np.int64(starts[k, 0] * width + starts[k, 1])))
    while len(heap):
        so_far, place = heappop(heap)
        r, c = place // width, place % width
        if so_far > total[r, c]:
            continue
        if place == stop:
            break
        for n in range(8):
            down, right = r + _ROUND[n, 0], c + _ROUND[n, 1]
            if down < 0 or right < 0 or down >= height or right >= width or not np.isfinite(cost[down, right]):
                continue
            length = np.sqrt(2.0) if n % 2 else 1.0
            there = so_far + 0.5 * length * (cost[r, c] + cost[down, right])
            if there < total[down, right]:
                total[down, right] = there
                before[down, right] = place
                heappush(heap, (there, np.int64(down * width + right)))
    return total, before
