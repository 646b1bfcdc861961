"""A small clip of an experiment, rectified into the rig plane: a clip pixel is an affine function of rig mm."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration, Track
from rfea_vision.calibration.projection import camera_vector, project
from rfea_vision.errors import DataError
from rfea_vision.files import whole_file
from rfea_vision.lines import rig_axes
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.scene import matched_to

PLAYBACK_HZ = 30
KEY_FRAME_EVERY = 6  # frequent key frames, so that a page can jump anywhere
MARGIN_MM, MARGIN_SHARE = 14.0, 0.25  # around what the tube visits, and no more than this share of that: bodies of mm are filmed, too
LONGEST_SIDE_PX = 400
LEAST_FRAMES, MOST_FRAMES = 60, 900


def rig_to_plane(track: Track, rig_mm: FloatArray) -> FloatArray:
    """Plane coordinates (..., 2) mm of rig coordinates (..., 2) mm, from the track's attributes."""
    attributes = track.dataset.attrs
    try:
        origin = np.array([attributes["clamp_plane_x_mm"], attributes["clamp_plane_y_mm"]], dtype=float)
        down = np.array([attributes["down_plane_x"], attributes["down_plane_y"]], dtype=float)
    except KeyError as error:
        raise DataError(
            "the track does not say where its clamp lies in the picture; track the video again with --force"
        ) from error
    return origin + np.asarray(rig_mm) @ rig_axes(down)


def in_frame(track: Track, pixels: FloatArray, frame: int | slice = slice(None)) -> FloatArray:
    """Pixels of the first frame as one frame, or each of all (along the first axis), shows them: a camera that moves was followed.

    `pixels` are (..., n, 2), and (frames, n, 2) for all frames.
    """
    if "view" not in track.dataset:
        return pixels
    view = track.dataset["view"].values[frame]
    return pixels @ np.swapaxes(view[..., :2], -1, -2) + view[..., None, :, 2]


def make_clip(
    source: FrameSource,
    track: Track,
    calibration: Calibration,
    out_mp4: Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write the clip and say how its pixels relate to rig mm.

    Clip pixel of a rig point: column = (x - x_min_mm) * px_per_mm, row = (y_max_mm - y) * px_per_mm, measured from
    the picture's top left corner.

    Returns
    -------
    dict
        ``file``, ``times_s`` (camera clock, one per clip frame), ``x_min_mm``, ``y_max_mm``, ``px_per_mm``,
        ``width``, ``height``.
    """
    box = clip_box(track)
    columns, rows = np.meshgrid(np.arange(box["width"]), np.arange(box["height"]))
    rig = np.stack(
        [box["x_min_mm"] + (columns + 0.5) / box["px_per_mm"], box["y_max_mm"] - (rows + 0.5) / box["px_per_mm"]],
        axis=-1,
    )
    camera = camera_vector(matched_to(calibration, source))
    maps = project(camera, rig_to_plane(track, rig))
    times = track.time_s
    step = clip_step(times)
    shown: list[float] = []

    def pictures() -> Iterator[NDArray[np.uint8]]:
        for number, (time, luma) in enumerate(source):
            if number % step == 0:
                seen = in_frame(track, maps, min(number, len(times) - 1)).astype(np.float32)
                yield np.asarray(cv2.remap(luma, seen, None, cv2.INTER_LINEAR, borderValue=0), dtype=np.uint8)  # pyright: ignore[reportCallIssue, reportArgumentType]
                shown.append(float(time))
            if progress is not None and number % 16 == 0:
                progress(number + 1, max(len(times), number + 1))

    write_film(out_mp4, pictures(), (box["width"], box["height"]), crf=30)
    return {"file": out_mp4.name, "times_s": shown, **box}


def write_film(
    out_mp4: Path, pictures: Iterable[NDArray[np.uint8]], size: tuple[int, int], *, crf: int, rate_Hz: float = PLAYBACK_HZ
) -> None:
    """Encode pictures, grey (h, w) or RGB (h, w, 3), as H.264 of a width and height, even both, by one thread."""
    rate = Fraction(rate_Hz).limit_denominator(1000)
    options = {"crf": str(crf), "preset": "fast", "bf": "0", "threads": "1", "g": str(KEY_FRAME_EVERY)}
    with (
        whole_file(out_mp4) as temporary,
        av.open(str(temporary), "w", format="mp4", options={"movflags": "faststart"}) as container,
    ):
        stream = container.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        stream.time_base = 1 / rate
        for number, picture in enumerate(pictures):
            kind = "gray" if picture.ndim == 2 else "rgb24"
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format=kind).reformat(format="yuv420p")
            frame.pts, frame.time_base = number, 1 / rate
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def clip_step(times: FloatArray) -> int:
    """Take every so many frames: about 30 a second, no more than 900 in all, and of a fast film that is soon over no fewer than 60."""
    if len(times) < 2:
        return 1
    rate = 1.0 / max(float(np.median(np.diff(times))), 1e-6)
    step = min(round(rate / PLAYBACK_HZ), len(times) // LEAST_FRAMES)
    return max(1, step, int(np.ceil(len(times) / MOST_FRAMES)))


def clip_box(track: Track) -> dict[str, Any]:
    """Part of the rig plane that the tube visits, with a margin, and the clip's scale and size (even, in px)."""
    midline = track.dataset["midline"].values[track.valid].reshape(-1, 2)
    low, high = np.nanmin(midline, axis=0), np.nanmax(midline, axis=0)
    margin_mm = min(MARGIN_MM, MARGIN_SHARE * float(np.max(high - low)))
    low, high = low - margin_mm, high + margin_mm
    scale = min(LONGEST_SIDE_PX / float(np.max(high - low)), float(track.dataset.attrs.get("px_per_mm", 4.0)))
    width, height = (int(2 * np.ceil(side * scale / 2)) for side in high - low)
    return {"x_min_mm": float(low[0]), "y_max_mm": float(high[1]), "px_per_mm": scale, "width": width, "height": height}
