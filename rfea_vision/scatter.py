"""Noise of a series from its own scatter: what changes slowly, or in less than half of the record, does not count."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import median_filter

from rfea_vision.arrays import FloatArray

#: Median distance of a standard normal law from its median: its quantile at three quarters.
NORMAL = 0.6744897501960817


def scatter(values: ArrayLike) -> FloatArray:
    """Standard deviation of (samples, ...) along the first axis by the median distance from the median: outliers do not move it."""
    values = np.asarray(values, dtype=float)  # SciPy's takes five times as long for a few values, as in every frame
    return np.asarray(np.median(np.abs(values - np.median(values, axis=0)), axis=0) / NORMAL)


def third_difference_noise(values: FloatArray, stride: int = 1) -> FloatArray:
    """Standard deviation (columns,) of white noise on an evenly sampled series (time, columns), from its third differences.

    They remove any motion that is smooth over four samples, `stride` apart, and have 1 + 9 + 9 + 1 times the variance of the noise.
    Rows that are not all numbers are passed over. Zero where fewer than eight differences are left.
    """
    third = (
        values[3 * stride :]
        - 3 * values[2 * stride : -stride]
        + 3 * values[stride : -2 * stride]
        - values[: -3 * stride]
    )
    third = third[np.all(np.isfinite(third), axis=1)]
    if third.shape[0] < 8:
        return np.zeros(values.shape[1])
    return scatter(third) / np.sqrt(20.0)


def rounding_noise(values: FloatArray) -> float:
    """Standard deviation that rounding gives to values (time, columns), as the smallest step between any two of a column says.

    Zero where no two differ.
    """
    steps = np.abs(np.diff(np.sort(values, axis=0), axis=0))
    steps = steps[steps > 1e-9 * max(1.0, float(np.abs(values).max()))]
    return float(steps.min()) / np.sqrt(12.0) if steps.size else 0.0


#: Frames about one that tell what the tube does there: of fewer, bursts of wrong frames would be taken for it.
ABOUT_FRAMES = 51
#: Of a leap in one frame, what its neighbours are off by to the other side, where each is held to the cubic through the two frames on
#: either side of it: two thirds. A corner of a motion leaves a half, and one that rings, down to five frames a period, less.
LEAVES = 0.58


def leaps(signal: FloatArray, noise: float = 0.0) -> NDArray[np.bool_]:
    """Which frames (n,) of a motion (n, k) leap alone: by more than `noise` and what it does elsewhere, while it goes on as it came."""
    found = np.zeros(signal.shape[0], dtype=bool)
    if signal.shape[0] < 9:
        return found
    beside, beyond = signal[1:-3] + signal[3:-1], signal[:-4] + signal[4:]
    off = signal[2:-2] - (4.0 * beside - beyond) / 6.0
    size = np.abs(off)
    # What a still or moving tube does between frames sets the scale, over the run and about the frame: a tube that shakes while it is
    # held, and rests for most of the run, does not jump. A jump is far beyond that and the noise.
    about = np.maximum(np.median(size, axis=0), median_filter(size, (ABOUT_FRAMES, 1), mode="nearest"))
    far = size > np.maximum(12 * about + noise, 1e-9)
    left = np.minimum(-off[:-2] * np.sign(off[1:-1]), -off[2:] * np.sign(off[1:-1]))
    found[3:-3] = (far[1:-1] & (left > LEAVES * size[1:-1])).any(axis=1)
    return found
