"""The model of a blurred edge, tabulated: what a pixel sees of it, and how that changes with the edge's place and blur.

At distance x (px, outward) from an edge of Gaussian blur s, a pixel is a box of one px along its row, and sees the share

    light(x, s) = 1 - s [I((x + 1/2) / s) - I((x - 1/2) / s)],    I the integral of the normal distribution function,

of the step between outside and inside. The pixels of a row lie one px apart: for each blur of a geometric series, and
for each of `PHASES` places of the first pixel, their shares and both derivatives stand side by side. What lies between
the tabulated places and blurs is reached to first order by these derivatives; it is wrong by 1e-4 of the step at most.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

PHASES = 32
LEAST_BLUR_PX, MOST_BLUR_PX, RATIO = 0.12, 24.0, 1.03
# Columns of `Steps.blurs`: the blur, how many pixels its rows have, where its rows begin, and half their reach in px.
BLUR_PX, PIXELS, BEGIN, HALF_REACH = 0, 1, 2, 3


class Steps(NamedTuple):
    """Blurs (n, 4) in increasing order, and the table: of each blur `PHASES` + 1 times light, -d/dx and d/ds."""

    blurs: NDArray[np.float64]
    table: NDArray[np.float64]


def pixels_across(blur_px: float) -> int:
    """How many pixels of a row tell where an edge is."""
    return int(np.floor(5.0 * blur_px + 1.2)) + 1


@lru_cache(maxsize=1)
def steps() -> Steps:
    """Tabulate the edge model."""
    count = int(np.ceil(np.log(MOST_BLUR_PX / LEAST_BLUR_PX) / np.log(RATIO))) + 1
    blurs, parts, begin = np.empty((count, 4)), [], 0
    for i, blur in enumerate(LEAST_BLUR_PX * RATIO ** np.arange(count)):
        number = pixels_across(blur)
        half = 0.5 * (number - 1) + 0.5  # the first pixel lies up to one px inside of it
        x = -half + np.arange(PHASES + 1)[:, None] / PHASES + np.arange(number)[None, :]
        part = np.stack(_model(x, blur), axis=1)
        blurs[i] = blur, number, begin, half
        parts.append(part.ravel())
        begin += part.size
    return Steps(blurs, np.concatenate(parts))


def _model(x: NDArray[np.float64], blur: float) -> tuple[NDArray[np.float64], ...]:
    """Share of the step that a pixel sees, minus its derivative to x, and its derivative to the blur."""
    low, high = (x - 0.5) / blur, (x + 0.5) / blur
    density = [np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi) for z in (low, high)]
    light = 1.0 - blur * ((high * ndtr(high) + density[1]) - (low * ndtr(low) + density[0]))
    return light, ndtr(high) - ndtr(low), density[0] - density[1]
