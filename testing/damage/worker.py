"""The process that reads: it is told which inputs to make of which file, and says of each what became of it.

``python -m testing.damage.worker`` takes jobs ``{"target", "apart", "inputs": [...]}`` on its standard input, one a line. Every
input is named by how it is made: ``as it is``, ``bomb NAME``, ``bytes NUMBER`` or ``values NUMBER``, so that each can be
made again by itself.
"""

from __future__ import annotations

import json
import os
import random
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from testing.damage.bombs import bombs
from testing.damage.changes import mutated, spoilt
from testing.damage.files import Target, targets


def content_of(target: Target, what: str, folder: Path, made_up: dict[str, bytes]) -> bytes:
    """Make one input."""
    kind, _, which = what.partition(" ")
    if kind == "bomb":
        return made_up[which]
    chance = random.Random(f"{target.name} {what}")
    if kind == "bytes":
        return mutated(target.content, chance)
    if kind == "values" and target.write is not None and target.table is not None:
        path = folder / f"spoilt{target.ending}"
        for _ in range(20):  # some tables cannot be written as some kinds of file
            with suppress(Exception):
                target.write(spoilt(target.table, chance), path)
                return path.read_bytes()
    return target.content


def given(target: Target, content: bytes, folder: Path) -> tuple[str, str]:
    """Give a reader its input; returns ``accepted``, ``refused`` or ``fault``, and for the last one what was wrong."""
    from rfea_vision.errors import RfeaError

    path = folder / f"x{target.ending}"
    path.write_bytes(content)
    try:
        target.read(path)
    except RfeaError as error:
        text = str(error)
        return ("fault", f"more than a sentence: {text[:200]!r}") if "\n" in text or not text else ("refused", "")
    except Exception as error:
        return "fault", f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return "accepted", ""


def peak_bytes() -> int:
    """The most memory that this process and the one that reads apart have used since they began."""
    from rfea_vision.readers import apart

    found = 0
    processes = [os.getpid(), *([apart._reading.process.pid] if apart._reading.process is not None else [])]
    for process in processes:
        with suppress(OSError):
            status = Path(f"/proc/{process}/status").read_text()
            found = max(
                found, *(1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:"))
            )
    return found


def used_s() -> float:
    """Processor time of this process and of those that read apart: a wall clock would count what other programs take."""
    from rfea_vision.readers import apart

    found = sum(os.times()[:4])
    if apart._reading.process is not None:
        with suppress(OSError):
            fields = Path(f"/proc/{apart._reading.process.pid}/stat").read_text().rpartition(")")[2].split()
            found += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return found


def _said(stderr: int) -> str:
    """What was printed on the standard error since the last look, if a traceback is in it; the file is emptied."""
    with suppress(OSError):
        size = os.fstat(stderr).st_size
        if size:
            text = os.pread(stderr, min(size, 1_000_000), 0).decode(errors="replace")
            os.ftruncate(stderr, 0)
            if "Traceback" in text:
                return " ".join(text.split())[-300:]
    return ""


def _jobs() -> Iterator[dict[str, Any]]:
    for line in sys.stdin:
        yield json.loads(line)


def main() -> None:
    """Read what one is told to, until nobody asks any more."""
    from rfea_vision.readers import apart

    answers = os.fdopen(os.dup(1), "w", buffering=1)
    warnings.filterwarnings("error", category=RuntimeWarning, module="rfea_vision")  # an overflow is a wrong number
    with tempfile.TemporaryDirectory(prefix="damage-") as name:
        folder = Path(name)
        printed_to = os.open(folder / "printed", os.O_RDWR | os.O_CREAT | os.O_APPEND)
        for stream in (1, 2):  # what libraries print is looked at, and is no answer
            os.dup2(printed_to, stream)
        every = {target.name: target for target in targets(folder)}
        made_up = dict(bombs())
        for job in _jobs():
            target = every[job["target"]]
            with apart.isolating(job["apart"]):
                for what in job["inputs"]:
                    content = content_of(target, what, folder, made_up)
                    answers.write(json.dumps(["begins", what]) + "\n")
                    begun = used_s()
                    became, fault = given(target, content, folder)
                    took = used_s() - begun
                    if printed := _said(2):
                        became, fault = "fault", f"a traceback on the standard error: {printed}"
                    answers.write(json.dumps(["ended", what, became, fault, round(took, 3), peak_bytes()]) + "\n")


if __name__ == "__main__":
    main()
