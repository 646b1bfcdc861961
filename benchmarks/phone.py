"""Films as phones take them: share of the frames tracked, error, honesty, and speed of the tracker of the whole body.

Sixty scenes of the renderer in testing/phone.py, and 24 of translucent rubber on paper of its colour (``clear``). The even ones
were looked at while the tracker was written, and of the odd ones the first six; the other odd ones (``unseen``) were not.
Each film is given what a person points at: the clamp's two edges (1 px of error), the
tip (1.5 px), and a ruler of 100 mm.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._films import Outcome, followed, rows_of, told
from rfea_vision.readers.video import open_video
from testing.phone import clear_scene, film, scene
from testing.pointing import pointed_by_hand

SCENES = {"phone": (scene, 60), "clear": (clear_scene, 24)}
SPENT = 12  # scenes below this were all looked at
AGAINST = "a renderer of its own, H.264 at crf 28; clamp, tip and a ruler pointed at"


def follow(kind: str, number: int, folder: Path) -> Outcome:
    """Render and track one scene."""
    path = folder / f"{number}.mp4"
    truth = film(path, *SCENES[kind][0](number))
    source, ends = open_video(path), truth.centre_px[:, -1]
    within = np.all((ends > truth.half_width_px) & (ends < np.array(source.size) - truth.half_width_px), axis=1)
    pointed = pointed_by_hand(truth, source.size, np.random.default_rng(number))
    lines = {int(frame): truth.centre_px[frame] for frame in np.flatnonzero(within)}
    outcome = followed(source, pointed, ends, 0.0, truth.half_width_px, counts=within, middles=lines, whole=True)
    path.unlink()
    return outcome


def run() -> list[dict[str, Any]]:
    """All scenes, or of each kind those below PHONE_SCENES; what each gave goes to standard error."""
    rows = []
    for kind, (_, count) in SCENES.items():
        outcomes: dict[str, list[Outcome]] = {"seen": [], "unseen": []}
        with tempfile.TemporaryDirectory() as folder:
            for number in range(min(count, int(os.environ.get("PHONE_SCENES", count)))):
                outcome = follow(kind, number, Path(folder))
                outcomes["unseen" if number % 2 and number >= SPENT else "seen"].append(outcome)
                sys.stderr.write(told(f"{kind} {number}", outcome) + "\n")
        groups = [(f"{kind} films, {name}", group) for name, group in outcomes.items() if group]
        rows += [row for name, group in groups for row in rows_of(name, group, AGAINST, alone=True)]
    return rows
