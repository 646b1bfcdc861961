"""Noise of a series from its own scatter: what changes slowly, or in less than half of the record, does not count."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

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
