"""First frames of real films: in how many of those in which a person saw a body's end it is found by its clamp and that end alone.

Films as for `benchmarks.real_films`, with ``REAL_FILMS`` and ``REAL_FILMS_ONLY`` as there. ``FIRST_FRAMES=0`` or ``1`` takes every
second frame alone, from the first or the second on. Found means that no rule refuses the line, not that it is right.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from benchmarks.real_films import chosen
from testing.beginnings import begun
from testing.real_films import FilmFile, pointed_at

MOVES = ("air_dancer", "discs_")  # names of films, or how they begin, in which the clamp goes elsewhere


def found(film: FilmFile, folder: Path) -> str:
    """Why the one frame of a film is refused; empty where its body is found."""
    source = film.opened(folder)
    return begun(source, film.calibration(source.size), film.tube, film.hints)[1]


def run() -> list[dict[str, Any]]:
    """All films that are there; a line for each goes to standard error."""
    folder, half = Path(os.environ.get("REAL_FILMS", "real-films")), os.environ.get("FIRST_FRAMES")
    told: list[str] = []
    for name, film in chosen(pointed_at(), folder):
        if film.mark is not None or name.startswith(MOVES):
            continue
        numbers = [number for number, place in film.tips.items() if place is not None]
        numbers = numbers if half is None else numbers[int(half) :: 2]
        reasons = [found(film.begun_at(number), folder) for number in numbers]
        refused = [f"{number} {reason}" for number, reason in zip(numbers, reasons, strict=True) if reason]
        sys.stderr.write(f"{name}: {len(numbers) - len(refused)} of {len(numbers)} found; {'; '.join(refused)}\n")
        told += reasons
    frames = f"first frames of real films, clamp and tip pointed at ({len(told)})"
    return [{"name": f"{frames}: found", "value": sum(not reason for reason in told), "unit": "frames"}]
