"""Hints that a film itself suggests, and what hints bring on its first frames: tried before anything is said of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Hints
from rfea_vision.calibration.projection import project, unproject
from rfea_vision.lines import along, scaled
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.body.begin import hinted_lines, scale_for
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.body.shown import Shown
from rfea_vision.vision.edges.fitted import new_buffers
from rfea_vision.vision.find.begin import Scene, allowed_pixels, begin, line_of
from rfea_vision.vision.find.locate import Path, find_paths
from rfea_vision.vision.find.moving import Motion, moving_lines
from rfea_vision.vision.light import levelled

PHONE_HZ, MOST_LOOKED = 30.0, 240  # hints are tried at this rate, on so many frames: eight seconds, and as many to wait
MOST_TRIED = 8  # lines: those whose ends edges tell, of the first frame, and of what changes; most are given up after three frames
_TO_LEFT = {0: "down", 90: "left", 180: "up", 270: "right"}  # where gravity points, by degrees from down towards the picture's left


class Trial(NamedTuple):
    """What hints bring: how many frames are read with them, and by how many half widths the tip sways in these."""

    good: int
    sways: float

    @property
    def worth(self) -> float:
        """Of lines that are read as well, the one that sways most is the tube's: edges of what rests are read, too."""
        return self.good * self.sways


class Guess(NamedTuple):
    """A hint that was not given, in words, and what it brings."""

    words: str
    trial: Trial


