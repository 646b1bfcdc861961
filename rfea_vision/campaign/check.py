"""Everything that is wrong with a campaign, looked at before any stage runs: keys, files, pictures, logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rfea_vision.campaign import following, plausibility, pointing, repeats
from rfea_vision.campaign.loading import read_campaign
from rfea_vision.campaign.problems import FileProblem
from rfea_vision.campaign.specs import CameraSpec, Campaign, ExperimentSpec, TrackSpec, VideoSpec
from rfea_vision.campaign.tracked import motion_of
from rfea_vision.campaign.tubes import modulus_of, of_load, of_moduli, of_square, of_stretch, of_tube, of_weight
from rfea_vision.errors import InputError, RfeaError
from rfea_vision.files import sha256_of
from rfea_vision.readers.source import open_source

if TYPE_CHECKING:
    from rfea_vision.arrays import FloatArray
    from rfea_vision.artefacts import Actuator, Track
    from rfea_vision.calibration.board import Board
    from rfea_vision.readers.pressure import PressureLog


_UNREADABLE = "{} is not a readable picture; take it out or copy it again"


@dataclass(frozen=True)
class CheckedCampaign:
    """The experiments found, with their roles, what is wrong, and those without a pressure: they cannot be fitted."""

    experiments: dict[str, str]
    problems: tuple[FileProblem, ...]
    unpressed: tuple[str, ...] = ()


@dataclass(frozen=True)
class _AllRuns:
    """What is kept of each run, by its name, for the checks that compare runs.

    Attributes
    ----------
    highest_kPa : highest pressure
    responses : how far tube and pressure go
    moduli : Young's modulus (Pa) of a wall that bends so far; None where it cannot be told
    angles : motion and log of runs in which only an angle was measured
    logs, motions : pressure log, and what moves (frames, 2 or 1)
    lines : number of points and length (mm) of the centre line
    rests : where the tube is before anything moves, and at which pressure
    """

    highest_kPa: dict[str, float] = field(default_factory=dict)
    responses: dict[str, plausibility.Response] = field(default_factory=dict)
    moduli: dict[str, float | None] = field(default_factory=dict)
    angles: dict[str, following.Pair] = field(default_factory=dict)
    logs: dict[str, PressureLog] = field(default_factory=dict)
    motions: dict[str, FloatArray] = field(default_factory=dict)
    lines: dict[str, tuple[int, float]] = field(default_factory=dict)
    rests: dict[str, repeats.Rest] = field(default_factory=dict)


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
        problems += _camera_problems(camera, campaign, experiment)
        if progress is not None:
            progress(done + 1, total)
    runs = _AllRuns()
    for done, experiment in enumerate(active, start=len(cameras)):
        said = any(
            p.experiment in (None, experiment.name) and (p.key.startswith("pressure") or p.meant == "pressure") for p in problems
        )
        problems += _experiment_problems(experiment, runs, pressure_said=said)
        if progress is not None:
            progress(done + 1, total)
    for experiment in active:
        odd = plausibility.beside_others(experiment.name, runs.highest_kPa)
        if text := odd or plausibility.of_response(experiment.name, runs.responses):
            problems.append(_warning(experiment, "pressure", text))
    sized = any(p.key == "pressure" or p.key.startswith("actuator") for p in problems)
    together = "" if sized else _odd_pressures(active, runs)
    if text := together or following.together(list(runs.angles.values())):
        problems.append(FileProblem(campaign.root / "campaign.yaml", text, "pressure", severity="warning"))
    for experiment in active:
        problems += [_warning(experiment, key, text) for key, text in _beside_others(experiment, runs)]
    for experiment, key, text in repeats.alike(active, runs.motions):
        problems.append(_warning(experiment, key, text))
    found = sorted((*campaign.experiments, *reading.broken), key=lambda item: item.folder)
    unpressed = tuple(item.name for item in active if item.pressure.missing)
    return CheckedCampaign({item.name: item.role for item in found}, tuple(dict.fromkeys(problems)), unpressed)


def _beside_others(experiment: ExperimentSpec, runs: _AllRuns) -> list[tuple[str, str]]:
    """What a run says of itself that the pressures of others tell: keys and why."""
    own, first = runs.logs.get(experiment.name), runs.logs.get(str(experiment.repeat_of))
    found = [("repeat_of", repeats.of_repeat(own, first, str(experiment.repeat_of)))] if own and first else []
    load_kg, highest_kPa = experiment.rig.conditions.get("payload.m", 0.0), max(runs.highest_kPa.values(), default=0.0)
    found.append(("conditions.payload", of_load(load_kg, highest_kPa, experiment.actuator, experiment.rig.gravity_deg)))
    if experiment.name in runs.lines:
        found.append(("track", repeats.of_line(experiment.name, runs.lines)))
    found.append(("pressure", repeats.of_rest(experiment.name, runs.rests)))
    return [(key, text) for key, text in found if text]


def _odd_tubes(campaign: Campaign, active: list[ExperimentSpec]) -> list[FileProblem]:
    """Doubt dimensions that are right in form and unlikely in size: above all, diameters given as radii."""
    tubes = dict.fromkeys((campaign.actuator, *(item.actuator for item in active)))
    file, doubts = campaign.root / "campaign.yaml", [doubt for tube in tubes for doubt in of_tube(tube)]
    return [FileProblem(file, text, f"actuator.{key}", severity="warning") for key, text in doubts]


def _odd_pressures(active: list[ExperimentSpec], runs: _AllRuns) -> str:
    """Doubt the pressures of all runs of one tube together; empty where there is no doubt."""
    if len({item.actuator for item in active}) != 1:
        return ""
    gravities = {item.rig.gravity_deg for item in active}
    highest = max(runs.highest_kPa.values(), default=None)
    text = of_moduli(runs.moduli.values())
    if text or highest is None or len(gravities) != 1:
        return text
    return of_weight(highest, active[0].actuator, gravities.pop())


def _cameras(campaign: Campaign, active: list[ExperimentSpec]) -> list[tuple[CameraSpec, ExperimentSpec | None]]:
    """Return the campaign's camera and those of experiments with their own."""
    found: list[tuple[CameraSpec, ExperimentSpec | None]] = []
    if campaign.camera is not None:
        found.append((campaign.camera, None))
    found += [(item.camera, item) for item in active if item.camera is not None and item.camera != campaign.camera]
    return found


