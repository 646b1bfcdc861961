"""What lies on the desk: one campaign or a folder of them, the worker, and everyone who listens."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.errors import InputError
from rfea_vision.workbench.hands import Worker
from rfea_vision.workbench.orders import order

DEEPEST = 3  # folders below the one that was opened in which campaigns are looked for
LOG_LINES = 200


class Desk:
    """Campaigns by number, and the work that is under way on them.

    Attributes
    ----------
    campaigns : their folders; one, or all that a folder holds
    single : whether a campaign itself was opened
    log : commands given so far, oldest first
    ending : whether the server is about to stop
    """

    def __init__(self, folder: Path, out: Path | None = None) -> None:
        self.folder = folder.expanduser().resolve()
        self.out = out
        self.single = is_campaign(self.folder)
        self.campaigns = [self.folder] if self.single else campaigns_below(self.folder)
        if not self.campaigns:
            raise InputError(f"{folder}: holds no campaign; 'rfea init DIR' makes one")
        self.log: list[dict[str, Any]] = []
        self.ending: Callable[[], bool] = lambda: False
        self.own_files: set[Path] = set()  # effect files that this user has typed or opened
        self.worker = Worker(self.tell)
        self.judge = Worker(lambda event: None)  # checks laws, so that one that never ends can be stopped
        self._benches: dict[int, Any] = {}
        self._listeners: set[tuple[asyncio.AbstractEventLoop, asyncio.Queue[dict[str, Any]]]] = set()
        self._lock = threading.Lock()

    def bench(self, index: int) -> Any:
        """The bench of one campaign, made when it is first looked at."""
        from rfea_vision.workbench.bench import Bench

        with self._lock:
            if index not in self._benches:
                self._benches[index] = Bench(self.campaigns[index], self.out)
            return self._benches[index]

    def begin(self, index: int, do: str, options: dict[str, Any], label: str) -> bool:
        """Hand a job to the worker; False if it is busy."""
        campaign = self.campaigns[index]
        files = {str(file) for file in self.own_files}
        if not set(map(str, options.get("effect_files", []))) <= files:
            raise InputError("effect_files: only a law that was opened or written in this workbench is run")
        kept, command = order(shown(campaign), self.out, do, options)
        out = None if self.out is None else str(self.out)
        job = {
            "index": index,
            "do": do,
            "options": kept,
            "campaign": str(campaign),
            "out": out,
            "command": command,
            "label": label or do,
        }
        return self.worker.submit(job)

    def tell(self, event: dict[str, Any]) -> None:
        """Tell everyone who listens; may be called from any thread."""
        if event.get("command") and event["event"] in ("begun", "said"):
            self.log.append({"command": event["command"], "label": event.get("label", "")})
            del self.log[:-LOG_LINES]
        for loop, queue in list(self._listeners):
            with suppress(RuntimeError):  # a loop that has been closed
                loop.call_soon_threadsafe(queue.put_nowait, event)

    def listen(self) -> asyncio.Queue[dict[str, Any]]:
        """A queue of what is told from now on."""
        queue: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._listeners.add((asyncio.get_running_loop(), queue))
        return queue

    def leave(self, queue: asyncio.Queue[dict[str, Any]]) -> None:
        """Stop listening."""
        self._listeners = {pair for pair in self._listeners if pair[1] is not queue}

    def close(self) -> None:
        """End the processes."""
        self.worker.stop()
        self.judge.stop()


def is_campaign(folder: Path) -> bool:
    """Whether a folder is a campaign, or a lone experiment."""
    return (folder / "campaign.yaml").is_file() or (folder / "experiment.yaml").is_file()


def campaigns_below(folder: Path) -> list[Path]:
    """Campaigns in a folder and in those below it, by name; results are not searched."""
    found: list[Path] = []
    level = [folder] if folder.is_dir() else []
    for _ in range(DEEPEST):
        level = [path for parent in level for path in sorted(parent.iterdir()) if path.is_dir() and path.name[0] != "."]
        found += [path for path in level if is_campaign(path)]
        level = [path for path in level if path not in found and path.name != OUTPUT_FOLDER]
    return sorted(found)


def shown(path: Path) -> str:
    """A folder as one would type it here."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) and path != here else str(path)
