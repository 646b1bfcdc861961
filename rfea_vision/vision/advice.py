"""The one hint that would help a film most: tried on its first frames before it is said, with what it brings."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import closing
from dataclasses import replace
from itertools import islice

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.body.begin import scale_for
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.body.held import HeldView
from rfea_vision.vision.body.model import frame_of
from rfea_vision.vision.body.rules import FOLDED, LEAST_SLENDER
from rfea_vision.vision.body.still import StillView
from rfea_vision.vision.clicks import LEAST_CLEAR, aside, on_wall, sides_clear
from rfea_vision.vision.find.begin import OTHER_LENGTH, POINTING_PX, Scene, digits_of
from rfea_vision.vision.follow.follower import Follower
from rfea_vision.vision.trials import Guess, Trial, Trials, in_words, pixel

TRIED = 60  # frames: two seconds of a phone's film
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
OTHER_WIDTH = 1.5  # times as wide as the tube is by the scale, or as narrow: chosen, twice is what takes a diameter for a radius
LEAST_WIDE_PX = 5.0  # films of bodies 2, 3 and 4 px wide were refused, such of 8 and 10 px were followed while their bases rested
GAIN = 0.05  # of these frames: less is no reason to point again


def next_hint(trials: Trials, reasons: list[str], *, scale_off: str = "", side_off: str = "", carried: int = 0) -> str:
    """Say which hint to give, and what it brought on the first frames where it could be tried.

    Where length and width are both off, one scale may be the cause of both, which no hint mends: that is said first. Where only the
    length is, a hint that helps comes before it.

    Parameters
    ----------
    trials : of the film, with the hints that were given
    reasons : why each frame was refused, empty where it was measured
    scale_off, side_off : what the tube as measured says against the scale, and against its side, if anything
    carried : the film is read up to this frame where what holds the tube is followed as it moves
    """
    scene = trials.scene
    if gone := _left_picture(reasons):  # no hint shows what is not in it
        return f"film a wider view: in {gone} of {len(reasons)} frames the tip is at the border of the picture or beyond it"
    if reasons and "camera.region or camera.exclude" in reasons[_first_lost(reasons)]:
        return "the tube goes where camera.region or camera.exclude forbid it: make the region larger, or the boxes smaller"
    if moved := base_moved(trials.source, scene, reasons, carried):
        return moved
    commonest = Counter(filter(None, reasons)).most_common(1)
    of_scale = scale_off if commonest and commonest[0][0].startswith("width_off") else ""
    before = trials.read_without(reasons)
    tried = list(trials.guesses()) if before < (1.0 - GAIN) * trials.count else []
    most = max((guess.trial.worth for guess in tried), default=0.0)
    words, best = next((guess for guess in tried if guess.trial.worth >= AS_GOOD * most), Guess("", Trial(0, 0.0)))
    if best.good >= before + GAIN * trials.count and (scene.is_pointed_at or best.sways >= LEAST_SWAY):
        said = f"check this against the picture and give it: {words} ({trials.said(best)}, and {before} were read without it)"
        if of_scale:
            return f"{of_scale}; where these are right, {said}"
        return f"{side_off}; {said}" if side_off else _scale_first(reasons) + said
    if of_scale or side_off:
        return of_scale or side_off
    if scene.is_pointed_at and (told := read_until(reasons) or film_lacks(trials)):
        return told  # no scale that is off loses a tube that it has let be read
    if scale_off:
        return scale_off
    return _untried(scene, reasons) + (f" (guesses at it that were tried and brought nothing: {len(tried)})" if tried else "")


def clicked_aside(trials: Trials, reasons: list[str]) -> str:
    """Say which of clamp and tip was pointed at beside the body, by the first frame, and where it is; empty where none was.

    What it reads then is tried before it is said: where that is less than what was read, it is another thing.
    """
    if (found := aside(trials.first)) is None:
        return ""
    before, scene = trials.read_without(reasons), trials.scene
    pixels = tuple(map(pixel, found.places)) if found.name == "clamp" else pixel(found.places)
    trial = trials.of(replace(scene.hints, **{found.name: pixels}))
    if trial.good < max(READ * before, 1.0):
        return ""
    words = f"[{', '.join(map(in_words, found.places))}]" if found.name == "clamp" else in_words(found.places)
    return (
        f"camera.{found.name} was pointed at beside the tube, or not at its end: check this against the first frame and give it: "
        f"camera.{found.name}: {words} (the tube is {found.length_mm:.3g} mm long by that, and {scene.length_mm:.3g} mm by "
        f"actuator.length; {trials.said(trial)}, and {before} were read without it)"
    )


def moves_elsewhere(trials: Trials, tips_mm: FloatArray) -> str:
    """Say that what was followed rests, by its tips (n, 2), where another that may be the tube moves; else empty."""
    scene = trials.scene
    if scene.is_pointed_at or np.ptp(tips_mm, axis=0).max() > LEAST_SWAY * scene.half_mm:
        return ""
    for words, trial in trials.guesses():
        if trial.good >= READ * trials.count and trial.sways >= LEAST_SWAY:
            told = f"point at the one that is meant; that one is {words} ({trials.said(trial)})"
            return f"what was found rests, and another tube moves: {told}"
    return ""


def _first_lost(reasons: list[str]) -> int:
    """The first frame that was refused, and is no copy; 0 where none was."""
    return next((frame for frame, reason in enumerate(reasons) if reason and not reason.startswith("duplicate")), 0)


def _left_picture(reasons: list[str]) -> int:
    """In how many frames the tip is out of the picture, where that is so in most that were refused; else 0."""
    gone = sum(reason.startswith("touches_border") for reason in reasons)
    return gone if 2 * gone > sum(bool(reason) for reason in reasons) else 0


def read_from_start(reasons: list[str]) -> tuple[int, int]:
    """The longest beginning of a film of which `READ` is read: how many frames, and how many of them were read."""
    good = np.cumsum([not reason or reason.startswith("duplicate") for reason in reasons])
    count = int(np.max(np.flatnonzero(good >= READ * np.arange(1, len(reasons) + 1)), initial=-1)) + 1
    return count, int(good[count - 1]) if count else 0


def read_until(reasons: list[str]) -> str:
    """Say up to where a film is read, `READ` of it, and what stands there; empty where it is not read from its beginning."""
    count, good = read_from_start(reasons)
    if not BEGUN <= count < len(reasons):
        return ""
    return (
        f"the hints fit the first {count} frames, of which {good} were read: cut the film to these, or see what "
        f"changes in frame {count} ({reasons[count]}) and {_point_again(count)}"
    )


def film_lacks(trials: Trials) -> str:
    """Say what keeps a body that was pointed at from being followed: its shape, its pixels, its contrast; empty where none does."""
    scene = trials.scene
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
        key = scene.actuator.width_key
        return (
            f"camera.clamp is {wide_mm:.3g} mm wide by the scale, and the tube {tube_mm:.3g} mm by {key}: point at the two edges of "
            "the tube where it leaves what holds it, or correct the scale or the tube's width"
        )
    seen = trials.first
    if FOLDED in seen.refusal:
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


def marks_unseen(trials: Trials) -> str:
    """Say that the tube has no mark in the first frame of the colour that a person gave; empty where it has, or none was given."""
    named = trials.scene.hints.marks
    if named is None or not trials.scene.is_pointed_at or not trials.first.good or trials.first.marks:
        return ""
    colour = "#" + "".join(f"{level:02x}" for level in named)
    return (
        f"camera.marks: nothing on the tube is of the colour '{colour}' in the first frame, so that no mark is followed: give the "
        "colour that the marks have in the picture, as a picture editor shows it, or leave the key out"
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


def base_moved(source: FrameSource, scene: Scene, reasons: list[str], carried: int = 0) -> str:
    """Say that what holds the tube has moved up to where frames were refused: no hint mends that. Empty where it rests.

    Up to frame `carried` the film is read where what holds the tube is followed as it moves.
    """
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
                if carried > max(rests + 1, BEGUN):
                    cut = f"its first {carried} frames, in which it is followed as it moves, or {_point_again(carried)}"
                by = f"by some {np.rad2deg(turn):.0f} degrees" if turned else f"by {off / scale:.0f} px"
                how = f"{'turned' if turned else 'moved'} in the picture, {by}"
                return f"what holds the tube has {how} in frame {frame}: hold the base and the camera still, or cut the film to {cut}"
            if off < 0.5 * least_px:
                rests = frame
    return ""


def scale_doubt(length_check: str) -> str:
    """What a track's check of the length says against the scale; empty where the length is the tube's."""
    kept, _, measures = length_check.partition("; ")
    return measures.replace("it measures", f"{re.split(' keeps | changes ', kept)[0]} measures", 1)


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
