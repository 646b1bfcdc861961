"""The server's end of a worker: one job at a time, what happens is told to whoever listens, and any job can be stopped."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

#: Events with which a job is over.
ENDS = ("finished", "failed", "stopped")
PATIENCE_S = 2.0  # between a polite end and a kill; files are whole in either case

Tell = Callable[[dict[str, Any]], None]


class WorkerProcess:
    """A process that does jobs; it is started with the first, and anew after one was stopped."""

    def __init__(self, tell: Tell, *, prepared: bool = True) -> None:
        self.tell = tell
        # whether the libraries of all stages are loaded at its start
        self._arguments = ["prepared"] if prepared else []
        self.job: dict[str, Any] | None = None
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()

    def warm(self) -> None:
        """Start the process, so that the first job need not wait for it."""
        with self._lock:
            self._ready()

    def submit(self, job: dict[str, Any]) -> bool:
        """Begin a job; False if another is not finished."""
        with self._lock:
            if self.job is not None:
                return False
            process = self._ready()
            self.job = job
            self.tell({"event": "begun", **_told(job)})
            assert process.stdin is not None
            process.stdin.write(json.dumps(job) + "\n")
            process.stdin.flush()
            return True

    def told(self) -> dict[str, Any] | None:
        """What is told of the job that is under way."""
        job = self.job
        return None if job is None else _told(job)

    def stop(self) -> None:
        """End the process and with it its job; what was finished is kept, for files are written whole or not at all."""
        with self._lock:  # the next job begins when this process has ended
            process, job = self._process, self.job
            self._process = self.job = None
            if process is not None:
                process.terminate()
                try:
                    process.wait(timeout=PATIENCE_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        if job is not None:
            self.tell({**_told(job), "event": "stopped"})

    def _ready(self) -> subprocess.Popen[str]:
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "rfea_vision.workbench.worker", *self._arguments],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8",
            )  # fmt: skip
            threading.Thread(target=self._listen, args=(self._process,), daemon=True).start()
        return self._process

    def _listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        try:
            for line in process.stdout:
                self._hear(process, json.loads(line))
        except ValueError:
            pass  # the process was killed within a line
        finally:
            process.kill()  # has ended, or says nothing that is understood
            process.wait()
            self._hear(process, {"event": "stopped"})

    def _hear(self, process: subprocess.Popen[str], event: dict[str, Any]) -> None:
        """Tell what a process says of its job; one that was stopped has none."""
        with self._lock:
            job = self.job
            if process is not self._process or job is None:
                return
            if event["event"] in ENDS:
                self.job = None
        self.tell({**_told(job), **event})


def _told(job: dict[str, Any]) -> dict[str, Any]:
    return {key: job[key] for key in ("index", "do", "command", "label") if key in job}
