"""The stages left of the waist: photos to a calibration, pictures to a track, track and log to a recording."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rfea_vision.artefacts import Calibration, Hints, Recording, Track
from rfea_vision.campaign import CameraSpec, ExperimentSpec, VideoSpec, plausibility
from rfea_vision.errors import DataError, InputError
from rfea_vision.files import whole_file, write_text
from rfea_vision.progress import Progress
from rfea_vision.stages.earlier import runs_before, with_earlier_pressure
from rfea_vision.stages.products import compiling
from rfea_vision.stages.runner import Runner, Stage
from rfea_vision.stages.stored import Stored
from rfea_vision.stages.warnings import few_frames, log_warnings, reasons_of, say_warnings, warn_of_equal_logs

if TYPE_CHECKING:
    from rfea_vision.readers.pressure import PressureLog


def calibration_path(work: Runner, experiment: ExperimentSpec | None) -> Path:
    """Return where a calibration is kept: the campaign's, or an experiment's own where its camera differs."""
    if experiment is None or experiment.camera == work.campaign.camera:
        return work.out / "calibration" / "camera.yaml"
    return work.out / experiment.name / "camera.yaml"


def calibrate(work: Runner, camera: CameraSpec, path: Path, subject: str) -> Stored[Calibration]:
    """Calibrate one camera from its photos, or take over an earlier calibration."""
    inputs = [*camera.photos, *([camera.plane] if camera.plane else []), *([camera.file] if camera.file else [])]
    size = _picture_size(work, camera) if camera.scale is not None else None
    scaled = (camera.hints, size, work.campaign.actuator.length) if camera.scale is not None else None

    def load(file: Path) -> Calibration:
        from rfea_vision.calibration import load_calibration

        return load_calibration(file)

    def make(progress: Progress) -> tuple[Calibration, list[Path], str]:
        from rfea_vision.calibration import calibrate as calibrate_camera
        from rfea_vision.calibration import save_calibration
        from rfea_vision.calibration.placing import place_in_plane
        from rfea_vision.calibration.thumbnails import save_thumbnails

        vertical = camera.vertical if isinstance(camera.vertical, str) else "plumb"
        if size is not None:
            calibration = _scaled(camera, size, 1e3 * work.campaign.actuator.length)
            save_calibration(path, calibration)
            return calibration, [path], str(calibration.quality["note"])
        if camera.file is not None:
            calibration = load(camera.file)
            if camera.plane is not None and camera.board is not None:
                offset_mm = camera.board_offset_mm
                calibration = place_in_plane(
                    calibration, camera.plane, camera.board, board_offset_mm=offset_mm, vertical=vertical
                )
        else:
            assert camera.board is not None
            calibration = calibrate_camera(
                camera.photos,
                camera.plane,
                camera.board,
                vertical=vertical,
                board_offset_mm=camera.board_offset_mm,
                lens=camera.lens,
                clamp_px=camera.hints.clamp,
                tube_length_mm=1e3 * work.campaign.actuator.length,
                progress=progress,
            )
        save_calibration(path, calibration)
        if path.parent.name == "calibration":  # the campaign's own camera is the one that the report shows
            save_thumbnails(path.parent / "photos", camera.photos, camera.plane)
        used = sum(bool(photo.get("used")) for photo in calibration.photos)
        sentence = f"{calibration.model}, RMS {calibration.rms_px:.3f} px, {used} of {len(calibration.photos)} photos"
        if camera.file is not None:
            sentence = f"{calibration.model}, taken from {camera.file.name}"
        return calibration, [path], sentence

    return work.run(
        Stage(
            "calibrate",
            subject,
            inputs=inputs,
            options={"camera": replace(camera, hints=Hints(clamp=camera.hints.clamp)), "scaled": scaled},
        ),
        make=make,
        load=lambda: load(path),
    )


def _picture_size(work: Runner, camera: CameraSpec) -> tuple[int, int]:
    """Width and height of the first pictures that were taken with a camera."""
    for experiment in work.campaign.experiments:
        if experiment.video is not None and experiment.camera == camera:
            return open_source(experiment.video).size
    raise InputError(
        f"{work.campaign.root / 'campaign.yaml'}: camera.scale: no experiment has a video of this camera; give one, "
        "or write the scale into the experiment.yaml whose video it belongs to"
    )


def _scaled(camera: CameraSpec, size: tuple[int, int], length_mm: float) -> Calibration:
    """Calibration by `camera.scale`."""
    from rfea_vision.calibration.scale import TUBE_SPREAD, scaled_by_distance, scaled_by_places

    scale, hints = camera.scale, camera.hints
    assert scale is not None
    if scale.places_mm:
        return scaled_by_places(size, scale.points, scale.places_mm, error_mm=scale.error_mm)
    if scale.distance_mm is not None:
        return scaled_by_distance(size, scale.points, scale.distance_mm, error_mm=scale.error_mm)
    assert hints.clamp is not None and hints.tip is not None
    (ax, ay), (bx, by) = hints.clamp
    line = [((ax + bx) / 2, (ay + by) / 2), *hints.centre_line, hints.tip]
    return scaled_by_distance(size, line, length_mm, error_mm=TUBE_SPREAD * length_mm)


def track(work: Runner, experiment: ExperimentSpec) -> Stored[Track]:
    """Track one experiment's pictures, or read the track that another tool made."""
    path = work.out / experiment.name / "track.nc"
    if experiment.track is not None:
        return _foreign_track(work, experiment, path)
    if experiment.video is None or experiment.camera is None:
        raise InputError(
            f"{experiment.folder / 'experiment.yaml'}: video: nothing to track; name a video, frames or a track"
        )
    calibration_file = calibration_path(work, experiment)
    calibration = calibration_of(work, experiment)
    camera, video = experiment.camera, experiment.video
    lamp = experiment.sync.box if experiment.sync.method == "led" else None

    def make(progress: Progress) -> tuple[Track, list[Path], str]:
        work.tell(compiling("vision"))
        found = follow(experiment, calibration.value, open_source(video), progress=progress)
        _say_calibration(found, calibration.value, experiment)
        _say_gravity(found, calibration.value, experiment)
        found.save(path)
        say_warnings(work, experiment, found)
        return found, [path], describe_track(found)

    tracked = work.run(
        Stage(
            "track",
            experiment.name,
            inputs=[*_pictures(video), *_hint_files(camera.hints)],
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
    )
    _clip(work, experiment, tracked, path, calibration)
    return tracked


def follow(experiment: ExperimentSpec, calibration: Calibration, source: Any, **more: Any) -> Track:
    """Track the tube through a source of this experiment's pictures, with its hints; `more` as for `track_frames`."""
    from rfea_vision.vision import track_frames

    camera, sync = experiment.camera, experiment.sync
    assert camera is not None
    return track_frames(
        source,
        calibration,
        experiment.actuator,
        vertical=camera.vertical,
        gravity_deg=experiment.rig.gravity_deg or 0.0,
        hints=camera.hints,
        lamp_box=sync.box if sync.method == "led" else None,
        **more,
    )


def _say_calibration(found: Track, calibration: Calibration, experiment: ExperimentSpec) -> None:
    """Add, as attributes, what the calibration's uncertainty means where the tube has been."""
    from rfea_vision.calibration.region import visited

    region = visited(calibration, found, 1e3 * experiment.actuator.length)
    for key, value in (region or {}).items():
        found.dataset.attrs[f"calibration_{key}"] = value


def _say_gravity(found: Track, calibration: Calibration, experiment: ExperimentSpec) -> None:
    """Add, as an attribute, where gravity points by the plumb line in the picture."""
    from rfea_vision.vision.track import gravity_seen_deg

    if experiment.rig.plumb is not None:
        down = np.array([found.dataset.attrs[f"down_plane_{axis}"] for axis in "xy"])
        bends = experiment.actuator.bends
        found.dataset.attrs["gravity_deg"] = gravity_seen_deg(calibration, down, experiment.rig.plumb, bends)


def _clip(
    work: Runner,
    experiment: ExperimentSpec,
    tracked: Stored[Track],
    track_file: Path,
    calibration: Stored[Calibration],
) -> None:
    """Make the small rectified clip that the report shows."""
    folder = track_file.parent
    video = experiment.video
    assert video is not None

    def make(progress: Progress) -> tuple[None, list[Path], str]:
        from rfea_vision.vision import make_clip

        facts: dict[str, Any] = make_clip(
            open_source(video), tracked.value, calibration.value, folder / "clip.mp4", progress=progress
        )
        write_text(folder / "clip.json", json.dumps(facts) + "\n")
        size = (folder / "clip.mp4").stat().st_size
        return None, [folder / "clip.mp4", folder / "clip.json"], f"{size / 1e3:.0f} kB"

    work.run(
        Stage(
            "clip",
            experiment.name,
            earlier=[work.cache.sha256(track_file)],
        ),
        make=make,
        load=lambda: None,
    )


def preview(work: Runner, experiment: ExperimentSpec) -> Stored[Path]:
    """Draw the track over the video, for people to look at.

    Raises
    ------
    InputError
        If the experiment has no pictures.
    """
    video = experiment.video
    if video is None:
        where = f"{experiment.folder / 'experiment.yaml'}: video"
        raise InputError(f"{where}: this experiment has no pictures to draw on; choose others with -e")
    tracked, calibration = track(work, experiment), calibration_of(work, experiment)
    path = work.out / experiment.name / "preview.mp4"

    def make(progress: Progress) -> tuple[Path, list[Path], str]:
        from rfea_vision.vision import preview_video

        with whole_file(path) as temporary:
            preview_video(open_source(video), tracked.value, calibration.value, temporary, progress=progress)
        return path, [path], str(path)

    return work.run(
        Stage(
            "preview",
            experiment.name,
            earlier=[work.cache.sha256(path.with_name("track.nc"))],
        ),
        make=make,
        load=lambda: path,
    )


def _foreign_track(work: Runner, experiment: ExperimentSpec, path: Path) -> Stored[Track]:
    source = experiment.track
    assert source is not None

    camera = experiment.camera if source.points and source.scale_mm is None else None
    calibration = None if camera is None else calibration_of(work, experiment).value

    def make(progress: Progress) -> tuple[Track, list[Path], str]:
        from rfea_vision.readers.tracks import read_track

        to_rig_mm = None
        if calibration is not None and camera is not None:
            from rfea_vision.vision.track import rig_axes_mm

            gravity_deg, bends = experiment.rig.gravity_deg or 0.0, experiment.actuator.bends
            to_rig_mm = rig_axes_mm(calibration, camera.vertical, gravity_deg, bends)
        found = read_track(source.file, bends=experiment.actuator.bends, spec=source, to_rig_mm=to_rig_mm)
        if camera is None:
            found.dataset.attrs["doubts"] = "; ".join(
                plausibility.of_track(found.dataset, 1e3 * experiment.actuator.length)
            )
        found.save(path)
        say_warnings(work, experiment, found)
        return found, [path], f"{describe_track(found)}; noise {found.dataset.attrs['sigma_source']}"

    return work.run(
        Stage(
            "track",
            experiment.name,
            inputs=[source.file],
            earlier=[] if camera is None else [work.cache.sha256(calibration_path(work, experiment))],
            options={"bends": experiment.actuator.bends, "track": source, "gravity": experiment.rig.gravity_deg},
        ),
        make=make,
        load=lambda: Track.load(path),
    )


def synchronise(work: Runner, experiment: ExperimentSpec) -> Stored[Recording]:
    """Bring the track and the pressure log of one experiment on one clock."""
    tracked = track(work, experiment)
    spec, sync = experiment.pressure, experiment.sync
    if spec.missing:
        raise InputError(
            f"{experiment.folder / 'experiment.yaml'}: pressure: is missing; 'rfea track' needs none, what comes after it "
            "does: 'pressure: {file: pressure.csv}'"
        )
    path = work.out / experiment.name / "recording.nc"
    log: PressureLog | None = None
    before = runs_before(work.campaign, experiment)
    also = [work.cache.sha256(work.out / experiment.name / "track.nc")]
    if any(part.url is not None for part in spec.chambers):  # a database has no file to hash: its answer counts
        from rfea_vision.readers.pressure import read_pressure

        log = read_pressure(spec, experiment.name)
        also.append(hashlib.sha256(log.time_s.tobytes() + log.pressure_kPa.tobytes()).hexdigest())

    def make(progress: Progress) -> tuple[Recording, list[Path], str]:
        from rfea_vision.readers.pressure import constant_pressure, read_pressure
        from rfea_vision.sync import synchronise as synchronise_clocks

        if spec.constant:
            seen_s = tracked.value.time_s
            used = constant_pressure(spec, float(seen_s[0]), float(seen_s[-1]), experiment.name)
        else:
            used = log or read_pressure(spec, experiment.name)
        try:
            recording = synchronise_clocks(
                tracked.value,
                used,
                experiment=experiment.name,
                role=experiment.role,
                bends=experiment.actuator.bends,
                method="common_clock" if spec.constant else sync.method,
                value_s=sync.value_s,
                channel=sync.channel,
                repeat_of=experiment.repeat_of,
            )
        except DataError as error:
            if few := few_frames(tracked.value):  # the clocks are not what is wrong
                raise DataError(f"{experiment.name}: track: {few}") from error
            raise
        recording = with_earlier_pressure(recording, work.campaign, experiment)
        recording.dataset.attrs |= rig_attributes(experiment) | ({} if spec.constant else log_warnings(recording, used))
        recording.save(path)
        say_warnings(work, experiment, recording)
        warn_of_equal_logs(work, [experiment])
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
    )


