"""A process that reads what is damaged, and is watched: a hang or a crash is a fault like others, and the next input follows."""

from __future__ import annotations

import json
import select
import subprocess
import sys
import time
from dataclasses import dataclass, field

from testing.damage.bombs import NAMES

SHARD = 50
MOST_S, MOST_BYTES = 20.0, 2_000_000_000  # of processor time, and of memory
PATIENCE_S = 150.0  # of a wall clock, of which a reader on a busy machine gets a part


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
            line = self._line(PATIENCE_S)
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
                [sys.executable, "-m", "testing.damage.worker"],
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
