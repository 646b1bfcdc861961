"""Everything that is wrong with a campaign, looked at before any stage runs: keys, files, pictures, logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from rfea_vision.campaign import following, plausibility, pointing, repeats
from rfea_vision.campaign.boards import Look, camera_problems, unlike_camera
from rfea_vision.campaign.loading import read_campaign
from rfea_vision.campaign.problems import FileProblem, problem_at
from rfea_vision.campaign.scaling import of_sizes, one_scale
from rfea_vision.campaign.specs import CameraSpec, Campaign, ExperimentSpec, TrackSpec, VideoSpec
from rfea_vision.campaign.tracked import motion_of
from rfea_vision.campaign.tubes import modulus_of, of_load, of_moduli, of_stretch, of_tube, of_weight
from rfea_vision.campaign.yaml_file import YamlFile, read_yaml
from rfea_vision.errors import InputError, RfeaError
from rfea_vision.files import is_file
from rfea_vision.readers.source import open_source

if TYPE_CHECKING:
    from rfea_vision.arrays import FloatArray
    from rfea_vision.artefacts import Track
    from rfea_vision.readers.pressure import PressureLog


_Value = TypeVar("_Value")


@dataclass(frozen=True)
class CheckedCampaign:
    """The experiments found, with their roles, what is wrong, and those without a pressure: they cannot be fitted."""

    experiments: dict[str, str]
    problems: tuple[FileProblem, ...]
    unpressed: tuple[str, ...] = ()


def check_campaign(
    path: Path, progress: Callable[[int, int], None] | None = None, *, trust: bool = False
) -> CheckedCampaign:
    """Read every file of a campaign as the stages will, and say all that is wrong; nothing is written.

    Parameters
    ----------
    path : campaign folder or lone experiment folder
    progress : called with (done, total) experiments and cameras
    trust : let it read outside of its folder
    """
    reading = read_campaign(path, trust=trust)
    campaign, problems = reading.campaign, list(reading.problems)
    if campaign is None:
        return CheckedCampaign({}, tuple(problems))
    active = [item for item in (*campaign.experiments, *reading.broken) if item.role != "ignore"]
    problems += _odd_tubes(campaign, active)
    cameras = _cameras(campaign, active)
    total = len(active) + len(cameras)
    for done, (camera, experiment) in enumerate(cameras):
        problems += camera_problems(camera, campaign, experiment, tube_known=_tube_known(problems, experiment))
        if progress is not None:
            progress(done + 1, total)
    runs = []
    for done, experiment in enumerate(active, start=len(cameras)):
        said = any(
            p.experiment in (None, experiment.name) and (p.key.startswith("pressure") or p.meant == "pressure") for p in problems
        )
        runs.append(_looked_at(experiment, pressure_said=said, tube_known=_tube_known(problems, experiment)))
        if progress is not None:
            progress(done + 1, total)
    problems += _compared(campaign, runs, problems)
    problems += [problem for run in runs for problem in run.problems]
    found = sorted((*campaign.experiments, *reading.broken), key=lambda item: item.folder)
    unpressed = tuple(item.name for item in active if item.pressure.missing)
    problems = _placed(problems, campaign)
    return CheckedCampaign({item.name: item.role for item in found}, tuple(dict.fromkeys(problems)), unpressed)


def _placed(problems: list[FileProblem], campaign: Campaign) -> list[FileProblem]:
    """The same, each at the line of its key; where that is the campaign's, the runs have it all alike."""
    common = campaign.root / "campaign.yaml"
    known: dict[Path, YamlFile] = {}
    for path in {common, *(problem.file for problem in problems)}:
        if path.suffix == ".yaml" and is_file(path):
            with suppress(InputError):  # what is no YAML was said, at its line
                known[path] = read_yaml(path)
    return [_at_line(problem, [known[path] for path in dict.fromkeys((problem.file, common)) if path in known]) for problem in problems]


def _at_line(problem: FileProblem, files: list[YamlFile]) -> FileProblem:
    if problem.line is not None or not problem.key or not files:
        return problem
    at = problem_at(files, problem.key, problem.message)
    if at.line is None:
        return problem
    return replace(problem, file=at.file, line=at.line, experiment=problem.experiment if at.file == problem.file else None)


