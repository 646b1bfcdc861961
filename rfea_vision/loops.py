"""Compiled loops that Numba keeps on disk, forgotten where a source has changed that they were compiled from.

Numba looks at the one file that a function stands in, and not at those that it calls: an update of a checkout could leave loops
of yesterday's formulas, in silence.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rfea_vision.files import write_text

try:
    import fcntl
except ImportError:  # Windows: there, two processes may make the same loops at once
    fcntl = None


def digest_of_sources(folder: Path) -> str:
    """Return a hash of all Python files below a folder, with their names."""
    digest = hashlib.sha256()
    for source in sorted(folder.rglob("*.py")):
        digest.update(source.relative_to(folder).as_posix().encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()


def forget_stale_loops(room: Path) -> None:
    """Remove what Numba keeps of a room (a folder of the package) unless all of its sources are as they were.

    To be called before the first function of the room is compiled. Where the folder cannot be written to, Numba keeps its loops
    elsewhere, by the age of each file; there, nothing is removed.
    """
    known, now = room / "__pycache__" / "sources.sha256", digest_of_sources(room)
    with suppress(OSError):
        if known.is_file() and known.read_text(encoding="ascii") == now:
            return
        for kept in room.rglob("__pycache__/*.nbi"):
            kept.unlink(missing_ok=True)
        write_text(known, now)


@contextmanager
def one_at_a_time(path: Path) -> Iterator[None]:
    """Let one process after the other make what the rest will find in the cache, where the system knows locks.

    path : a file, made where it is not there yet; whoever is given the same one waits
    """
    handle = None
    with suppress(OSError):  # a folder that cannot be written to, or that knows no locks
        handle = path.open("ab")
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if handle is not None:
            handle.close()
