"""Many campaigns on many processes: Dask on this machine by default, on any scheduler by its address.

Every experiment is measured by a task of its own; when all of a campaign are through, one more task runs its recipe.
Results do not depend on the number of workers: each task is deterministic and writes only what is its own.
Workers must see the same files under the same paths.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.errors import InputError, RfeaError

if TYPE_CHECKING:
    from distributed import Client

DEFAULT_WORKERS = 2


@dataclass(frozen=True)
class BatchResult:
    """What became of one campaign.

    Attributes
    ----------
    folder : as it was given
    status : ``done``, ``partly`` (some experiments failed, the rest went through) or ``failed``
    errors : experiment (or ``campaign``) -> one sentence
    rungs : model, validation error in mm and verdict of each rung of the ladder
    report : path of the report, if there is one
    out : where its results are
    """

    folder: str
    status: str
    errors: dict[str, str] = field(default_factory=dict)
    rungs: list[dict[str, Any]] = field(default_factory=list)
    report: str | None = None
    out: str = ""


@contextmanager
def dask_client(scheduler: str | None, workers: int = DEFAULT_WORKERS) -> Iterator[Client]:
    """Connect to a scheduler, or start a cluster of processes on this machine for as long as the block runs.

    Raises
    ------
    InputError
        If no scheduler answers at the address.
    """
    from dask import config
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="5s")
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: nothing answers there; start 'dask scheduler' or drop the option"
            ) from error
        with client:
            yield client
        return
    # A worker that grows is killed in silence and its task runs again: let the machine decide instead.
    with config.set({"distributed.worker.memory.terminate": False, "distributed.admin.low-level-log-length": 0}):
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            memory_limit=0,
            silence_logs=50,
        )
        with cluster, Client(cluster) as client:
            yield client


def run_batch(
    folders: Sequence[Path],
    *,
    client: Client,
    recipe: str = "default",
    out: Path | None = None,
    force: bool = False,
    on_result: Callable[[BatchResult], None] | None = None,
) -> list[BatchResult]:
    """Run a recipe over campaigns; what is broken is named and does not stop the rest.

    Parameters
    ----------
    folders : campaigns or lone experiments
    client : of a Dask scheduler
    recipe : name or path
    out : folder that holds one folder of results per campaign; default each campaign's own ``rfea/``
    force : redo the steps of the recipe even where nothing has changed
    on_result : called as each campaign ends

    Returns
    -------
    list of BatchResult
        In the order of `folders`.
    """
    from distributed import as_completed

    from rfea_vision.campaign import read_campaign

    finals = {}
    for index, folder in enumerate(folders):
        target = None if out is None else _results_of(folder, out)
        campaign = read_campaign(folder, target).campaign
        names = [item.name for item in campaign.experiments if item.role != "ignore"] if campaign is not None else []
        # One task calibrates first, so that the experiments' tasks find it done instead of each doing it.
        ready = client.submit(_calibrate, str(folder), _text(target), pure=False)
        measured = [client.submit(_measure, str(folder), _text(target), name, ready, pure=False) for name in names]
        future = client.submit(_finish, str(folder), _text(target), recipe, force, measured, pure=False)
        finals[future] = index
    results: dict[int, BatchResult] = {}
    for future in as_completed(list(finals)):
        index = finals[future]
        error = future.exception()
        failed = BatchResult(str(folders[index]), "failed", {"campaign": _sentence(error)}) if error else None
        target = _results_of(folders[index], out)
        results[index] = replace(failed or future.result(), out=str(target))
        if on_result is not None:
            on_result(results[index])
    return [results[index] for index in range(len(folders))]


def _results_of(folder: Path, out: Path | None) -> Path:
    return folder.resolve() / OUTPUT_FOLDER if out is None else out.resolve() / folder.resolve().name


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)


def _sentence(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, RfeaError) else f"{type(error).__name__}: {text}"


def _quiet_threads() -> None:
    """Keep one process to one thread, where processes are the unit of work."""
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    import cv2
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=1)
    cv2.setNumThreads(1)


def _workspace(folder: str, out: str | None, force: Sequence[str] = ()) -> Any:
    from rfea_vision.campaign import read_campaign
    from rfea_vision.stages import Workspace

    reading = read_campaign(folder, out)
    blocked = reading.blocked
    if reading.campaign is None or blocked is not None:
        raise InputError(str(blocked or reading.problems[0]))
    work = Workspace(reading.campaign, force=force, tolerant=True)
    for problem in reading.problems:
        if problem.severity == "error" and problem.experiment is not None:
            work.failures.setdefault(problem.experiment, InputError(str(problem)))
    return work


def _calibrate(folder: str, out: str | None) -> None:
    """Calibrate the campaign's own camera; what goes wrong is said by the task that needs it."""
    _quiet_threads()
    try:
        work = _workspace(folder, out)
        if work.campaign.camera is not None:
            work.calibrate()
            work.cache.save_hashes()
    except RfeaError:
        return


def _measure(folder: str, out: str | None, name: str, ready: None) -> None:
    """Track and synchronise one experiment; the last task says what went wrong."""
    _quiet_threads()
    try:
        work = _workspace(folder, out)
        work.sync([name])
    except RfeaError:
        return


def _finish(folder: str, out: str | None, recipe: str, force: bool, measured: Sequence[None]) -> BatchResult:
    """Run the recipe on what could be measured."""
    _quiet_threads()
    from rfea_vision.artefacts import Ladder
    from rfea_vision.stages.recipes import load_recipe, run_recipe

    steps = load_recipe(recipe)
    try:
        work = _workspace(folder, out, [name for name, _ in steps.calls()] if force else ())
    except RfeaError as error:
        return BatchResult(folder, "failed", {"campaign": _sentence(error)})
    try:
        run_recipe(work, steps)
    except RfeaError as error:
        errors = {name: _sentence(failure) for name, failure in work.failures.items()}
        return BatchResult(folder, "failed", errors or {"campaign": _sentence(error)})
    errors = {name: _sentence(failure) for name, failure in work.failures.items()}
    ladder_file, page = work.out / Ladder.FILE, work.out / "report" / "index.html"
    rungs = []
    if ladder_file.is_file():
        for rung in Ladder.load(ladder_file).rungs:
            rungs.append({"model": rung.model, f"validate_{rung.unit}": rung.error("validate"), "verdict": rung.verdict})
    return BatchResult(folder, "partly" if errors else "done", errors, rungs, str(page) if page.is_file() else None)
