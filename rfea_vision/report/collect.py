"""Reads an `rfea/` folder: whatever is there, and one sentence for whatever is not."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr

from rfea_vision.artefacts import Comparison, Diagnosis, Ladder, ModelFit, Recording, Rung, Track
from rfea_vision.errors import RfeaError
from rfea_vision.files import dataset_groups, read_dataset
from rfea_vision.report.camera import read_camera

_ROLE_ORDER = {"train": 0, "validate": 1, "test": 2}  # as runs are shown
_Read = TypeVar("_Read")


@dataclass(frozen=True)
class Experiment:
    """One recorded run; ``absent`` says why for each piece that is missing. A recording holds all that its track does."""

    name: str
    role: str
    recording: xr.Dataset | None
    track: xr.Dataset | None
    clip: bytes | None
    clip_info: Mapping[str, Any]
    absent: Mapping[str, str]

    @property
    def measured(self) -> xr.Dataset | None:
        """The recording, or the track where there is no recording."""
        return self.recording if self.recording is not None else self.track


@dataclass(frozen=True)
class LadderStep:
    """One rung of the ladder, or a fit beside it, with everything that was found out about it."""

    rung: Rung
    on_ladder: bool
    fit: ModelFit
    comparison: Comparison | None
    diagnosis: Diagnosis | None
    predictions: Mapping[str, xr.Dataset]
    next_pressure: tuple[list[float], list[float]] | None
    absent: Mapping[str, str]
    study_seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """What was said of this model; the ladder remembers it where the diagnosis cannot be read."""
        return self.diagnosis.verdict if self.diagnosis else self.rung.verdict

    @property
    def asks_less(self) -> bool:
        """Whether it is complete for the held-out runs alone."""
        return self.diagnosis.asks_less if self.diagnosis else self.rung.asks_less

    @property
    def outcome(self) -> str:
        """The verdict, or that it is too uncertain."""
        return self.diagnosis.outcome if self.diagnosis else self.rung.outcome

    @property
    def uncertain_because(self) -> str:
        """Why the verdict is none to rest on, as a clause; empty where nobody said."""
        return self.diagnosis.uncertain_because if self.diagnosis else self.rung.uncertain_because


@dataclass(frozen=True)
class Evidence:
    """Everything that the page shows; ``photos`` are small JPEGs of the board by the name of their photo."""

    folder: Path
    experiments: tuple[Experiment, ...]
    steps: tuple[LadderStep, ...]
    ladder: Ladder | None
    camera: Mapping[str, Any] | None
    absent: Mapping[str, str] = field(default_factory=dict)
    photos: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def climbed(self) -> list[LadderStep]:
        """The rungs of the ladder; without one, every model there is."""
        return [step for step in self.steps if step.on_ladder] or list(self.steps)

    @property
    def last(self) -> LadderStep | None:
        """The top rung of the ladder, or the last model fitted."""
        return self.climbed[-1] if self.steps else None


def collect(folder: Path, runs: Collection[str] | None = None) -> Evidence:
    """Read all artefacts below `folder` (``<campaign>/rfea``); with `runs`, of these experiments alone.

    Results of runs that were renamed, taken out or set aside since stay in the folder, and are none of the campaign's.
    A missing or unreadable file becomes a sentence in ``absent``, never an error.
    """
    absent = _Absent()
    if not folder.is_dir():
        absent["folder"] = f"{folder} is not there: no command has written results for this campaign yet."
    no_ladder = "No ladder yet: run `rfea improve` to let the tool add effects one by one."
    ladder = absent.read("ladder", Ladder.load, folder / Ladder.FILE, no_ladder)
    experiments = tuple(sorted(_experiments(folder, runs), key=lambda e: (_ROLE_ORDER.get(e.role, 3), e.name)))
    steps = tuple(_steps(folder, ladder, absent))
    if not steps:
        absent.setdefault("models", "No model yet: run `rfea fit` or `rfea improve`.")
    no_camera = "No camera was calibrated here: the experiments came as tracks from another tool, or `rfea calibrate` has not run."
    camera = absent.read("calibration", read_camera, folder / "calibration" / "camera.yaml", no_camera)
    photos = {path.stem: path.read_bytes() for path in sorted((folder / "calibration" / "photos").glob("*.jpg"))}
    return Evidence(folder, experiments, steps, ladder, camera, absent, photos)


class _Absent(dict[str, str]):
    """Why pieces are missing: one sentence each."""

    def read(self, key: str, reader: Callable[[Path], _Read], path: Path, missing: str = "") -> _Read | None:
        """`reader(path)`; or None, with the reason under `key`: `missing` where there is no such file."""
        if not path.exists():
            if missing:
                self[key] = missing
            return None
        try:
            return reader(path)
        except RfeaError as error:
            self[key] = f"{error}"
        except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
            self[key] = f"{path.name} could not be read ({error}); run the stage that writes it with --force."
        return None


def _read_mapping(path: Path) -> dict[str, Any]:
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ValueError(f"it holds a {type(content).__name__} in place of names and values")
    return content


def _experiments(folder: Path, runs: Collection[str] | None) -> list[Experiment]:
    found = []
    rooms = {path.parent for pattern in ("*/recording.nc", "*/track.nc") for path in folder.glob(pattern)}
    for room in sorted(room for room in rooms if runs is None or room.name in runs):
        absent = _Absent()
        no_recording = f"{room.name} has no recording yet: run `rfea sync`."
        recording = absent.read("recording", Recording.load, room / "recording.nc", no_recording)
        track = absent.read("track", Track.load, room / "track.nc") if recording is None else None
        clip, info = _clip(room, absent)
        role = str(recording.dataset.attrs.get("role", "")) if recording else ""
        data = (recording.dataset if recording else None, track.dataset if track else None)
        found.append(Experiment(room.name, role or "not synchronised", *data, clip, info, absent))
    return found


def _read_clip(path: Path) -> dict[str, Any]:
    """What `make_clip` says of a film, as numbers: the page draws by them."""
    content = _read_mapping(path)
    told = {key: float(content[key]) for key in ("x_min_mm", "y_max_mm", "px_per_mm", "width", "height")}
    if not (times := [float(time) for time in content["times_s"]]):
        raise ValueError("it has no frames")
    return {**content, **told, "times_s": times}


def _clip(room: Path, absent: _Absent) -> tuple[bytes | None, dict[str, Any]]:
    no_film = "There is no film of this run (its track came from another tool), so the tube is drawn alone."
    info = absent.read("clip", _read_clip, room / "clip.json", no_film)
    if info is None:
        return None, {}
    film = room / Path(str(info.get("file", "clip.mp4"))).name  # one that leads elsewhere is none, as in `_find`
    if not film.exists():
        absent["clip"] = f"{film.name} is missing beside clip.json: run `rfea track` with --force."
        return None, {}
    return film.read_bytes(), info


def _steps(folder: Path, ladder: Ladder | None, absent: _Absent) -> list[LadderStep]:
    models: dict[str, ModelFit] = {}
    for path in sorted((folder / "models").glob("*/model.json")):
        if (fit := absent.read("models", ModelFit.load, path)) is not None:
            models[path.parent.name] = fit
    steps = []
    for rung in ladder.rungs if ladder else []:
        below = steps[-1].diagnosis if steps else None
        if rung.added and not rung.tied and below is not None:  # a ladder written before rungs told of their ties
            rung = rung.model_copy(update={"tied": below.rivals_of(rung.added)})
        if rung.model in models:
            steps.append(_step(folder, models.pop(rung.model), rung, on_ladder=True))
        else:
            absent["models"] = f"models/{rung.model} is named in ladder.json but is not there: run `rfea improve --force`."
    for name, fit in sorted(models.items(), key=lambda item: (len(item[1].effects), item[0])):
        rung = Rung.of(fit, model=name, added=" + ".join(fit.effects) or None, verdict="")
        steps.append(_step(folder, fit, rung, on_ladder=False))
    return steps


def _step(folder: Path, fit: ModelFit, rung: Rung, *, on_ladder: bool) -> LadderStep:
    room, absent = folder / "models" / rung.model, _Absent()
    no_comparison = f"{rung.model} has no comparison yet: run `rfea compare`."
    comparison = absent.read("comparison", Comparison.load, room / "comparison.json", no_comparison)
    no_diagnosis = f"{rung.model} has no diagnosis yet: run `rfea diagnose`."
    diagnosis = absent.read("diagnosis", Diagnosis.load, room / "diagnosis.json", no_diagnosis)
    no_prediction = f"{rung.model} has no prediction.nc: run `rfea compare`."
    predictions = absent.read("prediction", _read_groups, room / "prediction.nc", no_prediction) or {}
    if (room / "prediction.nc").exists():
        predictions |= absent.read("prediction", _read_groups, room / "prediction-test.nc") or {}
    pressure = None
    if diagnosis and diagnosis.next_experiment and diagnosis.next_experiment.decides:
        file = _find(folder, room, diagnosis.next_experiment.pressure)
        pressure = absent.read("next_experiment", _read_pressure, file, f"{file.name} is missing: run `rfea diagnose --force`.")
    timings = absent.read("timings", _read_mapping, room / "timings.json") or {}
    seconds = timings.get("segments_study_s", {})
    return LadderStep(rung, on_ladder, fit, comparison, diagnosis, predictions, pressure, absent, seconds)


def _find(folder: Path, room: Path, name: str) -> Path:
    """A file named in a diagnosis stands beside it, in `rfea/`, or in the campaign."""
    name = Path(name).name  # a name that leads elsewhere is none: the diagnosis may be a stranger's
    for place in (room, folder, folder.parent):
        if (place / name).exists():
            return place / name
    return room / name


def _read_groups(path: Path) -> dict[str, xr.Dataset]:
    return {name: read_dataset(path, group=name) for name in dataset_groups(path)}


def _read_pressure(path: Path) -> tuple[list[float], list[float]]:
    """Time in s and pressure in kPa from a CSV with one line of headings."""
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()[1:] if line.strip()]
    return [float(row[0]) for row in rows], [float(row[1]) for row in rows]
