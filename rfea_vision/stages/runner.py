"""How a stage runs: what it depends on as data, and the campaign whose results are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

from rfea_vision.campaign import Campaign, ExperimentSpec
from rfea_vision.errors import DataError, InputError, RfeaError
from rfea_vision.files import sweep
from rfea_vision.progress import Listener, Outcome, Progress
from rfea_vision.stages.cache import StageCache
from rfea_vision.stages.code import code_of
from rfea_vision.stages.locks import locked
from rfea_vision.stages.stored import Stored

_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Stage:
    """A stage on one subject, by all that its result depends on.

    Attributes
    ----------
    name, subject : of the record and of the progress bar, such as track and steps-270kPa
    inputs : raw files
    earlier : content hashes of results of earlier stages
    options : kept in the record
    code : function whose source counts, with all that it imports; None for the one that does the work
    """

    name: str
    subject: str
    inputs: Sequence[Path] = ()
    earlier: Sequence[str] = ()
    options: Mapping[str, object] = field(default_factory=dict)
    code: Callable[..., object] | None = None

    @property
    def key(self) -> str:
        """Name of the record."""
        return f"{self.name}/{self.subject}"

    def made_by(self, make: Callable[..., object]) -> Stage:
        """The same with the code of `make`, unless it names its own."""
        return self if self.code is not None else replace(self, code=make)


class Runner:
    """A campaign and its results.

    Attributes
    ----------
    campaign : the typed input
    out : folder of the results
    outcomes : what has been done in this session: stage, subject, outcome and a sentence
    failures : experiments that could not be measured, where failing is tolerated
    """

    def __init__(
        self, campaign: Campaign, *, listener: Listener | None = None, force: Iterable[str] = (), tolerant: bool = False
    ) -> None:
        self.campaign = campaign
        self.out = campaign.out
        self.cache = StageCache(campaign.out)
        self.listener = listener or Listener()
        self.force = set(force)
        self.tolerant = tolerant
        self.outcomes: list[dict[str, str]] = []
        self.failures: dict[str, RfeaError] = {}
        self._done: dict[str, Stored[Any]] = {}
        self._told: set[str] = set()

    def run(
        self,
        stage: Stage,
        *,
        make: Callable[[Progress], tuple[_Result, list[Path], str]],
        load: Callable[[], _Result],
        facts: Callable[[_Result], Mapping[str, object]] = lambda result: {},
    ) -> Stored[_Result]:
        """Run a stage, or take what it made before if nothing that it depends on has changed.

        Parameters
        ----------
        stage : what the result depends on
        make : does the work; returns the result, the files written, and a sentence
        load : reads the result back
        facts : what the record keeps of the result, so that it need not be read to be told of
        """
        if stage.key in self._done:
            return self._done[stage.key]
        hashes, digest = self._digest(stage.made_by(make))
        stored = None if self._is_fresh(stage, digest) else self._made(stage, hashes, digest, make, facts)
        if stored is None:
            record = self.cache.record(stage.key)
            stored = Stored(load, None if record is None else record.facts)
            self._say(stage, "unchanged", "")
        self._done[stage.key] = stored
        return stored

    def _made(
        self,
        stage: Stage,
        hashes: Mapping[str, str],
        digest: str,
        make: Callable[[Progress], tuple[_Result, list[Path], str]],
        facts: Callable[[_Result], Mapping[str, object]],
    ) -> Stored[_Result] | None:
        """Do the work of a stage and note it; None if another process has done it in the meantime."""
        with locked(self.cache.lock, say=self.listener.note):
            if self._is_fresh(stage, digest):
                return None
            sweep(self.out)
            progress = self.listener.begin(stage.name, stage.subject)
            try:
                result, outputs, sentence = make(progress)
                self._refuse_changed(hashes, stage.inputs)
            except BaseException as error:
                self.listener.end(stage.name, stage.subject, "failed", str(error))
                raise
            record = self.cache.finished(
                stage.key, digest, outputs, options=stage.options, inputs=hashes, facts=facts(result)
            )
            self.cache.store(record)
            self._say(stage, "done", sentence)
            return Stored.of(result, record.facts)

    def _is_fresh(self, stage: Stage, digest: str) -> bool:
        return stage.name not in self.force and self.cache.is_fresh(stage.key, digest)

    def _refuse_changed(self, hashes: Mapping[str, str], inputs: Sequence[Path]) -> None:
        """Raise if a raw file changed while it was read: the result belongs to neither state of it."""
        for path in inputs:
            if not path.is_file() or self.cache.sha256(path) != hashes[self._shown(path)]:
                raise DataError(
                    f"{path}: changed while it was read; wait until it is complete and run the command again"
                )

    def remember(self, *results: tuple[Stage, Sequence[Path]]) -> None:
        """Note results that came about inside another stage, so that their own stages find them done.

        All is worked out before the first is noted: a command that is killed notes all of them or, but for an instant, none.
        """
        records = []
        for stage, outputs in results:
            hashes, digest = self._digest(stage)
            records.append(self.cache.finished(stage.key, digest, outputs, options=stage.options, inputs=hashes))
        self.cache.store(*records)

    def has(self, stage: Stage) -> bool:
        """Whether a stage has been done with just these inputs, options and code, and is not to be redone."""
        return self._is_fresh(stage, self._digest(stage)[1])

    def _digest(self, stage: Stage) -> tuple[dict[str, str], str]:
        assert stage.code is not None
        hashes = {self._shown(path): self.cache.sha256(path) for path in stage.inputs}
        return hashes, self.cache.digest(
            stage.name, [*hashes.values(), *stage.earlier], stage.options, code_of(stage.code)
        )

    def outcome(self, stage: str, subject: str) -> str:
        """Return how a stage ended in this session: done or unchanged."""
        found = [item for item in self.outcomes if item["stage"] == stage and item["subject"] == subject]
        return found[-1]["outcome"] if found else "unchanged"

    def unchanged_since(self) -> datetime | None:
        """Return when the last result of this session was made, if all of them were there already and true; None otherwise."""
        if not self.outcomes or self.failures or any(item["outcome"] != "unchanged" for item in self.outcomes):
            return None
        return max(self.cache.made(f"{item['stage']}/{item['subject']}") for item in self.outcomes)

    def raw_inputs(self, experiments: Iterable[str]) -> dict[str, str]:
        """Return the hashes of the raw files that these recordings were made from, by path below the campaign."""
        keys = [key for name in experiments for key in (f"calibrate/{name}/camera", f"track/{name}", f"sync/{name}")]
        found: dict[str, str] = {}
        for key in (f"calibrate/{self.campaign.name}", *keys):
            record = self.cache.record(key)
            found |= record.inputs if record is not None else {}
        return dict(sorted(found.items()))

    def tell(self, sentence: str) -> None:
        """Tell the listener a sentence, unless it is empty or was told before."""
        if sentence and sentence not in self._told:
            self._told.add(sentence)
            self.listener.note(sentence)

    def _say(self, stage: Stage, outcome: Outcome, sentence: str) -> None:
        said = {"stage": stage.name, "subject": stage.subject, "outcome": outcome, "sentence": sentence}
        self.outcomes.append(said)
        self.listener.end(stage.name, stage.subject, outcome, sentence)

    def _shown(self, path: Path) -> str:
        return path.relative_to(self.campaign.root).as_posix() if path.is_relative_to(self.campaign.root) else str(path)

    def runs(self) -> list[str]:
        """Names of the experiments that are not set aside."""
        return [item.name for item in self.campaign.experiments if item.role != "ignore"]

    def active(self) -> list[ExperimentSpec]:
        """The experiments that are neither set aside nor have failed in this session."""
        return [item for item in self.campaign.experiments if item.role != "ignore" and item.name not in self.failures]

    def each(self, names: Sequence[str], action: Callable[[ExperimentSpec], _Result], verb: str) -> dict[str, _Result]:
        """Do something to each experiment; one that fails does not keep the others from being done.

        Raises
        ------
        RfeaError
            Where failing is not tolerated: the first failure, with the names of the others, whose reasons are noted before.
        """
        chosen = [self.campaign.experiment(name) for name in names] if names else self.active()
        results: dict[str, _Result] = {}
        failures: dict[str, RfeaError] = {}
        for experiment in chosen:
            try:
                results[experiment.name] = action(experiment)
            except RfeaError as error:
                failures[experiment.name] = error
        if failures and not self.tolerant:
            for name in list(failures)[1:]:
                self.listener.note(f"{name}: {str(failures[name]).removeprefix(f'{name}: ')}")
            raise _as_one_error(failures, len(chosen), verb)
        self.failures |= failures
        return results


def _as_one_error(failures: dict[str, RfeaError], total: int, verb: str) -> RfeaError:
    """Return one error for the experiments that failed; those that did not are kept."""
    first = next(iter(failures.values()))
    rest = total - len(failures)
    kept = f" ({rest} of {total} experiments were {verb}; 'role: ignore' leaves a run out)" if rest else ""
    more = f"; also failed: {', '.join(list(failures)[1:])}" if len(failures) > 1 else ""
    kind = InputError if any(isinstance(error, InputError) for error in failures.values()) else DataError
    return kind(f"{first}{more}{kept}")
