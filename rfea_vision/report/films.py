"""Films in the page: as they are where they fit, encoded smaller where they do not, left out with a word at the worst."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import av
from av.error import FFmpegError
from markupsafe import Markup

from rfea_vision.report.collect import Experiment

LEAST_SIDE_PX = 120  # a tube is still seen
KEY_FRAME_EVERY = 6  # as in the clip itself, so that the page can jump anywhere


def fit_films(
    experiments: Sequence[Experiment], records: Sequence[dict[str, Any]], budget: int
) -> list[tuple[str, Markup]]:
    """Films as base64 within `budget` characters, shared out evenly, what small ones leave going to the large ones.

    A film that still does not fit is left out, and its record says so.
    """
    chosen = []
    films = [(e, r, e.clip) for e, r in zip(experiments, records, strict=True) if e.clip is not None]
    for number, (experiment, record, film) in enumerate(sorted(films, key=lambda item: len(item[2]))):
        share = budget // (len(films) - number)
        text = base64.b64encode(_fitted(film, 3 * share // 4)).decode("ascii")
        if len(text) <= share:
            budget -= len(text)
            chosen.append((experiment.name, Markup(text)))
        else:
            record["clip"] = None
            record["why"]["clip"] = _left_out(experiment.name, experiment.clip_info)
    return chosen


def _left_out(name: str, info: Mapping[str, object]) -> str:
    return (
        f"The film of {name} was left out to keep this page below 10 MB; "
        f"it is in rfea/{name}/{info.get('file', 'clip.mp4')}."
    )


def _fitted(film: bytes, size: int) -> bytes:
    """The film itself, or the first of ever smaller copies that has at most `size` bytes; else the smallest."""
    made = film
    for shrink in (1.0, 0.75, 0.5, 0.35):
        if len(made) <= size:
            break
        smaller = _encoded(film, size, shrink)
        if smaller is None:
            break
        made = smaller
    return made


def _encoded(film: bytes, size: int, shrink: float) -> bytes | None:
    """The film with `shrink` times its side and a bit rate that should give `size`; None if it cannot be read."""
    out = io.BytesIO()
    try:
        with av.open(io.BytesIO(film), "r") as source, av.open(out, "w", format="mp4") as target:
            pictures = source.streams.video[0]
            rate = Fraction(pictures.average_rate or 30)
            width, height = (
                max(LEAST_SIDE_PX, 2 * round(side * shrink / 2)) for side in (pictures.width, pictures.height)
            )
            seconds = max(float((pictures.frames or 1) / rate), 0.1)
            stream = target.add_stream("libx264", rate=rate)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.gop_size = KEY_FRAME_EVERY
            most = max(4000, int(0.8 * 8 * size / seconds))
            stream.options = {"crf": "34", "maxrate": str(most), "bufsize": str(most), "preset": "veryfast", "bf": "0"}
            stream.options |= {"threads": "1"}  # by default as many as cores: other bytes on other machines
            for number, frame in enumerate(source.decode(pictures)):
                small = frame.reformat(width=width, height=height, format="yuv420p")
                small.pts, small.time_base = number, 1 / rate
                target.mux(stream.encode(small))
            target.mux(stream.encode())
    except (FFmpegError, IndexError):
        return None
    return out.getvalue()
