"""The one hint that would help a film most: tried on its first frames before it is said, with what it brings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
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
from rfea_vision.vision.body.held import HeldView
from rfea_vision.vision.body.model import frame_of
from rfea_vision.vision.body.rules import FOLDED, LEAST_SLENDER
from rfea_vision.vision.body.shown import Shown
from rfea_vision.vision.body.still import StillView
from rfea_vision.vision.clicks import LEAST_CLEAR, aside, on_wall, sides_clear
from rfea_vision.vision.edges.fitted import new_buffers
from rfea_vision.vision.find.begin import OTHER_LENGTH, POINTING_PX, Scene, allowed_pixels, begin, digits_of, line_of
from rfea_vision.vision.find.locate import Path, find_paths
from rfea_vision.vision.find.moving import Motion, moving_lines
from rfea_vision.vision.follow.follower import Follower
from rfea_vision.vision.light import levelled

TRIED = 60  # frames: two seconds of a phone's film
PHONE_HZ, MOST_LOOKED = 30.0, 240  # hints are tried at this rate, on so many frames: eight seconds, and as many to wait
MOST_TRIED = 8  # lines: those whose ends edges tell, of the first frame, and of what changes; most are given up after three frames
# Half widths by which the tip of a line sways that is suggested: on seven other films those on the body swayed by 1.5 to 6.4 where they
# were read, and others by 0.1 to 0.8, but for a second body that moved.
LEAST_SWAY = 1.0
AS_GOOD = 0.8  # of what the best brings: chosen, one that ends farther out sways more; of these it is the first
# By half widths that what holds the tube moves, by radians that it turns (chosen: tape and rubber give way by less at a clamp that
# rests), and by so many standard errors, before that is said.
BASE_MOVED, BASE_TURNED, SURELY = 0.5, 0.25, 3.0
# Share of a film that is read as one: where edges read less, the body is followed, too; frames, half a second of most films: fewer may
# be luck.
READ, BEGUN = 0.95, 12
_UPSIDE_DOWN = (
    ", by which the tube leads upwards: if it hangs, the film is upside down (turn it and the photos of the board by half a turn), if "
    "it stands, write rig: {gravity: up}"
)
OTHER_WIDTH = 1.5  # times as wide as the tube is by the scale, or as narrow: chosen, twice is what takes a diameter for a radius
LEAST_WIDE_PX = 5.0  # films of bodies 2, 3 and 4 px wide were refused, such of 8 and 10 px were followed while their bases rested
GAIN = 0.05  # of these frames: less is no reason to point again


def next_hint(source: FrameSource, scene: Scene, reasons: list[str], *, scale_off: str = "", side_off: str = "") -> str:
    """Say which hint to give, and what it brought on the first frames where it could be tried.

    Where length and width are both off, one scale may be the cause of both, which no hint mends: that is said first. Where only the
    length is, a hint that helps comes before it.

    Parameters
    ----------
    source : the film
    scene : with the hints that were given
    reasons : why each frame was refused, empty where it was measured
    scale_off, side_off : what the tube as measured says against the scale, and against its side, if anything
    """
    if gone := _left_picture(reasons):  # no hint shows what is not in it
        return f"film a wider view: in {gone} of {len(reasons)} frames the tip is at the border of the picture or beyond it"
    if reasons and "camera.region or camera.exclude" in reasons[_first_lost(reasons)]:
        return "the tube goes where camera.region or camera.exclude forbid it: make the region larger, or the boxes smaller"
    if moved := base_moved(source, scene, reasons):
        return moved
    commonest = Counter(filter(None, reasons)).most_common(1)
    of_scale = scale_off if commonest and commonest[0][0].startswith("width_off") else ""
    before, count, step = _looked(source, reasons)
    suggested = _candidates(source, scene, len(reasons)) if before < (1.0 - GAIN) * count else ()
    tried = [(_trial(source, replace(scene, hints=hints), count, step), words) for hints, words in suggested]
    most = max((trial.worth for trial, _ in tried), default=0.0)
    best, words = next((pair for pair in tried if pair[0].worth >= AS_GOOD * most), (Trial(0, 0.0), ""))
    if best.good >= before + GAIN * count and (scene.is_pointed_at or best.sways >= LEAST_SWAY):
        said = f"check this against the picture and give it: {words} ({best.words(count, step)}, and {before} were read without it)"
        if of_scale:
            return f"{of_scale}; where these are right, {said}"
        return f"{side_off}; {said}" if side_off else _scale_first(reasons) + said
    if of_scale or side_off:
        return of_scale or side_off
    if scene.is_pointed_at and (told := _read_until(reasons) or film_lacks(source, scene)):
        return told  # no scale that is off loses a tube that it has let be read
    if scale_off:
        return scale_off
    return _untried(scene, reasons) + (f" (guesses at it that were tried and brought nothing: {len(tried)})" if tried else "")


def clicked_aside(source: FrameSource, scene: Scene, reasons: list[str]) -> str:
    """Say which of clamp and tip was pointed at beside the body, by the first frame, and where it is; empty where none was.

    What it reads then is tried before it is said: where that is less than what was read, it is another thing.
    """
    look, picture = _first_look(source, scene)
    look.next(picture, 0.0)
    if (found := aside(look, picture)) is None:
        return ""
    before, count, step = _looked(source, reasons)
    pixels = tuple(map(_pixel, found.places)) if found.name == "clamp" else _pixel(found.places)
    trial = _trial(source, replace(scene, hints=replace(scene.hints, **{found.name: pixels})), count, step)
    if trial.good < max(READ * before, 1.0):
        return ""
    words = f"[{', '.join(map(_words, found.places))}]" if found.name == "clamp" else _words(found.places)
    return (
        f"camera.{found.name} was pointed at beside the tube, or not at its end: check this against the first frame and give it: "
        f"camera.{found.name}: {words} (the tube is {found.length_mm:.3g} mm long by that, and {scene.length_mm:.3g} mm by "
        f"actuator.length; {trial.words(count, step)}, and {before} were read without it)"
    )


def moves_elsewhere(source: FrameSource, scene: Scene, tips_mm: FloatArray, count: int) -> str:
    """Say that what was followed rests, by its tips (n, 2), where another that may be the tube moves in `count` frames; else empty."""
    if scene.is_pointed_at or np.ptp(tips_mm, axis=0).max() > LEAST_SWAY * scene.half_mm:
        return ""
    count = min(-(-count // (step := _step(source))), MOST_LOOKED)
    for hints, words in _candidates(source, scene, step * count):
        trial = _trial(source, replace(scene, hints=hints), count, step)
        if trial.good >= READ * count and trial.sways >= LEAST_SWAY:
            told = f"point at the one that is meant; that one is {words} ({trial.words(count, step)})"
            return f"what was found rests, and another tube moves: {told}"
    return ""


def _first_lost(reasons: list[str]) -> int:
    """The first frame that was refused, and is no copy; 0 where none was."""
    return next((frame for frame, reason in enumerate(reasons) if reason and not reason.startswith("duplicate")), 0)


def _left_picture(reasons: list[str]) -> int:
    """In how many frames the tip is out of the picture, where that is so in most that were refused; else 0."""
    gone = sum(reason.startswith("touches_border") for reason in reasons)
    return gone if 2 * gone > sum(bool(reason) for reason in reasons) else 0


def _read_until(reasons: list[str]) -> str:
    """Say up to where a film is read, `READ` of it, and what stands there; empty where it is not read from its beginning."""
    good = np.cumsum([not reason or reason.startswith("duplicate") for reason in reasons])
    count = int(np.max(np.flatnonzero(good >= READ * np.arange(1, len(reasons) + 1)), initial=-1)) + 1
    if not BEGUN <= count < len(reasons):
        return ""
    return (
        f"the hints fit the first {count} frames, of which {good[count - 1]} were read: cut the film to these, or see what "
        f"changes in frame {count} ({reasons[count]}) and {_point_again(count)}"
    )


def film_lacks(source: FrameSource, scene: Scene) -> str:
    """Say what keeps a body that was pointed at from being followed: its shape, its pixels, its contrast; empty where none does."""
    _, line_px, half_px = scene.pointed()
    wide_px = 2.0 * half_px
    slender = float(along(line_px)[-1]) / wide_px
    if slender < LEAST_SLENDER:
        return (
            f"what was pointed at is {slender:.1f} times as long as wide, and a body is followed from {LEAST_SLENDER:g} times on: "
            "point at camera.clamp farther back on it, or film a longer piece"
        )
    if wide_px < LEAST_WIDE_PX:
        return (
            f"the tube is {wide_px:.1f} px wide in the film, and of less than {LEAST_WIDE_PX:g} px too little is seen: film it from "
            f"nearer, or with more pixels, some {max(1.5, 2 * LEAST_WIDE_PX / wide_px):.1f} times as many across it"
        )
    wide_mm, tube_mm = wide_px / scene.px_per_mm, 2.0 * scene.half_mm
    if max(wide_mm / tube_mm, tube_mm / wide_mm) > OTHER_WIDTH:
        key = "actuator.outer_radius" if scene.actuator.kind == "tube" else "actuator.section"
        return (
            f"camera.clamp is {wide_mm:.3g} mm wide by the scale, and the tube {tube_mm:.3g} mm by {key}: point at the two edges of "
            "the tube where it leaves what holds it, or correct the scale or the tube's width"
        )
    seen, picture = _first_look(source, scene)
    if FOLDED in seen.next(picture, 0.0):
        return (
            "as it is seen in the first frame the tube turns there within its own width, as one does that bends towards the camera: "
            "film it from where it bends in the picture's plane, or begin the film where it lies in that"
        )
    if told := on_wall(seen.body):
        return told
    clear = np.median(sides_clear(seen.body), axis=0)
    if clear.min() >= LEAST_CLEAR:
        return ""
    across = frame_of(seen.body.points)[1].mean(axis=0) * (1.0, -1.0)[int(np.argmin(clear))]
    side = [("left of", "right of"), ("above", "below")][int(np.argmax(np.abs(across)))][int(across[np.argmax(np.abs(across))] > 0)]
    return (
        f"{side} it the tube's colour differs from what is beside it by {clear.min():.1f} times their scatter: put something plain of "
        "another colour behind it, or light it from that side"
    )


def end_like_wall(follower: Follower | BodyFollower) -> str:
    """Say that a body's end cannot be told from what is behind it, and what shows it; empty where it can."""
    if not isinstance(follower, BodyFollower) or follower.body.told.all():
        return ""
    length_mm = follower.scene.length_mm
    end_mm = f"{float(np.mean(~follower.body.told)) * length_mm:.{digits_of(length_mm)}f}"
    return (
        f"the last {end_mm} mm of the tube look like the wall behind them, and its end is known by so much less: stick something of "
        "another colour around the end, or hang something plain of another colour behind it"
    )


