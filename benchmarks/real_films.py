"""Real films by others: share of the frames tracked, error, honesty, and speed of the tracker of the whole body.

What is pointed at is in ``real_films/``, a file for each body in each film, and so is where a person saw its end in later frames.
The films are not: for each, clone the repository that its `source` names from GitHub, check its `commit` out, and copy `path` to
``$REAL_FILMS/<owner>+<name>/<path>`` (of single pictures it is a folder). Those that are not there are left out, and named.
``REAL_FILMS_ONLY`` chooses by name: the names of files, or patterns such as ``arm_*_end``, with blanks between.

Films of which `seen` is false were looked at by nobody who worked on the tracker before they were first run.
"""

from __future__ import annotations

import fnmatch
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.errors import DataError
from rfea_vision.vision import track_frames
from testing.real_films import Ends, FilmFile, Score, known_places, pointed_at, score

WELL = (0.95, 0.02)  # share of the frames, and error over the range: what a film is to reach
WRONG = 0.02  # share of the frames compared that are sure and wrong, beyond which a film counts as such


@dataclass(frozen=True)
class Outcome:
    """What one film gave: how its tip compares with what is known of it, and frames/s of processor time; or why it was refused."""

    scored: Score
    frames_per_s: float
    refused: str = ""

    @property
    def share(self) -> float:
        return self.scored.read / self.scored.frames

    @property
    def well(self) -> bool:
        return not self.refused and self.share >= WELL[0] and self.scored.error <= WELL[1]


def follow(film: FilmFile, folder: Path) -> Outcome:
    """Track one film from what is pointed at in its first frame."""
    source = film.opened(folder)
    calibration = film.calibration(source.size)
    known = known_places(film, source)
    began = time.process_time()
    refused = ""
    try:
        track = track_frames(source, calibration, film.tube, hints=film.hints, vertical="image")
        ends = Ends.of(track, calibration)
    except DataError as error:
        ends = Ends.none(len(known))
        refused = str(error)
    rate = len(known) / (time.process_time() - began)
    scored = score(ends, known[: len(ends.tip_px)], film.hand_px, film.half_width_px)
    return Outcome(scored, rate, refused)


def told(name: str, outcome: Outcome) -> str:
    """One line of what a film gave."""
    found = outcome.scored
    if outcome.refused:
        return f"{name}: refused: {outcome.refused}"
    return (
        f"{name}: {found.read}/{found.frames} frames, "
        f"{100 * found.error:.2f} % ({100 * found.carried:.2f}) of {found.range_px:.0f} px, "
        f"{100 * found.covered:.0f} % within, {found.sure_and_wrong} of {found.compared} sure and wrong, "
        f"{outcome.frames_per_s:.0f} frames/s"
    )


def rows_of(name: str, outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """Medians and counts over a set of films."""
    tracked = [item for item in outcomes if not item.refused]
    compared = [item for item in tracked if item.scored.compared]
    astray = sum(item.scored.sure_and_wrong > WRONG * item.scored.compared for item in compared)
    wrong = sum(item.scored.sure_and_wrong for item in compared)
    share = float(np.median([item.share for item in outcomes]))
    error = _median([item.scored.error for item in compared])
    carried = _median([item.scored.carried for item in compared])
    table = [
        ("films with 95 % of the frames", sum(item.share >= WELL[0] for item in outcomes), "films", None, None),
        ("films with 95 % of the frames and 2 % error", sum(item.well for item in outcomes), "films", None, None),
        ("films refused (exit code 1)", len(outcomes) - len(tracked), "films", None, None),
        ("films with frames that are wrong and do not say so", astray, "films", "0", astray == 0),
        ("frames that are wrong and do not say so", wrong, "frames", None, None),
        ("share of the frames tracked, median film", 100 * share, "%", ">= 95", share >= WELL[0]),
        ("error over the range, median film", 100 * error, "%", "<= 2", error <= WELL[1]),
        ("error over the range less what was off at first, median film", 100 * carried, "%", None, None),
        ("tip within its 95 % interval", 100 * _mean([item.scored.covered for item in compared]), "%", None, None),
        ("speed", _median([item.frames_per_s for item in tracked]), "frames/s of processor time", ">= 60", None),
    ]
    return [
        {
            "name": f"{name} ({len(outcomes)}): {what}",
            "value": round(float(value), 2),
            "unit": unit,
            "target": target,
            "met": met,
            "against": "a coloured mark's middle, or a person's clicks in later frames; clamp, tip and a scale pointed at",
        }
        for what, value, unit, target, met in table
    ]


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else np.nan


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else np.nan


def chosen(films: dict[str, FilmFile], folder: Path) -> Iterator[tuple[str, FilmFile]]:
    """The films of ``REAL_FILMS_ONLY`` (all by default) that are there; those that are not go to standard error."""
    patterns = os.environ.get("REAL_FILMS_ONLY", "*").split()
    for name, film in films.items():
        if not any(fnmatch.fnmatch(name, pattern) for pattern in patterns):
            continue
        if film.film(folder).exists():
            yield name, film
        else:
            sys.stderr.write(f"{name}: left out, {film.source}:{film.path} is not in REAL_FILMS\n")


def run() -> list[dict[str, Any]]:
    """All films that are there; a line for each goes to standard error."""
    folder = Path(os.environ.get("REAL_FILMS", "real-films"))
    outcomes: dict[str, list[Outcome]] = {}
    for name, film in chosen(pointed_at(), folder):
        outcome = follow(film, folder)
        sys.stderr.write(told(name, outcome) + "\n")
        kind = f"real films, tip at a {'mark' if film.end == 'mark' else 'body'}'s {'middle' if film.end == 'mark' else 'end'}"
        outcomes.setdefault(f"{kind}, {'seen' if film.seen else 'unseen'}", []).append(outcome)
    return [row for name, group in outcomes.items() for row in rows_of(name, group)]
