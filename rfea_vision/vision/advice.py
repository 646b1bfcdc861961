"""The one hint that would help a film most: tried on its first frames before it is said, with what it brings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Hints
from rfea_vision.calibration.projection import project
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.body.begin import hinted_lines, scale_for
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.body.still import StillView
from rfea_vision.vision.edges.fitted import new_buffers
from rfea_vision.vision.find.begin import OTHER_LENGTH, Scene, begin, line_of

TRIED = 60  # frames: two seconds of a phone's film
# The picture around the clamp, to 3 half widths, is looked for up to 2 half widths aside. In four real films whose base rested it lay
# within 0.25, or fitted as well in its place (a stem, along itself); in four whose base or view moved it went 1.2 to 2.
AROUND_CLAMP, ASIDE = 3.0, 2.0
BASE_MOVED, BASE_ALIKE, BASE_GONE = 0.5, 0.7, 0.15  # half widths; least correlation there, and by how much it beats that in its place
LOOKS = 12  # frames in which this is looked at
READ, BEGUN = 0.95, 12  # share of a film that is read as one; frames, half a second of most films: fewer may be luck
_UPSIDE_DOWN = (
    ", by which the tube leads upwards: if it hangs, the film is upside down (turn it and the photos of the board by half a turn), if "
    "it stands, write rig: {gravity: up}"
)
GAIN = 0.05  # of these frames: less is no reason to point again


def next_hint(source: FrameSource, scene: Scene, reasons: list[str], *, scale_off: str = "") -> str:
    """Say which hint to give, and what it brought on the first frames where it could be tried.

    Where length and width are both off, one scale is the cause of both, and no hint mends it; where only the length is, hints are
    tried first.

    Parameters
    ----------
    source : the film
    scene : with the hints that were given
    reasons : why each frame was refused, empty where it was measured
    scale_off : what the length of the tube as measured says against the scale, if anything
    """
    gone = sum(reason.startswith("touches_border") for reason in reasons)
    if 2 * gone > sum(bool(reason) for reason in reasons):  # no hint shows what is not in the picture
        return f"film a wider view: in {gone} of {len(reasons)} frames the tip is at the border of the picture or beyond it"
    lost = next((frame for frame, reason in enumerate(reasons) if reason and not reason.startswith("duplicate")), 0)
    if moved := base_moved(source, scene, min(lost + TRIED, len(reasons))):
        return moved
    if scale_off and Counter(filter(None, reasons)).most_common(1)[0][0].startswith("width_off"):
        return scale_off
    count = min(TRIED, len(reasons))
    before = sum(not reason for reason in reasons[:count])
    tried = [(_read(source, _with(scene, hints), count), words) for hints, words in _candidates(source, scene)]
    best, words = max(tried, key=lambda pair: pair[0], default=(0, ""))
    if best >= before + GAIN * count:
        brings = f"tried, it reads {best} of the first {count} frames, and {before} were read without it"
        return f"{_scale_first(reasons)}check this against the picture and give it: {words} ({brings})"
    if scene.clamp_px is not None and scene.tip_px is not None and (cut := _read_until(reasons)):
        return cut  # no scale that is off loses a tube that it has let be read
    if scale_off:
        return scale_off
    return _untried(scene, reasons) + (f" (guesses at it that were tried and brought nothing: {len(tried)})" if tried else "")


def _read_until(reasons: list[str]) -> str:
    """Say up to where a film is read, `READ` of it, and what stands there; empty where it is not read from its beginning."""
    good = np.cumsum([not reason or reason.startswith("duplicate") for reason in reasons])
    count = int(np.max(np.flatnonzero(good >= READ * np.arange(1, len(reasons) + 1)), initial=-1)) + 1
    if not BEGUN <= count < len(reasons):
        return ""
    return (
        f"the hints fit the first {count} frames, of which {good[count - 1]} were read: cut the film to these, or see what "
        f"changes in frame {count} ({reasons[count]})"
    )


def base_moved(source: FrameSource, scene: Scene, count: int) -> str:
    """Say that what holds the tube has moved since the first of `count` frames: no hint mends that. Empty where it rests."""
    if scene.clamp_px is None:
        return ""
    scale = scale_for(scene, source.size)
    half = 0.5 * scale * float(np.linalg.norm(scene.clamp_px[1] - scene.clamp_px[0]))
    foot = (scene.clamp_px.mean(axis=0) + 0.5) * scale - 0.5
    near, far = (round(reach * half) for reach in (AROUND_CLAMP, AROUND_CLAMP + ASIDE))
    looked = {int(k) for k in np.linspace(0, count - 1, LOOKS)}
    rests, first, still = 0, None, StillView(np.vstack([foot, (scene.line_px + 0.5) * scale - 0.5]), half)
    with closing(source.colours(scale)) as pictures:
        for frame, (_, seen) in enumerate(islice(pictures, count)):
            picture = still(seen)  # a camera that drifts is followed
            if frame not in looked:
                continue
            grey = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
            if first is None:
                first = _around(grey, foot, near)
                continue
            alike = cv2.matchTemplate(_around(grey, foot, far), first, cv2.TM_CCOEFF_NORMED)
            row, column = np.unravel_index(int(np.argmax(alike)), alike.shape)
            off = float(np.hypot(row - (far - near), column - (far - near)))
            if off > BASE_MOVED * half and alike[row, column] > max(BASE_ALIKE, alike[far - near, far - near] + BASE_GONE):
                cut = f"its first {rests + 1} frames" if rests >= BEGUN else "where both rest"
                return (
                    f"what holds the tube has moved in the picture, by {off / scale:.0f} px in frame {frame}: hold the base and the "
                    f"camera still, or cut the film to {cut}"
                )
            rests = frame
    return ""


def _around(grey: NDArray[np.uint8], place: FloatArray, reach: int) -> NDArray[np.uint8]:
    """What a picture shows within `reach` px of a place."""
    size = 2 * reach + 1
    return np.asarray(cv2.getRectSubPix(grey, (size, size), (float(place[0]), float(place[1]))), dtype=np.uint8)


def scale_doubt(length_check: str) -> str:
    """What a track's check of the length says against the scale; empty where the length is the tube's."""
    return length_check.partition("; ")[2]


def _candidates(source: FrameSource, scene: Scene) -> Iterator[tuple[Hints, str]]:
    """Hints that the first frame itself suggests, and their words."""
    if scene.clamp_px is None or scene.tip_px is None:
        unhinted = replace(scene, hints=replace(scene.hints, clamp=None, tip=None, centre_line=()), clamp_px=None, tip_px=None)
        ways = [(scene, ""), (replace(unhinted, down=-scene.down), _UPSIDE_DOWN)]
        if len(scene.line_px):  # pointed at in the wrong place, as by rows and columns
            ways.insert(1, (unhinted, ""))
        for way, remark in ways:
            found = begin(source.frame(0), way, new_buffers())
            if isinstance(found, str):
                continue
            line = line_of(found.state)
            tangent = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
            across = found.state.width[0] * np.array([-tangent[1], tangent[0]])
            left, right, tip = np.round(project(scene.camera, np.array([line[0] + across, line[0] - across, line[-1]])), 1)
            hints = replace(way.hints, clamp=(_pixel(left), _pixel(right)), tip=_pixel(tip))
            yield hints, f"camera.clamp: [{_words(left)}, {_words(right)}] and camera.tip: {_words(tip)}{remark}"
    elif len(scene.hints.centre_line) < 2:
        seen = BodyFollower(scene, scale_for(scene, source.size))
        with closing(source.colours(seen.scale)) as pictures:
            _, picture = next(pictures)
        lab = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2LAB), dtype=np.uint8)
        for line in hinted_lines(lab, seen.clamp, seen.line, seen.pointed_half(), scene.length_mm * seen.px_per_mm):
            points = np.round((line[[16, 32, 48]] + 0.5) / seen.scale - 0.5, 1)
            hints = replace(scene.hints, centre_line=tuple(_pixel(point) for point in points))
            yield hints, f"camera.centre_line: [{', '.join(map(_words, points))}]"


def _read(source: FrameSource, scene: Scene, count: int) -> int:
    """How many of the first frames the body tracker reads."""
    follower = BodyFollower(scene, scale_for(scene, source.size))
    with closing(source.colours(scale_for(scene, source.size))) as pictures:
        return sum(not follower.next(picture, time_s) for time_s, picture in islice(pictures, count))


def _with(scene: Scene, hints: Hints) -> Scene:
    return replace(scene, hints=hints, clamp_px=np.array(hints.clamp), tip_px=np.array(hints.tip))


def _scale_first(reasons: list[str]) -> str:
    """What a hint may make up for in part and does not mend: a tube of another size than was predicted. Empty where it is none."""
    if OTHER_LENGTH not in [reason for reason, _ in Counter(filter(None, reasons)).most_common(1)]:
        return ""
    return (
        "check the board's square (or camera.scale), actuator.outer_radius and actuator.length, by which the tube's "
        "size in the picture is predicted; or "
    )


def _untried(scene: Scene, reasons: list[str]) -> str:
    """The hint that has not been given."""
    if scene.clamp_px is None or scene.tip_px is None:
        lacking = [name for name in ("clamp", "tip") if getattr(scene.hints, name) is None]
        hints = f"give {' and '.join(f'camera.{name}' for name in lacking)}, in pixels of the first frame"
        return _scale_first(reasons) + hints
    if len(scene.hints.centre_line) < 2:
        return "give a few points of the tube in the first frame as camera.centre_line, from the clamp to the tip"
    first = next((k for k, reason in enumerate(reasons) if reason and not reason.startswith("duplicate")), 0)
    if first:  # nothing says that the hints are wrong: they were enough for the frames before
        return f"see what changes in frame {first}, the first that was refused ({reasons[first]}), and check the hints against frame 0"
    return (
        "check the hints against the first frame, and actuator.outer_radius and actuator.length against the tube, "
        "or film it before a wall of another colour"
    )


def _pixel(point: FloatArray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _words(point: FloatArray) -> str:
    return f"[{point[0]:g}, {point[1]:g}]"