def _compared(campaign: Campaign, runs: list[_Run], problems: list[FileProblem]) -> list[FileProblem]:
    """Doubt runs by what the others show, each with its own doubts; and all of them together, with those that are returned."""
    highest_kPa, logs = _of_each(runs, lambda run: run.highest_kPa), _of_each(runs, lambda run: run.log)
    responses, rests = _of_each(runs, lambda run: run.response), _of_each(runs, lambda run: run.rest)
    lines, motions = _of_each(runs, lambda run: run.line), _of_each(runs, lambda run: run.motion)
    for run in runs:
        name = run.experiment.name
        odd = plausibility.beside_others(name, highest_kPa)
        run.doubt("pressure", odd or plausibility.of_response(name, responses))
    said = [*problems, *(problem for run in runs for problem in run.problems)]
    sized = any(problem.key == "pressure" or problem.key.startswith("actuator") for problem in said)
    most_kPa = max(highest_kPa.values(), default=0.0)
    for run in runs:
        experiment, name = run.experiment, run.experiment.name
        own, first = logs.get(name), logs.get(str(experiment.repeat_of))
        run.doubt("repeat_of", repeats.of_repeat(own, first, str(experiment.repeat_of)) if own and first else "")
        load_kg = experiment.rig.conditions.get("payload.m", 0.0)
        if run.tube_known:
            run.doubt("conditions.payload", of_load(load_kg, most_kPa, experiment.actuator, experiment.rig.gravity_deg))
        run.doubt("track", repeats.of_line(name, lines) if name in lines else "")
        run.doubt("pressure", repeats.of_rest(name, rests))
    for experiment, key, text in repeats.alike([run.experiment for run in runs], motions):
        next(run for run in runs if run.experiment is experiment).doubt(key, text)
    unlike = _unlike_films(runs)
    together = "" if sized else _odd_pressures(runs, highest_kPa)
    text = together or following.together([run.angle for run in runs if run.angle is not None])
    return unlike + ([FileProblem(campaign.root / "campaign.yaml", text, "pressure", severity="warning")] if text else [])


def _unlike_films(runs: list[_Run]) -> list[FileProblem]:
    """Scales that were pointed at in pictures of one size, and are those of runs with others, too."""
    filmed = [run for run in runs if run.size is not None and run.experiment.camera is not None]
    found: list[FileProblem] = []
    while filmed:
        alike = [run for run in filmed if run is filmed[0] or one_scale(run.experiment.camera, filmed[0].experiment.camera)]
        filmed = [run for run in filmed if run not in alike]
        if text := of_sizes({run.name or "": run.size for run in alike if run.size is not None}):
            found.append(FileProblem(alike[0].file, text, "camera.scale"))
    return found


def _of_each(runs: list[_Run], what: Callable[[_Run], _Value | None]) -> dict[str, _Value]:
    """What is known of runs, by their names."""
    return {run.experiment.name: value for run in runs if (value := what(run)) is not None}


def _odd_tubes(campaign: Campaign, active: list[ExperimentSpec]) -> list[FileProblem]:
    """Doubt dimensions that are right in form and unlikely in size: above all, diameters given as radii."""
    tubes = dict.fromkeys((campaign.actuator, *(item.actuator for item in active)))
    file, doubts = campaign.root / "campaign.yaml", [doubt for tube in tubes for doubt in of_tube(tube)]
    return [FileProblem(file, text, f"actuator.{key}", severity="warning") for key, text in doubts]


def _odd_pressures(runs: list[_Run], highest_kPa: Mapping[str, float]) -> str:
    """Doubt the pressures of all runs of one tube together; empty where there is no doubt."""
    if len({run.experiment.actuator for run in runs}) != 1:
        return ""
    gravities = {run.experiment.rig.gravity_deg for run in runs}
    text = of_moduli(run.modulus for run in runs)
    if text or not highest_kPa or len(gravities) != 1:
        return text
    return of_weight(max(highest_kPa.values()), runs[0].experiment.actuator, gravities.pop())


def _cameras(campaign: Campaign, active: list[ExperimentSpec]) -> list[tuple[CameraSpec, ExperimentSpec | None]]:
    """Return the campaign's camera and those of experiments with their own."""
    found: list[tuple[CameraSpec, ExperimentSpec | None]] = []
    if campaign.camera is not None:
        found.append((campaign.camera, None))
    found += [(item.camera, item) for item in active if item.camera is not None and item.camera != campaign.camera]
    return found


