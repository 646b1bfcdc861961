"""The stages right of the waist: recordings to models, comparisons, diagnoses and the ladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.artefacts import CHOOSING_ROLES, Actuator, Comparison, Diagnosis, Ladder, ModelFit, Recording, Rung
from rfea_vision.errors import DataError, InputError
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.options.asking import as_record
from rfea_vision.options.given import refuse_impossible_lever
from rfea_vision.progress import Progress
from rfea_vision.stages import measurement
from rfea_vision.stages.naming import climb_apart, fit_apart, fitted_with
from rfea_vision.stages.products import (
    CLIMBING,
    compiling,
    describe_fit,
    describe_rung,
    load_prediction,
    rung_of,
    save_diagnosis,
    save_prediction,
    save_timings,
)
from rfea_vision.stages.runner import Runner, Stage
from rfea_vision.stages.stored import Stored, values
from rfea_vision.stages.warnings import warn_of_fitted

if TYPE_CHECKING:
    import xarray as xr

    from rfea_vision.critique.propose import Proposal

RUNG_FILES = ("model.json", "prediction.nc", "comparison.json", "diagnosis.json")

Recordings = Mapping[str, Stored[Recording]]


def model_folder(work: Runner, name: str) -> Path:
    """Return the folder of a model's artefacts.

    Raises
    ------
    InputError
        If the name, which may stand in a file of a stranger, cannot name a folder.
    """
    if Path(name).name != name or name.startswith("."):
        raise InputError(f"{work.out}: '{name}' cannot name a model; fit it again under another name")
    return work.out / "models" / name


def model_names(work: Runner) -> list[str]:
    """Return the models there are, in the order in which they were fitted."""
    known = [record.key.partition("/")[2] for record in work.cache.records("fit")]
    known = [name for name in known if (model_folder(work, name) / "model.json").is_file()]
    others = sorted(path.parent.name for path in (work.out / "models").glob("*/model.json"))
    return known + [name for name in others if name not in known]


def last_model(work: Runner) -> str | None:
    """Return the model that was fitted last."""
    names = model_names(work)
    return names[-1] if names else None


def fit(work: Runner, options: FitOptions) -> Stored[ModelFit]:
    """Fit one model to the training experiments and score it on the others; `test` stays untouched."""
    before = fitted_with(work.cache.record(f"fit/{options.name}"))
    known = before is not None and before.effects == options.effects and not options.effect_files
    if not known:  # the catalogue takes a second to load
        _refuse_unknown(options.effects, options.effect_files)
    # An unknown joint is refused before anything is measured, too.
    if not known and any("@" in effect for effect in options.effects):
        from rfea_vision.fitting.problem import parse_effects

        parse_effects(options.effects, options.segments)
    _refuse_impossible(work, options)
    recordings = measurement.recordings(work)
    actuator = common_actuator(work, recordings)
    options = fit_apart(work, options)
    folder = model_folder(work, options.name)

    def make(progress: Progress) -> tuple[ModelFit, list[Path], str]:
        work.tell(compiling("dynamics"))
        warn_of_fitted(work, recordings)
        model = _fitted(values(recordings), actuator, options, work.raw_inputs(recordings), folder, progress)
        return model, [folder / "model.json", folder / "prediction.nc"], describe_fit(model)

    stage = _fit_stage(work, options, recordings, actuator)
    return work.run(stage, make=make, load=lambda: ModelFit.load(folder / "model.json"))


def _refuse_unknown(effects: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Refuse effects that nobody declares, and faulty effect files, before anything is measured."""
    if effects or files:
        from rfea_vision.effects.catalogue import find_effects

        find_effects([name.partition("@")[0] for name in effects], files)


def _refuse_impossible(work: Runner, options: FitOptions) -> None:
    """Refuse, before anything is measured, a lever that no tube of the campaign can have."""
    for experiment in work.campaign.with_role("train"):
        refuse_impossible_lever(options.fixed, experiment.actuator)


