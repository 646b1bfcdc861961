"""The stages from pictures to a track, and from track and log to a recording."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rfea_vision.artefacts import CHOOSING_ROLES, Calibration, Hints, Recording, Track
from rfea_vision.campaign import ExperimentSpec, following, plausibility
from rfea_vision.campaign.tubes import of_stretch, of_width
from rfea_vision.errors import DataError, InputError, RfeaError
from rfea_vision.files import whole_file, write_text
from rfea_vision.progress import Progress
from rfea_vision.readers.source import open_source
from rfea_vision.stages.cameras import calibration_of, calibration_path, own_times, pictures_of
from rfea_vision.stages.earlier import runs_before, with_earlier_pressure
from rfea_vision.stages.products import compiling
from rfea_vision.stages.runner import Runner, Stage
from rfea_vision.stages.stored import Stored
from rfea_vision.stages.warnings import (
    LEAST_MEASURED,
    few_frames,
    log_warnings,
    misdeclared,
    reasons_of,
    say_warnings,
    warn_of_copies,
)

if TYPE_CHECKING:
    from rfea_vision.arrays import FloatArray
    from rfea_vision.readers.pressure import PressureLog
    from rfea_vision.readers.video import FrameSource


def track(work: Runner, experiment: ExperimentSpec) -> Stored[Track]:
    """Track one experiment's pictures, or read the track that another tool made; InputError if it has neither."""
    path = work.out / experiment.name / "track.nc"
    if experiment.track is not None:
        return _foreign_track(work, experiment, path)
    if experiment.video is None or experiment.camera is None:
        raise InputError(f"{experiment.file}: video: nothing to track; name a video, frames or a track")
    if not experiment.video.found:
        raise InputError(f"{experiment.file}: video: the pictures that it names are not there; correct the name or put them there")
    calibration_file = calibration_path(work, experiment)
    calibration = calibration_of(work, experiment)
    camera, video = experiment.camera, experiment.video
    lamp = experiment.sync.lamp_box if experiment.sync.method == "led" else None

    def make(progress: Progress) -> tuple[Track, list[Path], str]:
        work.tell(compiling("vision"))
        for doubt in calibration.value.quality.get("warnings", []):
            work.tell(f"warning: calibration: {doubt}")
        source = open_source(video)
        found = follow(experiment, calibration.value, source, progress=progress)
        doubts = plausibility.of_end(float(found.time_s[-1]), source.announced_s) + plausibility.of_damage(source.damaged_s())
        counted = video.file is not None and video.rate_Hz is not None
        seen_s = open_source(replace(video, rate_Hz=None)).times_s() if counted else found.time_s
        doubts += plausibility.of_gaps(seen_s, counted=counted)
        doubts += plausibility.of_copies(found.time_s, np.asarray(found.dataset["reason"].values == "duplicate"))
        doubts += plausibility.of_upside_down(found.dataset, 1e3 * experiment.actuator.length, experiment.rig.gravity_deg)
        doubts += of_width(found.dataset, experiment.actuator)
        found.dataset.attrs["doubts"] = "; ".join(filter(None, [found.dataset.attrs.get("doubts"), *doubts]))
        _say_calibration(found, calibration.value, experiment)
        _say_gravity(found, calibration.value, experiment)
        found.save(path)
        say_warnings(work, experiment, found)
        return found, [path], describe_track(found)

    tracked = work.run(
        Stage(
            "track",
            experiment.name,
            inputs=[*pictures_of(video), *_hint_files(camera.hints)],
            earlier=[work.cache.sha256(calibration_file)],
            options={
                "actuator": experiment.actuator,
                "camera": camera,
                "rate_Hz": video.rate_Hz,
                "lamp": lamp,
                "gravity": (experiment.rig.gravity_deg, experiment.rig.plumb),
            },
        ),
        make=make,
        load=lambda: Track.load(path),
        facts=facts_of_track,
    )
    _clip(work, experiment, tracked, path, calibration)
    return tracked


