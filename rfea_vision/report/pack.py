"""Arrays for the page: quantised to 16 bits, laid end to end, deflated once, and written as one line of base64."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

MISSING = -32768  # what the page reads as "no value"
_STEPS = 65000.0  # of a 16-bit number; the rest of its range says that there is none


class Pack:
    """Collects arrays; `add` returns what the page needs to find one again.

    A value is ``zero + step * integer``. The step is a 65,000th of the array's range: 3 micrometres over 200 mm.
    ``detail`` is the share of the usual number of samples that is kept.
    """

    def __init__(self, detail: float = 1.0) -> None:
        self.detail = detail
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: ArrayLike) -> dict[str, Any]:
        """Store an array of numbers (any shape, NaN allowed) and return its address: offset, shape, zero and step."""
        array = np.asarray(values, dtype=np.float64)
        finite = array[np.isfinite(array)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        step = (high - low) / _STEPS or 1.0
        whole = np.full(array.shape, MISSING, dtype="<i2")
        known = np.isfinite(array)
        whole[known] = np.rint((array[known] - low) / step - _STEPS / 2).astype("<i2")
        address = {"at": self._size, "shape": list(array.shape), "zero": low + step * _STEPS / 2, "step": step}
        data = whole.tobytes()
        self._parts.append(data)
        self._size += len(data)
        return address

    def rows(self, count: int, most: int) -> np.ndarray:
        """Row numbers (kept,), evenly spaced, that keep at most about `most` of `count` rows, fewer at a lower detail."""
        return stride(count, max(2, round(self.detail * most)))

    def bytes(self) -> bytes:
        """Everything added so far."""
        return b"".join(self._parts)

    def base64(self) -> str:
        """Everything added so far, as one line."""
        return base64.b64encode(zlib.compress(self.bytes(), 9)).decode("ascii")


def stride(count: int, most: int) -> np.ndarray:
    """Row numbers (kept,), evenly spaced, that keep at most about `most` of `count` rows."""
    return np.arange(0, count, max(1, -(-count // most)))


def nearest(times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """For each wanted time, the row (wanted,) of the sorted `times` that lies nearest; both in s.

    Raises
    ------
    ValueError
        If there are no times.
    """
    if len(times) == 0:
        raise ValueError("no times to choose from")
    after = np.clip(np.searchsorted(times, wanted), 1, max(1, len(times) - 1))
    after = np.minimum(after, len(times) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(wanted - times[before] <= times[after] - wanted, before, after)
