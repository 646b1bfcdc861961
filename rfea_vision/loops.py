"""Compiled loops that Numba keeps on disk, forgotten where a source has changed that they were compiled from.

Numba looks at the one file that a function stands in, and not at those that it calls: an update of a checkout could leave loops
of yesterday's formulas, in silence.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

from rfea_vision.files import write_text


def forget_stale_loops(room: Path) -> None:
    """Remove what Numba keeps of a room (a folder of the package) unless all of its sources are as they were.

    To be called before the first function of the room is compiled. Where the folder cannot be written to, Numba keeps its loops
    elsewhere, by the age of each file; there, nothing is removed.
    """
    digest = hashlib.sha256()
    for source in sorted(room.rglob("*.py")):
        digest.update(source.relative_to(room).as_posix().encode() + b"\0" + source.read_bytes())
    known, now = room / "__pycache__" / "sources.sha256", digest.hexdigest()
    with suppress(OSError):
        if known.is_file() and known.read_text(encoding="ascii") == now:
            return
        for kept in room.rglob("__pycache__/*.nbi"):
            kept.unlink(missing_ok=True)
        write_text(known, now)
