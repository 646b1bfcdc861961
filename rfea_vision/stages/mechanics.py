"""The stages right of the waist: recordings to models, comparisons, diagnoses and the ladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from rfea_vision.artefacts import Actuator, Comparison, Diagnosis, Ladder, ModelFit, Recording, Rung
from rfea_vision.errors import DataError, InputError
from rfea_vision.files import read_dataset, whole_file, write_datasets
from rfea_vision.progress import Progress
from rfea_vision.stages.cache import StageRecord, plain

if TYPE_CHECKING:
    from rfea_vision.fitting import FitOptions
    from rfea_vision.stages.workspace import Workspace

CODE = ("tube", "steady", "dynamics", "effects", "fitting", "critique")
PREDICTED_ROLES = ("train", "validate")


def fit_options(
    name: str | None, *, add: Sequence[str] = (), effect_files: Sequence[Path | str] = (), **more: Any
) -> FitOptions:
    """Return the options of a fit; without a name the model is called after its effects."""
    from rfea_vision.fitting import FitOptions

    known = {item.name for item in fields(FitOptions)}
    for key in more:
        if key not in known:
            raise InputError(f"fit: unknown option '{key}'; known are {', '.join(sorted(known))}")
    effects = tuple(dict.fromkeys(add))
    files = tuple(Path(file).expanduser().resolve() for file in effect_files)
    for file in files:
        if not file.is_file():
            raise InputError(f"--effect-file {file}: not found; 'rfea effects new {file.name}' writes a template")
    return FitOptions(name=name or "+".join(["base", *effects]), effects=effects, effect_files=files, **more)


def model_folder(work: Workspace, name: str) -> Path:
    """Return the folder of a model's artefacts."""
    return work.out / "models" / name


def model_names(work: Workspace) -> list[str]:
    """Return the models there are, in the order in which they were fitted."""
    known = [record.key.partition("/")[2] for record in work.cache.records("fit")]
    known = [name for name in known if (model_folder(work, name) / "model.json").is_file()]
    others = sorted(path.parent.name for path in (work.out / "models").glob("*/model.json"))
    return known + [name for name in others if name not in known]


def last_model(work: Workspace) -> str | None:
    """Return the model that was fitted last."""
    names = model_names(work)
    return names[-1] if names else None


def fit(work: Workspace, options: FitOptions) -> ModelFit:
    """Fit one model to the training experiments and score it on the others; `test` stays untouched."""
    recordings = work.recordings(*PREDICTED_ROLES)
    actuator = common_actuator(work, recordings)
    folder = model_folder(work, options.name)

    def make(progress: Progress) -> tuple[ModelFit, list[Path], str]:
        from rfea_vision.critique import with_residual_torque
        from rfea_vision.fitting import fit_model, predict

        model = fit_model(recordings, actuator, options, progress=progress)
        model = model.model_copy(update={"inputs": work.raw_inputs()})
        save_prediction(folder, with_residual_torque(model, recordings, predict(model, recordings)))
        model.save(folder / "model.json")
        return model, [folder / "model.json", folder / "prediction.nc"], describe_fit(model)

    return work.run(
        "fit",
        options.name,
        **fit_parts(work, options, recordings, actuator),
        make=make,
        load=lambda: ModelFit.load(folder / "model.json"),
    )


def fit_parts(
    work: Workspace, options: FitOptions, recordings: Mapping[str, Recording], actuator: Actuator
) -> dict[str, Any]:
    """Return what a fit depends on."""
    seen = {name: recording for name, recording in recordings.items() if recording.role in PREDICTED_ROLES}
    return {
        "inputs": list(options.effect_files),
        "also": recording_hashes(work, seen),
        "options": {"fit": _kept(options), "actuator": actuator},
        "code": CODE,
    }


def compare_parts(work: Workspace, name: str) -> dict[str, Any]:
    """Return what a comparison depends on."""
    files = [model_folder(work, name) / file for file in ("model.json", "prediction.nc")]
    return {"inputs": [], "also": [work.cache.sha256(file) for file in files], "options": {}, "code": CODE}


def diagnose_parts(
    work: Workspace, name: str, recordings: Mapping[str, Recording], files: Sequence[Path], seed: int
) -> dict[str, Any]:
    """Return what a diagnosis depends on."""
    seen = {name: recording for name, recording in recordings.items() if recording.role in PREDICTED_ROLES}
    model = work.cache.sha256(model_folder(work, name) / "model.json")
    also = [model, *recording_hashes(work, seen)]
    return {"inputs": list(files), "also": also, "options": {"seed": seed}, "code": CODE}


