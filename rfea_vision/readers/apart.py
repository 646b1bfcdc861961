"""Files are read in a process of their own, so that a faulty or malicious one cannot harm this process through a parser in C.

The process may use so much memory and no more, and an answer must come within a time. What it sends back is JSON and bare
arrays, never pickles: an overrun parser could make those run code here.
"""

from __future__ import annotations

import json
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from rfea_vision.errors import DataError, InputError

MOST_BYTES = 1_750_000_000  # so that all of it stays below 2 GB
#: Processor time of one answer: libraries load in a few seconds, and a wall clock counts what other programs take.
MOST_CPU_S = 15
ANSWER_S = 120.0  # of a wall clock, for a reader that waits
#: More of both for each MB of the file: the slowest reader, of LabVIEW's text, takes 0.09 s where this was written.
MORE_S_PER_MB = 1.0
_START = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[1]); from rfea_vision.readers.serving import serve; "
    "serve(int(sys.argv[2]))"
)
_KINDS = "biufM"  # of arrays that cross as they are; text crosses as JSON
_LENGTH = struct.Struct("<Q")

_on = _serving = False


@contextmanager
def isolating(on: bool = True) -> Iterator[None]:
    """Read tables, films, pictures and results in a process of their own (or not) as long as this lasts."""
    global _on
    before, _on = _on, on
    try:
        yield
    finally:
        _on = before


def isolated() -> bool:
    """Whether files are read in a process of their own."""
    return _on


def serving() -> bool:
    """Whether this process is the one that reads for another."""
    return _serving


def begin_serving() -> None:
    """Mark this process as the one that reads for another."""
    global _serving
    _serving = True


# -- what crosses --------------------------------------------------------------------------------------------------


def send(stream: IO[bytes], value: Any) -> None:
    """Write a value made of mappings, lists, plain values and arrays."""
    arrays: list[np.ndarray] = []
    head = json.dumps(_plain(value, arrays)).encode()
    stream.write(_LENGTH.pack(len(head)) + head)
    for array in arrays:
        stream.write(array.tobytes())
    stream.flush()


def _plain(value: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in _KINDS:
        arrays.append(value.view("i8") if value.dtype.kind == "M" else value)
        return {"array": [value.dtype.str, list(value.shape)]}
    if isinstance(value, np.ndarray):
        texts = [item.decode(errors="replace") if isinstance(item, bytes) else _text(item) for item in value.ravel()]
        return {"texts": texts, "shape": list(value.shape)}
    if isinstance(value, dict):
        return {"map": [[key, _plain(item, arrays)] for key, item in value.items()]}
    if isinstance(value, list | tuple):
        return {"list": [_plain(item, arrays) for item in value]}
    return value.item() if isinstance(value, np.generic) else value


def _text(item: Any) -> Any:
    return item if item is None or isinstance(item, str | int | float | bool) else str(item)


def receive(read: Callable[[int], bytes]) -> Any:
    """Read what `send` wrote; `read` returns exactly so many bytes.

    Raises
    ------
    EOFError
        If more is announced than is read at most.
    """
    (length,) = _LENGTH.unpack(read(_LENGTH.size))
    if length > MOST_BYTES:
        raise EOFError
    return _built(json.loads(read(length)), read)


def _built(value: Any, read: Callable[[int], bytes]) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        kind, shape = value["array"]
        size = int(np.prod(shape, dtype=object)) * np.dtype(kind).itemsize
        if np.dtype(kind).kind not in _KINDS or not 0 <= size <= MOST_BYTES:
            raise EOFError
        return np.frombuffer(bytearray(read(size)), dtype=kind).reshape(shape)
    if "texts" in value:
        return np.array([*value["texts"], None], dtype=object)[:-1].reshape(value["shape"])
    if "map" in value:
        return {key: _built(item, read) for key, item in value["map"]}
    return [_built(item, read) for item in value["list"]]


# -- the process ---------------------------------------------------------------------------------------------------


def _size_MB(path: Path) -> float:
    with suppress(OSError, ValueError):
        return path.stat().st_size / 1e6
    return 0.0


class _Process:
    """The process that reads; started when it is needed, and again when a file has ended it."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None
        self.lock = threading.Lock()
        self.owner = 0

    def ask(self, what: str, path: Path, **given: Any) -> Any:
        """Send one question and wait for its answer; InputError or DataError as its reader says, or if it takes too long or ends."""
        more_s = 0.0 if what == "film next" else MORE_S_PER_MB * _size_MB(path)  # one picture is no whole file
        late = "on this machine; export a part of it, or, if it is not large, all of it again: it may be damaged"
        with self.lock:
            process = self._running()
            questions, answers = process.stdin, process.stdout
            assert questions is not None and answers is not None
            try:
                send(questions, {"what": what, "path": str(path), "most_cpu_s": int(MOST_CPU_S + more_s), **given})
                ends = time.monotonic() + ANSWER_S + more_s
                answer = receive(lambda count: self._read(answers, count, ends))
            except TimeoutError as error:
                self._end()
                raise InputError(f"{path}: cannot be read within {ANSWER_S + more_s:.3g} s {late}") from error
            except (OSError, EOFError, ValueError, KeyError, TypeError, struct.error) as error:
                self._end()
                if process.returncode == -getattr(signal, "SIGXCPU", 0):
                    text = f"cannot be read within {int(MOST_CPU_S + more_s)} s of processor time {late}"
                else:
                    text = (
                        f"ended the process that read it, or needed more than {MOST_BYTES / 1e9:g} GB; export it again"
                    )
                raise InputError(f"{path}: {text}") from error
            except BaseException:
                self._end()
                raise
        if "fault" in answer:
            raise (DataError if answer["kind"] == "DataError" else InputError)(answer["fault"])
        return answer["value"]

    def _running(self) -> subprocess.Popen[bytes]:
        if self.process is not None and (self.process.poll() is not None or self.owner != os.getpid()):
            self._end()
        if self.process is None:
            paths = json.dumps([str(Path(entry).resolve()) for entry in sys.path if entry])
            quiet = {
                "OMP_NUM_THREADS": "1",
                "OPENBLAS_NUM_THREADS": "1",
                "ARROW_DEFAULT_MEMORY_POOL": "system",
                "HDF5_PLUGIN_PATH": "",
            }
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, paths, str(MOST_BYTES)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=os.environ | quiet,
            )  # fmt: skip
            self.owner = os.getpid()
        return self.process

    def _read(self, stream: IO[bytes], count: int, ends: float) -> bytes:
        found = bytearray()
        while len(found) < count:
            ready, _, _ = select.select([stream], [], [], max(0.0, ends - time.monotonic()))
            if not ready:
                raise TimeoutError
            block = os.read(stream.fileno(), min(1 << 20, count - len(found)))
            if not block:
                raise EOFError
            found += block
        return bytes(found)

    def _end(self) -> None:
        process, self.process = self.process, None
        if process is not None and self.owner == os.getpid():
            with suppress(OSError):
                process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                with suppress(OSError):
                    stream.close()  # type: ignore[union-attr]


_reading = _Process()


def ask(what: str, path: Path, **given: Any) -> Any:
    """Have a file read in the other process.

    Raises
    ------
    InputError, DataError
        What the reader says of it, or that the reader did not survive it.
    """
    return _reading.ask(what, path, **given)
