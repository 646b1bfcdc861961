"""The model under the slider: compiled laws and prepared recordings kept ready, so that a look takes a twentieth of a second."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.artefacts import CHOOSING_ROLES, ModelFit, Recording
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.simulation import Model
from rfea_vision.errors import InputError
from rfea_vision.fitting.observation import normals_of, observe_recording
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.prediction import NODES, as_dataset
from rfea_vision.fitting.problem import make_model, start_vector, with_zeros
from rfea_vision.fitting.residuals import Predicted, predict_observed
from rfea_vision.fitting.scoring import options_of
from rfea_vision.options import FitOptions
from rfea_vision.report.collect import Experiment
from rfea_vision.report.pack import Pack
from rfea_vision.report.series import pack_modelled
from rfea_vision.workbench.sliders import Slider, sliders_of

#: Longest step of a look, and how far Newton is taken: what the third-order integrator loses by it of the tip's RMSE against the
#: fit's own 1 ms and 1e-8, and what it gains in time, is measured by `python -m benchmarks workbench`.
LONGEST_STEP_S, TOLERANCE, FIT_TOLERANCE = 6e-3, 1e-4, 1e-8
TIP = np.array([1.0])


@dataclass(frozen=True)
class Chosen:
    """A model to play with: the fit it starts from, the effects it has, and the files of one's own laws."""

    fit: ModelFit
    effects: tuple[str, ...]
    files: tuple[Path, ...] = ()

    @property
    def key(self) -> tuple[object, ...]:
        """What the compiled law depends on; of one's own laws the content counts."""
        texts = tuple(file.read_text(encoding="utf-8") for file in self.files)
        return self.fit.segments, self.fit.joints, self.effects, texts, repr(sorted(self.fit.actuator.items()))

    def model(self) -> Model:
        """The model, with the integrator that values are refined for.

        Raises
        ------
        InputError
            If an effect is unknown or its law is wrong.
        """
        actuator = Actuator(**self.fit.actuator)
        options = replace(options_of(self.fit), effects=self.effects, effect_files=self.files)
        return replace(make_model(actuator, options, actuator.mirror), tolerance=TOLERANCE)


@dataclass(frozen=True)
class PlayedRun:
    """One recording made ready: as the fit sees it, and with the long steps of a look."""

    item: Observed
    quick: Observed
    experiment: Experiment
    recording: Recording

    @cached_property
    def normals(self) -> np.ndarray | None:
        """Normals (frames, nodes, 2) of the measured centre line, which no slider moves; None where there is none."""
        data = self.recording.dataset
        return normals_of(data["midline"].values) if "midline" in data else None

    @property
    def nodes(self) -> np.ndarray:
        """Places (nodes,) on the centre line that are drawn, 0 at the clamp, 1 at the tip."""
        return np.linspace(0, 1, self.recording.dataset.sizes.get("node", NODES))