def fitted(work: Workspace, name: str) -> ModelFit:
    """Return a model by name, fitted again with the same options if it is out of date."""
    record = work.cache.record(f"fit/{name}")
    if record is not None and "fit" in record.options:
        return fit(work, options_of(record))
    file = model_folder(work, name) / "model.json"
    if file.is_file():
        return ModelFit.load(file)
    if name == "base":
        return fit(work, fit_options("base"))
    there = ", ".join(model_names(work)) or "none"
    raise InputError(
        f"{work.out / 'models'}: no model '{name}'; there are: {there}; 'rfea fit --name {name}' makes one"
    )


def compare(work: Workspace, name: str) -> Comparison:
    """Say where a model fails."""
    model = fitted(work, name)
    folder = model_folder(work, name)
    recordings = work.recordings(*PREDICTED_ROLES)

    def make(progress: Progress) -> tuple[Comparison, list[Path], str]:
        from rfea_vision.critique import compare as compare_model

        comparison = compare_model(model, recordings, load_prediction(folder, list(recordings)))
        comparison.save(folder / "comparison.json")
        return comparison, [folder / "comparison.json"], comparison.sentences[0] if comparison.sentences else ""

    return work.run(
        "compare",
        name,
        **compare_parts(work, name),
        make=make,
        load=lambda: Comparison.load(folder / "comparison.json"),
    )


def diagnose(work: Workspace, name: str, *, effect_files: Sequence[Path | str] = (), seed: int = 0) -> Diagnosis:
    """Say which effect is missing."""
    model = fitted(work, name)
    compare(work, name)
    folder = model_folder(work, name)
    recordings = work.recordings(*PREDICTED_ROLES)
    record = work.cache.record(f"fit/{name}")
    files = tuple(Path(file).expanduser().resolve() for file in effect_files)
    if not files and record is not None:
        files = tuple(options_of(record).effect_files)

    def make(progress: Progress) -> tuple[Diagnosis, list[Path], str]:
        from rfea_vision.critique import diagnose as diagnose_model

        diagnosis, experiment = diagnose_model(model, recordings, effect_files=files, seed=seed, progress=progress)
        pressure = None if experiment is None else (experiment["log_time"].values, experiment["pressure"].values)
        outputs = save_diagnosis(folder, diagnosis, pressure)
        return diagnosis, outputs, diagnosis.sentence or diagnosis.verdict

    return work.run(
        "diagnose",
        name,
        **diagnose_parts(work, name, recordings, files, seed),
        make=make,
        load=lambda: Diagnosis.load(folder / "diagnosis.json"),
    )


def improve(work: Workspace, options: FitOptions, *, budget_s: float) -> Ladder:
    """Climb the ladder; every rung is written as it comes, so that an interruption keeps it."""
    recordings = work.recordings("train", "validate", "test")
    actuator = common_actuator(work, recordings)
    path = work.out / Ladder.FILE

    def make(progress: Progress) -> tuple[Ladder, list[Path], str]:
        from rfea_vision.critique import improve as climb

        outputs: list[Path] = []
        rungs: list[Rung] = []

        def on_rung(
            model: ModelFit, predictions: Mapping[str, xr.Dataset], comparison: Comparison, diagnosis: Diagnosis
        ) -> None:
            outputs.extend(_save_rung(work, options, recordings, actuator, (model, predictions, comparison, diagnosis)))
            rungs.append(rung_of(model, diagnosis, rungs))
            Ladder(rungs=rungs, noise_floor_mm=model.noise_floor_mm, stopped_because="not finished").save(path)
            work.listener.note(describe_rung(rungs[-1]))

        ladder = climb(recordings, actuator, options, budget_s=budget_s, on_rung=on_rung, progress=progress)
        ladder.save(path)
        return ladder, [path, *dict.fromkeys(outputs)], ladder.stopped_because

    return work.run(
        "improve",
        "ladder",
        inputs=list(options.effect_files),
        also=recording_hashes(work, recordings),
        options={"fit": _kept(options), "actuator": actuator, "budget_s": budget_s},
        code=CODE,
        make=make,
        load=lambda: Ladder.load(path),
    )


def _save_rung(
    work: Workspace,
    options: FitOptions,
    recordings: Mapping[str, Recording],
    actuator: Actuator,
    rung: tuple[ModelFit, Mapping[str, xr.Dataset], Comparison, Diagnosis],
) -> list[Path]:
    """Write a rung's artefacts, and note them as if fit, compare and diagnose had been called one by one."""
    model, predictions, comparison, diagnosis = rung
    model = model.model_copy(update={"inputs": work.raw_inputs()})
    folder = model_folder(work, model.name)
    fit_files = [folder / "model.json", folder / "prediction.nc"]
    save_prediction(folder, predictions)
    model.save(fit_files[0])
    own = replace(options, name=model.name, effects=tuple(model.effects))
    work.remember("fit", model.name, fit_files, **fit_parts(work, own, recordings, actuator))
    comparison.save(folder / "comparison.json")
    work.remember("compare", model.name, [folder / "comparison.json"], **compare_parts(work, model.name))
    outputs = save_diagnosis(folder, *_without_pressure(diagnosis))
    parts = diagnose_parts(work, model.name, recordings, options.effect_files, options.seed)
    work.remember("diagnose", model.name, outputs, **parts)
    return [*fit_files, folder / "comparison.json", *outputs]