def _tube_known(problems: list[FileProblem], experiment: ExperimentSpec | None) -> bool:
    """Whether no value of the tube was refused: one that was assumed in its place is none to doubt others by."""
    own = (None,) if experiment is None else (None, experiment.name)
    return not any(
        problem.severity == "error" and problem.key.split(".")[0] == "actuator" and problem.experiment in own for problem in problems
    )


def _looked_at(experiment: ExperimentSpec, *, pressure_said: bool, tube_known: bool) -> _Run:
    """Read what belongs to a run."""
    run = _Run(experiment.file, experiment.name, experiment, tube_known)
    try:
        if experiment.video is not None:
            _look_at_film(run, experiment.video)
        elif experiment.track is not None:
            _look_at_track(run, experiment.track)
    except RfeaError as error:
        run.refuse("track" if experiment.track is not None else "video", str(error))
    if experiment.pressure.missing and not pressure_said:
        run.warn("pressure", "is missing, so nothing can be fitted; of a run at constant pressure write 'pressure: {value: 0 kPa}'")
    elif not experiment.pressure.missing and not experiment.pressure.constant:
        _look_at_pressure(run)
    return run


@dataclass
class _Run(Look):
    """A run, and what is found of it while it is looked at, as far as it can be read.

    Attributes
    ----------
    tube_known : whether no value of its tube was refused
    size : width and height (px) of its film's pictures
    track, seconds : its track, and the times (s) of its frames
    motion, line : what moves (frames, 2 or 1); number of points and length (mm) of the centre line
    log, highest_kPa : its pressure log, and the highest pressure
    response, modulus : how far tube and pressure go, and Young's modulus (Pa) of a wall that bends so far
    angle : motion beside log, where only an angle was measured
    rest : where the tube is before anything moves, and at which pressure
    """

    experiment: ExperimentSpec
    tube_known: bool
    size: tuple[int, int] | None = None
    track: Track | None = None
    seconds: FloatArray | None = None
    motion: FloatArray | None = None
    line: tuple[int, float] | None = None
    log: PressureLog | None = None
    highest_kPa: float | None = None
    response: plausibility.Response | None = None
    modulus: float | None = None
    angle: following.Pair | None = None
    rest: repeats.Rest | None = None

    def doubt(self, key: str, text: str) -> None:
        """Note a warning, if there is one."""
        if text:
            self.warn(key, text)

    @property
    def in_px(self) -> bool:
        """Whether the track is looked at in pixels, which a camera makes mm later."""
        spec = self.experiment.track
        return spec is not None and bool(spec.keys.points) and self.experiment.camera is not None and spec.keys.scale is None


def _look_at_film(run: _Run, video: VideoSpec) -> None:
    """Times and size of the pictures."""
    if video.file is None and (video.frames is None or (video.times is None and video.rate_Hz is None)):
        return  # what is lacking was said of its keys
    source = open_source(video)
    if video.file is not None and video.rate_Hz is not None:
        own = open_source(replace(video, rate_Hz=None))
        run.warn("video.rate", *plausibility.of_rate(video.rate_Hz, own.rate_Hz), *plausibility.of_gaps(own.times_s(), counted=True))
    run.size, run.seconds = source.size, source.times_s()
    experiment = run.experiment
    if experiment.camera is not None:
        film, gravity_deg = pointing.Film(source.size, len(run.seconds)), experiment.rig.gravity_deg
        tube = experiment.actuator if run.tube_known else None
        wrong, odd = pointing.of_camera(experiment.camera, film, tube, gravity_deg)
        run.problems += [FileProblem(run.file, text, key, experiment=run.name) for key, text in wrong]
        for key, text in odd:
            run.warn(key, text)
    if len(run.seconds):
        run.warn("video", *plausibility.of_end(float(run.seconds[-1]), source.announced_s, listed=True))
    run.warn("video", *plausibility.of_gaps(run.seconds))
    if text := unlike_camera(experiment.camera, source.size):
        run.refuse("video", text)


