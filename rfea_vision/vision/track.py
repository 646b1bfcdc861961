"""The tube in every frame: `track_frames`."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator, Calibration, Hints, Track
from rfea_vision.artefacts.measurement import Vertical
from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.ahead import read_ahead
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision.advice import (
    READ,
    base_moved,
    clicked_aside,
    end_guessed,
    end_like_wall,
    marks_unseen,
    moves_elsewhere,
    next_hint,
    read_from_start,
    read_until,
    scale_doubt,
    went_astray,
)
from rfea_vision.vision.body.begin import scale_for
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.derive.rows import Rows
from rfea_vision.vision.derive.shape import build_dataset
from rfea_vision.vision.derive.shutter import Shutter
from rfea_vision.vision.find.begin import Scene, line_of, off_hints
from rfea_vision.vision.follow.follower import Follower
from rfea_vision.vision.light import levelled
from rfea_vision.vision.scene import make_scene, matched_to
from rfea_vision.vision.trials import Trials

Progress = Callable[[int, int], None] | None

LEAST_SHARE = 0.5  # of the frames: a film of which less was measured tells more of what disturbs than of the tube
WRONG_SIDE_DEG = 5.0  # chosen: more than a hanging tube at rest is turned by in a camera put up by eye
# Below this share the edges that are found may be another thing's: of the films of testing/phone.py one that was read
# to 81 % held, and those read to 72 and 64 % were off by a tenth of the range.
EDGES_ALONE = 0.8
EDGES_TRIED = 31  # frames after which this is first asked, unless so many were missed that the answer is known
LOST_FOR = 240  # frames, a second of the fastest phone's: what hides a body for longer than it was seen is not waited out
CARRIED_ABOUT = "what holds the tube is carried about in the picture and was followed: the line is as it is seen from there"
PULLED_ALIKE = ", and gravity is taken to pull on it as in the first frame"
BY_ENDS = (
    "it was read by camera.clamp and camera.tip alone, for along camera.centre_line too few frames are: the line passes those points "
    "all the same"
)
GIVE_UP_AFTER = 2400  # frames without any tube before the search is called off
PIXELS_AHEAD = 16_000_000


def track_frames(
    source: FrameSource,
    calibration: Calibration,
    actuator: Actuator,
    *,
    vertical: Vertical = "board",
    gravity_deg: float | None = 0.0,
    hints: Hints | None = None,
    lamp_box: Sequence[float] | None = None,
    line_delay_s: float | None = None,
    nodes: int = 33,
    segments: int = 16,
    progress: Progress = None,
) -> Track:
    """Track the tube through a video.

    Parameters
    ----------
    source : frames with their times
    calibration : lens and plane of motion, for pictures of the same shape
    actuator : outer radius and length predict how wide and how long the tube looks
    vertical : ``board``, ``rest``, ``image`` or ``{"plumb": [[x, y], [x, y]]}`` in px
    gravity_deg : direction of the vertical from that in which the unloaded tube points, positive in the direction of the bend;
        None where no gravity pulls in the plane
    hints : what a person pointed at in the first frame
    lamp_box : x, y, width and height in px of a lamp whose brightness is to be read in every frame
    line_delay_s : of a rolling shutter, from one row of the file's pictures to the next; a frame's time is then that of the
        lamp's row, or of the middle one
    nodes, segments : nodes of the centre line, and segments of the elongation
    progress : called with (frames done, frames in all)

    Returns
    -------
    Track
        One row per frame; see `rfea_vision.artefacts.Track`. Attributes name the clamp in px and how it was found.

    Raises
    ------
    InputError
        If the calibration has no plane or belongs to pictures of another shape, or a frame takes longer to read than the next
        one is away.
    DataError
        If no tube is found, or fewer than half of the frames could be measured, or what nobody pointed at rests and another tube moves.
    """
    calibration = matched_to(calibration, source)
    scene = make_scene(calibration, actuator, vertical, hints or Hints(), source.size, gravity_deg)
    last = _frame_count(source) - 1 if scene.hints.corrections else 0
    if late := [later.frame for later in scene.hints.corrections if later.frame > last]:
        raise InputError(f"{source.path}: camera.corrections: frame {late[0]} is not in the film, whose last is {last}; correct it")
    lamp = lamp_window(lamp_box, source.size)
    shutter = shutter_of(source, line_delay_s, lamp)
    follower, rows, carried_for = _followed(source, scene, lamp, nodes, segments, progress)
    first = follower.first_look if isinstance(follower, BodyFollower) and not follower.held else None
    trials = Trials(source, scene, len(rows), progress, first)
    if follower.start is None or rows.share < LEAST_SHARE:
        raise DataError(f"{source.path}: {_why_lost(trials, calibration, vertical, follower, rows, carried_for)}")
    attributes = {
        "followed_by": "edges" if isinstance(follower, Follower) else "body",
        "source": source.path.name,
        "clamp_found_by": follower.start.base.kind,
        "polarity": follower.start.polarity,
    }
    rows.marked = follower.marked and follower.good >= 3
    data = build_dataset(rows, calibration, scene, follower.clamp_stderr_mm(), vertical, attributes, shutter)
    if told := moves_elsewhere(trials, data["tip"].values[data["valid"].values.astype(bool)]):
        raise DataError(f"{source.path}: {told}")
    carried = isinstance(follower, BodyFollower) and follower.held
    said = [CARRIED_ABOUT + ("" if gravity_deg is None else PULLED_ALIKE)] if carried else []
    said += [told] if (told := went_astray(follower)) else []
    told = _misplaced(trials, follower, rows) or end_like_wall(follower) or end_guessed(follower)
    if not told and rows.share < READ and carried:
        told = read_until(rows.reasons)
    elif not told and rows.share < READ and not said:
        told = next_hint(trials, rows.reasons, scale_off=scale_doubt(data.attrs["length_check"]), carried=carried_for)
    said += [told] if told else []
    said += [BY_ENDS] if follower.scene.by_ends else []
    if said:
        data.attrs["advice"] = "; ".join(said)
    if told := marks_unseen(trials):
        data.attrs["doubts"] = told
    return Track(data)


def _followed(
    source: FrameSource, scene: Scene, lamp: tuple[slice, slice] | None, nodes: int, segments: int, progress: Progress
) -> tuple[Follower | BodyFollower, Rows, int]:
    """Follow the edges, and the whole body, too, where these read too little: that of the two which is to be kept.

    The third of what is returned is how many of the first frames are read where what holds the body is followed as it moves.
    """
    carried_for = 0
    follower, rows = follow_edges(source, scene, lamp, Rows(nodes, segments), progress)
    unread, astray = _corrected_edges(rows, scene)
    if scene.is_pointed_at and (rows.share < READ or unread or astray):
        body, seen = follow_body(source, scene, lamp, Rows(nodes, segments), progress)
        if seen.share < READ:
            if base_moved(source, scene, seen.reasons):
                held = follow_body(source, scene, lamp, Rows(nodes, segments), progress, held=True)
                carried_for, _ = read_from_start(held[1].reasons)
                body, seen = max((body, seen), held, key=lambda way: way[1].good)
            elif scene.hints.centre_line:
                by_ends = follow_body(source, replace(scene, by_ends=True), lamp, Rows(nodes, segments), progress)
                body, seen = by_ends if by_ends[1].share >= READ else (body, seen)
        given_up = too_few(len(rows), rows.good, rows.copies)
        # Where the body reads nothing, nothing is where it was pointed at.
        if seen.good == 0 or astray or given_up or rows.share < max(EDGES_ALONE, seen.share):
            follower, rows = body, seen
    if len(rows) == 0:
        raise DataError(f"{source.path}: video.file holds no frame that can be read; record it again")
    return follower, rows, carried_for


def _corrected_edges(rows: Rows, scene: Scene) -> tuple[bool, bool]:
    """Whether edges were refused in a frame in which a person points at the tube again, and whether they lie elsewhere in one."""
    unread, astray = False, False
    for later in scene.hints.corrections:
        if later.frame < len(rows):
            line = line_of(rows.of_all("coefficients")[later.frame])
            unread |= bool(rows.reasons[later.frame])
            astray |= not rows.reasons[later.frame] and bool(off_hints(line, scene, again=np.array(later.points)))
    return unread, astray


def follow_edges(
    source: FrameSource, scene: Scene, lamp: tuple[slice, slice] | None, rows: Rows, progress: Progress
) -> tuple[Follower | BodyFollower, Rows]:
    """Follow the edges, as far as there is a tube to follow; if a tube was pointed at, as far as edges alone will do."""
    follower, pointed = Follower(scene), scene.is_pointed_at
    for done in _added(rows, follower, source, source.frames(0), lamp, progress):
        if follower.start is None and (pointed or done >= GIVE_UP_AFTER):  # what was pointed at is in the first frame
            break
        if pointed and too_few(done, rows.good, rows.copies):
            break
    return follower, rows


def _added(
    rows: Rows,
    follower: Follower | BodyFollower,
    source: FrameSource,
    frames: Generator[tuple[float, NDArray[np.uint8]], None, None],
    lamp: tuple[slice, ...] | None,
    progress: Progress,
) -> Iterator[int]:
    """Follow what is in the frames and add a row for each; yields how many there are."""
    total = _frame_count(source)
    with closing(read_ahead(frames, frames_ahead(source.size))) as pictures:
        for done, (time_s, picture) in enumerate(pictures, 1):
            reason = follower.next(picture, time_s)
            if follower.good < rows.good:
                rows.reject_all()
            rows.append(time_s, reason, follower, np.nan if lamp is None else float(picture[lamp].mean()))
            yield done
            if progress is not None and (done % 8 == 1 or done == total):
                progress(done, max(total, done))


def _why_lost(
    trials: Trials, calibration: Calibration, vertical: Vertical, follower: Follower | BodyFollower, rows: Rows, carried_for: int
) -> str:
    """How little of a film could be measured, the commonest reason, and what would help most."""
    scene, total = trials.scene, _frame_count(trials.source)
    looked = f"the first {len(rows)}" if len(rows) < total else str(len(rows))
    measured = f"{rows.good} of {looked} frames could be measured" if rows.good else "no tube found"
    side, off = "", ""
    if follower.start is not None and rows.good >= 3:
        told = build_dataset(rows, calibration, scene, follower.clamp_stderr_mm(), vertical, {})
        if isinstance(follower, Follower):  # edges alone rest on the side
            side = wrong_side(told["bend_angle"].values[told["valid"].values.astype(bool)], scene.actuator.bends)
        off = scale_doubt(told.attrs["length_check"])
    remedy = _misplaced(trials, follower, rows) or (end_like_wall(follower) if rows.good else "")
    remedy = remedy or next_hint(trials, rows.reasons, scale_off=off, side_off=side, carried=carried_for)
    return "; ".join(filter(None, [f"{measured} ({rows.commonest_reason})", marks_unseen(trials), remedy]))


def _misplaced(trials: Trials, follower: Follower | BodyFollower, rows: Rows) -> str:
    """Which click lies beside the body that was followed from the clicks, in words; empty where none does."""
    pointed_at = isinstance(follower, BodyFollower) and not follower.held
    return clicked_aside(trials, rows.reasons) if pointed_at else ""


def _frame_count(source: FrameSource) -> int:
    """How many frames there are; Matroska does not say how many, so that they are counted."""
    return source.frame_count or len(source.times_s())


def too_few(frames: int, good: int, copies: int) -> bool:
    """Whether the edges read less than `EDGES_ALONE` of the frames that are no copies, of `EDGES_TRIED` at least."""
    return frames - copies - good > (1.0 - EDGES_ALONE) * max(frames - copies, EDGES_TRIED)


def wrong_side(bend_deg: FloatArray, bends: str) -> str:
    """Doubt the side where what could be measured bends away from it; empty where it does not."""
    if -bend_deg.min() <= max(WRONG_SIDE_DEG, 2 * bend_deg.max()):
        return ""
    return f"it bends to the other side than actuator.bends says ('{bends}'): correct that, or is the film mirrored?"


def follow_body(
    source: FrameSource, scene: Scene, lamp: tuple[slice, slice] | None, rows: Rows, progress: Progress, *, held: bool = False
) -> tuple[BodyFollower, Rows]:
    """Follow the whole body by colour, texture and outline, from what was pointed at; `held` by something that moves, from there."""
    follower, total = BodyFollower(scene, scale_for(scene, source.size), held=held), _frame_count(source)
    read = follower.picture_scale
    small = None if lamp is None else tuple(slice(int(read * s.start), int(read * s.stop) + 1) for s in lamp)
    for done in _added(rows, follower, source, follower.ahead(levelled(source.colours(read))), small, progress):
        lost = 0 if follower.awaited() else follower.missed
        if follower.hopeless() or too_late(done, rows.good, rows.copies, total, lost=lost):
            break
    return follower, rows


def too_late(done: int, good: int, copies: int, total: int, *, lost: int) -> bool:
    """Whether the frames that are left cannot, or will not, make a film's `LEAST_SHARE` any more; `lost` of the last were missed."""
    cannot = good + total - done < LEAST_SHARE * (total - copies)
    return done < total and (cannot or (lost >= LOST_FOR and good < LEAST_SHARE * (done - copies)))


