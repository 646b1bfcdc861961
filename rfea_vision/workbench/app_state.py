"""What the server knows: one campaign or a folder of them, the worker process, and the pages that listen."""

from __future__ import annotations

import asyncio
import queue
import shlex
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.effects.permission import name_files
from rfea_vision.errors import InputError
from rfea_vision.files import write_text
from rfea_vision.workbench.loading import loaded
from rfea_vision.workbench.orders import order
from rfea_vision.workbench.process import ENDS, WorkerProcess

if TYPE_CHECKING:
    from rfea_vision.campaign import ExperimentSpec
    from rfea_vision.workbench.opened import OpenedCampaign

DEEPEST = 3  # folders below the one that was opened in which campaigns are looked for
LOG_LINES = 200
MEASURING = ("calibrate", "track", "sync")
LONGEST_START_S, LONGEST_CHECK_S = 600.0, 30.0  # loading what reads laws took 130 s on a busy machine


class AppState:
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
            what = "holds no campaign" if self.folder.is_dir() else "no such folder"
            raise InputError(f"{folder}: {what}; 'rfea init DIR' makes one")
        if out is not None and not self.single:
            raise InputError(
                f"--out {out}: is for one campaign, and {folder} holds several, which would share it; leave it out, or open one"
            )
        self.log: list[dict[str, Any]] = []
        self.failed: dict[int, str] = {}  # by campaign: why its runs could not be measured at the last try
        self.ending: Callable[[], bool] = lambda: False
        self.own_files: set[Path] = set()  # effect files that this user has typed or opened, and that passed the check
        self.begun_files: set[Path] = set()  # those that may be written to: the user has opened or begun them here
        self.worker = WorkerProcess(self.tell)
        # checks laws, so that one that never ends can be stopped
        self.judge = WorkerProcess(lambda event: None, prepared=False)
        self._judging = threading.Lock()
        self._opened: dict[int, OpenedCampaign] = {}
        self.seen = threading.Event()  # whether a page has been given what it shows first
        self._listeners: set[tuple[asyncio.AbstractEventLoop, asyncio.Queue[dict[str, Any]]]] = set()
        self._lock = threading.Lock()

    def opened(self, index: int) -> OpenedCampaign:
        """One campaign as it is read, from when it is first looked at."""
        with self._lock:
            if index not in self._opened:
                self._opened[index] = loaded("workbench.opened").OpenedCampaign(self.campaigns[index], self.out)
            return self._opened[index]

    def begin(self, index: int, do: str, options: dict[str, Any], label: str) -> bool:
        """Hand a job to the worker; False if it is busy.

        Raises
        ------
        InputError
            If it names an effect file or a target that the page may not.
        """
        files = {str(file) for file in self.laws()}
        if not set(map(str, options.get("effect_files", []))) <= files:
            raise InputError("effect_files: only a law that was opened or written in this workbench is run")
        if "file" in options:
            raise InputError("file: where a proposed law is written is not the page's to say")
        if do == "propose":
            options = {**options, "file": str(loaded("workbench.laws").own_file("proposed"))}
        if own := self._own_of(index, options):
            options = {**options, "effect_files": own}
        kept, command = order(shown(self.campaigns[index]), self.out, do, options)
        return self.submit(index, do, kept, label or do, command)

    def laws(self) -> list[Path]:
        """The user's own effect files, as far as they are still there."""
        return sorted(file for file in self.own_files if file.is_file())

    def _own_of(self, index: int, options: dict[str, Any]) -> list[str]:
        """Files of the user's own laws that a job's effects, or those of its model, are declared in."""
        if not (laws := self.laws()):
            return []
        wanted = {str(effect).partition("@")[0] for effect in options.get("add", [])}
        if "model" in options:
            wanted |= set(self.opened(index).chosen(str(options["model"]), (), ()).fit.effects)
        return [str(file) for file in laws if wanted & loaded("workbench.laws").ids_of(file)]

    def submit(self, index: int, do: str, options: dict[str, Any], label: str, command: str | None = None) -> bool:
        """Submit a job to the worker as it stands; one without a command is no step of its own."""
        out = None if self.out is None else str(self.out)
        job = {"index": index, "do": do, "options": options, "campaign": str(self.campaigns[index]), "out": out}
        return self.worker.submit(job | {"label": label} | ({"command": command} if command else {}))

    def begin_all(self) -> bool:
        """Run all campaigns as `rfea batch` would; False if the worker is busy."""
        folders = [shown(folder) for folder in self.campaigns]
        job = {"do": "batch", "options": {}, "campaigns": list(map(str, self.campaigns))}
        said = {"label": f"Run {len(folders)} campaigns", "command": shlex.join(["rfea", "batch", *folders])}
        return self.worker.submit(job | said)

    def check_law(self, file: Path, text: str, *, keep: bool) -> dict[str, Any]:
        """Check a law in a process of its own; with `keep` it is written, and one that is right counts as the user's.

        Raises
        ------
        InputError
            What is wrong with it, that it does not end, or that another law lies there already.
        """
        with self._judging:
            if keep:
                if file not in self.begun_files:
                    loaded("workbench.laws").refuse_taken(file)
                self.begun_files.add(file)
                self.own_files.discard(file)
                write_text(file, text)
                found = self._judged(file)
                self.own_files.add(file)
                name_files([file])
                return found
            with tempfile.TemporaryDirectory(prefix="rfea-law-") as folder:
                draft = Path(folder) / file.name
                draft.write_text(text, encoding="utf-8")
                return self._judged(draft)

    def _judged(self, file: Path) -> dict[str, Any]:
        answers: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self.judge.tell = answers.put
        if not self.judge.submit({"do": "check law", "file": str(file)}):
            raise InputError("another law is being read; try again when that has ended")
        patience_s = LONGEST_START_S
        try:
            while (event := answers.get(timeout=patience_s))["event"] not in ENDS:
                if event["event"] == "ready":
                    patience_s = LONGEST_CHECK_S
        except queue.Empty:
            self.judge.stop()
            raise InputError(f"the law took longer than {patience_s:g} s to be read, and was stopped") from None
        if event["event"] != "finished":
            raise InputError(event.get("error", "the process that reads laws has ended"))
        return event["result"]

    def tell(self, event: dict[str, Any]) -> None:
        """Tell everyone who listens; may be called from any thread."""
        if event.get("command") and event["event"] in ("begun", "said"):
            self.log.append({"command": event["command"], "label": event.get("label", "")})
            del self.log[:-LOG_LINES]
        if event.get("do") in MEASURING and event["event"] in ENDS:
            self.failed[event["index"]] = event.get("error", "")
        if "error" in event:
            event = event | {"error": in_words(event["error"])}
        for loop, line in list(self._listeners):
            with suppress(RuntimeError):  # a loop that has been closed
                loop.call_soon_threadsafe(line.put_nowait, event)

    def listen(self) -> asyncio.Queue[dict[str, Any]]:
        """A queue of what is told from now on."""
        line: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._listeners.add((asyncio.get_running_loop(), line))
        return line

    def leave(self, line: asyncio.Queue[dict[str, Any]]) -> None:
        """Stop listening."""
        self._listeners = {pair for pair in self._listeners if pair[1] is not line}

    def close(self) -> None:
        """End the processes."""
        self.worker.stop()
        self.judge.stop()


@dataclass(frozen=True)
class Asked:
    """A question of the page: the campaign that its address names and the part of it, by number, and what comes with it."""

    app: AppState
    index: int = 0
    number: int = 0
    given: dict[str, Any] = field(default_factory=dict)

    @property
    def opened(self) -> OpenedCampaign:
        """The campaign that is asked about."""
        return self.app.opened(self.index)

    @property
    def experiment(self) -> ExperimentSpec:
        """The run that is asked about; InputError if there is none of that number."""
        return self.opened.experiment(self.number)

    def __getitem__(self, key: str) -> Any:
        return self.given[key]

    def get(self, key: str, default: Any = None) -> Any:
        """What comes under a key, if it does."""
        return self.given.get(key, default)


def in_words(sentence: str) -> str:
    """A sentence of the command line with words in place of the codes of its reasons."""
    from rfea_vision.artefacts.reasons import REASONS  # the page is served before artefacts are loaded

    for code, reason in REASONS.items():
        sentence = sentence.replace(f"({code})", f"({reason.words})")
    return sentence


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