@dataclass
class _Look:
    """A file of the campaign while what it names is looked at, for one run or for all, and what is wrong."""

    file: Path
    name: str | None
    problems: list[FileProblem] = field(default_factory=list, kw_only=True)

    def warn(self, key: str, *texts: str) -> None:
        self.problems += [FileProblem(self.file, text, key, severity="warning", experiment=self.name) for text in texts]

    def refuse(self, key: str, text: str) -> None:
        self.problems.append(FileProblem(self.file, text, key, experiment=self.name))


def _camera_problems(camera: CameraSpec, campaign: Campaign, experiment: ExperimentSpec | None) -> list[FileProblem]:
    """Read an earlier calibration, and look for the board in every photo."""
    from rfea_vision.calibration.storage import load_calibration

    look = _Look(campaign.root / "campaign.yaml", None) if experiment is None else _Look(experiment.file, experiment.name)
    if camera.file is not None:
        try:
            load_calibration(camera.file)
        except RfeaError as error:
            look.refuse("camera.file", str(error))
    if camera.board is not None:
        if text := _of_another_camera(camera):
            look.refuse("camera.plane", text)
        _look_at_photos(look, camera, camera.board)
        if camera.plane is not None:
            _look_at_plane(look, camera, camera.board, (experiment or campaign).actuator)
    return look.problems


def _look_at_photos(look: _Look, camera: CameraSpec, board: Board) -> None:
    """Look for the board in the photos of the lens: three with it are needed."""
    from rfea_vision.calibration.corners import Refused, find_corners
    from rfea_vision.readers.pictures import read_grey

    seen, refused = 0, dict[str, list[str]]()
    for photo in (item for item in camera.photos if item != camera.plane):
        grey = read_grey(photo)
        if grey is None:
            look.refuse("camera.photos", _UNREADABLE.format(photo))
        elif isinstance(found := find_corners(photo, grey, board), Refused):
            refused.setdefault(found.reason, []).append(photo.name)
        else:
            seen += 1
    for reason, (first, *more) in refused.items():  # what ails many photos alike is said once
        some = f"{1 + len(more)} photos ({first} to {more[-1]})" if more else first
        look.warn("camera.photos", f"{some}: {reason}")
    if camera.photos and seen < 3:
        text = f"{seen} of {len(camera.photos)} photos show the board, 3 are needed; check camera.board or take more"
        look.refuse("camera.photos", text)


