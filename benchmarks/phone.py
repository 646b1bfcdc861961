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
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import DataError
from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from testing.phone import clear_scene, film, scene

SCENES = {"phone": (scene, 60), "clear": (clear_scene, 24)}
SPENT = 12  # scenes below this were all looked at
RULER_MM = 100.0
POINTING_PX = (1.0, 1.5)  # clamp and tip
WELL = (0.95, 0.02)  # share of the frames, and error over the range: what a film is to reach
WRONG = 0.1  # of the range: a track that is farther off than this, and does not say so


@dataclass(frozen=True)
class Outcome:
    """What one film gave: share of the frames with the tip in the picture, error over range, covered share, frames/s."""

    share: float
    error: float
    covered: float
    wrong: float
    frames_per_s: float
    refused: str = ""


def follow(kind: str, number: int, folder: Path) -> Outcome:
    """Render and track one scene."""
    arm, room, bends = SCENES[kind][0](number)
    path = folder / f"{number}.mp4"
    truth = film(path, arm, room, bends)
    rng = np.random.default_rng(number)
    source = open_video(path)
    x, y = np.mean(truth.clamp_px, axis=0)
    calibration = scaled_by_distance(source.size, [[x, y], [x + RULER_MM * truth.px_per_mm, y]], RULER_MM)
    clamp = np.array(truth.clamp_px) + rng.normal(0, POINTING_PX[0], (2, 2))
    tip = np.array(truth.tip_px) + rng.normal(0, POINTING_PX[1], 2)
    hints = Hints(clamp=tuple(map(tuple, clamp.tolist())), tip=tuple(tip.tolist()))  # pyright: ignore[reportArgumentType]
    actuator = Actuator(outer_radius=arm.half_width / 1e3, inner_radius=arm.half_width / 2e3, length=arm.length / 1e3)
    width, height = source.size
    ends = truth.centre_px[:, -1]
    margin = arm.half_width * room.px_per_mm
    inside = np.all((ends > margin) & (ends < np.array([width, height]) - margin), axis=1)
    began = time.process_time()
    try:
        track = track_frames(source, calibration, actuator, hints=hints, vertical="image")
    except DataError as error:
        return Outcome(0.0, np.nan, np.nan, 0.0, np.nan, str(error))
    finally:
        path.unlink()
    rate = len(truth.times_s) / (time.process_time() - began)
    off = track.dataset["tip"].values - truth.tip_mm
    swing = float(np.ptp(truth.tip_mm, axis=0).max())
    sigma = track.dataset["tip_sigma"].values
    apart = np.linalg.norm(off, axis=1)
    astray = (apart > WRONG * swing) & np.any(np.abs(off) > 3 * sigma, axis=1)
    return Outcome(
        float(track.valid[inside].mean()),
        float(np.sqrt(np.nanmean(apart**2)) / swing),
        float(np.nanmean((np.abs(off) < 1.96 * sigma)[track.valid])),
        float(np.mean(astray)),
        rate,
    )


def rows_of(name: str, outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """Medians and counts over a set of films."""
    tracked = [item for item in outcomes if not item.refused]
    well = [item for item in tracked if item.share >= WELL[0] and item.error <= WELL[1]]
    share = float(np.median([item.share for item in outcomes]))
    error = float(np.median([item.error for item in tracked]))
    astray = sum(item.wrong > 0.02 for item in tracked)
    table = [
        ("films with 95 % of the frames", sum(item.share >= WELL[0] for item in outcomes), "films", None, None),
        ("films with 95 % of the frames and 2 % error", len(well), "films", None, None),
        ("films refused (exit code 1)", len(outcomes) - len(tracked), "films", None, None),
        ("films with frames that are wrong and do not say so", astray, "films", "0", astray == 0),
        ("share of the frames tracked, median film", 100 * share, "%", ">= 95", share >= WELL[0]),
        ("error over the range, median film", 100 * error, "%", "<= 2", error <= WELL[1]),
        ("tip within its 95 % interval", 100 * float(np.mean([item.covered for item in tracked])), "%", None, None),
        (
            "speed",
            float(np.median([item.frames_per_s for item in tracked])),
            "frames/s of processor time",
            ">= 60",
            None,
        ),
    ]
    return [
        {
            "name": f"{name} ({len(outcomes)}): {what}",
            "value": round(float(value), 2),
            "unit": unit,
            "target": target,
            "met": met,
            "against": "a renderer of its own, H.264 at crf 28; clamp, tip and a ruler pointed at",
        }
        for what, value, unit, target, met in table
    ]


def run() -> list[dict[str, Any]]:
    """All scenes, or of each kind those below PHONE_SCENES; what each gave goes to standard error."""
    rows = []
    for kind, (_, count) in SCENES.items():
        outcomes: dict[bool, list[Outcome]] = {False: [], True: []}
        with tempfile.TemporaryDirectory() as folder:
            for number in range(min(count, int(os.environ.get("PHONE_SCENES", count)))):
                outcome = follow(kind, number, Path(folder))
                outcomes[bool(number % 2) and number >= SPENT].append(outcome)
                sys.stderr.write(f"{kind} {number}: {outcome}\n")
        rows += [
            row
            for seen, name in ((False, "seen"), (True, "unseen"))
            if outcomes[seen]
            for row in rows_of(f"{kind} films, {name}", outcomes[seen])
        ]
    return rows
