"""Everything that is wrong with a campaign, looked at before any stage runs: keys, files, pictures, logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.campaign import following, plausibility, repeats
from rfea_vision.campaign.loading import read_campaign
from rfea_vision.campaign.problems import FileProblem
from rfea_vision.campaign.specs import CameraSpec, Campaign, ExperimentSpec
from rfea_vision.campaign.tubes import modulus_of, of_load, of_moduli, of_square, of_stretch, of_tube, of_weight
from rfea_vision.errors import InputError, RfeaError
from rfea_vision.files import sha256_of

if TYPE_CHECKING:
    from rfea_vision.arrays import FloatArray
    from rfea_vision.readers.pressure import PressureLog


@dataclass(frozen=True)
class CheckedCampaign:
    """The experiments found, with their roles, what is wrong, and those without a pressure: they cannot be fitted."""

    experiments: dict[str, str]
    problems: tuple[FileProblem, ...]
    unpressed: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Seen:
    """What is kept of each run, to look at all of them together: by name the highest pressure (kPa), how far it and the tube go, the
    modulus (Pa) that goes with it, angles alone, logs, what moved, and centre lines.
    """

    highest_kPa: dict[str, float] = field(default_factory=dict)
    responses: dict[str, plausibility.Response] = field(default_factory=dict)
    moduli: dict[str, float | None] = field(default_factory=dict)
    angles: dict[str, following.AngleRun] = field(default_factory=dict)
    logs: dict[str, PressureLog] = field(default_factory=dict)
    motions: dict[str, FloatArray] = field(default_factory=dict)
    lines: dict[str, tuple[int, float]] = field(default_factory=dict)


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
    seen = _Seen()
    for done, experiment in enumerate(active, start=len(cameras)):
        said = any(
            p.experiment in (None, experiment.name) and (p.key.startswith("pressure") or p.meant == "pressure") for p in problems
        )
        problems += _experiment_problems(experiment, seen, pressure_said=said)
        if progress is not None:
            progress(done + 1, total)
    for experiment in active:
        odd = plausibility.beside_others(experiment.name, seen.highest_kPa)
        if text := odd or plausibility.of_response(experiment.name, seen.responses):
            problems.append(_warning(experiment, "pressure", text))
    sized = any(p.key == "pressure" or p.key.startswith("actuator") for p in problems)
    together = "" if sized else _odd_pressures(active, seen)
    if text := together or following.together(list(seen.angles.values())):
        problems.append(FileProblem(campaign.root / "campaign.yaml", text, "pressure", severity="warning"))
    for experiment in active:
        problems += [_warning(experiment, key, text) for key, text in _beside_others(experiment, seen)]
    for experiment, key, text in repeats.alike(active, seen.motions):
        problems.append(_warning(experiment, key, text))
    found = sorted((*campaign.experiments, *reading.broken), key=lambda item: item.folder)
    unpressed = tuple(item.name for item in active if item.pressure.missing)
    return CheckedCampaign({item.name: item.role for item in found}, tuple(dict.fromkeys(problems)), unpressed)


def _beside_others(experiment: ExperimentSpec, seen: _Seen) -> list[tuple[str, str]]:
    """What a run says of itself that the pressures of others tell: keys and why."""
    own, first = seen.logs.get(experiment.name), seen.logs.get(str(experiment.repeat_of))
    found = [("repeat_of", repeats.of_repeat(own, first, str(experiment.repeat_of)))] if own and first else []
    load_kg, highest_kPa = experiment.rig.conditions.get("payload.m", 0.0), max(seen.highest_kPa.values(), default=0.0)
    found.append(("conditions.payload", of_load(load_kg, highest_kPa, experiment.actuator, experiment.rig.gravity_deg)))
    if experiment.name in seen.lines:
        found.append(("track", repeats.of_line(experiment.name, seen.lines)))
    return [(key, text) for key, text in found if text]


def _odd_tubes(campaign: Campaign, active: list[ExperimentSpec]) -> list[FileProblem]:
    """Doubt dimensions that are right in form and unlikely in size: above all, diameters given as radii."""
    tubes = dict.fromkeys((campaign.actuator, *(item.actuator for item in active)))
    return [_odd(campaign, key, text) for tube in tubes for key, text in of_tube(tube)]


def _odd_pressures(active: list[ExperimentSpec], seen: _Seen) -> str:
    """Doubt the pressures of all runs of one tube together; empty where there is no doubt."""
    if len({item.actuator for item in active}) != 1:
        return ""
    gravities = {item.rig.gravity_deg for item in active}
    highest = max(seen.highest_kPa.values(), default=None)
    text = of_moduli(seen.moduli.values())
    if text or highest is None or len(gravities) != 1:
        return text
    return of_weight(highest, active[0].actuator, gravities.pop())


def _odd(campaign: Campaign, key: str, text: str) -> FileProblem:
    return FileProblem(campaign.root / "campaign.yaml", text, f"actuator.{key}", severity="warning")


def _cameras(campaign: Campaign, active: list[ExperimentSpec]) -> list[tuple[CameraSpec, ExperimentSpec | None]]:
    """Return the campaign's camera and those of experiments with their own."""
    found: list[tuple[CameraSpec, ExperimentSpec | None]] = []
    if campaign.camera is not None:
        found.append((campaign.camera, None))
    found += [(item.camera, item) for item in active if item.camera is not None and item.camera != campaign.camera]
    return found


