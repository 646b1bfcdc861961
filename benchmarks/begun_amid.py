"""Beginnings amid drawn films: in how many frames of bent bodies these are found by clamp and tip alone, and rightly.

Films of testing/drawn by ``DRAWN_FILMS`` as in benchmarks.drawn_films, four frames of each, pointed at by the same hand. A line is
right where it lies within a half width, or half of one, of the body's middle line everywhere. Nothing of the film before the frame
is seen, and it is as the sensor gives it.

Seeds 240 to 359 were run once with each of two versions, as docs/films-record.md tells, and count as seen since.
"""

from __future__ import annotations

import os
import sys
from multiprocessing import Pool
from typing import Any

import numpy as np

from testing.beginnings import Beginning, begun_amid
from testing.drawn import draw, summary

WORKERS = 2
AMID = (0.2, 0.45, 0.7, 0.95)  # of the film
LEAST_OFF, MOST_OFF = 0.5, 1.0  # half widths


def follow(seed: int) -> tuple[str, dict[int, Beginning]]:
    """What a film is, and what beginning it in some of its frames gave."""
    scene = draw(seed)
    numbers = [int(share * scene.frames) for share in AMID]
    return summary(scene), begun_amid(scene, numbers, seed)


def run() -> list[dict[str, Any]]:
    """All films of ``DRAWN_FILMS``; a line for each goes to standard error."""
    first, _, last = os.environ.get("DRAWN_FILMS", "0-59").partition("-")
    all_found: list[Beginning] = []
    with Pool(WORKERS) as pool:
        for what, found in pool.imap(follow, range(int(first), int(last or first) + 1)):
            words = [f"{number} {was.refused or f'{was.off:.2f} half widths off'}" for number, was in found.items()]
            sys.stderr.write(f"{what}: {'; '.join(words)}\n")
            all_found += found.values()
    off = np.array([was.off for was in all_found if not was.refused])
    frames = f"beginnings amid drawn films, seeds {first} to {last or first} ({len(all_found)})"
    return [
        {"name": f"{frames}: found", "value": len(off), "unit": "frames"},
        {"name": f"{frames}: found, and off by more than half a half width", "value": int(np.sum(off > LEAST_OFF)), "unit": "frames"},
        {"name": f"{frames}: found, and off by more than a half width", "value": int(np.sum(off > MOST_OFF)), "unit": "frames"},
    ]
