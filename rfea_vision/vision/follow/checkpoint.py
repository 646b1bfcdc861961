"""What was tracked of a long video so far, on disk: an interrupted run goes on from there and ends with the same result."""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from zipfile import BadZipFile

import numpy as np

from rfea_vision.files import whole_file

if TYPE_CHECKING:
    from rfea_vision.vision.derive.rows import Rows

EVERY_S = 20.0


class Remembers(Protocol):
    """What carries the tube from frame to frame."""

    def memory(self) -> dict[str, Any]:
        """Everything that the next frame depends on: arrays, and plain values under ``plain``."""
        ...

    def recall(self, memory: dict[str, Any]) -> None:
        """Go on from what `memory` returned."""
        ...


class Checkpoint:
    """Saves every `EVERY_S` seconds, and loads what an interrupted run with the same inputs and code left.

    Parameters
    ----------
    path : the file; None keeps nothing
    about : what the result depends on; a file that was written for anything else is not used
    """

    def __init__(self, path: Path | None, *about: object) -> None:
        self.path = path
        self.key = _digest(about) if path is not None else ""
        self._saved = time.monotonic()

    def load(self, rows: Rows, follower: Remembers) -> int:
        """Put `rows` and `follower` where the interrupted run was; returns the number of frames that are done."""
        if self.path is None or not self.path.is_file():
            return 0
        try:
            with np.load(self.path, allow_pickle=False) as file:
                plain = json.loads(str(file["plain"]))
                if plain["key"] != self.key:
                    return 0
                arrays = {name: file[name] for name in file.files if name != "plain"}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):  # cut off or foreign: start afresh
            return 0
        rows.restore(
            {name[5:]: values for name, values in arrays.items() if name.startswith("rows.")}, plain["reasons"]
        )
        follower.recall(
            {name[5:]: v for name, v in arrays.items() if name.startswith("tube.")} | {"plain": plain["tube"]}
        )
        return len(rows)

    def keep(self, rows: Rows, follower: Remembers, *, now: bool = False) -> None:
        """Save, if it is time to."""
        if self.path is None or (not now and time.monotonic() - self._saved < EVERY_S):
            return
        memory = follower.memory()
        plain = {"key": self.key, "reasons": rows.reasons, "tube": memory.pop("plain")}
        arrays: dict[str, Any] = {f"rows.{name}": values for name, values in rows.saved().items()}
        arrays |= {f"tube.{name}": np.asarray(values) for name, values in memory.items()}
        with whole_file(self.path) as temporary, temporary.open("wb") as stream:
            np.savez(stream, allow_pickle=False, plain=np.array(json.dumps(plain)), **arrays)
        self._saved = time.monotonic()

    def remove(self) -> None:
        """Forget it: the track is complete."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def _digest(about: tuple[object, ...]) -> str:
    digest = hashlib.sha256()
    for code in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(code.read_bytes())
    for part in about:
        if isinstance(part, np.ndarray):
            digest.update(np.ascontiguousarray(part).tobytes())
        elif isinstance(part, Path) and part.exists():
            stat = part.stat()
            digest.update(f"{part.resolve()} {stat.st_size} {stat.st_mtime_ns}".encode())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()