class Trials:
    """What hints bring on a film's first frames, at a phone's rate; each guess, and the first look, are worked out once.

    Parameters
    ----------
    source, scene : the film, and what is known of it with the hints that were given
    frames : how many were looked at
    progress : called with (frames done, frames in all) of each trial
    first : one that has looked for the body in the first picture, where it was pointed at, and in no other; None: not yet
    """

    def __init__(
        self,
        source: FrameSource,
        scene: Scene,
        frames: int,
        progress: Callable[[int, int], None] | None = None,
        first: BodyFollower | None = None,
    ) -> None:
        self.source, self.scene, self.progress = source, scene, progress
        times = source.times_s()
        self.step = max(1, round(1.0 / (PHONE_HZ * float(np.median(np.diff(times)))))) if len(times) > 1 else 1
        self.count = min(-(-frames // self.step), MOST_LOOKED)
        self._untried, self._tried = _suggested(self), list[Guess]()
        self._first = first

    @property
    def first(self) -> BodyFollower:
        """One that has looked for the body in the first picture, and in no other."""
        if self._first is None:
            follower, picture = begun(self.source, self.scene)
            follower.next(picture, 0.0)
            self._first = follower.first_look
        return self._first

    def guesses(self) -> Iterator[Guess]:
        """What the film itself suggests, tried one by one as they are asked for; those that were before come first."""
        yield from list(self._tried)
        for hints, words in self._untried:
            self._tried.append(Guess(words, self.of(hints)))
            yield self._tried[-1]

    def of(self, hints: Hints) -> Trial:
        """Follow the body with these hints."""
        scene = replace(self.scene, hints=hints)
        follower, seen = BodyFollower(scene, scale_for(scene, self.source.size)), []
        with closing(levelled(self.source.colours(follower.picture_scale))) as pictures:
            looked_at = islice(pictures, 0, self.step * self.count, self.step)
            for done, (time_s, picture) in enumerate(looked_at, 1):
                if not follower.next(picture, time_s):
                    seen.append((*follower.body.points[-1], follower.body.length))
                elif not seen:
                    break  # hints are of the first frame
                follower.frame += self.step - 1  # of the film: what is known of single frames is theirs
                if self.progress is not None:
                    self.progress(done, self.count)
        # In all but a tenth of the frames to either side: a line that settles after the first one does not sway, nor one that slides.
        *sways, slides = np.ptp(np.quantile(seen, (0.1, 0.9), axis=0), axis=0) if seen else np.zeros(3)
        return Trial(len(seen), max(float(max(sways) - slides), 0.0) / follower.pointed.half)

    def read_without(self, reasons: list[str]) -> int:
        """How many of the frames that are looked at were read, by the reasons of all of the film's: empty where it was measured."""
        return sum(not reason for reason in reasons[:: self.step][: self.count])

    def said(self, trial: Trial) -> str:
        """What a trial has read, in words."""
        every = f" that are looked at, one in {self.step}" if self.step > 1 else ""
        return f"tried, it reads {trial.good} of the first {self.count} frames{every}"


def begun(source: FrameSource, scene: Scene) -> tuple[BodyFollower, NDArray[np.uint8]]:
    """One that would follow the body, and its first picture."""
    follower = BodyFollower(scene, scale_for(scene, source.size))
    with closing(source.colours(follower.picture_scale)) as pictures:
        return follower, next(pictures)[1]


def _suggested(trials: Trials) -> Iterator[tuple[Hints, str]]:
    """Hints that the film itself suggests, by its first frame and what moves in those that are tried, and their words; best first."""
    source, scene = trials.source, trials.scene
    if not scene.is_pointed_at:
        unhinted = replace(scene, hints=replace(scene.hints, clamp=None, tip=None, centre_line=()))
        half_px, picture = scene.half_mm * scene.px_per_mm, source.frame(0)
        length_px = scene.length_mm * scene.px_per_mm
        motion = Motion.of(source.frames(0), trials.step * trials.count, 2 * half_px)
        paths = find_paths(picture, 2 * half_px, length_px, allowed=allowed_pixels(picture.shape, scene.hints))
        fitted = []  # whose ends edges tell
        for way in (unhinted, replace(unhinted, down=-scene.down), *[scene] * bool(len(scene.line_px))):
            if not isinstance(found := begin(picture, way, new_buffers()), str):
                fitted.append(Path(project(scene.camera, line_of(found.state.coefficients)), found.polarity, found.score, found.score))
        kinds = fitted, paths, motion.ribbons(2 * half_px, length_px)
        for line in [line for kind in kinds for line in moving_lines(kind, motion, length_px)][:MOST_TRIED]:
            ahead = line[int(np.argmax(along(line) > half_px))] - line[0]
            across = half_px * np.array([ahead[1], -ahead[0]]) / np.linalg.norm(ahead)
            one, other, tip = np.round([line[0] + across, line[0] - across, line[-1]], 1)
            foot, leads = unproject(scene.camera, np.array([line[0], line[0] + ahead]))
            remark = _other_way(scene) if (leads - foot) @ scene.down < 0.0 else ""
            hints = replace(unhinted.hints, clamp=(pixel(one), pixel(other)), tip=pixel(tip))
            yield hints, f"camera.clamp: [{in_words(one)}, {in_words(other)}] and camera.tip: {in_words(tip)}{remark}"
    elif len(scene.hints.centre_line) < 2:
        seen, picture = begun(source, scene)
        shown = Shown(picture, seen.enlarged)
        for line in hinted_lines(shown.lab(shown.whole), seen.pointed):
            points = np.round(scaled(line[[16, 32, 48]], 1.0 / seen.scale), 1)
            hints = replace(scene.hints, centre_line=tuple(pixel(point) for point in points))
            yield hints, f"camera.centre_line: [{', '.join(map(in_words, points))}]"
    else:  # one that was pointed at in another order, or beside the body, leads astray
        yield replace(scene.hints, centre_line=()), "camera.clamp and camera.tip alone, without camera.centre_line"


def _other_way(scene: Scene) -> str:
    """That a line leads the other way than the tube does as the rig is said to stand, in words; empty where no gravity pulls."""
    if scene.gravity_deg is None:
        return ""
    if scene.gravity_deg == 0.0:
        return (
            ", by which the tube leads upwards: if it hangs, the film is upside down (turn it and the photos of the board by half a "
            "turn), if it stands, write rig: {gravity: up}"
        )
    turned = (scene.gravity_deg + 180.0) % 360.0
    gravity = _TO_LEFT.get(round(turned * scene.actuator.mirror) % 360, f"{{angle: {turned:g} deg}}")
    return (
        f", by which the tube leads the other way than rig.gravity says: write rig: {{gravity: {gravity}}}, or is the film turned by "
        "half a turn?"
    )


def pixel(point: FloatArray) -> tuple[float, float]:
    """A place (2,) px as hints hold it."""
    return float(point[0]), float(point[1])


def in_words(point: FloatArray) -> str:
    """A place (2,) px as it is written in a campaign."""
    return f"[{point[0]:g}, {point[1]:g}]"