def frames_ahead(size: tuple[int, int]) -> int:
    """How many pictures may wait: enough to even out what frames take, of large pictures few."""
    return max(2, min(8, PIXELS_AHEAD // max(size[0] * size[1], 1)))


def lamp_window(box: Sequence[float] | None, size: tuple[int, int]) -> tuple[slice, slice] | None:
    """Rows and columns of the lamp's box.

    Raises
    ------
    InputError
        If no pixel of the box lies in the picture.
    """
    if box is None:
        return None
    x, y, width, height = box
    columns = slice(max(round(x), 0), min(max(round(x + width), round(x) + 1), size[0]))
    lines = slice(max(round(y), 0), min(max(round(y + height), round(y) + 1), size[1]))
    if columns.start >= columns.stop or lines.start >= lines.stop:
        raise InputError(
            f"sync.box: the box {list(box)} lies outside the picture of {size[0]} x {size[1]} px; correct it"
        )
    return lines, columns


def shutter_of(source: FrameSource, line_delay_s: float | None, lamp: tuple[slice, slice] | None) -> Shutter | None:
    """How the rows of a film were read; None where all are taken to be of one instant.

    Raises
    ------
    InputError
        If the rows take longer than from one frame to the next.
    """
    if not line_delay_s:
        return None
    width, height = source.size
    steps = np.diff(source.times_s())
    rows = width if source.quarter_turns % 2 else height
    if len(steps) and abs(line_delay_s) * rows > (period := float(np.median(steps))):
        raise InputError(
            f"camera.line_delay: {rows} rows take {1e3 * abs(line_delay_s) * rows:.3g} ms at {1e6 * abs(line_delay_s):.3g} us each, "
            f"and the frames of {source.path.name} are {1e3 * period:.3g} ms apart; give the delay from one row of the film to the next"
        )
    middle = (width - 1) / 2, (height - 1) / 2
    at = middle if lamp is None else ((lamp[1].start + lamp[1].stop - 1) / 2, (lamp[0].start + lamp[0].stop - 1) / 2)
    return Shutter(line_delay_s, at, source.quarter_turns, source.size)
