"""What is kept of every frame while a video runs, in arrays that grow by doubling."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.vision import fitted
from rfea_vision.vision.compiled import lean
from rfea_vision.vision.curve import COEFFICIENTS, WIDTH_COEFFICIENTS, basis_matrix
from rfea_vision.vision.markers import SAMPLES

FloatArray = NDArray[np.float64]


@lean
def _quadratic_forms(rows, covariance, first, out):
    """Diagonal of rows @ covariance[first:, first:] @ rows.T."""
    size = rows.shape[1]
    for n in range(rows.shape[0]):
        total = 0.0
        for i in range(size):
            if rows[n, i] != 0.0:
                inner = 0.0
                for j in range(size):
                    inner += covariance[first + i, first + j] * rows[n, j]
                total += rows[n, i] * inner
        out[n] = total


@lean
def _add_covariance(covariance, noise, total):
    """Add the covariance of the centre line, at unit pixel noise."""
    weight = 1.0 / max(noise, 1e-3) ** 2
    for i in range(total.shape[0]):
        for j in range(total.shape[1]):
            total[i, j] += weight * covariance[i, j]


class Rows:
    """One row per frame: coefficients, variances of what will be derived from them, reason."""

    def __init__(self, nodes: int, segments: int) -> None:
        self.nodes, self.segments = nodes, segments
        at_nodes = np.linspace(0, 1, nodes)
        joints = np.linspace(0, 1, segments + 1)
        slopes = basis_matrix(joints, COEFFICIENTS, 1)
        self.shift_rows = np.ascontiguousarray(
            np.vstack(
                [
                    basis_matrix(at_nodes, COEFFICIENTS),
                    basis_matrix(at_nodes, COEFFICIENTS, 2),
                    basis_matrix(np.array([1.0]), COEFFICIENTS, 1),
                    np.diff(slopes, axis=0),
                ]
            )
        )
        self._width_rows = np.ascontiguousarray(basis_matrix(at_nodes, WIDTH_COEFFICIENTS))
        self._arrays: dict[str, NDArray[Any]] = {}
        self._count = 0
        self.covariance_sum = np.zeros((COEFFICIENTS, COEFFICIENTS))  # at unit pixel noise, to be averaged
        self.good = 0
        self._profiled = False
        self.marked = False  # whether the profiles are worth reading
        self.reasons: list[str] = []
        self._allocate(256)

    def _allocate(self, capacity: int) -> None:
        shapes: dict[str, tuple[int, ...]] = {
            "time": (),
            "coefficients": (COEFFICIENTS, 2),
            "width": (WIDTH_COEFFICIENTS,),
            "shift_variance": (len(self.shift_rows),),
            "width_variance": (len(self._width_rows),),
            "numbers": (fitted.NUMBERS,),
            "lamp": (),
            "profile": (SAMPLES,),
        }
        for name, shape in shapes.items():
            if name == "profile":  # 256 steps to a grey level; pages that are never written need no memory
                new = np.zeros((capacity, *shape), dtype=np.uint16)
            else:
                new = np.full((capacity, *shape), np.nan, dtype=np.float32 if "variance" in name else np.float64)
            old = self._arrays.get(name)
            if old is not None and (name != "profile" or self._profiled):
                new[: self._count] = old[: self._count]
            self._arrays[name] = new

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, name: str) -> FloatArray:
        return self._arrays[name][: self._count]

    @property
    def valid(self) -> NDArray[np.bool_]:
        return np.array([reason == "" for reason in self.reasons])

    @property
    def any_valid(self) -> bool:
        return any(reason == "" for reason in self.reasons)

    @property
    def commonest_reason(self) -> str:
        return Counter(self.reasons).most_common(1)[0][0]

    def part(self, name: str) -> slice:
        """Rows of `shift_rows`: ``node`` positions, ``bend2`` d2/du2, ``tip_slope`` d/du, ``joint`` its differences."""
        n = self.nodes
        return {
            "node": slice(0, n),
            "bend2": slice(n, 2 * n),
            "tip_slope": slice(2 * n, 2 * n + 1),
            "joint": slice(2 * n + 1, None),
        }[name]

    def saved(self) -> dict[str, FloatArray]:
        """Everything in it but the reasons, for a checkpoint."""
        sums = {"covariance_sum": self.covariance_sum, "good": np.array(self.good)}
        kept = {name: values for name, values in self._arrays.items() if name != "profile" or self._profiled}
        return {name: values[: self._count] for name, values in kept.items()} | sums

    def restore(self, saved: dict[str, FloatArray], reasons: list[str]) -> None:
        """Put back what `saved` gave."""
        self.reasons, self._count = list(reasons), len(reasons)
        self.covariance_sum, self.good = saved["covariance_sum"].copy(), int(saved["good"])
        capacity = max(256, len(reasons))
        self._arrays = {}
        self._allocate(capacity)
        for name, values in self._arrays.items():
            if name in saved:
                self._profiled = self._profiled or name == "profile"
                values[: self._count] = saved[name]

    def append(self, time_s: float, reason: str, follower: Any, lamp: float = np.nan) -> None:
        """Add a frame."""
        if self._count == len(self._arrays["time"]):
            self._allocate(2 * self._count)
        n = self._count
        self._arrays["time"][n] = time_s
        self._arrays["lamp"][n] = lamp
        self.reasons.append(reason)
        self._count += 1
        if reason:
            return
        self._arrays["coefficients"][n] = follower.state.coefficients
        self._arrays["width"][n] = follower.state.width
        if follower.marked and follower.profile is not None:
            self._profiled = True
            self._arrays["profile"][n] = np.round(256.0 * follower.profile)
        self._arrays["numbers"][n] = follower.work.numbers
        self.good += 1
        _add_covariance(follower.work.covariance, follower.work.numbers[fitted.NOISE], self.covariance_sum)
        _quadratic_forms(self.shift_rows, follower.work.covariance, 0, self._arrays["shift_variance"][n])
        _quadratic_forms(self._width_rows, follower.work.covariance, COEFFICIENTS, self._arrays["width_variance"][n])