def _camera_problems(camera: CameraSpec, campaign: Campaign, experiment: ExperimentSpec | None) -> list[FileProblem]:
    """Look for the board in every photo; three with a board are needed."""
    from rfea_vision.calibration.corners import Refused, find_corners
    from rfea_vision.calibration.storage import load_calibration
    from rfea_vision.readers.pictures import read_grey

    file = campaign.root / "campaign.yaml" if experiment is None else experiment.file
    name = None if experiment is None else experiment.name
    problems: list[FileProblem] = []
    if camera.file is not None:
        try:
            load_calibration(camera.file)
        except RfeaError as error:
            problems.append(FileProblem(file, str(error), "camera.file", experiment=name))
    if camera.board is None:
        return problems
    seen = 0
    refused: dict[str, list[str]] = {}
    tube = campaign.actuator if experiment is None else experiment.actuator
    if text := _of_another_camera(camera):
        problems.append(FileProblem(file, text, "camera.plane", experiment=name))
    for photo in [*camera.photos, *([camera.plane] if camera.plane else [])]:
        key = "camera.plane" if photo == camera.plane else "camera.photos"
        grey = read_grey(photo)
        if grey is None:
            message = f"{photo} is not a readable picture; take it out or copy it again"
            problems.append(FileProblem(file, message, key, experiment=name))
            continue
        found = find_corners(photo, grey, camera.board)
        if key == "camera.plane" and (twin := _same_picture(photo, camera.photos)):
            message = f"{photo.name} is {twin} once more; photograph the board lying in the plane in which the tube moves"
            problems.append(FileProblem(file, message, key, severity="warning", experiment=name))
        if not isinstance(found, Refused):
            seen += key == "camera.photos"
            if key == "camera.plane" and (text := of_square(found.board_mm, found.pixels, grey.shape, tube)):
                problems.append(FileProblem(file, text, "camera.board.square", severity="warning", experiment=name))
        elif key == "camera.plane":
            problems.append(FileProblem(file, f"{photo.name}: {found.reason}", key, experiment=name))
        else:
            refused.setdefault(found.reason, []).append(photo.name)
    for reason, photos in refused.items():  # what ails many photos alike is said once
        message = f"{_some(photos)}: {reason}"
        problems.append(FileProblem(file, message, "camera.photos", severity="warning", experiment=name))
    if camera.photos and seen < 3:
        message = f"{seen} of {len(camera.photos)} photos show the board, 3 are needed; check camera.board or take more"
        problems.append(FileProblem(file, message, "camera.photos", experiment=name))
    return problems


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


def _some(names: list[str]) -> str:
    """Name a few of many."""
    return names[0] if len(names) == 1 else f"{len(names)} photos ({names[0]} to {names[-1]})"


