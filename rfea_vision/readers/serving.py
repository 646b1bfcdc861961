"""The other end of `apart`: a process that reads what it is asked for, with bounded memory, and can lose nothing."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from rfea_vision.errors import RfeaError
from rfea_vision.readers.apart import begin_serving, receive, send

_MOST_WRITTEN_BYTES = 1 << 30  # a reader that writes more unpacks a bomb


def serve(most_bytes: int) -> None:
    """Answer until nobody asks any more; an answer that takes more processor time than was asked for ends the process."""
    begin_serving()
    _limit(most_bytes)
    # what a library prints must not get into the answers
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    questions = sys.stdin.buffer

    def read(size: int) -> bytes:
        found = questions.read(size)
        if len(found) < size:
            raise EOFError
        return found

    films = _Films()
    while True:
        try:
            asked = receive(read)
        except EOFError:
            return
        _limit_time(asked.pop("most_cpu_s"))
        try:
            answer = {"value": _answer(films, asked.pop("what"), Path(asked.pop("path")), asked)}
        except RfeaError as error:
            answer = {"fault": str(error), "kind": type(error).__name__}
        except MemoryError:
            answer = {"fault": "needs more memory than a file of a stranger is given; export a part of it", "kind": ""}
        except Exception as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            answer = {"fault": f"cannot be read ({reason}); export it again", "kind": ""}
        send(answers, answer)


def _limit(most_bytes: int) -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    for kind, most in (("RLIMIT_DATA", most_bytes), ("RLIMIT_FSIZE", _MOST_WRITTEN_BYTES), ("RLIMIT_CORE", 0)):
        with suppress(ValueError, OSError, AttributeError):
            resource.setrlimit(getattr(resource, kind), (most, most))


def _limit_time(most_cpu_s: int) -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    used_s = int(time.process_time()) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (used_s + most_cpu_s, resource.getrlimit(resource.RLIMIT_CPU)[1]))


def _answer(films: _Films, what: str, path: Path, given: dict[str, Any]) -> Any:
    if what == "table":
        from rfea_vision.readers.tables import read_table

        table = read_table(path)
        return {**vars(table), "points": {name: vars(points) for name, points in table.points.items()}}
    if what == "dataset":
        from rfea_vision.files import read_dataset

        return read_dataset(path, given["group"]).to_dict(data="array", encoding=False)
    if what == "groups":
        from rfea_vision.files import dataset_groups

        return dataset_groups(path)
    if what == "picture":
        from rfea_vision.readers.pictures import decode

        return decode(path, given["how"])
    return films.answer(what, path, given)


class _Films:
    """The films that are open, and how far each is decoded."""

    def __init__(self) -> None:
        self.sources: dict[str, Any] = {}
        self.running: dict[int, Generator[Any, None, None]] = {}
        self.numbers = count()

    def answer(self, what: str, path: Path, given: dict[str, Any]) -> Any:
        """Answer what is asked of a film."""
        if what == "film next":
            found = next(self.running[given["number"]], None)
            return None if found is None else list(found)
        if what == "film end":
            self.running.pop(given["number"]).close()
            return None
        asked = given.pop("asked", {})
        source = self._source(path, given)
        if what == "film":
            names = "frame_count", "rate_Hz", "quarter_turns", "announced_s"
            return {"size": list(source.size)} | {name: getattr(source, name) for name in names}
        if what == "film times":
            return source.times_s()
        if what == "film damaged":
            return source.damaged_s()
        number = next(self.numbers)
        self.running[number] = source.colours(asked["scale"]) if "scale" in asked else source.frames(asked["start"])
        return number

    def _source(self, path: Path, given: dict[str, Any]) -> Any:
        from rfea_vision.readers.video import open_frames, open_video

        key = f"{path} {given}"
        if key not in self.sources:
            times, within = given.get("times"), given.get("within")
            self.sources = {} if len(self.sources) > 4 else self.sources
            self.sources[key] = (
                replace(open_video(path, given["rate_Hz"]), threads=1)  # type: ignore[call-arg]
                if "times" not in given
                else open_frames(
                    path, times and Path(times), given["rate_Hz"], within=None if within is None else Path(within)
                )
            )
        return self.sources[key]
