"""A campaign at work: every stage as a method, each running what it needs and is out of date."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rfea_vision.artefacts import Calibration, Comparison, Diagnosis, Ladder, ModelFit, Recording, Track
from rfea_vision.campaign import ExperimentSpec, load_campaign
from rfea_vision.errors import RfeaError
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.options.asking import declares, from_keywords
from rfea_vision.progress import Listener
from rfea_vision.stages import cameras, measurement, mechanics, publishing
from rfea_vision.stages.runner import Runner
from rfea_vision.stages.stored import Stored, values

if TYPE_CHECKING:
    from rfea_vision.critique.propose import Proposal

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


class Workspace(Runner):
    """A campaign and its results; every stage is a method. Attributes as those of `Runner`."""

    # -- measurement ---------------------------------------------------------------------------------------------

    def calibrate(self) -> Calibration | None:
        """Calibrate the campaign's camera, and those of experiments with their own; None where nothing is pictured."""
        found: list[Stored[Calibration]] = []
        camera = self.campaign.camera
        # A scale without a board belongs to the film it was read from.
        if camera is not None and (camera.scale is None or any(item.camera == camera for item in self.active())):
            path = cameras.calibration_path(self, None)
            found.append(cameras.calibrate(self, camera, path, self.campaign.name, length_m=self.campaign.actuator.length))
        found += [self.calibration_of(item) for item in self.active() if item.video is not None]
        return found[0].value if found else None

    def track(self, names: Sequence[str] = ()) -> dict[str, Track]:
        """Track the experiments (all, or those named) and return the tracks by name."""
        return values(self.each(names, self.track_of, "tracked"))

    def preview(self, names: Sequence[str] = ()) -> dict[str, Path]:
        """Draw the tracks over the videos and return the files by name; experiments without pictures are left out."""
        chosen = names or [item.name for item in self.active() if item.video is not None]
        return values(self.each(chosen, lambda item: measurement.preview(self, item), "drawn")) if chosen else {}

    def sync(self, names: Sequence[str] = ()) -> dict[str, Recording]:
        """Bring tracks and pressure logs on one clock and return the recordings by name."""
        return values(self.each(names, self.recording_of, "synchronised"))

    def measured(self) -> dict[str, Recording | Track]:
        """Return the recordings by name, and the tracks of runs without a pressure log, or with one that is on no one clock with it."""

        def of(item: ExperimentSpec) -> Recording | Track:
            tracked = self.track_of(item)
            if not item.pressure.missing:
                try:
                    return self.recording_of(item).value
                except RfeaError as error:
                    why = str(error).removeprefix(f"{item.name}: ")
                    self.tell(f"warning: {item.name}: taken by the track's own times, without pressure, because of {why}")
            return tracked.value

        return self.each((), of, "measured")

    def calibration_of(self, experiment: ExperimentSpec) -> Stored[Calibration]:
        """Return the calibration that an experiment's pictures need."""
        return cameras.calibration_of(self, experiment)

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
        judged = {name: value for name, value in asked.items() if declares(CritiqueOptions, name)}
        fitted = {name: value for name, value in asked.items() if declares(FitOptions, name) or name not in judged}
        fit = fit or from_keywords(FitOptions, fitted)
        return mechanics.improve(self, fit, critique or from_keywords(CritiqueOptions, judged)).value

    def propose(self, model: str | None = None, file: Path | str | None = None) -> Proposal:
        """Write a law for what a model leaves (default: the one fitted last, or the base model) as an effect file.

        Parameters
        ----------
        model : its name
        file : where the law is written; default ``proposed.py`` among the model's results
        """
        return mechanics.propose(
            self, model or mechanics.last_model(self) or "base", None if file is None else Path(file)
        )

    # -- publishing ----------------------------------------------------------------------------------------------

    def report(self) -> Path:
        """Write the report and return its path; with no model yet, `improve` comes first."""
        return publishing.report(self).value

    def recordings(self, *roles: str) -> dict[str, Recording]:
        """Return the recordings of these roles (default: all but test runs) by name; DataError if no training run is left."""
        return values(measurement.recordings(self, *roles))
