"""An overlay video, to see what was tracked."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from rfea_vision.artefacts import Calibration, Track
from rfea_vision.calibration.projection import camera_vector, project
from rfea_vision.files import whole_file
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.show.clip import clip_step, in_frame, rig_to_plane
from rfea_vision.vision.track import matched_to

RED, GREY = (220, 0, 60), (150, 150, 150)


def preview_video(
    source: FrameSource,
    track: Track,
    calibration: Calibration,
    out_mp4: Path,
    *,
    every: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the frames with centre line, edges and tip drawn on them; rejected frames carry their reason, and where the tube was last.

    `every` takes each so-many-th frame; by default about thirty a second.
    """
    camera = camera_vector(matched_to(calibration, source))
    data = track.dataset
    midline, edges, valid = data["midline"].values, data["edges"].values, track.valid
    reasons = data["reason"].values
    details = data["reason_detail"].values if "reason_detail" in data else np.full(len(reasons), "")
    step = every or clip_step(track.time_s)
    width, height = (2 * (side // 2) for side in source.size)
    with whole_file(out_mp4) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": "24", "preset": "fast", "threads": "1"}  # by default as many as cores: other bytes
        shown = 0
        for number, (_, luma) in enumerate(source):
            if number % step or number >= len(valid):
                continue
            canvas = np.asarray(cv2.cvtColor(np.ascontiguousarray(luma), cv2.COLOR_GRAY2RGB), dtype=np.uint8)
            if valid[number]:
                for line, colour in (
                    (edges[number, 0], (255, 176, 0)),
                    (edges[number, 1], (0, 176, 255)),
                    (midline[number], (220, 0, 60)),
                ):
                    pixels = in_frame(track, project(camera, rig_to_plane(track, line)), number)
                    cv2.polylines(canvas, [np.round(pixels * 16).astype(np.int32)], False, colour, 1, cv2.LINE_AA, 4)
                cv2.circle(canvas, (round(pixels[-1, 0]), round(pixels[-1, 1])), 6, (220, 0, 60), 1, cv2.LINE_AA)
            else:
                before = np.flatnonzero(valid[:number])
                if before.size:  # where it was last
                    pixels = in_frame(track, project(camera, rig_to_plane(track, midline[before[-1]])), number)
                    cv2.polylines(canvas, [np.round(pixels * 16).astype(np.int32)], False, GREY, 1, cv2.LINE_AA, 4)
                for k, text in enumerate((str(reasons[number]), str(details[number]))):
                    cv2.putText(canvas, text, (20, 40 + 30 * k), cv2.FONT_HERSHEY_SIMPLEX, 1.0 - 0.4 * k, RED, 2)
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(canvas[:height, :width]), format="rgb24").reformat(
                format="yuv420p"
            )
            frame.pts, frame.time_base = shown, Fraction(1, 30)
            shown += 1
            for packet in stream.encode(frame):
                container.mux(packet)
            if progress is not None:
                progress(number + 1, len(valid))
        for packet in stream.encode():
            container.mux(packet)
