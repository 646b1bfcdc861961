"""The type of arrays of floats, and the stretches of a mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def stretches(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where the stretches of a mask (n,) begin, and the places after their ends."""
    turns = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return turns[::2], turns[1::2]


def longest(mask: NDArray[np.bool_]) -> slice | None:
    """The longest stretch of a mask (n,); None where there is none."""
    first, end = stretches(mask)
    return slice(*max(zip(first.tolist(), end.tolist(), strict=True), key=lambda run: run[1] - run[0])) if len(first) else None
