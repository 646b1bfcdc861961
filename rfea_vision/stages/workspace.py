"""A campaign at work: every stage as a method, each running what it needs and is out of date."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rfea_vision.artefacts import Calibration, Comparison, Diagnosis, Ladder, ModelFit, Recording, Track
from rfea_vision.campaign import Campaign, ExperimentSpec, load_campaign
from rfea_vision.errors import DataError, InputError, RfeaError
from rfea_vision.files import sweep
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.options.asking import declares, from_keywords
from rfea_vision.progress import Listener, Progress
from rfea_vision.stages import measurement, mechanics, publishing
from rfea_vision.stages.cache import StageCache
from rfea_vision.stages.code import code_of
from rfea_vision.stages.locks import locked
from rfea_vision.stages.stored import Stored, values

_Result = TypeVar("_Result")


def open_campaign(
    path: Path | str, out: Path | str | None = None, *, listener: Listener | None = None, trust: bool = False
) -> Workspace:
    """Open a campaign folder to work on.

    Parameters
    ----------
    path : campaign folder, or a lone folder with an experiment.yaml
    out : where results go; default ``<campaign>/rfea``
    listener : hears of every stage and its progress
    trust : let it read outside of its folder, and from database servers

    Raises
    ------
    InputError
        If the campaign or one of its experiments is not right.
    """
    return Workspace(load_campaign(path, out, trust=trust), listener=listener)


class Workspace:
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

    # -- measurement ---------------------------------------------------------------------------------------------

    def calibrate(self) -> Calibration | None:
        """Calibrate the campaign's camera, and those of experiments with their own; None where nothing is pictured."""
        found: list[Stored[Calibration]] = []
        camera = self.campaign.camera
        # A scale without a board belongs to the film it was read from.
        if camera is not None and (camera.scale is None or any(item.camera == camera for item in self._active())):
            path = measurement.calibration_path(self, None)
            found.append(measurement.calibrate(self, camera, path, self.campaign.name))
        found += [self.calibration_of(item) for item in self._active() if item.video is not None]
        return found[0].value if found else None

    def track(self, names: Sequence[str] = ()) -> dict[str, Track]:
        """Track the experiments (all, or those named) and return the tracks by name."""
        return values(self._each(names, self.track_of, "tracked"))

    def preview(self, names: Sequence[str] = ()) -> dict[str, Path]:
        """Draw the tracks over the videos and return the files by name; experiments without pictures are left out."""
        chosen = names or [item.name for item in self._active() if item.video is not None]
        return values(self._each(chosen, lambda item: measurement.preview(self, item), "drawn")) if chosen else {}

    def sync(self, names: Sequence[str] = ()) -> dict[str, Recording]:
        """Bring tracks and pressure logs on one clock and return the recordings by name."""
        return values(self._each(names, self.recording_of, "synchronised"))

    def calibration_of(self, experiment: ExperimentSpec) -> Stored[Calibration]:
        """Return the calibration that an experiment's pictures need."""
        if experiment.camera is None:
            raise InputError(f"{experiment.folder / 'experiment.yaml'}: camera: is missing; pictures need it")
        path = measurement.calibration_path(self, experiment)
        subject = self.campaign.name if experiment.camera == self.campaign.camera else experiment.name
        return measurement.calibrate(self, experiment.camera, path, subject)

    def track_of(self, experiment: ExperimentSpec) -> Stored[Track]:
        """Return the track of one experiment."""
        return measurement.track(self, experiment)

    def recording_of(self, experiment: ExperimentSpec) -> Stored[Recording]:
        """Return the recording of one experiment."""
        return measurement.synchronise(self, experiment)

    # -- mechanics -----------------------------------------------------------------------------------------------

    def fit(self, options: FitOptions | None = None, /, **asked: object) -> ModelFit:
        """Fit one model to the training experiments.

        Parameters
        ----------
        options : what to fit and how
        asked : fields of `FitOptions`, in place of `options`: ``fit(segments=8, add=["maxwell"])``
        """
        return mechanics.fit(self, options or from_keywords(FitOptions, asked)).value

    def model(self, name: str) -> ModelFit:
        """Return a model by name, fitted again if it is out of date."""
        return mechanics.fitted(self, name).value

    def model_names(self) -> list[str]:
        """Return the models there are, in the order in which they were fitted."""
        return mechanics.model_names(self)

    def compare(self, *models: str) -> dict[str, Comparison]:
        """Compare models (default: all there are, or the base model) with the measurement."""
        return values({name: mechanics.compare(self, name) for name in models or self.model_names() or ("base",)})

    def diagnose(
        self, model: str | None = None, options: CritiqueOptions | None = None, /, **asked: object
    ) -> Diagnosis:
        """Ask which effect is missing from a model (default: the one fitted last, or the base model).

        `asked` are fields of `CritiqueOptions`, in place of `options`.
        """
        name = model or mechanics.last_model(self) or "base"
        return mechanics.diagnose(self, name, options or from_keywords(CritiqueOptions, asked)).value

    def improve(
        self, fit: FitOptions | None = None, critique: CritiqueOptions | None = None, **asked: object
    ) -> Ladder:
        """Fit, diagnose, add one effect, again, until a verdict ends it.

        `asked` are fields of `FitOptions` and of `CritiqueOptions`, in place of `fit` and `critique`.
        """
        own = {name: value for name, value in asked.items() if not declares(CritiqueOptions, name)}
        both = {name: value for name, value in asked.items() if declares(FitOptions, name)}
        judged = {name: value for name, value in asked.items() if declares(CritiqueOptions, name)}
        fit = fit or from_keywords(FitOptions, {**own, **both})
        return mechanics.improve(self, fit, critique or from_keywords(CritiqueOptions, judged)).value

    # -- publishing ----------------------------------------------------------------------------------------------

    def report(self) -> Path:
        """Write the report and return its path; with no model yet, `improve` comes first."""
        return publishing.report(self).value

    # -- how stages run ------------------------------------------------------------------------------------------

    def recordings(self, *roles: str) -> dict[str, Stored[Recording]]:
        """Return the recordings of these roles by name.

        Raises
        ------
        DataError
            If no training experiment is left.
        """
        wanted = [item.name for item in self._active() if item.role in roles]
        found = self._each(wanted, self.recording_of, "synchronised") if wanted else {}
        if not any(self.campaign.experiment(name).role == "train" for name in found):
            raise DataError(f"{self.campaign.root}: no experiment with 'role: train' is left to fit; mend or add one")
        return found

    def run(
        self,
        stage: str,
        subject: str,
        *,
        inputs: Sequence[Path],
        options: Mapping[str, Any],
        make: Callable[[Progress], tuple[_Result, list[Path], str]],
        load: Callable[[], _Result],
        also: Sequence[str] = (),
        code: Callable[..., Any] | None = None,
    ) -> Stored[_Result]:
        """Run one stage, or take what it made before if nothing that it depends on has changed.

        Parameters
        ----------
        stage, subject : names of the record and of the progress bar
        inputs : raw files that the result depends on
        options : options that it depends on; kept in the record
        make : does the work; returns the result, the files written, and a sentence
        load : reads the result back
        also : content hashes of results of earlier stages
        code : function whose source, with all that it imports, the result depends on; by default `make`
        """
        key = f"{stage}/{subject}"
        if key in self._done:
            return self._done[key]
        hashes, digest = self._digest(stage, inputs, also, options, code or make)
        stored = None
        if not self._is_fresh(stage, key, digest):
            with locked(self.cache.lock, say=self.listener.note):
                if not self._is_fresh(stage, key, digest):  # it may have been done while we waited
                    sweep(self.out)
                    progress = self.listener.begin(stage, subject)
                    try:
                        result, outputs, sentence = make(progress)
                        self._refuse_changed(hashes, inputs)
                    except BaseException as error:
                        self.listener.end(stage, subject, "failed", str(error))
                        raise
                    stored = Stored.of(result)
                    self.cache.store(key, digest, outputs, options=options, inputs=hashes)
                    self._say(stage, subject, "done", sentence)
        if stored is None:
            stored = Stored(load)
            self._say(stage, subject, "unchanged", "")
        self._done[key] = stored
        return stored

    def _is_fresh(self, stage: str, key: str, digest: str) -> bool:
        return stage not in self.force and self.cache.is_fresh(key, digest)

    def _refuse_changed(self, hashes: Mapping[str, str], inputs: Sequence[Path]) -> None:
        """Raise if a raw file changed while it was read: the result belongs to neither state of it."""
        for path in inputs:
            if not path.is_file() or self.cache.sha256(path) != hashes[self._shown(path)]:
                raise DataError(
                    f"{path}: changed while it was read; wait until it is complete and run the command again"
                )

    def remember(
        self,
        stage: str,
        subject: str,
        outputs: Sequence[Path],
        *,
        inputs: Sequence[Path],
        also: Sequence[str],
        options: Mapping[str, Any],
        code: Callable[..., Any],
    ) -> None:
        """Note a result that came about inside another stage, so that its own stage finds it done."""
        hashes, digest = self._digest(stage, inputs, also, options, code)
        self.cache.store(f"{stage}/{subject}", digest, outputs, options=options, inputs=hashes)

    def has(
        self,
        stage: str,
        subject: str,
        *,
        inputs: Sequence[Path],
        also: Sequence[str],
        options: Mapping[str, Any],
        code: Callable[..., Any],
    ) -> bool:
        """Whether a stage has been done with just these inputs, options and code, and is not to be redone."""
        _, digest = self._digest(stage, inputs, also, options, code)
        return stage not in self.force and self.cache.is_fresh(f"{stage}/{subject}", digest)

    def _digest(
        self,
        stage: str,
        inputs: Sequence[Path],
        also: Sequence[str],
        options: Mapping[str, Any],
        code: Callable[..., Any],
    ) -> tuple[dict[str, str], str]:
        hashes = {self._shown(path): self.cache.sha256(path) for path in inputs}
        return hashes, self.cache.digest(stage, [*hashes.values(), *also], options, code_of(code))

    def outcome(self, stage: str, subject: str) -> str:
        """Return how a stage ended in this session: done or unchanged."""
        found = [item for item in self.outcomes if item["stage"] == stage and item["subject"] == subject]
        return found[-1]["outcome"] if found else "unchanged"

    def raw_inputs(self) -> dict[str, str]:
        """Return the hashes of all raw files that recordings were made from, by path below the campaign."""
        found: dict[str, str] = {}
        for stage in ("calibrate", "track", "sync"):
            for record in self.cache.records(stage):
                found |= record.inputs
        return dict(sorted(found.items()))

    def _say(self, stage: str, subject: str, outcome: Any, sentence: str) -> None:
        self.outcomes.append({"stage": stage, "subject": subject, "outcome": outcome, "sentence": sentence})
        self.listener.end(stage, subject, outcome, sentence)

    def _shown(self, path: Path) -> str:
        return path.relative_to(self.campaign.root).as_posix() if path.is_relative_to(self.campaign.root) else str(path)

    def _active(self) -> list[ExperimentSpec]:
        return [item for item in self.campaign.experiments if item.role != "ignore" and item.name not in self.failures]

    def _each(self, names: Sequence[str], action: Callable[[ExperimentSpec], _Result], verb: str) -> dict[str, _Result]:
        """Do something to each experiment; one that fails does not keep the others from being done."""
        chosen = [self.campaign.experiment(name) for name in names] if names else self._active()
        results: dict[str, _Result] = {}
        failures: dict[str, RfeaError] = {}
        for experiment in chosen:
            try:
                results[experiment.name] = action(experiment)
            except RfeaError as error:
                failures[experiment.name] = error
        if failures and not self.tolerant:
            raise measurement.failures_as_error(failures, len(chosen), verb)
        self.failures |= failures
        return results
