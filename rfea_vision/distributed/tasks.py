"""What a worker does: calibrate a camera, measure one run, run the recipe on what was measured."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfea_vision import __version__
from rfea_vision.effects.permission import name_files
from rfea_vision.errors import DataError, InputError, RfeaError
from rfea_vision.files import storage_error
from rfea_vision.loops import digest_of_sources
from rfea_vision.readers.apart import isolating

if TYPE_CHECKING:
    from rfea_vision.artefacts import Rung
    from rfea_vision.stages import Workspace

_PATIENCE_S = 60.0  # for a lock that another worker holds


@dataclass(frozen=True)
class Settings:
    """What all tasks of a batch share.

    Attributes
    ----------
    version : of the package where the batch was started
    recipe : name or path
    force : redo the steps of the recipe
    trust : campaigns may read outside of their folders
    effect_files : named on the command line
    """

    version: str
    recipe: str = "default"
    force: bool = False
    trust: bool = False
    effect_files: tuple[str, ...] = ()


@dataclass(frozen=True)
class BatchResult:
    """What became of one campaign.

    Attributes
    ----------
    folder : as it was given
    status : ``done``, ``partly`` (some experiments failed, the rest went through) or ``failed``
    errors : experiment (or ``campaign``) -> one sentence
    rungs : model, validation error in mm or deg, verdict, what was added and what it cannot be told from, of each rung of the ladder
    report : path of the report, if there is one
    out : where its results are
    """

    folder: str
    status: str
    errors: dict[str, str] = field(default_factory=dict)
    rungs: list[dict[str, Any]] = field(default_factory=list)
    report: str | None = None
    out: str = ""


@cache
def fingerprint() -> str:
    """The version of this package and a hash of its code: two that differ may differ in their results."""
    return f"{__version__} ({digest_of_sources(Path(__file__).resolve().parent.parent)[:12]})"


def sentence_of(error: BaseException) -> str:
    """One sentence of whatever went wrong."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and not isinstance(error, RfeaError):
        return str(storage_error(error) or f"{type(error).__name__}: {text}")
    return text if isinstance(error, RfeaError) else f"{type(error).__name__}: {text}"


def calibrate(folder: str, out: str | None, settings: Settings) -> None:
    """Calibrate the campaign's own camera; what goes wrong is said by the task that needs it."""
    with _working(folder, out, settings, "calibration") as work:
        if work.campaign.camera is not None:
            work.calibrate()


def measure(folder: str, out: str | None, name: str, settings: Settings) -> str | None:
    """Track and synchronise one experiment; return what went wrong in a sentence, or None."""
    try:
        with _working(folder, out, settings, name) as work:
            work.sync([name])
            failure = work.failures.get(name)
    except Exception as error:  # whatever it is, the other experiments go on
        return sentence_of(error)
    return None if failure is None else sentence_of(failure)


def finish(folder: str, out: str | None, failures: Mapping[str, str], settings: Settings) -> BatchResult:
    """Run the recipe on what could be measured."""
    from rfea_vision.artefacts import Ladder
    from rfea_vision.stages.recipes import load_recipe, run_recipe

    errors: dict[str, str] = {}
    try:
        steps = load_recipe(settings.recipe)
        with _working(folder, out, settings, None) as work:
            work.force = {name for name, _ in steps.calls()} if settings.force else set()
            for name, sentence in failures.items():
                work.failures.setdefault(name, DataError(sentence))
            try:
                run_recipe(work, steps)
            finally:
                errors = {name: sentence_of(failure) for name, failure in work.failures.items()}
            page, rungs = work.out / "report" / "index.html", []
            if (work.out / Ladder.FILE).is_file():
                ladder = Ladder.load(work.out / Ladder.FILE)
                rungs = [told_of(rung) for rung in ladder.rungs]
    except Exception as error:
        return BatchResult(folder, "failed", {**errors, "campaign": sentence_of(error)})
    return BatchResult(folder, "partly" if errors else "done", errors, rungs, str(page) if page.is_file() else None)


def told_of(rung: Rung) -> dict[str, object]:
    """What a batch tells of a rung."""
    told = {"model": rung.model, f"validate_{rung.unit}": rung.error("validate"), "verdict": rung.verdict, "said": rung.said}
    return told | {"added": rung.added, "tied": list(rung.tied)}


@contextmanager
def _working(folder: str, out: str | None, settings: Settings, part: str | None) -> Iterator[Workspace]:
    """A campaign to work on, alone or, with a `part`, beside the tasks of its other parts."""
    from rfea_vision.campaign import read_campaign
    from rfea_vision.stages import Workspace
    from rfea_vision.stages.locks import locked

    if settings.version != fingerprint():
        raise InputError(
            f"{folder}: the batch was started with rfea-vision {settings.version}, this worker runs {fingerprint()}; install the same"
        )
    name_files(settings.effect_files)
    _one_thread()
    with isolating():
        if not Path(folder).is_dir():
            where = "where this worker runs; give a campaign folder, and with --scheduler mount it there under the same path"
            raise InputError(f"{folder}: no such folder {where}")
        reading = read_campaign(folder, out, trust=settings.trust)
        blocked = reading.blocked
        if reading.campaign is None or blocked is not None:
            raise InputError(str(blocked or reading.problems[0]))
        work = Workspace(reading.campaign, tolerant=True)
        for problem in reading.problems:
            if problem.severity == "error" and problem.experiment is not None:
                work.failures.setdefault(problem.experiment, InputError(str(problem)))
        lock = work.cache.lock
        alone = nullcontext() if part is None else locked(lock.with_name(f"lock@{part}"), patience_s=_PATIENCE_S)
        with locked(lock, shared=part is not None, patience_s=_PATIENCE_S), alone:
            yield work
            work.cache.save_hashes()


def _one_thread() -> None:
    """Keep one process to one thread, where processes are the unit of work."""
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    import cv2
    import numba
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=1)
    cv2.setNumThreads(1)
    numba.set_num_threads(1)
