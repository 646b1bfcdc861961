"""Drawn films: share of the frames tracked, error, honesty, and speed, on films of a hand of its own (testing/drawn).

Many actuators, rooms, lights and cameras, all of a film from its seed: ``DRAWN_FILMS`` names the seeds, such as ``0-59`` (the default),
two films at a time. Each is given what a person points at in its first frame: the clamp's two edges (1 px of error, 1 s.d.), the tip
(1.5 px), and a ruler of 100 mm. The error is that of the tip as it is seen from the clamp, over its range, in the frames in which the
end is in the picture with nothing before it.

Seeds from 1000 on were looked at while the hand was written, and 1020 to 1079 while the tracker was worked on; 0 to 59 were run once,
at the commit and with the counts that docs/films-record.md names, and count as seen since.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real_films import Outcome, rows_of, told
from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import DataError
from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from testing.drawn import draw, film, summary
from testing.real_films import Ends, score

RULER_MM = 100.0
CLAMP_PX, TIP_PX = 1.0, 1.5  # how well these are pointed at, 1 s.d.
WORKERS = 2


def follow(seed: int) -> tuple[str, Outcome]:
    """Draw and track one film: what it is, and what it gave."""
    with tempfile.TemporaryDirectory() as folder:
        scene, path = draw(seed), Path(folder) / f"{seed}.mp4"
        truth = film(path, scene)
        source, rng = open_video(path), np.random.default_rng(seed)
        high = np.array(source.size) - 1.0
        clamp = np.clip(np.array(truth.clamp_px) + rng.normal(0.0, CLAMP_PX, (2, 2)), 0.0, high)
        tip = np.clip(np.array(truth.tip_px) + rng.normal(0.0, TIP_PX, 2), 0.0, high)
        x, y = np.mean(truth.clamp_px, axis=0)
        calibration = scaled_by_distance(source.size, [[x, y], [x + RULER_MM * truth.px_per_mm, y]], RULER_MM)
        half_mm = truth.half_width_px / truth.px_per_mm
        actuator = Actuator(outer_radius=half_mm / 1e3, inner_radius=half_mm / 2e3, length=truth.length_mm / 1e3)
        hints = Hints(clamp=tuple(map(tuple, clamp.tolist())), tip=tuple(tip.tolist()))  # pyright: ignore[reportArgumentType]
        ends = truth.centre_px[:, -1] - truth.centre_px[:, 0] + truth.centre_px[0, 0]
        ends = np.where(np.asarray(truth.visible)[:, None], ends, np.nan)
        began, refused = time.process_time(), ""
        try:
            found = Ends.of(track_frames(source, calibration, actuator, hints=hints, vertical="image"), calibration, stayed=True)
        except DataError as error:
            found = Ends.none(len(ends))
            refused = str(error).partition(": ")[2]
        rate = len(ends) / (time.process_time() - began)
    return summary(scene), Outcome(score(found, ends, 0.0, truth.half_width_px), rate, refused)


def run() -> list[dict[str, Any]]:
    """All films of ``DRAWN_FILMS``; a line for each goes to standard error."""
    first, _, last = os.environ.get("DRAWN_FILMS", "0-59").partition("-")
    outcomes = []
    with Pool(WORKERS) as pool:
        for what, outcome in pool.imap(follow, range(int(first), int(last or first) + 1)):
            sys.stderr.write(told(what, outcome) + "\n")
            outcomes.append(outcome)
    return rows_of(f"drawn films, seeds {first} to {last or first}", outcomes)