def follow(
    experiment: ExperimentSpec, calibration: Calibration, source: FrameSource, progress: Progress | None = None
) -> Track:
    """Track the tube through a source of this experiment's pictures, with its hints."""
    from rfea_vision.vision import track_frames

    camera, sync = experiment.camera, experiment.sync
    assert camera is not None
    return track_frames(
        source,
        calibration,
        experiment.actuator,
        vertical=camera.vertical,
        gravity_deg=experiment.rig.gravity_deg,
        hints=camera.hints,
        lamp_box=sync.lamp_box if sync.method == "led" else None,
        line_delay_s=camera.line_delay_s,
        progress=progress,
    )


def _say_calibration(found: Track, calibration: Calibration, experiment: ExperimentSpec) -> None:
    """Add, as attributes, what the calibration's uncertainty means where the tube has been."""
    from rfea_vision.calibration.region import visited

    region = visited(calibration, found, 1e3 * experiment.actuator.length)
    for key, value in (region or {}).items():
        found.dataset.attrs[f"calibration_{key}"] = value


def _say_gravity(found: Track, calibration: Calibration, experiment: ExperimentSpec) -> None:
    """Add, as an attribute, where gravity points by the plumb line in the picture."""
    from rfea_vision.vision.scene import gravity_seen_deg

    if experiment.rig.plumb is not None:
        down = np.array([found.dataset.attrs[f"down_plane_{axis}"] for axis in "xy"])
        bends = experiment.actuator.bends
        found.dataset.attrs["gravity_deg"] = gravity_seen_deg(calibration, down, experiment.rig.plumb, bends)


def _clip(
    work: Runner, experiment: ExperimentSpec, tracked: Stored[Track], track_file: Path, calibration: Stored[Calibration]
) -> None:
    """Make the small rectified clip that the report shows."""
    folder = track_file.parent
    video = experiment.video
    assert video is not None

    def make(progress: Progress) -> tuple[None, list[Path], str]:
        from rfea_vision.vision import make_clip

        facts = make_clip(
            open_source(video), tracked.value, calibration.value, folder / "clip.mp4", progress=progress
        )
        write_text(folder / "clip.json", json.dumps(facts) + "\n")
        size = (folder / "clip.mp4").stat().st_size
        return None, [folder / "clip.mp4", folder / "clip.json"], f"{size / 1e3:.0f} kB"

    work.run(Stage("clip", experiment.name, earlier=[work.cache.sha256(track_file)]), make=make, load=lambda: None)


def preview(work: Runner, experiment: ExperimentSpec) -> Stored[Path]:
    """Draw the track over the video, for people to look at.

    Raises
    ------
    InputError
        If the experiment has no pictures.
    """
    video = experiment.video
    if video is None:
        where = f"{experiment.file}: video"
        raise InputError(f"{where}: this experiment has no pictures to draw on; choose others with -e")
    tracked, calibration = track(work, experiment), calibration_of(work, experiment)
    path = work.out / experiment.name / "preview.mp4"

    def make(progress: Progress) -> tuple[Path, list[Path], str]:
        from rfea_vision.vision import preview_video

        with whole_file(path) as temporary:
            slower = preview_video(open_source(video), tracked.value, calibration.value, temporary, progress=progress)
        return path, [path], str(path) + (f", {slower:.2g} times slower than filmed" if slower > 1 else "")

    return work.run(
        Stage("preview", experiment.name, earlier=[work.cache.sha256(path.with_name("track.nc"))]),
        make=make,
        load=lambda: path,
    )


def _foreign_track(work: Runner, experiment: ExperimentSpec, path: Path) -> Stored[Track]:
    source = experiment.track
    assert source is not None

    camera = experiment.camera if source.keys.points and source.keys.scale is None else None
    calibration = None if camera is None else calibration_of(work, experiment).value

    def make(progress: Progress) -> tuple[Track, list[Path], str]:
        from rfea_vision.readers.tracks import read_track

        to_rig_mm = None
        if calibration is not None and camera is not None:
            from rfea_vision.vision.scene import rig_axes_mm

            gravity_deg, bends = experiment.rig.gravity_deg or 0.0, experiment.actuator.bends
            to_rig_mm = rig_axes_mm(calibration, camera.vertical, gravity_deg, bends)
        found = read_track(source.file, bends=experiment.actuator.bends, spec=source.keys, to_rig_mm=to_rig_mm)
        if "doubts" not in found.dataset.attrs:  # else it is a track of our own, which was doubted where it was made
            doubts, tube = plausibility.of_gaps(found.time_s), experiment.actuator
            if camera is None:
                doubts += plausibility.of_track(found.dataset, 1e3 * tube.length) or of_stretch(found.dataset, tube)
            found.dataset.attrs["doubts"] = "; ".join(doubts)
        found.save(path)
        say_warnings(work, experiment, found)
        noise = found.dataset.attrs.get("sigma_source", "as it was told of the film")
        return found, [path], f"{describe_track(found)}; noise {noise}"

    return work.run(
        Stage(
            "track",
            experiment.name,
            inputs=[source.file],
            earlier=[] if camera is None else [work.cache.sha256(calibration_path(work, experiment))],
            options={
                "bends": experiment.actuator.bends,
                "length": experiment.actuator.length,
                "radius": experiment.actuator.outer_radius,
                "track": source,
                "vertical": None if camera is None else camera.vertical,
                "gravity": experiment.rig.gravity_deg,
            },
        ),
        make=make,
        load=lambda: Track.load(path),
        facts=facts_of_track,
    )


