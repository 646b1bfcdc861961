"""Frames held in memory, and a calibration taken from a rendered lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

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


def write_grey_film(path: Path, pictures: Sequence[NDArray[np.uint8]], rate_Hz: int, crf: int) -> None:
    """Compress grey pictures (h, w), whose sides are even, to an H.264 film: the same bytes from the same pictures.

    A grey picture that is reformatted has no colours of its own, and the encoder's choices would hang on what is in memory
    there; so they do, of the same pictures, with its vector instructions (24 encodings of one film were 23 different ones). On
    as many threads as there are cores it would be another film on each machine.
    """
    height, width = pictures[0].shape
    no_colour = np.full((height // 2, width), 128, dtype=np.uint8)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate_Hz)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"  # pyright: ignore[reportAttributeAccessIssue]
        stream.options = {"crf": str(crf), "threads": "1", "x264-params": "asm=0"}
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(np.vstack([picture, no_colour]), format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, rate_Hz)
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
