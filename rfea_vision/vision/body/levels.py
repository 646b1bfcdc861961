"""Blurred grey levels of a picture, and what they are between pixels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray

Level = NDArray[np.float32]  # a picture (h, w) of grey levels, blurred


def sampled(picture: Level, places: FloatArray) -> FloatArray:
    """Grey levels (n,) at places (n, 2) px."""
    x, y = places.T.astype(np.float32)
    return np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=float).ravel()