def synchronise(work: Runner, experiment: ExperimentSpec) -> Stored[Recording]:
    """Bring the track and the pressure log of one experiment on one clock; InputError if it has no pressure."""
    tracked = track(work, experiment)
    spec, sync = experiment.pressure, experiment.sync
    if spec.missing:
        raise InputError(
            f"{experiment.file}: pressure: is missing; 'rfea track' needs none, what comes after it "
            "does: 'pressure: {file: pressure.csv}'"
        )
    path = work.out / experiment.name / "recording.nc"
    log: PressureLog | None = None
    before = runs_before(work.campaign, experiment)
    also = [work.cache.sha256(work.out / experiment.name / "track.nc")]
    if any(part.keys.url is not None for part in spec.chambers):  # a database has no file to hash: its answer counts
        from rfea_vision.readers.pressure import read_pressure

        log = read_pressure(spec, experiment.name)
        also.append(hashlib.sha256(log.time_s.tobytes() + log.pressure_kPa.tobytes()).hexdigest())

    def make(progress: Progress) -> tuple[Recording, list[Path], str]:
        from rfea_vision.readers.pressure import constant_pressure, read_pressure

        if spec.constant:
            seen_s = tracked.value.time_s
            used = constant_pressure(spec, float(seen_s[0]), float(seen_s[-1]), experiment.name)
        else:
            used = log or read_pressure(spec, experiment.name)
        recording = _on_one_clock(tracked.value, used, experiment)
        recording = with_earlier_pressure(recording, work.campaign, experiment)
        said = {} if spec.constant else log_warnings(experiment, recording, used, own_times(experiment, recording.time_s))
        recording.dataset.attrs |= rig_attributes(experiment) | said
        recording.save(path)
        say_warnings(work, experiment, recording)
        warn_of_copies(work, [experiment])
        return recording, [path], describe_recording(recording)

    return work.run(
        Stage(
            "sync",
            experiment.name,
            inputs=[file for given in (spec, *(run.pressure for run in before)) for file in given.files],
            earlier=also,
            options={
                "before": [[run.name, run.recorded_at, run.pressure] for run in before],
                "recorded_at": experiment.recorded_at if before else None,
                "pressure": spec,
                "sync": sync,
                "role": experiment.role,
                "bends": experiment.actuator.bends,
                "repeat_of": experiment.repeat_of,
                "rig": experiment.rig,
            },
        ),
        make=make,
        load=lambda: Recording.load(path),
        facts=facts_of_recording,
    )


def _on_one_clock(tracked: Track, log: PressureLog, experiment: ExperimentSpec) -> Recording:
    """Synchronise; an error names its cause where that lies in the track or in the log."""
    from rfea_vision.sync import synchronise as synchronise_clocks

    spec, sync = experiment.pressure, experiment.sync
    try:
        recording = synchronise_clocks(
            tracked,
            log,
            experiment=experiment.name,
            role=experiment.role,
            bends=experiment.actuator.bends,
            method="common_clock" if spec.constant else sync.method,
            value_s=sync.value,
            channel=sync.channel,
            repeat_of=experiment.repeat_of,
            gravity_deg=tracked.dataset.attrs.get("gravity_deg", experiment.rig.gravity_deg),
        )
    except RfeaError as error:
        if few := few_frames(tracked):  # the clocks are not what is wrong
            raise DataError(f"{experiment.name}: track: {few}") from error
        own_s = own_times(experiment, tracked.time_s)
        if order := following.of_order(tracked.dataset, tracked.time_s, log.time_s, log.pressure_kPa, own_s):
            raise InputError(f"{experiment.name}: pressure: {order}") from error
        _refuse_doubtful(log, tracked.time_s, experiment, error)
        raise
    seen_s = recording.time_s
    if np.mean((seen_s >= log.time_s[0]) & (seen_s <= log.time_s[-1])) < LEAST_MEASURED:
        _refuse_doubtful(log, seen_s, experiment)  # hardly a frame has a pressure, and it says why
    return recording