def _look_at_plane(look: _Look, camera: CameraSpec, board: Board, tube: Actuator) -> None:
    """Look for the board in the photo of the plane of motion, and how large the tube is beside it."""
    from rfea_vision.calibration.corners import Refused, find_corners
    from rfea_vision.readers.pictures import read_grey

    plane = camera.plane
    grey = None if plane is None else read_grey(plane)
    if plane is None or grey is None:
        look.refuse("camera.plane", _UNREADABLE.format(plane))
        return
    if twin := _same_picture(plane, camera.photos):
        text = f"{plane.name} is {twin} once more; photograph the board lying in the plane in which the tube moves"
        look.warn("camera.plane", text)
    found = find_corners(plane, grey, board)
    if isinstance(found, Refused):
        look.refuse("camera.plane", f"{plane.name}: {found.reason}")
    elif text := of_square(found.board_mm, found.pixels, grey.shape, tube):
        look.warn("camera.board.square", text)


def _of_another_camera(camera: CameraSpec) -> str:
    """Why the photo of the plane is not by the camera, or in the mode, of the others; empty where it is, or cannot be read."""
    from rfea_vision.calibration.photos import read_photo, unlike_film

    plane = None if camera.plane is None else read_photo(camera.plane)
    first = None if plane is None or not camera.photos else read_photo(camera.photos[0])
    if plane is None or first is None:
        return ""
    own, other = plane.shown().shape[::-1], first.shown(plane).shape[::-1]
    if not unlike_film(own, other):
        return ""
    sizes = f"{plane.file.name} has {own[0]} x {own[1]} px, and {first.file.name} {other[0]} x {other[1]}"
    return f"{sizes}; photograph the board in the plane with the camera, and in the mode, that films"


def _same_picture(photo: Path, others: tuple[Path, ...]) -> str:
    """The name of another photo that is this one, byte by byte; empty where there is none."""
    size = photo.stat().st_size
    alike = (item for item in others if item != photo and item.stat().st_size == size)
    return next((item.name for item in alike if sha256_of(item) == sha256_of(photo)), "")


def _experiment_problems(experiment: ExperimentSpec, runs: _AllRuns, *, pressure_said: bool) -> list[FileProblem]:
    """Read what belongs to a run, and keep of it what is looked at together with the others."""
    run = _Run(experiment.file, experiment.name, experiment)
    try:
        if experiment.video is not None:
            _look_at_film(run, experiment.video)
        elif experiment.track is not None:
            _look_at_track(run, experiment.track, runs)
    except RfeaError as error:
        run.refuse("track" if experiment.track is not None else "video", str(error))
    if experiment.pressure.missing and not pressure_said:
        run.warn("pressure", "is missing, so nothing can be fitted; of a run at constant pressure write 'pressure: {value: 0 kPa}'")
    elif not experiment.pressure.missing and not experiment.pressure.constant:
        _look_at_pressure(run, runs)
    return run.problems


@dataclass
class _Run(_Look):
    """A run while it is looked at: its track and the times (s) of its frames, as far as they can be read."""

    experiment: ExperimentSpec
    track: Track | None = None
    seconds: FloatArray | None = None

    @property
    def in_px(self) -> bool:
        """Whether the track is looked at in pixels, which a camera makes mm later."""
        spec = self.experiment.track
        return spec is not None and self.experiment.camera is not None and spec.keys.scale is None


def _look_at_film(run: _Run, video: VideoSpec) -> None:
    """Times and size of the pictures."""
    if video.file is None and (video.frames is None or (video.times is None and video.rate_Hz is None)):
        return  # what is lacking was said of its keys
    source = open_source(video)
    if video.file is not None and video.rate_Hz is not None:
        own = open_source(replace(video, rate_Hz=None))
        run.warn("video.rate", *plausibility.of_rate(video.rate_Hz, own.rate_Hz), *plausibility.of_gaps(own.times_s(), counted=True))
    run.seconds = source.times_s()
    camera, gravity_deg = run.experiment.camera, run.experiment.rig.gravity_deg
    for key, text in [] if camera is None else pointing.of_hints(camera.hints, gravity_deg):
        run.warn(f"camera.{key}", text)
    if len(run.seconds):
        run.warn("video", *plausibility.of_end(float(run.seconds[-1]), source.announced_s))
    run.warn("video", *plausibility.of_gaps(run.seconds))
    if text := _unlike_photos(run.experiment.camera, source.size):
        run.refuse("video", text)


