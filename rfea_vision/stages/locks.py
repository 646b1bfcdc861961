"""One command at a time on one folder of results: the next one waits, and says for whom.

The lock is the operating system's (``flock``), so that it ends with whoever holds it, however that ends. Network folders
keep it between hosts; where one does not, the time of change of the lock's file tells: its holder touches it every few
seconds, and a lock of another host is taken over when it has stopped to change, by the clock of the one who waits.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from rfea_vision.errors import DataError

try:
    import fcntl
except ImportError:  # Windows: the touched file tells of other hosts; on one host nothing waits
    fcntl = None

BEAT_S, SILENT_S = 2.0, 15.0  # several beats, and the few seconds that network folders keep a file's time for
_POLL_S = 0.1  # between looks at a lock that somebody holds
_UNWRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM)

_held: dict[Path, int] = {}  # in this process: how many blocks hold each lock
_guard = threading.Lock()


@contextmanager
def locked(
    path: Path, *, shared: bool = False, patience_s: float | None = None, say: Callable[[str], None] | None = None
) -> Iterator[None]:
    """Hold the lock of the file `path` while the block runs; blocks of one thread may be nested.

    In a folder that cannot be written to nothing is locked, as nothing can be changed there.

    Parameters
    ----------
    path : the lock's file; it stays, empty, when the lock is released
    shared : held together with others that share it
    patience_s : how long to wait; None waits as long as it takes
    say : told whom it waits for

    Raises
    ------
    DataError
        If it is still held after `patience_s`; the sentence says by whom.
    """
    key = path.parent.resolve() / f"{path.name}/{threading.get_ident()}"
    with _guard:
        nested = key in _held
        _held[key] = _held.get(key, 0) + 1
    handle = None
    try:
        handle = None if nested else _open(path)
        if handle is not None:
            _wait(path, handle, shared, patience_s, say)
        with contextlib.nullcontext() if handle is None else _beating(handle, shared):
            yield
    finally:
        with _guard:
            _held[key] -= 1
            if not _held[key]:
                del _held[key]
        if handle is not None:
            os.close(handle)


def holder(path: Path) -> str:
    """Who holds a lock, as far as its file says."""
    about = _about(path)
    if not about:
        return "another command"
    return f"'{about['command']}' (process {about['pid']} on {about['host']}, since {about['since']})"


def _open(path: Path) -> int | None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        if error.errno in _UNWRITABLE:
            return None
        raise


def _wait(path: Path, handle: int, shared: bool, patience_s: float | None, say: Callable[[str], None] | None) -> None:
    begun, said, seen, seen_at = time.monotonic(), "", _beat(handle), time.monotonic()
    while True:
        now = time.monotonic()
        if _beat(handle) != seen:
            seen, seen_at = _beat(handle), now
        if _take(handle, shared):
            about = _about(path)
            foreign = bool(about) and about.get("host") != socket.gethostname() and not (shared and about.get("shared"))
            if not foreign or now - max(seen_at, begun) > SILENT_S:
                return
            _release(handle)
        who = holder(path)
        if patience_s is not None and now - begun > patience_s:
            raise DataError(f"{path.parent.parent}: is held by {who}; run this again when that has ended")
        if say is not None and who != said and now - begun > 0.5:
            said = who
            say(f"waits for {who}")
        time.sleep(_POLL_S)


def _take(handle: int, shared: bool) -> bool:
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        # a folder that knows no locks (ENOLCK, ENOTSUP) leaves the beat
        return error.errno not in (errno.EWOULDBLOCK, errno.EACCES, errno.EINTR)
    return True


def _release(handle: int) -> None:
    if fcntl is not None:
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_UN)


@contextmanager
def _beating(handle: int, shared: bool) -> Iterator[None]:
    """Write who holds the lock, and touch its file until the block ends."""
    about = {
        "host": socket.gethostname(), "pid": os.getpid(), "command": " ".join(["rfea", *sys.argv[1:]])[:200], "shared": shared,
        "since": datetime.now().astimezone().isoformat(timespec="seconds"),
    }  # fmt: skip
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(BEAT_S):
            with contextlib.suppress(OSError):
                os.utime(handle)

    with contextlib.suppress(OSError):  # a full disk: the lock holds all the same
        os.ftruncate(handle, 0)
        os.pwrite(handle, json.dumps(about).encode(), 0)
    thread = threading.Thread(target=beat, name="lock", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        with contextlib.suppress(OSError):
            if not shared:
                os.ftruncate(handle, 0)
        _release(handle)


def _beat(handle: int) -> int:
    return os.fstat(handle).st_mtime_ns


def _about(path: Path) -> dict[str, object]:
    try:
        about = json.loads(path.read_text(encoding="utf-8") or "{}")
    except (OSError, ValueError):
        return {}
    return about if isinstance(about, dict) and {"host", "pid", "command", "since"} <= set(about) else {}