def _refuse_doubtful(
    log: PressureLog, time_s: FloatArray, experiment: ExperimentSpec, cause: Exception | None = None
) -> None:
    """Raise the doubt that a log is declared wrongly, by itself or beside the times (frames,) of a track, if there is one."""
    if doubt := next(iter(misdeclared(log, time_s)), ""):
        raise InputError(f"{experiment.name}: pressure: {doubt}") from cause


def rig_attributes(experiment: ExperimentSpec) -> dict[str, str | float]:
    """Attributes of a recording on how its run was set up; none for a tube that hangs and is free from the start, as the paper's."""
    rig = experiment.rig
    found: dict[str, str | float] = {}
    if rig.gravity_deg is None:
        found["gravity"] = "none"
    elif rig.gravity_deg and rig.plumb is None:  # by the plumb line it stands in the track
        found["gravity_deg"] = rig.gravity_deg
    if rig.held:
        found["held_until_s"] = np.nan if rig.held_until_s is None else rig.held_until_s
    if rig.pulled is not None:
        found["pulled_N"], found["pulled_deg"] = rig.pulled
    if rig.conditions:
        found["conditions"] = json.dumps(dict(rig.conditions), sort_keys=True)
    return found


def _hint_files(hints: Hints) -> list[Path]:
    """The files that hints name: what other programs saw."""
    masks = sorted(path for path in hints.masks.iterdir() if path.is_file()) if hints.masks is not None else []
    return [*masks, *([hints.keypoints] if hints.keypoints is not None else [])]


def facts_of_track(track: Track) -> dict[str, Any]:
    """What `rfea track` prints of a track."""
    return {
        "frames": len(track.time_s),
        "valid": int(track.valid.sum()),
        "reasons": reasons_of(track),
        "too_little": few_frames(track),
    }


def facts_of_recording(recording: Recording) -> dict[str, Any]:
    """What `rfea sync` prints of a recording."""
    attributes = recording.dataset.attrs
    clocks = ("offset_s", "offset_stderr_s", "drift_ppm", "drift_stderr_ppm")
    return {
        "method": str(attributes["sync_method"]),
        **{key: float(attributes[key]) for key in clocks if key in attributes},
    }


def describe_track(track: Track) -> str:
    """Say how many frames were tracked, and why the others were not."""
    lost = ", ".join(f"{count} {reason}" for reason, count in reasons_of(track).items())
    advice = track.dataset.attrs.get("advice")
    said = f"{int(track.valid.sum())} of {len(track.time_s)} frames" + (f" ({lost})" if lost else "")
    return f"{said}; {advice}" if advice else said


def describe_recording(recording: Recording) -> str:
    """Say how the clocks stand."""
    attributes = recording.dataset.attrs
    offset, error = float(attributes["offset_s"]) * 1e3, float(attributes["offset_stderr_s"]) * 1e3
    return f"{attributes['sync_method']}: log clock minus camera clock {offset:.2f} ms (standard error {error:.2f} ms)"


def recordings(work: Runner, *roles: str) -> dict[str, Stored[Recording]]:
    """Return the recordings of these roles by name; of those that are looked at while a model is chosen, where none is given.

    Raises
    ------
    DataError
        If no training experiment is left.
    """
    wanted = [item.name for item in work.active() if item.role in (roles or CHOOSING_ROLES)]
    found = work.each(wanted, lambda item: synchronise(work, item), "synchronised") if wanted else {}
    if not any(work.campaign.experiment(name).role == "train" for name in found):
        raise DataError(f"{work.campaign.root}: no experiment with 'role: train' is left to fit; mend or add one")
    return found
