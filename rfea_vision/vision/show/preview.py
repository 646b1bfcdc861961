"""An overlay video, to see what was tracked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts import Calibration, Track
from rfea_vision.calibration.projection import camera_vector, project
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.scene import matched_to
from rfea_vision.vision.show.clip import PLAYBACK_HZ, clip_step, in_frame, rig_to_plane, write_film

RED, GREY, INNER, OUTER = (220, 0, 60), (150, 150, 150), (255, 176, 0), (0, 176, 255)


def preview_video(
    source: FrameSource,
    track: Track,
    calibration: Calibration,
    out_mp4: Path,
    *,
    every: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> float:
    """Write the frames with centre line, edges and tip drawn on them; rejected frames carry their reason, and where the tube was last.

    In the film's colours and at its pace. `every` takes each so-many-th frame; by default about thirty a second, and more of a fast
    film that is over too soon to be seen, which then runs slower than it was filmed.

    Returns
    -------
    float
        How many times slower it runs, 1 for a film at its pace.
    """
    camera = camera_vector(matched_to(calibration, source))
    data = track.dataset
    midline, edges, valid = data["midline"].values, data["edges"].values, track.valid
    reasons = data["reason"].values
    details = data["reason_detail"].values if "reason_detail" in data else np.full(len(reasons), "")
    step = every or clip_step(track.time_s)
    width, height = (2 * (side // 2) for side in source.size)

    def pictures() -> Iterator[NDArray[np.uint8]]:
        for number, (_, picture) in enumerate(source.colours()):
            if number % step or number >= len(valid):
                continue
            canvas = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
            before = np.flatnonzero(valid[: number + 1])
            lines = [(midline[before[-1]], GREY)] if before.size else []  # where it was last
            if valid[number]:
                lines = [(edges[number, 0], INNER), (edges[number, 1], OUTER), (midline[number], RED)]
            for line, colour in lines:
                pixels = in_frame(track, project(camera, rig_to_plane(track, line)), number)
                cv2.polylines(canvas, [np.round(pixels * 16).astype(np.int32)], False, colour, 1, cv2.LINE_AA, 4)
                if colour == RED:
                    cv2.circle(canvas, (round(pixels[-1, 0]), round(pixels[-1, 1])), 6, RED, 1, cv2.LINE_AA)
            for k, text in enumerate((str(reasons[number]), str(details[number]))):
                cv2.putText(canvas, text, (20, 40 + 30 * k), cv2.FONT_HERSHEY_SIMPLEX, 1.0 - 0.4 * k, RED, 2)
            yield canvas[:height, :width]
            if progress is not None:
                progress(number + 1, len(valid))

    filmed_Hz = 1.0 / max(float(np.median(np.diff(track.time_s[::step]))), 1e-6) if len(valid) > step else PLAYBACK_HZ
    # thirty a second, rounded to whole frames, are no more than this
    shown_Hz = PLAYBACK_HZ if filmed_Hz > 1.5 * PLAYBACK_HZ else filmed_Hz
    write_film(out_mp4, pictures(), (width, height), crf=24, rate_Hz=shown_Hz)
    return filmed_Hz / shown_Hz