def _look_at_track(run: _Run, spec: TrackSpec) -> None:
    """Times and places of a track that another tool, or an earlier run of this one, has made."""
    from rfea_vision.readers.tracks import read_track

    experiment = run.experiment
    track = read_track(
        spec.file,
        bends=experiment.actuator.bends,
        spec=spec.keys,
        to_rig_mm=(lambda pixels: pixels) if run.in_px else None,  # lengths are not what is looked at here
    )
    run.track, run.seconds = track, track.time_s
    run.motion, run.line = motion_of(track.dataset)[0], repeats.line_of(track.dataset)
    if "doubts" in track.dataset.attrs:  # a track of our own, which was doubted where it was made
        run.doubt("track", str(track.dataset.attrs["doubts"]))
        return
    run.warn("track", *plausibility.of_gaps(track.time_s))
    if not run.in_px and run.tube_known:
        tube = experiment.actuator
        run.warn("track", *(plausibility.of_track(track.dataset, 1e3 * tube.length) or of_stretch(track.dataset, tube)))


def _look_at_pressure(run: _Run) -> None:
    """The log: by itself, beside the frames, and where the clocks are declared beside the motion."""
    from rfea_vision.readers.pressure import read_pressure

    experiment, track = run.experiment, run.track
    try:
        log = read_pressure(experiment.pressure, experiment.name)
    except RfeaError as error:
        run.refuse("pressure", str(error))
        return
    for key, text in _unseen_signals(experiment, log, lamp=track is not None and "lamp" in track.dataset):
        run.refuse(key, text)
    run.log, run.highest_kPa = log, float(abs(log.pressure_kPa).max())
    said = plausibility.of_pressure(log)
    if track is not None and not run.in_px and not said:
        run.response = plausibility.response(track.dataset, log.pressure_kPa)
        if run.tube_known:
            run.modulus = modulus_of(track.dataset, log.pressure_kPa, experiment.actuator, experiment.rig.gravity_deg)
    if run.seconds is not None and len(run.seconds):
        filmed = experiment.video is not None and experiment.video.file is not None and experiment.video.rate_Hz is None
        said += plausibility.of_times(log.time_s, run.seconds, filmed=filmed)
    if track is not None and not said and experiment.sync.method in ("common_clock", "offset"):
        said += _beside_the_motion(run, track, log)
    elif track is not None and not said and experiment.sync.method == "motion":
        said += filter(None, [following.of_order(track.dataset, track.time_s, log.time_s, log.pressure_kPa)])
    run.warn("pressure", *said)


def _beside_the_motion(run: _Run, track: Track, log: PressureLog) -> list[str]:
    """Why the log may not be that of the track, by the clocks that are declared."""
    sync, zero_s = run.experiment.sync, track.dataset.attrs.get("clock_zero_s")
    if sync.method == "common_clock" and (text := log.zero_doubt(zero_s)):
        run.warn("sync", text)
    shifted = track.time_s + log.zero_apart_s(zero_s) + (sync.value or 0.0)
    pair = following.pair_of(track.dataset, shifted, log.time_s, log.pressure_kPa)
    if pair is not None and pair.unit == "deg" and len(log.pushes_kPa or ()) < 2:
        run.angle = pair
    held = run.experiment.rig.held
    run.rest = None if held else repeats.rest_of(track.dataset, np.interp(shifted, log.time_s, log.pressure_kPa))
    if text := following.of_sign(track.dataset, shifted, log.time_s, log.pressure_kPa, sync.value):
        return [text]
    return following.of_pair(track.dataset, shifted, log.time_s, log.pressure_kPa, log.pushes_kPa, held=held)


def _unseen_signals(experiment: ExperimentSpec, log: PressureLog, *, lamp: bool) -> list[tuple[str, str]]:
    """What `sync.method` needs of film and log, and they have not: keys and why; `lamp`: a track without its film has the lamp."""
    sync = experiment.sync
    if sync.method not in ("led", "trigger"):
        return []
    if sync.method == "led" and experiment.video is None and not lamp:
        return [("sync.method", "'led' looks for a lamp in the film, and this run has none; take motion, or common_clock")]
    try:
        log.signal(sync.method, sync.channel)
    except InputError as error:
        return [("sync.channel", str(error))]
    if sync.method == "led" and sync.lamp_box is None and not lamp:
        return [("sync.box", "is missing; the method 'led' needs the lamp's box in the picture, [x, y, width, height] in px")]
    return []
