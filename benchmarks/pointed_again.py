"""Drawn films that are not read well, with a person who looks and points again: what one, two and three corrections bring.

Films of testing/drawn by ``DRAWN_FILMS`` as in benchmarks.drawn_films, pointed at by the same hand. Of those that miss 95 % of their
frames or 2 % of their range the person sees the first frame, after the last correction, that was refused, or in which the line's end
lies beside the body's by more than half a half width and 3 px, and points at five places along the body there.

Seeds 390 to 689 were run once, as docs/films-record.md tells, and count as seen since.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._films import Outcome, followed, rows_of, told
from rfea_vision.readers.video import open_video
from testing.drawn import draw, film, summary
from testing.pointing import pointed_again, pointed_by_hand

WORKERS = 2
CORRECTIONS = 3
AGAINST = "a hand of its own, H.264; clamp, tip and a ruler pointed at, and five points in each of some later frames"
SEEN_OFF = 0.5, 3.0  # half widths, and px: what a person sees who looks at the line over its film


def follow(seed: int) -> tuple[str, list[Outcome]]:
    """What a film is, and what it gave with no correction, with one, and so on, as long as it is not read well."""
    with tempfile.TemporaryDirectory() as folder:
        scene, path = draw(seed), Path(folder) / f"{seed}.mp4"
        truth = film(path, scene)
        source = open_video(path)
        pointed = pointed_by_hand(truth, source.size, np.random.default_rng(seed))
        visible, rng = np.asarray(truth.visible), np.random.default_rng([seed, 1])
        ends, least = np.where(visible[:, None], truth.ends_px, np.nan), float(np.hypot(SEEN_OFF[0] * truth.half_width_px, SEEN_OFF[1]))
        outcomes, frame = [followed(source, pointed, ends, 0.0, truth.half_width_px, stayed=True)], 0
        while not outcomes[-1].well and len(outcomes) <= CORRECTIONS:
            off = np.full(len(ends), np.nan)
            off[: len(outcomes[-1].off_px)] = outcomes[-1].off_px
            wrong = np.flatnonzero(visible & ~(off <= least))
            if not len(wrong := wrong[wrong > frame]):
                break
            frame = int(wrong[0])
            again = pointed_again(truth, frame, rng)
            pointed = pointed._replace(hints=replace(pointed.hints, corrections=(*pointed.hints.corrections, again)))
            outcomes.append(followed(source, pointed, ends, 0.0, truth.half_width_px, stayed=True))
        return summary(scene), outcomes


def run() -> list[dict[str, Any]]:
    """All films of ``DRAWN_FILMS``; a line for each that is corrected goes to standard error."""
    first, _, last = os.environ.get("DRAWN_FILMS", "0-59").partition("-")
    films: list[list[Outcome]] = []
    with Pool(WORKERS) as pool:
        for what, outcomes in pool.imap(follow, range(int(first), int(last or first) + 1)):
            if not outcomes[0].well:
                gave = [told(f"  {count} corrections", found) for count, found in enumerate(outcomes)]
                sys.stderr.write("\n".join([what, *gave]) + "\n")
            films.append(outcomes)
    name = f"drawn films, seeds {first} to {last or first}"
    return [
        row
        for count in range(CORRECTIONS + 1)
        for row in rows_of(
            f"{name}, {count} corrections at most", [outcomes[min(count, len(outcomes) - 1)] for outcomes in films], AGAINST
        )
    ]
