"""Polygons drawn by exact coverage: every pixel receives the area of the polygon inside it, to rounding.

Pixel origin: the centre of the top left pixel is (0, 0); a pixel reaches half a unit from its centre to either side.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray


def coverage(outlines: list[FloatArray], left: int, top: int, width: int, height: int) -> NDArray[np.float32]:
    """Area of closed polygons inside each pixel of a window.

    Parameters
    ----------
    outlines : (k, 2) corners x, y in pixels; polygons must not overlap each other
    left, top, width, height : of the window, in whole pixels

    Returns
    -------
    (height, width) values between 0 and 1
    """
    sweep = np.zeros((height, width + 2))
    for outline in outlines:
        _add_outline(np.ascontiguousarray(outline, dtype=np.float64), 0.5 - left, 0.5 - top, width, height, sweep)
    return _gather(sweep, width)


@njit(cache=True)
def _add_outline(outline: FloatArray, dx: float, dy: float, width: int, height: int, sweep: FloatArray) -> None:
    """Add each edge's signed area to the first column it fills; a running sum along the row then fills the rest."""
    count = outline.shape[0]
    for index in range(count):
        x0, y0 = outline[index, 0] + dx, outline[index, 1] + dy
        after = (index + 1) % count
        x1, y1 = outline[after, 0] + dx, outline[after, 1] + dy
        if y0 == y1:
            continue
        sign = 1.0
        if y0 > y1:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
        slope = (x1 - x0) / (y1 - y0)
        for row in range(max(0, int(np.floor(y0))), min(height, int(np.ceil(y1)))):
            upper, lower = max(y0, float(row)), min(y1, row + 1.0)
            if lower <= upper:
                continue
            begin, end = x0 + slope * (upper - y0), x0 + slope * (lower - y0)
            if begin > end:
                begin, end = end, begin
            height_here = sign * (lower - upper)
            if end <= 0.0:
                sweep[row, 0] += height_here
                continue
            if begin >= width:
                continue
            span = end - begin
            # share of the edge left of the window, then column by column
            here = begin
            if here < 0.0:
                sweep[row, 0] += height_here * (-begin / span)
                here = 0.0
            column = int(here)
            while column < width:
                stop = min(end, column + 1.0)
                part = height_here if span < 1e-12 else height_here * (stop - here) / span
                middle = 0.5 * (here + stop) - column
                sweep[row, column] += part * (1.0 - middle)
                sweep[row, column + 1] += part * middle
                if end <= column + 1.0:
                    break
                here = stop
                column += 1


@njit(cache=True)
def _gather(sweep: FloatArray, width: int) -> NDArray[np.float32]:
    height = sweep.shape[0]
    out = np.empty((height, width), np.float32)
    for row in range(height):
        total = 0.0
        for column in range(width):
            total += sweep[row, column]
            out[row, column] = min(abs(total), 1.0)
    return out