def _experiment_problems(
    experiment: ExperimentSpec,
    seen: _Seen,
    *,
    pressure_said: bool,
) -> list[FileProblem]:
    """Read what belongs to a run, and keep of it what is looked at together with the others."""
    file = experiment.file
    problems: list[FileProblem] = []
    pictures_s = track_s = track = None
    by_camera = False
    try:
        if experiment.video is not None:
            from rfea_vision.readers.video import open_frames, open_video

            video = experiment.video
            source = None
            if video.file is not None:
                source, own = open_video(video.file, video.rate_Hz), open_video(video.file)
                said = plausibility.of_rate(video.rate_Hz, own.rate_Hz)
                said += [] if video.rate_Hz is None else plausibility.of_gaps(own.times_s(), counted=True)
                problems += [_warning(experiment, "video.rate", text) for text in said]
            elif video.frames is not None and (video.times is not None or video.rate_Hz is not None):
                source = open_frames(video.frames, video.times, video.rate_Hz, within=video.within)
            if source is not None:
                pictures_s = source.times_s()
                said = plausibility.of_end(float(pictures_s[-1]), source.announced_s) if len(pictures_s) else []
                said += plausibility.of_gaps(pictures_s)
                problems += [_warning(experiment, "video", text) for text in said]
                if text := _unlike_photos(experiment.camera, source.size):
                    problems.append(FileProblem(file, text, "video", experiment=experiment.name))
        elif experiment.track is not None:
            from rfea_vision.readers.tracks import read_track

            by_camera = experiment.camera is not None and experiment.track.scale_mm is None
            track = read_track(
                experiment.track.file,
                bends=experiment.actuator.bends,
                spec=experiment.track,
                to_rig_mm=(lambda pixels: pixels) if by_camera else None,  # lengths are not what is looked at here
            )
            track_s = track.time_s
            seen.motions[experiment.name] = repeats.motion_of(track.dataset)
            seen.lines[experiment.name] = repeats.line_of(track.dataset)
            problems += [_warning(experiment, "track", text) for text in plausibility.of_gaps(track_s)]
            said = [] if by_camera else plausibility.of_track(track.dataset, 1e3 * experiment.actuator.length)
            said = said or ([] if by_camera else of_stretch(track.dataset, experiment.actuator))
            problems += [_warning(experiment, "track", text) for text in said]
    except RfeaError as error:
        key = "track" if experiment.track is not None else "video"
        problems.append(FileProblem(file, str(error), key, experiment=experiment.name))
    if experiment.pressure.constant:
        return problems
    if experiment.pressure.missing:
        text = "is missing, so nothing can be fitted; of a run at constant pressure write 'pressure: {value: 0 kPa}'"
        return problems if pressure_said else [*problems, _warning(experiment, "pressure", text)]
    try:
        from rfea_vision.readers.pressure import read_pressure

        log = read_pressure(experiment.pressure, experiment.name)
    except RfeaError as error:
        problems.append(FileProblem(file, str(error), "pressure", experiment=experiment.name))
        return problems
    problems += [FileProblem(file, text, key, experiment=experiment.name) for key, text in _unseen_signals(experiment, log)]
    seen.highest_kPa[experiment.name] = float(abs(log.pressure_kPa).max())
    seen.logs[experiment.name] = log
    said = list(log.doubts) or plausibility.of_pressure(log.pressure_kPa, log.chambers)
    if track is not None and not by_camera and not said:
        if moved := plausibility.response(track.dataset, log.pressure_kPa):
            seen.responses[experiment.name] = moved
        gravity_deg = experiment.rig.gravity_deg
        seen.moduli[experiment.name] = modulus_of(track.dataset, log.pressure_kPa, experiment.actuator, gravity_deg)
    seconds = pictures_s if pictures_s is not None else track_s
    if seconds is not None and len(seconds):
        filmed = experiment.video is not None and experiment.video.file is not None and experiment.video.rate_Hz is None
        said += plausibility.of_times(log.time_s, seconds, filmed=filmed)
        if track is not None and not said and experiment.sync.method in ("common_clock", "offset"):
            apart_s = log.zero_apart_s(track.dataset.attrs.get("clock_zero_s"))
            if experiment.sync.method == "common_clock" and (text := log.zero_doubt(track.dataset.attrs.get("clock_zero_s"))):
                problems.append(_warning(experiment, "sync", text))
            shifted = track.time_s + apart_s + (experiment.sync.value_s or 0.0)
            if "tip" not in track.dataset and "bend_angle" in track.dataset and len(log.pushes_kPa or ()) < 2:
                seen.angles[experiment.name] = following.AngleRun(
                    track.dataset["bend_angle"].values, shifted, log.time_s, log.pressure_kPa
                )
            said += following.of_pair(track.dataset, shifted, log.time_s, log.pressure_kPa, log.pushes_kPa)
    problems += [_warning(experiment, "pressure", text) for text in said]
    return problems


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
    if sync.method == "led" and sync.box is None:
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