def _look_at_track(run: _Run, spec: TrackSpec, runs: _AllRuns) -> None:
    """Times and places of a track that another tool made."""
    from rfea_vision.readers.tracks import read_track

    experiment = run.experiment
    track = read_track(
        spec.file,
        bends=experiment.actuator.bends,
        spec=spec.keys,
        to_rig_mm=(lambda pixels: pixels) if run.in_px else None,  # lengths are not what is looked at here
    )
    run.track, run.seconds = track, track.time_s
    runs.motions[experiment.name] = motion_of(track.dataset)[0]
    runs.lines[experiment.name] = repeats.line_of(track.dataset)
    run.warn("track", *plausibility.of_gaps(track.time_s))
    if not run.in_px:
        tube = experiment.actuator
        run.warn("track", *(plausibility.of_track(track.dataset, 1e3 * tube.length) or of_stretch(track.dataset, tube)))


def _look_at_pressure(run: _Run, runs: _AllRuns) -> None:
    """The log: by itself, beside the frames, and where the clocks are declared beside the motion."""
    from rfea_vision.readers.pressure import read_pressure

    experiment, track, name = run.experiment, run.track, run.experiment.name
    try:
        log = read_pressure(experiment.pressure, name)
    except RfeaError as error:
        run.refuse("pressure", str(error))
        return
    for key, text in _unseen_signals(experiment, log):
        run.refuse(key, text)
    runs.highest_kPa[name] = float(abs(log.pressure_kPa).max())
    runs.logs[name] = log
    said = plausibility.of_pressure(log)
    if track is not None and not run.in_px and not said:
        if moved := plausibility.response(track.dataset, log.pressure_kPa):
            runs.responses[name] = moved
        gravity_deg = experiment.rig.gravity_deg
        runs.moduli[name] = modulus_of(track.dataset, log.pressure_kPa, experiment.actuator, gravity_deg)
    if run.seconds is not None and len(run.seconds):
        filmed = experiment.video is not None and experiment.video.file is not None and experiment.video.rate_Hz is None
        said += plausibility.of_times(log.time_s, run.seconds, filmed=filmed)
    if track is not None and not said and experiment.sync.method in ("common_clock", "offset"):
        said += _beside_the_motion(run, track, log, runs)
    elif track is not None and not said and experiment.sync.method == "motion":
        said += filter(None, [following.of_order(track.dataset, track.time_s, log.time_s, log.pressure_kPa)])
    run.warn("pressure", *said)


def _beside_the_motion(run: _Run, track: Track, log: PressureLog, runs: _AllRuns) -> list[str]:
    """Why the log may not be that of the track, by the clocks that are declared."""
    sync, zero_s = run.experiment.sync, track.dataset.attrs.get("clock_zero_s")
    if sync.method == "common_clock" and (text := log.zero_doubt(zero_s)):
        run.warn("sync", text)
    shifted = track.time_s + log.zero_apart_s(zero_s) + (sync.value or 0.0)
    pair = following.pair_of(track.dataset, shifted, log.time_s, log.pressure_kPa)
    if pair is not None and pair.unit == "deg" and len(log.pushes_kPa or ()) < 2:
        runs.angles[run.experiment.name] = pair
    held = run.experiment.rig.held
    if not held and (rest := repeats.rest_of(track.dataset, np.interp(shifted, log.time_s, log.pressure_kPa))):
        runs.rests[run.experiment.name] = rest
    return following.of_pair(track.dataset, shifted, log.time_s, log.pressure_kPa, log.pushes_kPa, held=held)


def _unseen_signals(experiment: ExperimentSpec, log: PressureLog) -> list[tuple[str, str]]:
    """What `sync.method` needs of film and log, and they have not: keys and why."""
    sync = experiment.sync
    if sync.method not in ("led", "trigger"):
        return []
    if sync.method == "led" and experiment.video is None:
        return [("sync.method", "'led' looks for a lamp in the film, and this run has none; take motion, or common_clock")]
    try:
        log.signal(sync.method, sync.channel)
    except InputError as error:
        return [("sync.channel", str(error))]
    if sync.method == "led" and sync.lamp_box is None:
        return [("sync.box", "is missing; the method 'led' needs the lamp's box in the picture, [x, y, width, height] in px")]
    return []


def _unlike_photos(camera: CameraSpec | None, film_px: tuple[int, int]) -> str:
    """Why the photos of the board cannot calibrate a film of this size; empty where they can, or cannot be read."""
    from rfea_vision.calibration.photos import reference_photo, unlike_film

    photo = None if camera is None else reference_photo(camera.photos, camera.plane)
    if camera is None or photo is None or _of_another_camera(camera):  # the latter is said of the camera
        return ""
    height, width = photo.shown().shape
    return unlike_film((width, height), film_px)


def _warning(experiment: ExperimentSpec, key: str, text: str) -> FileProblem:
    return FileProblem(experiment.file, text, key, severity="warning", experiment=experiment.name)
