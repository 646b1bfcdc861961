"""Drawn films: share of the frames tracked, error, honesty, and speed, on films of a hand of its own (testing/drawn).

Many actuators, rooms, lights and cameras, all of a film from its seed: ``DRAWN_FILMS`` names the seeds, such as ``0-59`` (the default),
two films at a time. Each is given what a person points at in its first frame: the clamp's two edges (1 px of error, 1 s.d.), the tip
(1.5 px), and a ruler of 100 mm. The error is that of the tip, had the camera stood, over its range, in the frames in which the
end is in the picture with nothing before it; in these frames the whole line, the bend angle and the curvature are compared, too.

Seeds from 1000 on were looked at while the hand was written, and 1020 to 1079 while the tracker was worked on; 0 to 59 were run once,
60 to 99 and 100 to 139 later, at the commits and with the counts that docs/films-record.md names, and count as seen since.
"""

from __future__ import annotations

import os
import sys
import tempfile
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._films import Outcome, followed, rows_of, told
from rfea_vision.readers.video import open_video
from testing.drawn import draw, film, summary
from testing.pointing import pointed_by_hand

WORKERS = 2
AGAINST = "a hand of its own, H.264; clamp, tip and a ruler pointed at"


def follow(seed: int) -> tuple[str, Outcome]:
    """Draw and track one film: what it is, and what it gave."""
    with tempfile.TemporaryDirectory() as folder:
        scene, path = draw(seed), Path(folder) / f"{seed}.mp4"
        truth = film(path, scene)
        source = open_video(path)
        pointed = pointed_by_hand(truth, source.size, np.random.default_rng(seed))
        ends = np.where(np.asarray(truth.visible)[:, None], truth.ends_px, np.nan)
        lines = {int(frame): truth.centre_px[frame] for frame in np.flatnonzero(truth.visible)}
        outcome = followed(source, pointed, ends, 0.0, truth.half_width_px, stayed=True, middles=lines, whole=True)
        return summary(scene), outcome


def run() -> list[dict[str, Any]]:
    """All films of ``DRAWN_FILMS``; a line for each goes to standard error."""
    first, _, last = os.environ.get("DRAWN_FILMS", "0-59").partition("-")
    outcomes = []
    with Pool(WORKERS) as pool:
        for what, outcome in pool.imap(follow, range(int(first), int(last or first) + 1)):
            sys.stderr.write(told(what, outcome) + "\n")
            outcomes.append(outcome)
    return rows_of(f"drawn films, seeds {first} to {last or first}", outcomes, AGAINST)