def _fitted(
    recordings: Mapping[str, Recording],
    actuator: Actuator,
    options: FitOptions,
    inputs: dict[str, str],
    folder: Path,
    progress: Progress,
) -> ModelFit:
    from rfea_vision.critique import with_residual_torque
    from rfea_vision.fitting import fit_model, predict

    model = fit_model(recordings, actuator, options, progress=progress).model_copy(update={"inputs": inputs})
    save_prediction(folder, with_residual_torque(model, recordings, predict(model, recordings)))
    model.save(folder / "model.json")
    save_timings(folder, model)
    return model


def fitted(work: Runner, name: str) -> Stored[ModelFit]:
    """Return a model by name, fitted again with the same choices if it is out of date; InputError if there is none."""
    record = work.cache.record(f"fit/{name}")
    if record is not None and (options := fitted_with(record)) is not None:
        found = fit(work, options)
        work.cache.keep_place(record.key, record.order)  # nobody asked for this fit: it is not the one fitted last
        return found
    file = model_folder(work, name) / "model.json"
    if file.is_file():
        return Stored(lambda: ModelFit.load(file))
    if name == "base":
        return fit(work, FitOptions())
    there = ", ".join(model_names(work)) or "none"
    where = f"{work.out / 'models'}: no model '{name}'; there are: {there}"
    raise InputError(f"{where}; 'rfea fit --name {name}' makes one")


def compare(work: Runner, name: str) -> Stored[Comparison]:
    """Say where a model fails."""
    model = fitted(work, name)
    folder = model_folder(work, name)
    recordings = measurement.recordings(work)

    def make(progress: Progress) -> tuple[Comparison, list[Path], str]:
        comparison = _compared(model.value, values(recordings), folder)
        return comparison, [folder / "comparison.json"], comparison.sentences[0] if comparison.sentences else ""

    return work.run(_compare_stage(work, name), make=make, load=lambda: Comparison.load(folder / "comparison.json"))


def _compared(model: ModelFit, recordings: Mapping[str, Recording], folder: Path) -> Comparison:
    from rfea_vision.critique import compare as compare_model

    comparison = compare_model(model, recordings, load_prediction(folder, list(recordings)))
    comparison.save(folder / "comparison.json")
    return comparison


def diagnose(work: Runner, name: str, options: CritiqueOptions) -> Stored[Diagnosis]:
    """Say which effect is missing."""
    model = fitted(work, name)
    compared = compare(work, name)
    folder = model_folder(work, name)
    recordings = measurement.recordings(work)
    options = _with_files(options, fitted_with(work.cache.record(f"fit/{name}")))

    def make(progress: Progress) -> tuple[Diagnosis, list[Path], str]:
        return _diagnosed(model.value, values(recordings), options, compared.value, folder, progress)

    stage = _diagnose_stage(work, name, recordings, options)
    return work.run(stage, make=make, load=lambda: Diagnosis.load(folder / "diagnosis.json"))


def _diagnosed(
    model: ModelFit,
    recordings: Mapping[str, Recording],
    options: CritiqueOptions,
    compared: Comparison,
    folder: Path,
    progress: Progress,
) -> tuple[Diagnosis, list[Path], str]:
    from rfea_vision.critique import diagnose as diagnose_model
    from rfea_vision.critique.comparison import goes_with

    diagnosis, experiment = diagnose_model(
        model, recordings, options, where=compared.where, goes_with=goes_with(compared), progress=progress
    )
    said = ": ".join(filter(None, (diagnosis.said, ", ".join(diagnosis.named))))  # why is told by the command, once
    return diagnosis, save_diagnosis(folder, diagnosis, experiment), said


def propose(work: Runner, name: str, file: Path | None) -> Proposal:
    """Write a law for what a model leaves; InputError if the file is not called as a Python file is."""
    from rfea_vision.critique import propose as propose_law

    target = file or model_folder(work, name) / "proposed.py"
    if target.suffix != ".py":
        raise InputError(f"{target}: an effect is a Python file; call it {target.with_suffix('.py')}")
    model, recordings = fitted(work, name).value, values(measurement.recordings(work))
    return propose_law(model, recordings, target, effect_id=target.stem.replace("-", "_"))