def end_guessed(follower: Follower | BodyFollower) -> str:
    """Say that in most frames nothing shows where a body ends, and what would; empty where something does."""
    if not isinstance(follower, BodyFollower) or 2 * follower.guessed <= follower.good:
        return ""
    return (
        "nothing shows how long the tube is in most frames: its end is not seen, and it looks alike all along; its tip is known by "
        "so much less; stick a mark of another colour near its tip"
    )


def went_astray(follower: Follower | BodyFollower) -> str:
    """Say in which frames the line had gone elsewhere than where a person points again, and what follows from it; else empty."""
    if not isinstance(follower, BodyFollower) or not follower.astray:
        return ""
    frames = ", ".join(map(str, follower.astray))
    return (
        f"before camera.corrections of frame {frames} the line had gone elsewhere than where the tube was pointed at there: earlier "
        "frames are wrong, too, back to one in which it is seen to be right; point at an earlier one as well"
    )


def base_moved(source: FrameSource, scene: Scene, reasons: list[str]) -> str:
    """Say that what holds the tube has moved up to where frames were refused: no hint mends that. Empty where it rests."""
    if scene.clamp_px is None or _left_picture(reasons):
        return ""
    count = min(_first_lost(reasons) + TRIED, len(reasons))
    scale = min(scale_for(scene, source.size), 1.0)
    clamp, line, half = scene.pointed(scale)
    still, held = StillView(line, half), HeldView(clamp, line, half)  # a camera that drifts is followed
    least_px, rests = max(BASE_MOVED * half, POINTING_PX * scale), 0
    with closing(source.colours(scale)) as pictures:
        for frame, (_, picture) in enumerate(islice(pictures, count)):
            still.look(picture)
            held.look(picture)  # as it comes: a view that is lost from one picture to the next takes its base along in one leap
            off, turn = held.off(still.moved)
            sure_px, sure_turn = SURELY * held.stderr[:2].max(), SURELY * held.stderr[2]
            turned = turn > max(BASE_TURNED, sure_turn)
            if held.seen and (turned or off > max(least_px, sure_px)):
                cut = f"its first {rests + 1} frames" if rests >= BEGUN else "where both rest"
                by = f"by some {np.rad2deg(turn):.0f} degrees" if turned else f"by {off / scale:.0f} px"
                how = f"{'turned' if turned else 'moved'} in the picture, {by}"
                return f"what holds the tube has {how} in frame {frame}: hold the base and the camera still, or cut the film to {cut}"
            if off < 0.5 * least_px:
                rests = frame
    return ""


