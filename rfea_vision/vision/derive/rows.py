"""What is kept of every frame while a video runs, in blocks that are given back one by one when the track is made."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.vision.curve import COEFFICIENTS, WIDTH_COEFFICIENTS, basis_matrix
from rfea_vision.vision.edges import fitted

BLOCK = 1024  # frames


class Rows:
    """One row per frame: coefficients, variances of what will be derived from them, reason."""

    def __init__(self, nodes: int, segments: int) -> None:
        self.nodes, self.segments = nodes, segments
        at_nodes = np.linspace(0, 1, nodes)
        joints = np.linspace(0, 1, segments + 1)
        slopes = basis_matrix(joints, COEFFICIENTS, 1)
        places, bends = basis_matrix(at_nodes, COEFFICIENTS), basis_matrix(at_nodes, COEFFICIENTS, 2)
        self.shift_rows = np.vstack([places, bends, slopes[-1:], np.diff(slopes, axis=0)])
        # Rows of these: positions, d2/du2, d/du at the tip, and differences of d/du between joints.
        cuts = np.cumsum([0, nodes, nodes, 1, segments])
        self.parts = {name: slice(*cuts[k : k + 2]) for k, name in enumerate(("node", "bend2", "tip_slope", "joint"))}
        self._width_rows = basis_matrix(at_nodes, WIDTH_COEFFICIENTS)
        self._row = np.dtype(
            [
                ("time", np.float64),
                ("coefficients", np.float64, (COEFFICIENTS, 2)),
                ("width", np.float64, (WIDTH_COEFFICIENTS,)),
                ("numbers", fitted.FRAME),
                ("lamp", np.float64),
                ("view", np.float64, (2, 3)),
                ("shift_variance", np.float32, (len(self.shift_rows),)),
                ("width_variance", np.float32, (len(self._width_rows),)),
            ],
            align=True,
        )
        self._blocks: list[NDArray[Any]] = []
        self.profiles: list[NDArray[np.uint16]] = []  # of every good frame of a marked tube, 256 steps to a grey level
        self.covariance_sum = np.zeros((COEFFICIENTS, COEFFICIENTS))  # at unit pixel noise, to be averaged
        self.good, self.copies = 0, 0  # frames measured, and frames that repeat the one before
        self.marked = False  # whether the profiles are worth reading
        self.reasons: list[str] = []
        self.material: list[dict[float, tuple[float, float]]] = []  # of every good frame: marks by their share

    def __len__(self) -> int:
        return len(self.reasons)

    def good_ones(self, name: str) -> NDArray[Any]:
        """One quantity of all good frames, copied."""
        return self.of_all(name)[self.valid]

    def of_all(self, name: str) -> NDArray[Any]:
        """One quantity of all frames, copied."""
        return np.concatenate([block[name] for block in self._blocks])[: len(self)]

    def given_back(self) -> Iterator[NDArray[Any]]:
        """Every block's good frames in their order; what has been given is no longer kept here."""
        valid, start = self.valid, 0
        while self._blocks:
            block = self._blocks.pop(0)
            yield block[: len(self) - start][valid[start : start + BLOCK]]
            start += BLOCK

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which frames (frames,) were measured."""
        return np.array([reason == "" for reason in self.reasons])

    @property
    def share(self) -> float:
        """Of the frames that are no copy of the one before, those that were measured."""
        return self.good / max(len(self) - self.copies, 1)

    @property
    def commonest_reason(self) -> str:
        """The commonest reason, in the words of the first frame that has it; empty where all frames were measured."""
        codes = Counter(reason.partition(":")[0] for reason in self.reasons if reason).most_common(1)
        return next((reason for reason in self.reasons if codes and reason.startswith(codes[0][0])), "")

    def reject_all(self) -> None:
        """What was followed so far was not the tube."""
        self.reasons = [reason or "no_tube" for reason in self.reasons]
        self.good, self.covariance_sum[:] = 0, 0.0
        self.material.clear()
        self.profiles.clear()

    def append(self, time_s: float, reason: str, follower: Any, lamp: float = np.nan) -> None:
        """Add a frame as a follower has left it."""
        n = len(self) % BLOCK
        if n == 0:
            # Memory of its own, that goes back to the system when the block is dropped.
            self._blocks.append(np.frombuffer(mmap(-1, BLOCK * self._row.itemsize), self._row))
            self._blocks[-1][:] = np.full(1, np.nan, dtype=self._row)
        block = self._blocks[-1]
        block["time"][n] = time_s
        block["lamp"][n], block["view"][n] = lamp, follower.view
        self.reasons.append(reason)
        self.copies += reason == "duplicate"
        if reason:
            return
        block["coefficients"][n] = follower.state.coefficients - follower.moved_mm
        block["width"][n] = follower.state.width
        if follower.marked and follower.profile is not None:
            self.profiles.append(np.round(256.0 * follower.profile).astype(np.uint16))
        block["numbers"][n] = follower.work.numbers[0]
        self.material.append(follower.material)
        self.good += 1
        covariance, k = follower.work.covariance, COEFFICIENTS
        self.covariance_sum += covariance[:k, :k] / max(follower.work.numbers["noise"][0], 1e-3) ** 2
        for name, rows, part in (("shift", self.shift_rows, covariance[:k, :k]), ("width", self._width_rows, covariance[k:, k:])):
            block[f"{name}_variance"][n] = np.einsum("ij,ij->i", rows @ part, rows)