def rig_attributes(experiment: ExperimentSpec) -> dict[str, Any]:
    """Return what a recording says of how the run was set up; nothing where it hangs, free from the start, as the paper's."""
    rig = experiment.rig
    found: dict[str, Any] = {}
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


def open_source(video: VideoSpec) -> Any:
    """Open a video or a folder of frames."""
    from rfea_vision.readers.video import open_frames, open_video

    if video.file is not None:
        return open_video(video.file, video.rate_Hz)
    assert video.frames is not None and video.times is not None
    return open_frames(video.frames, video.times, video.rate_Hz, within=video.within)


def _pictures(video: VideoSpec) -> list[Path]:
    if video.file is not None:
        return [video.file]
    assert video.frames is not None
    files = sorted(path for path in video.frames.iterdir() if path.is_file())
    return [*files, *([video.times] if video.times is not None else [])]


def _hint_files(hints: Hints) -> list[Path]:
    """The files that hints name: what other programs saw."""
    masks = sorted(path for path in hints.masks.iterdir() if path.is_file()) if hints.masks is not None else []
    return [*masks, *([hints.keypoints] if hints.keypoints is not None else [])]


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


def calibration_of(work: Runner, experiment: ExperimentSpec) -> Stored[Calibration]:
    """Calibrate the camera that an experiment's pictures need.

    Raises
    ------
    InputError
        If the experiment names no camera.
    """
    if experiment.camera is None:
        raise InputError(f"{experiment.folder / 'experiment.yaml'}: camera: is missing; pictures need it")
    subject = work.campaign.name if experiment.camera == work.campaign.camera else experiment.name
    return calibrate(work, experiment.camera, calibration_path(work, experiment), subject)


def recordings(work: Runner, *roles: str) -> dict[str, Stored[Recording]]:
    """Return the recordings of these roles by name.

    Raises
    ------
    DataError
        If no training experiment is left.
    """
    wanted = [item.name for item in work.active() if item.role in roles]
    found = work.each(wanted, lambda item: synchronise(work, item), "synchronised") if wanted else {}
    if not any(work.campaign.experiment(name).role == "train" for name in found):
        raise DataError(f"{work.campaign.root}: no experiment with 'role: train' is left to fit; mend or add one")
    return found
