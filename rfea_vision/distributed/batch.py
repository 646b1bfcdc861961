"""A batch: every run of every campaign is a task of its own; a campaign's recipe follows when its runs are through.

Results do not depend on the number of workers, nor on which of them die: each task is deterministic, writes whole files
that are its own, and finds done what was finished before. Workers must see the same files under the same paths.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.distributed import tasks
from rfea_vision.distributed.cluster import start_again
from rfea_vision.distributed.tasks import BatchResult, Settings, sentence_of
from rfea_vision.errors import DataError, InputError
from rfea_vision.stages.recipes import recipe_file

if TYPE_CHECKING:
    from distributed import Client, Future

_AHEAD = 4  # campaigns begun per worker: enough to keep all busy, few enough for a scheduler with 10,000 to come
_LOOK_EVERY_S = 2.0  # between looks at workers
_WITHOUT_WORKERS_S = 30.0  # after which it is said that those of a scheduler elsewhere have gone
# those of this machine: they are started again, but a busy machine takes its time for it
_WITHOUT_OWN_WORKERS_S = 600.0


@dataclass
class _Campaign:
    """One campaign on its way."""

    index: int
    folder: Path
    out: Path | None
    runs: tuple[str, ...] = ()
    waiting: set[Future] = field(default_factory=set)
    failures: dict[str, str] = field(default_factory=dict)


def run_batch(
    folders: Sequence[Path],
    *,
    client: Client,
    recipe: str = "default",
    out: Path | None = None,
    force: bool = False,
    trust: bool = False,
    effect_files: Sequence[Path] = (),
    on_result: Callable[[BatchResult], None] | None = None,
) -> list[BatchResult]:
    """Run a recipe over campaigns; what is broken is named and does not stop the rest.

    Parameters
    ----------
    folders : campaigns or lone experiments, each once
    client : of a Dask scheduler
    recipe : name or path
    out : folder that holds one folder of results per campaign; default each campaign's own ``rfea/``
    force : redo the steps of the recipe even where nothing has changed
    trust : campaigns may read outside of their folders
    effect_files : the only files whose code may run
    on_result : called as each campaign ends

    Returns
    -------
    list of BatchResult
        In the order of `folders`.

    Raises
    ------
    InputError
        If two campaigns would write to the same folder.
    DataError
        If the scheduler, or all its workers, have gone; what was finished is kept.
    """
    refuse_shared_results(folders, out)
    recipe = str(recipe_file(recipe) or recipe)  # whole paths, as workers have working folders of their own
    code = tuple(str(file.resolve()) for file in effect_files)
    settings = Settings(tasks.fingerprint(), recipe, force, trust, code)
    return _Batch(folders, out, client, settings, on_result).run()


def results_of(folder: Path, out: Path | None) -> Path:
    """Where the results of a campaign go."""
    return folder.resolve() / OUTPUT_FOLDER if out is None else out.resolve() / folder.resolve().name


def refuse_shared_results(folders: Sequence[Path], out: Path | None) -> None:
    """Raise if two campaigns would write to the same folder.

    Raises
    ------
    InputError
        With both campaigns and the folder.
    """
    seen: dict[Path, Path] = {}
    for folder in folders:
        where = results_of(folder, out)
        if where in seen:
            raise InputError(
                f"{folder}: its results would go to {where}, as those of {seen[where]}; give each campaign once"
            )
        seen[where] = folder


class _Batch:
    """The client's side: begins campaigns as workers become free, and hears of every task that ends."""

    def __init__(
        self,
        folders: Sequence[Path],
        out: Path | None,
        client: Client,
        settings: Settings,
        on_result: Callable[[BatchResult], None] | None,
    ) -> None:
        self.folders, self.out, self.client, self.settings = folders, out, client, settings
        self.on_result = on_result or (lambda result: None)
        self.pending: dict[Future, tuple[_Campaign, str]] = {}
        self.results: dict[int, BatchResult] = {}
        self.open = 0
        self.seen_workers = time.monotonic()

    def run(self) -> list[BatchResult]:
        from distributed import wait

        queue = list(reversed(range(len(self.folders))))
        while queue or self.pending:
            while queue and self.open < max(4, _AHEAD * self._workers()):
                self._begin(queue.pop())
            if not self.pending:
                continue
            try:
                waited: Any = wait(list(self.pending), timeout=_LOOK_EVERY_S, return_when="FIRST_COMPLETED")
                done = waited.done
            except TimeoutError:
                done = set()
            self._look_after()
            for future in done:
                self._heard(future, *self.pending.pop(future))
        return [self.results[index] for index in range(len(self.folders))]

    def _begin(self, index: int) -> None:
        from rfea_vision.campaign import read_campaign

        folder = self.folders[index]
        campaign = _Campaign(index, folder.resolve(), None if self.out is None else results_of(folder, self.out))
        self.open += 1
        try:
            found = read_campaign(campaign.folder, campaign.out, trust=self.settings.trust).campaign
        except Exception as error:  # a folder of a stranger: whatever it is, it is this campaign's
            self._end(campaign, BatchResult("", "failed", {"campaign": sentence_of(error)}))
            return
        if found is not None:
            campaign.runs = tuple(item.name for item in found.experiments if item.role != "ignore")
        if found is not None and found.camera is not None:
            # one task calibrates first, so that the experiments' tasks find it done instead of each doing it
            self._submit(campaign, "calibrate", tasks.calibrate)
        else:
            self._measure(campaign)

    def _measure(self, campaign: _Campaign) -> None:
        for name in campaign.runs:
            self._submit(campaign, f"measure {name}", tasks.measure, name)
        if not campaign.waiting:
            self._submit(campaign, "finish", tasks.finish, {})

    def _submit(self, campaign: _Campaign, what: str, task: Callable[..., Any], *more: Any) -> None:
        out = None if campaign.out is None else str(campaign.out)
        future = self.client.submit(task, str(campaign.folder), out, *more, self.settings, pure=False)
        self.pending[future] = (campaign, what)
        campaign.waiting.add(future)

    def _heard(self, future: Future, campaign: _Campaign, what: str) -> None:
        campaign.waiting.discard(future)
        kind, _, name = what.partition(" ")
        answer: Any
        try:
            answer = future.result()
        except Exception as error:
            answer = self._lost(error)
            if kind == "finish":
                answer = BatchResult("", "failed", {**campaign.failures, "campaign": answer})
        if kind == "finish":
            self._end(campaign, answer)
            return
        if kind == "calibrate":
            self._measure(campaign)
            return
        if answer is not None:
            campaign.failures[name] = answer
        if not campaign.waiting:
            self._submit(campaign, "finish", tasks.finish, campaign.failures)

    def _end(self, campaign: _Campaign, result: BatchResult) -> None:
        where = results_of(self.folders[campaign.index], self.out)
        result = replace(result, folder=str(self.folders[campaign.index]), out=str(where))
        self.open -= 1
        self.results[campaign.index] = result
        self.on_result(result)

    def _lost(self, error: BaseException) -> str:
        if type(error).__name__ == "KilledWorker":
            return "its worker was stopped again and again, as by too little memory; give workers more with --memory, or use fewer"
        return sentence_of(error)

    def _workers(self) -> int:
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    def _look_after(self) -> None:
        """Start workers of this machine that were killed again; raise if nobody is left to work."""
        if self.client.status != "running":
            raise DataError("the scheduler has gone; run the same command again: what was finished is kept")
        start_again(self.client)
        if self._workers():
            self.seen_workers = time.monotonic()
            return
        patience_s = _WITHOUT_WORKERS_S if self.client.cluster is None else _WITHOUT_OWN_WORKERS_S
        if time.monotonic() - self.seen_workers > patience_s:
            raise DataError(
                "all workers have gone; start them and run the same command again: what was finished is kept"
            )
