"""Pictures to point at: frames of films, photos of the board, and what was tracked in them; hints written into the files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rfea_vision.artefacts import Track
from rfea_vision.artefacts.reasons import reason_of
from rfea_vision.calibration.projection import camera_vector, project
from rfea_vision.calibration.storage import load_calibration
from rfea_vision.campaign import Campaign, ExperimentSpec, VideoSpec
from rfea_vision.errors import InputError
from rfea_vision.readers.source import open_source
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.scene import matched_to
from rfea_vision.vision.show.clip import in_frame, rig_to_plane
from rfea_vision.workbench.scales import take_scale, write_scale
from rfea_vision.workbench.state import HINTS
from rfea_vision.workbench.yaml_edit import set_keys

LONGEST_SIDE_PX, QUALITY = 1600, 88  # of what is sent to the page; hints are in pixels of the film itself


def _source(video: VideoSpec) -> FrameSource:
    stands = [path.stat() for path in (video.file, video.frames, video.times) if path is not None]
    return _opened(video, tuple((now.st_mtime_ns, now.st_size) for now in stands))


@lru_cache(maxsize=8)
def _opened(video: VideoSpec, stands: tuple[tuple[int, int], ...]) -> FrameSource:
    return open_source(video)


def source_of(experiment: ExperimentSpec) -> FrameSource:
    """The film of an experiment.

    Raises
    ------
    InputError
        If it has no pictures.
    """
    if experiment.video is None or not experiment.video.found:
        raise InputError(f"{experiment.name}: has no pictures; its track came from another tool")
    return _source(experiment.video)


def film(experiment: ExperimentSpec) -> dict[str, Any]:
    """Size in pixels, number of frames, and the time of each."""
    source = source_of(experiment)
    times = source.times_s()
    return {"width": source.size[0], "height": source.size[1], "frames": len(times), "times": times.round(6).tolist()}


def picture(experiment: ExperimentSpec, frame: int) -> bytes:
    """One frame as a JPEG."""
    return _jpeg(source_of(experiment).frame(frame))


def photo(campaign: Campaign, index: int) -> bytes:
    """One photo of the board as a JPEG.

    Raises
    ------
    InputError
        If there is no such photo, or it cannot be read.
    """
    photos = campaign.camera.photos if campaign.camera is not None else ()
    if not 0 <= index < len(photos):
        raise InputError(f"{campaign.root}: has no photo {index + 1} of the board")
    image = cv2.imread(str(photos[index]), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise InputError(f"{photos[index]}: not a readable picture; remove it or copy it again")
    return _jpeg(np.asarray(image, dtype=np.uint8))


def _jpeg(luma: np.ndarray) -> bytes:
    shrink = min(1.0, LONGEST_SIDE_PX / max(luma.shape))
    small = luma if shrink == 1.0 else cv2.resize(luma, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", np.ascontiguousarray(small), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


@dataclass(frozen=True)
class Tracked:
    """Centre lines (frames, nodes, 2) in pixels, NaN where refused; reasons, and what more was said of each."""

    lines: np.ndarray
    reasons: np.ndarray
    details: np.ndarray


@lru_cache(maxsize=8)
def _tracked(file: Path, camera_file: Path, video: VideoSpec, changed: tuple[int, int]) -> Tracked:
    track = Track.load(file)
    camera = camera_vector(matched_to(load_calibration(camera_file), _source(video)))
    lines = in_frame(track, project(camera, rig_to_plane(track, track.dataset["midline"].values)))
    reasons = track.dataset["reason"].values.astype(str)
    details = track.dataset["reason_detail"].values.astype(str) if "reason_detail" in track.dataset else None
    return Tracked(lines, reasons, np.full(reasons.shape, "") if details is None else details)


def tracked(campaign: Campaign, experiment: ExperimentSpec) -> Tracked | None:
    """What `_tracked` gives of an experiment; None before it was tracked."""
    file = campaign.out / experiment.name / "track.nc"
    own = campaign.out / experiment.name / "camera.yaml"
    camera_file = (
        own if experiment.camera != campaign.camera and own.is_file() else campaign.out / "calibration" / "camera.yaml"
    )
    if experiment.video is None or not file.is_file() or not camera_file.is_file():
        return None
    changed = (file.stat().st_mtime_ns, camera_file.stat().st_mtime_ns)
    return _tracked(file, camera_file, experiment.video, changed)


def outline(campaign: Campaign, experiment: ExperimentSpec, frame: int) -> dict[str, Any]:
    """The centre line that was tracked in a frame, or why there is none."""
    found = tracked(campaign, experiment)
    if found is None or not 0 <= frame < len(found.reasons):
        return {"line": None, "reason": "", "words": ""}
    line, reason, detail = found.lines[frame], str(found.reasons[frame]), str(found.details[frame])
    words = ": ".join(filter(None, (reason_of(reason).words, detail)))
    return {"line": None if reason else line.round(1).tolist(), "reason": reason, "words": words}


def refused(campaign: Campaign, experiment: ExperimentSpec, reason: str) -> list[int]:
    """Frames that were refused for a reason."""
    found = tracked(campaign, experiment)
    return [] if found is None else np.flatnonzero(found.reasons == reason).tolist()


def write_hint(campaign: Campaign, experiment: ExperimentSpec, key: str, value: Any, *, everywhere: bool) -> Path:
    """Write a hint into experiment.yaml, or for all films into campaign.yaml, which a lone experiment has not; None takes it away.

    A scale is taken away where it stands.

    Raises
    ------
    InputError
        If it is no hint that one points at, lies outside of the picture, or the file's form does not allow the change.
    """
    if key not in ("scale", *HINTS):
        raise InputError(f"camera.{key}: is set by hand; one points at scale, {', '.join(HINTS)}")
    if value is None and key == "scale":
        return take_scale(campaign, experiment)
    if value is not None:
        source = source_of(experiment)
        width, height = source.size
        for x, y in _points(key, value):
            if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
                raise InputError(f"camera.{key}: {x:g}, {y:g} lies outside the picture of {width} x {height} px")
        if key == "corrections" and not all(0 < later["frame"] < len(source.times_s()) for later in value):
            raise InputError(f"camera.{key}: a frame is none of the film's after the first; point at the tube in one of these")
    if key == "scale" and value is not None:
        return write_scale(campaign, experiment, source_of(experiment).size, value, everywhere=everywhere)
    shared = campaign.root / "campaign.yaml"
    file = shared if everywhere and key != "corrections" and shared.is_file() else experiment.file  # frames are those of one film
    set_keys(file, {("camera", key): value})
    return file


def _points(key: str, value: Any) -> Sequence[tuple[float, float]]:
    """Points that have to lie in the picture; of boxes the two corners."""
    if key in ("clamp", "centre_line"):
        return [(float(x), float(y)) for x, y in value]
    if key == "scale":
        return [(float(x), float(y)) for x, y in value["points"]]
    if key == "corrections":
        return [(float(x), float(y)) for later in value for x, y in later["points"]]
    if key == "tip":
        x, y = value
        return [(float(x), float(y))]
    boxes = value if key == "exclude" else [value]
    return [point for x, y, w, h in boxes for point in ((float(x), float(y)), (float(x + w - 1), float(y + h - 1)))]