def scale_doubt(length_check: str) -> str:
    """What a track's check of the length says against the scale; empty where the length is the tube's."""
    return length_check.partition("; ")[2]


def _candidates(source: FrameSource, scene: Scene, count: int) -> Iterator[tuple[Hints, str]]:
    """Hints that the film itself suggests, by its first frame and what moves in the first `count`, and their words; best first."""
    if not scene.is_pointed_at:
        unhinted = replace(scene, hints=replace(scene.hints, clamp=None, tip=None, centre_line=()))
        half_px, picture = scene.half_mm * scene.px_per_mm, source.frame(0)
        length_px = scene.length_mm * scene.px_per_mm
        motion = Motion.of(source.frames(0), count, 2 * half_px)
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
            remark = _UPSIDE_DOWN if (leads - foot) @ scene.down < 0.0 else ""
            hints = replace(unhinted.hints, clamp=(_pixel(one), _pixel(other)), tip=_pixel(tip))
            yield hints, f"camera.clamp: [{_words(one)}, {_words(other)}] and camera.tip: {_words(tip)}{remark}"
    elif len(scene.hints.centre_line) < 2:
        seen, picture = _first_look(source, scene)
        shown = Shown(picture, seen.enlarged)
        for line in hinted_lines(shown.lab(shown.whole), seen.pointed):
            points = np.round(scaled(line[[16, 32, 48]], 1.0 / seen.scale), 1)
            hints = replace(scene.hints, centre_line=tuple(_pixel(point) for point in points))
            yield hints, f"camera.centre_line: [{', '.join(map(_words, points))}]"
    else:  # one that was pointed at in another order, or beside the body, leads astray
        yield replace(scene.hints, centre_line=()), "camera.clamp and camera.tip alone, without camera.centre_line"