def improve(work: Runner, options: FitOptions, critique: CritiqueOptions) -> Stored[Ladder]:
    """Climb the ladder; every rung is written as it comes, and a climb that was interrupted goes on from there."""
    _refuse_unknown(options.effects, (*options.effect_files, *critique.effect_files))
    _refuse_impossible(work, options)
    recordings = measurement.recordings(work, "train", "validate", "test")
    actuator = common_actuator(work, recordings)
    options, critique = climb_apart(work, options), _with_files(critique, options)
    path = work.out / Ladder.FILE

    def make(progress: Progress) -> tuple[Ladder, list[Path], str]:
        work.tell(compiling("dynamics"))  # before the import, which compiles the first of it
        from rfea_vision.critique import improve as climb_ladder

        climb = _Climb(work, options, critique, recordings, actuator)
        finished = climb.finished()
        work.tell("" if finished else CLIMBING)
        for model, diagnosis in finished:
            rung = climb.add(model, diagnosis, [model_folder(work, model.name) / file for file in RUNG_FILES])
            work.listener.note(f"{describe_rung(rung)} (as before)")
        ladder = climb_ladder(
            values(recordings),
            actuator,
            replace(options, study_segments=True),
            critique,
            on_rung=climb.save,
            finished=finished,
            progress=progress,
            say=work.tell,
        )
        ladder.save(path)
        files = [*climb.files, *_predict_test(work, ladder, recordings)]
        return ladder, [path, *dict.fromkeys(files)], ladder.stopped_because

    stage = Stage(
        "improve",
        "ladder",
        inputs=options.effect_files,
        earlier=_recording_hashes(work, recordings),
        options={"fit": as_record(options), "critique": as_record(critique), "actuator": actuator},
    )
    return work.run(stage, make=make, load=lambda: Ladder.load(path))


@dataclass(frozen=True)
class _Climb:
    """A ladder while it is climbed: what is asked for, the rungs so far, and their files."""

    work: Runner
    options: FitOptions
    critique: CritiqueOptions
    recordings: Recordings
    actuator: Actuator
    rungs: list[tuple[Rung, Diagnosis]] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)

    def add(self, model: ModelFit, diagnosis: Diagnosis, files: Sequence[Path]) -> Rung:
        """Go up by a rung."""
        rung = rung_of(model, diagnosis, self.rungs)
        self.rungs.append((rung, diagnosis))
        self.files.extend(files)
        return rung

    def fit_stage(self, model: ModelFit) -> Stage:
        """What makes a rung's model: its effects, and its segments where it has more than were asked for."""
        finer = self.options.with_segments(model.segments)
        own = replace(finer, name=model.name, effects=tuple(model.effects))
        return _fit_stage(self.work, own, self.recordings, self.actuator)

    def finished(self) -> list[tuple[ModelFit, Diagnosis]]:
        """Rungs of the ladder on disk that are up to date, from the first up to one that is not."""
        work, path, found = self.work, self.work.out / Ladder.FILE, list[tuple[ModelFit, Diagnosis]]()
        if "improve" in work.force or not path.is_file():
            return found
        for rung in Ladder.load(path).rungs:
            folder = model_folder(work, rung.model)
            if not (folder / "model.json").is_file():
                break
            model = ModelFit.load(folder / "model.json")
            if not found and model.name != self.options.name:  # it begins with another model, such as one of fewer segments
                break
            if not work.has(self.fit_stage(model)):
                break
            if not work.has(_diagnose_stage(work, model.name, self.recordings, self.critique)):
                break
            found.append((model, Diagnosis.load(folder / "diagnosis.json")))
        return found

    def save(
        self,
        model: ModelFit,
        predictions: Mapping[str, xr.Dataset],
        comparison: Comparison,
        diagnosis: Diagnosis,
        pressure: xr.Dataset | None,
    ) -> None:
        """Write a rung's artefacts, and that the stages that make them one by one are done."""
        work, folder = self.work, model_folder(self.work, model.name)
        seen = [name for name in self.recordings if work.campaign.experiment(name).role in CHOOSING_ROLES]
        model = model.model_copy(update={"inputs": work.raw_inputs(seen)})
        save_prediction(folder, predictions)
        model.save(folder / "model.json")
        save_timings(folder, model)
        comparison.save(folder / "comparison.json")
        made = [
            (self.fit_stage(model), [folder / "model.json", folder / "prediction.nc"]),
            (_compare_stage(work, model.name), [folder / "comparison.json"]),
        ]
        diagnosed = save_diagnosis(folder, diagnosis, pressure)
        made.append((_diagnose_stage(work, model.name, self.recordings, self.critique), diagnosed))
        rung = self.add(model, diagnosis, [file for _, files in made for file in files])
        so_far = [rung for rung, _ in self.rungs]
        Ladder(rungs=so_far, noise_floor_mm=model.noise_floor_mm, stopped_because="not finished").save(work.out / Ladder.FILE)
        work.remember(*made)  # at the very end: whoever is interrupted before finds the rung not done
        work.listener.note(describe_rung(rung))