class Player:
    """Simulates the training and held-out runs of a campaign with any parameters."""

    def __init__(self, experiments: Mapping[str, Experiment]) -> None:
        self.runs: dict[str, PlayedRun] = {}
        for name, experiment in experiments.items():
            if experiment.recording is not None and experiment.role in CHOOSING_ROLES:
                recording = Recording(experiment.recording)
                item = observe_recording(recording)
                self.runs[name] = PlayedRun(item, quickened(item), experiment, recording)
        self._models: dict[tuple[object, ...], Future[Model]] = {}
        self._threads = ThreadPoolExecutor(2)
        self._lock = threading.Lock()

    def open(self, chosen: Chosen) -> list[Slider]:
        """Sliders of a model; its law is compiled behind the scenes from here on.

        Raises
        ------
        InputError
            If an effect is unknown or its law is wrong.
        """
        model = chosen.model()
        with self._lock:
            if chosen.key not in self._models:
                self._models[chosen.key] = self._compile_behind(model, chosen)
        return sliders_of(chosen.fit, model, start_vector(model, Actuator(**chosen.fit.actuator), chosen.fit.segments))

    def ready(self, chosen: Chosen) -> bool:
        """Whether the law has been compiled; raises what kept it from being so."""
        future = self._models.get(chosen.key)
        return future is not None and future.done() and future.result() is not None

    def _compile_behind(self, model: Model, chosen: Chosen) -> Future[Model]:
        """Compile in a thread that does not keep the workbench from ending."""
        future: Future[Model] = Future()

        def work() -> None:
            try:
                future.set_result(self._compiled(model, chosen))
            except BaseException as error:
                future.set_exception(error)

        threading.Thread(target=work, daemon=True).start()
        return future

    def _compiled(self, model: Model, chosen: Chosen) -> Model:
        """Derive and compile by running a quarter of a second of the first run."""
        run = next(iter(self.runs.values()), None)
        if run is not None:
            excitation = run.quick.excitation
            count = max(2, round(0.25 / excitation.step_s))
            short = excitation.first(count)
            start = start_vector(model, Actuator(**chosen.fit.actuator), chosen.fit.segments)
            model.simulate(start, short, np.array([short.start_s]))
        return model

    def play(
        self, chosen: Chosen, values: Mapping[str, float], shown: str, *, exact: bool = False
    ) -> tuple[dict[str, Any], Pack]:
        """One look: the modelled tube of the run that is shown, and the errors of all.

        Parameters
        ----------
        chosen : the model
        values : parameters in SI; one that is missing keeps its fitted value, or is absent
        shown : name of the run whose tube is wanted
        exact : in the steps of a fit, not in those of a look

        Returns
        -------
        dict, Pack
            Header for the page, with the addresses of its arrays in the pack.

        Raises
        ------
        InputError
            If a value is no number or no such run is there.
        """
        begun = time.perf_counter()
        if shown not in self.runs:
            raise InputError(f"{shown}: is no training or held-out run that has been synchronised")
        if chosen.key not in self._models:
            self.open(chosen)
        model = self._models[chosen.key].result()
        par = _vector(chosen, model, values)
        options = options_of(chosen.fit)
        looks = {  # the run that is shown goes first: it is made ready for the page while the others are simulated
            name: self._threads.submit(self._look, model, par, chosen.fit, options, name, shown, exact)
            for name in sorted(self.runs, key=lambda name: name != shown)
        }
        run, pack, look = self.runs[shown], Pack(), looks[shown].result()
        modelled = as_dataset(model, run.item, run.recording, look, run.nodes, run.normals)
        why = {} if look else {"prediction": f"The model cannot be simulated on {shown} with these values."}
        record = pack_modelled(modelled, run.recording.dataset, run.experiment, pack, why, "this model")
        seen = {name: looks[name].result() for name in self.runs}
        header = {"run": record, **_errors(self.runs, seen), "ms": 1000 * (time.perf_counter() - begun)}
        return header, pack

    def _look(
        self, model: Model, par: np.ndarray, fit: ModelFit, options: FitOptions, name: str, shown: str, exact: bool
    ) -> Predicted | None:
        run = self.runs[name]
        item, quickly = (with_zeros(one, options) for one in (run.item, run.quick))
        score = fit.experiments.get(name)
        clock = float(score.nuisance.get("clock_offset_s", 0.0)) if score is not None else 0.0
        fractions = run.nodes if name == shown else TIP
        if exact:
            item = item.in_steps_of(None if score is None else score.step_s)
            return predict_observed(replace(model, tolerance=FIT_TOLERANCE), par, item, (), clock, fractions)
        quick = predict_observed(model, par, quickly, (), clock, fractions)
        # what long steps do not survive, short ones may
        return quick if quick is not None else predict_observed(model, par, item, (), clock, fractions)


def quickened(item: Observed) -> Observed:
    """The same run with the longest steps of a look, which push as much."""
    given = item.excitation
    every = math.floor(LONGEST_STEP_S / given.step_s * (1 + 1e-9))  # times of a log are rounded
    return item if every < 2 else replace(item, excitation=given.coarser(every))


def _vector(chosen: Chosen, model: Model, values: Mapping[str, float]) -> np.ndarray:
    """Parameters in the model's order: as asked, else as fitted, else absent."""
    start = start_vector(model, Actuator(**chosen.fit.actuator), chosen.fit.segments)
    absent: dict[str, float] = {
        f"{effect.id}.{name}": spec.absent
        for effect in model.effects
        for name, spec in effect.parameters.items()
        if spec.absent is not None
    }
    fitted = {name: parameter.value for name, parameter in chosen.fit.parameters.items()}
    known = {**absent, **fitted, **values}
    return np.array([known.get(name, first) for name, first in zip(model.names, start, strict=True)], dtype=float)


def _errors(runs: Mapping[str, PlayedRun], seen: Mapping[str, Predicted | None]) -> dict[str, Any]:
    """Root mean square error of every run and role: of the tip in mm or, where only an angle was measured, of it in deg."""
    squares: dict[str, np.ndarray | None] = {}
    with_tip = all(run.item.has_tip for run in runs.values())
    for name, run in runs.items():
        one = seen[name]
        if one is None:
            squares[name] = None
        elif with_tip:
            squares[name] = np.sum(((run.item.points[:, -1] - one.points[:, -1]) / MM) ** 2, axis=1)
        else:
            squares[name] = np.rad2deg(run.item.angle - one.angle) ** 2
    by_run = {name: None if parts is None else float(np.sqrt(np.nanmean(parts))) for name, parts in squares.items()}
    roles: dict[str, float | None] = {}
    for role in CHOOSING_ROLES:
        parts = [squares[name] for name, run in runs.items() if run.item.role == role]
        whole = [part for part in parts if part is not None]
        roles[role] = float(np.sqrt(np.nanmean(np.concatenate(whole)))) if whole and len(whole) == len(parts) else None
    return {"unit": "mm" if with_tip else "deg", "runs": by_run, **roles}
