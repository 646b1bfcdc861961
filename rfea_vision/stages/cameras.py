"""The camera of a campaign: its pictures, and the calibration that turns them into millimetres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.artefacts import Calibration, Hints
from rfea_vision.campaign import CameraSpec, ExperimentSpec, VideoSpec
from rfea_vision.campaign.scaling import calibrated_by_scale, of_sizes, one_scale
from rfea_vision.errors import InputError, RfeaError
from rfea_vision.progress import Progress
from rfea_vision.readers.source import open_source
from rfea_vision.stages.runner import Runner, Stage
from rfea_vision.stages.stored import Stored

if TYPE_CHECKING:
    from rfea_vision.arrays import FloatArray


def calibration_path(work: Runner, experiment: ExperimentSpec | None) -> Path:
    """Return where a calibration is kept: the campaign's, or an experiment's own where its camera differs."""
    if experiment is None or experiment.camera == work.campaign.camera:
        return work.out / "calibration" / "camera.yaml"
    return work.out / experiment.name / "camera.yaml"


def calibration_of(work: Runner, experiment: ExperimentSpec) -> Stored[Calibration]:
    """Calibrate the camera that an experiment's pictures need.

    Raises
    ------
    InputError
        If the experiment names no camera.
    """
    if experiment.camera is None:
        raise InputError(f"{experiment.file}: camera: is missing; pictures need it")
    own = experiment.camera != work.campaign.camera
    subject = f"{experiment.name}/camera" if own else work.campaign.name  # a run may be called as its campaign is
    tube = experiment.actuator if own else work.campaign.actuator
    path = calibration_path(work, experiment)
    return calibrate(work, experiment.camera, path, subject, length_m=tube.length, asked=experiment)


def calibrate(
    work: Runner, camera: CameraSpec, path: Path, subject: str, *, length_m: float, asked: ExperimentSpec | None = None
) -> Stored[Calibration]:
    """Calibrate one camera, of a tube of a length, from its photos, or take over an earlier calibration, as one run `asked` for it."""
    inputs = [*camera.photos, *([camera.plane] if camera.plane else []), *([camera.file] if camera.file else [])]
    size = _picture_size(work, camera, asked) if camera.scale is not None else None
    scaled = (camera.hints, size) if camera.scale is not None else None

    def make(progress: Progress) -> tuple[Calibration, list[Path], str]:
        from rfea_vision.calibration.storage import save_calibration
        from rfea_vision.calibration.thumbnails import save_thumbnails

        calibration, sentence = _calibrated(camera, size, 1e3 * length_m, progress)
        save_calibration(path, calibration)
        if size is None and path.parent.name == "calibration":  # the campaign's own camera is what the report shows
            save_thumbnails(path.parent / "photos", camera.photos, camera.plane)
        return calibration, [path], sentence

    def load() -> Calibration:
        from rfea_vision.calibration.storage import load_calibration

        return load_calibration(path)

    options = {"camera": replace(camera, hints=Hints(clamp=camera.hints.clamp)), "length": length_m, "scaled": scaled}
    return work.run(Stage("calibrate", subject, inputs=inputs, options=options), make=make, load=load)


def _calibrated(
    camera: CameraSpec, size: tuple[int, int] | None, length_mm: float, progress: Progress
) -> tuple[Calibration, str]:
    """A calibration by `camera.scale`, of which the picture's `size` is known, from a file, or from photos; and a sentence."""
    from rfea_vision.calibration.calibrate import calibrate as calibrate_camera
    from rfea_vision.calibration.placing import place_in_plane
    from rfea_vision.calibration.storage import load_calibration

    if size is not None:
        calibration = calibrated_by_scale(camera, size, length_mm)
        return calibration, calibration.quality.get("note", "")
    vertical, offset_mm = camera.vertical if isinstance(camera.vertical, str) else "plumb", camera.board_offset_mm
    if camera.file is not None:
        calibration = load_calibration(camera.file)
        if camera.plane is not None and camera.board is not None:
            calibration = place_in_plane(
                calibration, camera.plane, camera.board, board_offset_mm=offset_mm, vertical=vertical
            )
        return calibration, f"{calibration.model}, taken from {camera.file.name}"
    assert camera.board is not None
    calibration = calibrate_camera(
        camera.photos,
        camera.plane,
        camera.board,
        vertical=vertical,
        board_offset_mm=offset_mm,
        lens=camera.lens,
        clamp_px=camera.hints.clamp,
        tube_length_mm=length_mm,
        progress=progress,
    )
    used = sum(bool(photo.get("used")) for photo in calibration.photos)
    said = f"{calibration.model}, RMS {calibration.rms_px:.3f} px, {used} of {len(calibration.photos)} photos"
    return calibration, said


def _picture_size(work: Runner, camera: CameraSpec, asked: ExperimentSpec | None) -> tuple[int, int]:
    """Width and height of the pictures in which a scale was pointed at; a film that cannot be opened keeps no other from it."""
    sizes: dict[str, tuple[int, int]] = {}
    unreadable: RfeaError | None = None
    for experiment in work.campaign.experiments:
        used = experiment.role != "ignore" or experiment is asked
        if experiment.video is None or not used or not one_scale(experiment.camera, camera):
            continue
        try:
            sizes[experiment.name] = open_source(experiment.video).size
        except RfeaError as error:
            unreadable = unreadable or error
    if text := of_sizes(sizes):
        file = work.campaign.root / "campaign.yaml"
        if asked is not None and not one_scale(work.campaign.camera, camera):
            file = asked.file
        raise InputError(f"{file}: camera.scale: {text}")
    if sizes:
        return next(iter(sizes.values()))
    raise unreadable or InputError(
        f"{work.campaign.root / 'campaign.yaml'}: camera.scale: no experiment has a video of this camera; give one, "
        "or write the scale into the experiment.yaml whose video it belongs to"
    )


def own_times(experiment: ExperimentSpec, time_s: FloatArray) -> FloatArray | None:
    """Times (frames,) that the container itself gives, from the first of `time_s` on; None where `video.rate` does not replace them."""
    video = experiment.video
    if video is None or video.file is None or video.rate_Hz is None or experiment.track is not None:
        return None
    own_s = open_source(replace(video, rate_Hz=None)).times_s()
    return own_s - own_s[0] + time_s[0] if own_s.shape == time_s.shape else None


def pictures_of(video: VideoSpec) -> list[Path]:
    """The files that a video consists of: one, or a folder's pictures and the table of their times."""
    if video.file is not None:
        return [video.file]
    assert video.frames is not None
    files = sorted(path for path in video.frames.iterdir() if path.is_file())
    return [*files, *([video.times] if video.times is not None else [])]
