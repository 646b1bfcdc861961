"""Bodies begun in one picture by what a person points at there."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from rfea_vision.artefacts import Actuator, Calibration, Hints
from rfea_vision.readers.video import FrameSource, open_frames
from rfea_vision.vision.body.begin import scale_for
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.light import levelled
from rfea_vision.vision.scene import make_scene
from testing.drawn import Scene, Stage
from testing.pointing import pointed_by_hand


def begun(source: FrameSource, calibration: Calibration, tube: Actuator, hints: Hints) -> tuple[BodyFollower, str]:
    """What would follow the body, after a film's first frame, and why that is refused; empty where the body is found."""
    scene = make_scene(calibration, tube, "image", hints, source.size)
    follower = BodyFollower(scene, scale_for(scene, source.size))
    time_s, picture = next(iter(levelled(source.colours(follower.picture_scale))))
    return follower, follower.next(picture, time_s)


class Beginning(NamedTuple):
    """Why a frame is refused, empty where its body is found; and how far the line is off the middle, half widths, where most."""

    refused: str
    off: float


def begun_amid(scene: Scene, numbers: Iterable[int], seed: int) -> dict[int, Beginning]:
    """A drawn film begun in some of its frames, but those in which its end is not seen, as a person points there (`seed`)."""
    stage = Stage(scene)
    truth, found = stage.truth(), dict[int, Beginning]()
    for number in numbers:
        if not truth.visible[number]:
            continue
        middle = truth.centre_px[number]
        end = replace(truth, tip_px=tuple(middle[-1].tolist()))
        with tempfile.TemporaryDirectory() as folder:
            cv2.imwrite(f"{folder}/{number}.png", stage.frame(number)[:, :, ::-1])
            source = open_frames(Path(folder), None, scene.camera.rate_Hz)
            pointed = pointed_by_hand(end, source.size, np.random.default_rng([seed, number]))
            follower, refused = begun(source, pointed.calibration, pointed.tube, pointed.hints)
        line = follower.body.points / follower.scale
        apart = np.linalg.norm(line[:, None] - middle, axis=2)
        # What is at the clamp itself is where it was pointed at.
        off = max(apart.min(axis=1).max(), apart.min(axis=0)[2:].max()) / truth.half_width_px
        found[number] = Beginning(refused, float(off))
    return found
