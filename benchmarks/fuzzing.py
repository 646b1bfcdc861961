"""Fuzzing: files that were cut, flipped, swapped, blown up or made up, given to every reader and to the artefacts fed back.

A reader may return, or raise one sentence meant for people. Anything else is a fault: another exception, a traceback on the
standard error, a process that ends, more than 20 s, more than 2 GB, or numbers that are not finite or out of order.

``python -m benchmarks.fuzzing`` reads in a process that is watched, so that a hang or a crash is a fault like others and
the next input follows. Each shard (all readers, `SHARD` inputs each, here or apart) is a line of `ROWS` with the code that
it ran on; a run that was stopped goes on where it stood, and rows of other code do not count.
"""

from __future__ import annotations

import json
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.damage.bombs import NAMES
from benchmarks.damage.files import targets
from benchmarks.damage.rows import ROWS, add_row, rows_of_this_code

ENOUGH = 22_000
SHARD = 50
MOST_S, MOST_BYTES = 20.0, 2_000_000_000


@dataclass
class Shard:
    """What became of the inputs of one reader."""

    target: str
    apart: bool
    number: int
    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    longest_s: float = 0.0
    most_MB: float = 0.0
    faults: list[str] = field(default_factory=list)

    def count(self, what: str, became: str, fault: str = "", took_s: float = 0.0, used_bytes: float = 0.0) -> None:
        """Count one input."""
        self.inputs += 1
        self.accepted += became == "accepted"
        self.refused += became == "refused"
        self.longest_s, self.most_MB = max(self.longest_s, took_s), max(self.most_MB, round(used_bytes / 1e6))
        if took_s > MOST_S:
            fault = f"took more than {MOST_S:g} s"
        elif used_bytes > MOST_BYTES:
            fault = f"needed {used_bytes / 1e9:.2f} GB"
        if fault:
            self.faults.append(f"{self.target}, {what}{', apart' * self.apart}: {fault}")


def inputs_of(number: int, size: int = SHARD) -> list[str]:
    """Names of the inputs of a shard; the first one also has what was made up, and the file as it is."""
    made = [f"{('bytes', 'bytes', 'values')[index % 3]} {index}" for index in range(number * size, (number + 1) * size)]
    return made if number else ["as it is", *(f"bomb {name}" for name in NAMES), *made]


class Watched:
    """The process that reads, started when it is needed and again when an input has ended it."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None
        self.rest = b""

    def read(self, shard: Shard, inputs: list[str]) -> None:
        """Have inputs read and count what becomes of them."""
        left = list(inputs)
        while left:
            process = self._running()
            assert process.stdin is not None
            job = {"target": shard.target, "apart": shard.apart, "inputs": left}
            process.stdin.write(json.dumps(job).encode() + b"\n")
            process.stdin.flush()
            left = self._heard(shard, left)

    def _heard(self, shard: Shard, left: list[str]) -> list[str]:
        """Count what is said until all is read, or the process has ended; returns what is left to read."""
        begun = ""
        while left:
            line = self._line(120.0 if not begun else MOST_S + 5.0)
            if line is None:
                what = begun or left[0]
                shard.count(what, "fault", "ended the process that read it, or did not return")
                self.end()
                return left[left.index(what) + 1 :]
            said = json.loads(line)
            if said[0] == "begins":
                begun = said[1]
                continue
            shard.count(*said[1:])
            left = left[left.index(said[1]) + 1 :]
            begun = ""
            if said[5] > MOST_BYTES:  # the peak stays: the next input gets a new process
                self.end()
                return left
        return left

    def _running(self) -> subprocess.Popen[bytes]:
        if self.process is not None and self.process.poll() is not None:
            self.end()
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.damage.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            self.rest = b""
        return self.process

    def _line(self, patience_s: float) -> bytes | None:
        assert self.process is not None and self.process.stdout is not None
        ends = time.monotonic() + patience_s
        while b"\n" not in self.rest:
            ready, _, _ = select.select([self.process.stdout], [], [], max(0.0, ends - time.monotonic()))
            block = self.process.stdout.read1(65536) if ready else b""
            if not block:
                return None
            self.rest += block
        line, _, self.rest = self.rest.partition(b"\n")
        return line

    def end(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            for stream in (self.process.stdin, self.process.stdout):
                if stream is not None:
                    stream.close()
        self.process = None


def fuzz(inputs: int, file: Path = ROWS) -> None:
    """Read so many inputs in all, those of earlier runs of the same code counted, each shard a row of `file`."""
    with tempfile.TemporaryDirectory(prefix="fuzzing-") as name:
        names = [target.name for target in targets(Path(name))]
    watched = Watched()
    done = {(row["target"], row["apart"], row["number"]) for row in rows_of_this_code("fuzzing", file)}
    count = sum(row["inputs"] for row in rows_of_this_code("fuzzing", file))
    number = 0
    try:
        while count < inputs:
            for target in names:
                for apart in (False, True):
                    if (target, apart, number) in done:
                        continue
                    shard = Shard(target, apart, number)
                    watched.read(shard, inputs_of(2 * number + apart))
                    count += shard.inputs
                    add_row("fuzzing", asdict(shard), file)
                    for fault in shard.faults:
                        sys.stderr.write(f"  {fault}\n")
            number += 1
            sys.stderr.write(f"  {count} inputs\n")
    finally:
        watched.end()


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    fuzz(ENOUGH)
    rows = rows_of_this_code("fuzzing")
    faults = [text for row in rows for text in row["faults"]]
    total = sum(row["inputs"] for row in rows)
    longest, most = max(row["longest_s"] for row in rows), max(row["most_MB"] for row in rows)
    return [
        {"name": "damaged and made up inputs", "value": total, "unit": "inputs", "target": ">= 20000", "met": total >= 20_000},
        {"name": "inputs that were no single sentence, or a wrong number accepted", "value": len(faults), "unit": "inputs",
         "target": "0", "met": not faults},
        {"name": "longest reading", "value": longest, "unit": "s", "target": "< 20", "met": longest < MOST_S},
        {"name": "most memory", "value": round(most / 1e3, 2), "unit": "GB", "target": "< 2", "met": 1e6 * most < MOST_BYTES},
    ]  # fmt: skip


def by_target(rows: list[dict[str, Any]]) -> dict[str, Counter[str]]:
    """Inputs, and what became of them, by reader."""
    found: dict[str, Counter[str]] = {}
    for row in rows:
        counts = {key: row[key] for key in ("inputs", "accepted", "refused")}
        found.setdefault(row["target"], Counter()).update({**counts, "faults": len(row["faults"])})
    return found


if __name__ == "__main__":
    fuzz(int(sys.argv[1]) if len(sys.argv) > 1 else ENOUGH, Path(sys.argv[2]) if len(sys.argv) > 2 else ROWS)