def _predict_test(work: Runner, ladder: Ladder, recordings: Recordings) -> list[Path]:
    """Predict the test runs by the first and the last model, once the ladder has ended: nothing is chosen by them."""
    tested = {name: item for name, item in values(recordings).items() if item.role == "test"}
    if not ladder.test or not tested:
        return []
    from rfea_vision.fitting import predict

    files = []
    for name in dict.fromkeys((ladder.rungs[0].model, ladder.rungs[-1].model)):
        folder = model_folder(work, name)
        predicted = predict(ModelFit.load(folder / "model.json"), tested)
        files.append(save_prediction(folder, predicted, "prediction-test.nc"))
    return files


def _with_files(critique: CritiqueOptions, fit: FitOptions | None) -> CritiqueOptions:
    """Return the critique's options with the effect files of the fit, where it has none of its own."""
    return critique if critique.effect_files or fit is None else replace(critique, effect_files=fit.effect_files)


# -- what each stage depends on ------------------------------------------------------------------------------------


def _fit_stage(work: Runner, options: FitOptions, recordings: Recordings, actuator: Actuator) -> Stage:
    return Stage(
        "fit",
        options.name,
        inputs=options.effect_files,
        earlier=_recording_hashes(work, recordings, CHOOSING_ROLES),
        options={"fit": as_record(options), "actuator": actuator},
        code=_fitted,
    )


def _compare_stage(work: Runner, name: str) -> Stage:
    files = [model_folder(work, name) / file for file in ("model.json", "prediction.nc")]
    return Stage("compare", name, earlier=[work.cache.sha256(file) for file in files], code=_compared)


def _diagnose_stage(work: Runner, name: str, recordings: Recordings, critique: CritiqueOptions) -> Stage:
    model = work.cache.sha256(model_folder(work, name) / "model.json")
    return Stage(
        "diagnose",
        name,
        inputs=critique.effect_files,
        earlier=[model, *_recording_hashes(work, recordings, CHOOSING_ROLES)],
        options={"critique": as_record(replace(critique, budget_s=None))},  # the budget ends a climb, no diagnosis
        code=_diagnosed,
    )


def _recording_hashes(work: Runner, recordings: Recordings, roles: Sequence[str] | None = None) -> list[str]:
    """Return the content hashes of the recordings, of these roles alone where they are given."""
    names = [name for name in sorted(recordings) if roles is None or work.campaign.experiment(name).role in roles]
    return [f"{name}:{work.cache.sha256(work.out / name / 'recording.nc')}" for name in names]


def common_actuator(work: Runner, recordings: Recordings) -> Actuator:
    """Return the tube that the experiments share; the direction of bending may differ from run to run. DataError if they share none."""
    first = work.campaign.actuator
    tubes = {name: replace(work.campaign.experiment(name).actuator, bends=first.bends) for name in recordings}
    if len(set(tubes.values())) > 1:
        others = ", ".join(name for name, tube in tubes.items() if tube != first)
        where = f"{work.campaign.root}: actuator: {others} was run on another tube"
        raise DataError(f"{where}; one model fits one tube, give it a campaign of its own")
    return next(iter(tubes.values()))