def _without_pressure(diagnosis: Diagnosis) -> tuple[Diagnosis, tuple[Any, Any] | None]:
    """Take the next experiment's pressure, which a rung carries with it, out of its diagnosis."""
    content = diagnosis.model_dump(by_alias=True)
    given = content.pop("next_pressure", None)
    pressure = None if given is None else (given["time_s"], given["pressure_kPa"])
    return Diagnosis.model_validate(content), pressure


def rung_of(model: ModelFit, diagnosis: Diagnosis, below: Sequence[Rung]) -> Rung:
    """Return the rung that a model stands on, above those `below`."""
    known = {part for rung in below for part in (rung.added,) if part}
    new = [effect for effect in model.effects if effect not in known]
    train, validate = model.metrics.get("train"), model.metrics.get("validate")
    return Rung(
        model=model.name,
        added=new[-1] if below and new else None,
        train_tip_rmse_mm=train.tip_rmse_mm if train else None,
        validate_tip_rmse_mm=validate.tip_rmse_mm if validate else None,
        delta_bic=None,
        verdict=diagnosis.verdict,
    )


def describe_fit(model: ModelFit) -> str:
    """Say how well a model fits."""
    parts = []
    for role, metrics in model.metrics.items():
        if metrics.tip_rmse_mm is not None:
            parts.append(f"{role} {metrics.tip_rmse_mm:.3f} mm")
        elif metrics.angle_rmse_deg is not None:
            parts.append(f"{role} {metrics.angle_rmse_deg:.3f} deg")
    return f"{model.status}, tip RMSE {', '.join(parts)}" if parts else model.status


def describe_rung(rung: Rung) -> str:
    """Say what a rung has brought."""

    def shown(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} mm"

    errors = f"train {shown(rung.train_tip_rmse_mm)}, validate {shown(rung.validate_tip_rmse_mm)}"
    return f"{rung.model}: {errors}, {rung.verdict}"


def common_actuator(work: Workspace, recordings: Mapping[str, Recording]) -> Actuator:
    """Return the tube that the experiments share; the direction of bending may differ from run to run."""
    first = work.campaign.actuator
    tubes = {name: replace(work.campaign.experiment(name).actuator, bends=first.bends) for name in recordings}
    distinct = set(tubes.values())
    if len(distinct) > 1:
        others = [name for name, tube in tubes.items() if tube != first]
        where = f"{work.campaign.root}: actuator: {', '.join(others)} was run on another tube"
        raise DataError(f"{where}; one model fits one tube, give it a campaign of its own")
    return distinct.pop()


def recording_hashes(work: Workspace, recordings: Mapping[str, Recording]) -> list[str]:
    """Return the content hashes of the recordings."""
    return [f"{name}:{work.cache.sha256(work.out / name / 'recording.nc')}" for name in sorted(recordings)]


def save_prediction(folder: Path, predictions: Mapping[str, xr.Dataset]) -> None:
    """Write prediction.nc, one group per experiment."""
    groups: dict[str | None, xr.Dataset] = {name: dataset for name, dataset in predictions.items()}  # noqa: C416
    write_datasets(folder / "prediction.nc", groups)


def load_prediction(folder: Path, experiments: Sequence[str]) -> dict[str, xr.Dataset]:
    """Read the groups of prediction.nc."""
    return {name: read_dataset(folder / "prediction.nc", name) for name in experiments}


def save_diagnosis(folder: Path, diagnosis: Diagnosis, pressure: tuple[Any, Any] | None) -> list[Path]:
    """Write the diagnosis, and the pressure to play next (s, kPa) as a CSV beside it."""
    outputs = [folder / "diagnosis.json"]
    if pressure is not None and diagnosis.next_experiment is not None:
        path = folder / Path(diagnosis.next_experiment.pressure).name
        columns = {"time_s": pressure[0], "pressure_kPa": pressure[1]}
        with whole_file(path) as temporary:
            pd.DataFrame(columns).to_csv(temporary, float_format="%.6g", index=False)
        outputs.append(path)
    diagnosis.save(outputs[0])
    return outputs


def _kept(options: FitOptions) -> dict[str, Any]:
    """Return the options as they are kept in the record: paths in full, so that the fit can be done again."""
    kept = plain(options)
    kept["effect_files"] = [str(path) for path in options.effect_files]
    return kept


def options_of(record: StageRecord) -> FitOptions:
    from rfea_vision.fitting import FitOptions

    known = {item.name for item in fields(FitOptions)}
    kept: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in record.options["fit"].items()
        if key in known
    }
    kept["effect_files"] = tuple(Path(path) for path in kept.get("effect_files", ()))
    return FitOptions(**kept)
