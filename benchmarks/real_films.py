"""Real films by others: share of the frames tracked, error, honesty, and speed of the tracker of the whole body.

What is pointed at is in ``real_films/``, a file for each body in each film, and so is where a person saw its end, and in some also its
middle, in later frames.
The films are not: for each, clone the repository that its `source` names from GitHub, check its `commit` out, and copy `path` to
``$REAL_FILMS/<owner>+<name>/<path>`` (of single pictures it is a folder). Those that are not there are left out, and named.
``REAL_FILMS_ONLY`` chooses by name: the names of files, or patterns such as ``arm_*_end``, with blanks between.
``REAL_FILMS_CLICKS`` is the seed of another hand, which points a pixel or two beside what is kept.

Films of which `seen` is false were looked at by nobody who worked on the tracker before they were first run.
"""

from __future__ import annotations

import fnmatch
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._films import Outcome, followed, rows_of, told
from testing.pointing import Pointed
from testing.real_films import FilmFile, known_middles, known_places, pointed_at

AGAINST = "a coloured mark's middle, or a person's clicks in later frames; clamp, tip and a scale pointed at"


def follow(film: FilmFile, folder: Path) -> Outcome:
    """Track one film from what is pointed at in its first frame."""
    source = film.opened(folder)
    pointed = Pointed(film.calibration(source.size), film.tube, film.hints)
    return followed(source, pointed, known_places(film, source), film.hand_px, film.half_width_px, middles=known_middles(film))


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
    folder, clicks = Path(os.environ.get("REAL_FILMS", "real-films")), os.environ.get("REAL_FILMS_CLICKS")
    outcomes: dict[str, list[Outcome]] = {}
    for name, film in chosen(pointed_at(), folder):
        hand = film if clicks is None else film.clicked_again(np.random.default_rng([int(clicks), *name.encode()]))
        outcome = follow(hand, folder)
        sys.stderr.write(told(name, outcome) + "\n")
        kind = f"real films, tip at a {'mark' if film.end == 'mark' else 'body'}'s {'middle' if film.end == 'mark' else 'end'}"
        outcomes.setdefault(f"{kind}, {'seen' if film.seen else 'unseen'}", []).append(outcome)
    return [row for name, group in outcomes.items() for row in rows_of(name, group, AGAINST, alone=True)]
