"""Light that changes all over the picture: a camera that exposes anew, a lamp that is switched on."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing

import cv2
import numpy as np
from numpy.typing import NDArray

SMALL = (48, 64)  # px: of so small a picture each pixel is the mean of many, and has little noise
OF_EACH = 4  # rows and columns of pixels: to read all of them takes a tenth of a frame's time
# Of the light, chosen: drawn films whose light steps by 12 % are read in all frames, and such of 20 and 25 % in two thirds and less.
# What changes by less is followed by the colours that are known of body and wall.
STEP = 0.1
ALIKE = 0.3  # of a step, 1 s.d., chosen: light changes everywhere alike, and a hand before the camera does not
TENTHS, WIDE = (0.1, 0.9), 2.563  # in all but a tenth of the picture to either side: a body moves in less; and how wide that is
DARK, BRIGHT = 20.0, 240.0  # grey levels: what is beyond these says nothing of the light


def levelled(
    pictures: Generator[tuple[float, NDArray[np.uint8]], None, None],
) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
    """Pictures (h, w, 3) with their times, as light as the first; where the light changes by no more than a step, as they are."""
    known, gain = None, 1.0
    with closing(pictures):
        for time_s, picture in pictures:
            some = cv2.resize(picture, [OF_EACH * side for side in SMALL], interpolation=cv2.INTER_NEAREST)
            seen = cv2.resize(some, SMALL, interpolation=cv2.INTER_AREA).mean(axis=2)
            change, spread = (0.0, np.inf) if known is None else changed(known, seen)
            if spread > STEP:  # the first, or another view
                known = seen
            elif abs(change) > STEP and spread < ALIKE * abs(change):
                known, gain = seen, gain * float(np.exp(-change))
            yield time_s, picture if gain == 1.0 else np.clip(gain * picture, 0, 255).astype(np.uint8)


def changed(known: NDArray[np.float64], seen: NDArray[np.float64]) -> tuple[float, float]:
    """By what (logarithm) the light of one small picture differs from that of another, and by how much that from place to place."""
    read = (np.minimum(known, seen) > DARK) & (np.maximum(known, seen) < BRIGHT)
    if 2 * np.count_nonzero(read) < read.size:
        return 0.0, np.inf
    changes = np.log(seen[read] / known[read])
    low, high = np.quantile(changes, TENTHS)
    return float(np.median(changes)), float((high - low) / WIDE)
