"""Frames held in memory, and a calibration taken from a rendered lens."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfea_vision.artefacts import Calibration
from rfea_vision.readers.video import FrameSource
from testing.scenes import Lens


@dataclass(frozen=True)
class MemorySource(FrameSource):
    pictures: tuple = ()
    times: tuple = ()

    def times_s(self):
        return np.array(self.times)

    def frames(self, start_frame: int = 0):
        yield from zip(self.times[start_frame:], self.pictures[start_frame:], strict=True)


def memory_source(pictures, times) -> MemorySource:
    h, w = pictures[0].shape
    return MemorySource(Path("memory"), (w, h), len(pictures), None, tuple(pictures), tuple(float(t) for t in times))


def true_calibration(lens: Lens) -> Calibration:
    """The exact lens and plane, with no uncertainty."""
    n = 4 + len(lens.distortion)
    return Calibration(
        lens.size[0], lens.size[1], lens.matrix, lens.distortion, "brown5", 0.0, np.zeros((n, n)),
        lens.rotation @ np.diag([1.0, -1.0, -1.0]), lens.translation, np.zeros((6, 6)), 0.0, "board", (), {},
    )  # fmt: skip
