"""The process that does the work of commands: ``python -m rfea_vision.workbench.worker`` reads jobs, one JSON line each, and
writes what happens. Being a process of its own it can be stopped at any moment, and leaves the page's sliders a core.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

from rfea_vision.errors import RfeaError
from rfea_vision.progress import Listener, Outcome, Progress

SAID_EVERY_S = 0.1  # a bar need not move more often

Say = Callable[[dict[str, Any]], None]


class EventListener(Listener):
    """Tells the server of every stage."""

    def __init__(self, say: Say) -> None:
        self.say = say
        self._last = 0.0

    def begin(self, stage: str, subject: str) -> Progress:
        """Say that a stage starts; its progress is said now and then."""
        self.say({"event": "stage", "stage": stage, "subject": subject})

        def advance(done: int, total: int) -> None:
            if time.monotonic() - self._last > SAID_EVERY_S or done == total:
                self._last = time.monotonic()
                self.say({"event": "progress", "stage": stage, "subject": subject, "done": done, "total": total})

        return advance

    def end(self, stage: str, subject: str, outcome: Outcome, sentence: str) -> None:
        """Say how a stage ended."""
        self.say({"event": "ended", "stage": stage, "subject": subject, "outcome": outcome, "sentence": sentence})

    def note(self, sentence: str) -> None:
        """Say something in between, such as a new rung."""
        self.say({"event": "note", "sentence": sentence})


def run_job(job: dict[str, Any], say: Say) -> Any:
    """Do one job: a stage of a campaign by the name of its command, ``batch``, ``try`` or ``check law``."""
    if job["do"] == "check law":
        from rfea_vision.workbench.laws import check

        for name in ("rfea_vision.effects.typeset", "rfea_vision.report.formatting"):
            import_module(name)
        say({"event": "ready"})  # from here on the time is the law's own
        return check(Path(job["file"]))
    if job["do"] == "try":
        from rfea_vision.workbench.trying import try_hints

        return try_hints(Path(job["campaign"]), job.get("out"), say, **job["options"])
    if job["do"] == "batch":
        from rfea_vision.workbench.batches import run_all

        return run_all([Path(folder) for folder in job["campaigns"]], say)
    from rfea_vision.effects.permission import name_files
    from rfea_vision.stages import open_campaign

    name_files(job["options"].get("effect_files", ()))  # the server has seen that the user typed or opened them
    work = open_campaign(job["campaign"], job.get("out"), listener=EventListener(say))
    options = dict(job["options"])
    if job["do"] == "propose":
        options.pop("effect_files", None)  # it fits with those of its model, which are named now
    model = [options.pop("model")] if "model" in options else []  # stands first, as on the command line
    try:
        result = getattr(work, job["do"])(*model, **options)
    finally:
        work.cache.save_hashes()
    if job["do"] == "fit":
        return {"model": result.name}
    return {"file": str(result.file), "sentence": result.sentence} if job["do"] == "propose" else None


def jobs(source: TextIO) -> Iterator[dict[str, Any]]:
    """Jobs as they come, until the server closes the line."""
    for line in source:
        yield json.loads(line)


def main() -> None:
    """Do jobs until the standard input ends."""
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # what is open is closed on the way out
    lines = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print must not come between the lines

    def say(event: dict[str, Any]) -> None:
        lines.write(json.dumps(event, default=str) + "\n")
        lines.flush()

    if "prepared" in sys.argv:
        for name in ("rfea_vision.fitting", "rfea_vision.vision", "rfea_vision.critique"):
            import_module(name)
    for job in jobs(sys.stdin):
        try:
            say({"event": "finished", "result": run_job(job, say)})
        except RfeaError as error:
            say({"event": "failed", "error": str(error)})
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
            say({"event": "failed", "error": f"a fault in rfea-vision ({reason}); the command shown does the same"})


if __name__ == "__main__":
    main()
