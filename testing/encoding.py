"""Pictures to a film that is the same from run to run."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np


def encode(path: Path, pictures: Iterable[np.ndarray], size: tuple[int, int], rate_Hz: float, crf: int, preset: str) -> None:
    """Write pictures (h, w, 3) RGB of a size (w, h) as H.264, as strongly compressed as `crf` and `preset` of x264 say."""
    rate = Fraction(rate_Hz).limit_denominator(1000)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.codec_context.thread_count = 1  # with more, a busy machine encodes another film
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        # x264's assembly encodes the same pictures to another film now and then, from one run to the next.
        stream.options = {"crf": str(crf), "preset": preset, "x264-params": "no-asm=1"}
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = number, 1 / rate
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