def _first_look(source: FrameSource, scene: Scene) -> tuple[BodyFollower, NDArray[np.uint8]]:
    """One that would follow the body, and its first picture."""
    follower = BodyFollower(scene, scale_for(scene, source.size))
    with closing(source.colours(follower.picture_scale)) as pictures:
        return follower, next(pictures)[1]


class Trial(NamedTuple):
    """What hints bring: how many frames are read with them, and by how many half widths the tip sways in these."""

    good: int
    sways: float

    @property
    def worth(self) -> float:
        """Of lines that are read as well, the one that sways most is the tube's: edges of what rests are read, too."""
        return self.good * self.sways

    def words(self, count: int, step: int) -> str:
        """What it read of so many frames, each of them one in `step`."""
        return f"tried, it reads {self.good} of the first {count} frames" + (f" that are looked at, one in {step}" if step > 1 else "")


def _looked(source: FrameSource, reasons: list[str]) -> tuple[int, int, int]:
    """How many of the frames that are looked at were read, how many these are, and every how many of the film's they are."""
    looked = reasons[:: (step := _step(source))][:MOST_LOOKED]
    return sum(not reason for reason in looked), len(looked), step


def _step(source: FrameSource) -> int:
    """Every how many frames of a fast camera's film are as many as a phone's."""
    times = source.times_s()
    return max(1, round(1.0 / (PHONE_HZ * float(np.median(np.diff(times)))))) if len(times) > 1 else 1


def _trial(source: FrameSource, scene: Scene, count: int, step: int) -> Trial:
    """Follow the body with these hints in `count` frames, each `step`-th."""
    follower, seen = BodyFollower(scene, scale_for(scene, source.size)), []
    with closing(levelled(source.colours(follower.picture_scale))) as pictures:
        for time_s, picture in islice(pictures, 0, step * count, step):
            if not follower.next(picture, time_s):
                seen.append((*follower.body.points[-1], follower.body.length))
            elif not seen:
                break  # hints are of the first frame
            follower.frame += step - 1  # of the film: what is known of single frames is theirs
    # In all but a tenth of the frames to either side: a line that settles after the first one does not sway, nor one that slides along.
    *sways, slides = np.ptp(np.quantile(seen, (0.1, 0.9), axis=0), axis=0) if seen else np.zeros(3)
    return Trial(len(seen), max(float(max(sways) - slides), 0.0) / follower.pointed.half)


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
    if not scene.is_pointed_at:
        lacking = [name for name in ("clamp", "tip") if getattr(scene.hints, name) is None]
        hints = f"give {' and '.join(f'camera.{name}' for name in lacking)}, in pixels of the first frame"
        return _scale_first(reasons) + hints
    if first := _first_lost(reasons):  # nothing says that the hints are wrong: they were enough for the frames before
        return f"see what changes in frame {first}, the first that was refused ({reasons[first]}), and {_point_again(first)}"
    if len(scene.hints.centre_line) < 2:
        return "give a few points of the tube in the first frame as camera.centre_line, from the clamp to the tip"
    return (
        "check the hints against the first frame, and actuator.outer_radius and actuator.length against the tube, "
        "or film it before a wall of another colour"
    )


def _point_again(frame: int) -> str:
    example = f"camera.corrections: [{{frame: {frame}, points: [[x, y], ...]}}]"
    return f"point at the tube again where it is seen, from the clamp to the tip: {example}"


def _pixel(point: FloatArray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _words(point: FloatArray) -> str:
    return f"[{point[0]:g}, {point[1]:g}]"
