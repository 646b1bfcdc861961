"""A tube that is pointed at again in a later frame: the line goes there, and is known by what a person points at."""

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Correction, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import InputError
from rfea_vision.readers.video import open_frames
from rfea_vision.vision import track_frames
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.scene import make_scene

SIZE, LAST = (260, 240), 11
TWIN = 6  # the frame from which on the arm has left its twin, that hangs behind it
CALIBRATION = scaled_by_distance(SIZE, [[0, 0], [100, 0]], 50.0)
TUBE = Actuator(outer_radius=0.005, inner_radius=0.0025, length=0.085)
HINTS = Hints(clamp=((120.0, 30.0), (140.0, 30.0)), tip=(130.0, 200.0))
WALL = 2.0 * cv2.GaussianBlur(np.random.default_rng(3).normal(0, 14, (240, 260, 3)), (0, 0), 2.0)


def middle_line(bend):
    """Points (80, 2) px of an arm that bends evenly by an angle."""
    heading = bend * np.linspace(0, 1, 80)
    return np.array([130.0, 30.0]) + np.column_stack([np.cumsum(np.sin(heading)), np.cumsum(np.cos(heading))]) * 170 / 80


def picture_of(*bends, covered=False):
    picture = np.clip(215 + WALL, 0, 255).astype(np.uint8)
    for bend in bends:
        drawn = np.round(middle_line(bend) * 16).astype(np.int32)
        cv2.polylines(picture, [drawn], False, (60, 160, 90), 19, cv2.LINE_AA, 4)
        if covered:
            cv2.polylines(picture, [drawn[24:60]], False, (200, 60, 60), 25, cv2.LINE_AA, 4)
    return picture


def bend_of(frame):
    return 0.0 if frame < TWIN else 1.2 + 0.03 * (frame - TWIN)


def pictures():
    """An arm at rest, and then two: one as it was, and one that is bent from one picture to the next."""
    return [picture_of(0.0, bend_of(frame)) for frame in range(LAST + 1)]


def pointed_again(frame, bend, count=5):
    """The tube's middle at even distances, as whole pixels."""
    return Correction(frame, tuple(map(tuple, np.round(middle_line(bend)[np.linspace(0, 79, count + 1).astype(int)[1:]]).tolist())))


def follow(hints, frames):
    follower = BodyFollower(make_scene(CALIBRATION, TUBE, "image", hints, SIZE), 1.0)
    told = [(follower.next(picture, float(k)), follower.body.points[-1].copy()) for k, picture in enumerate(frames)]
    return follower, [reason for reason, _ in told], np.array([tip for _, tip in told])


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_line_that_has_stayed_behind_goes_where_one_points(count):
    """By the tip alone, a point between, or all along: without these it stays on what looks like the arm, and is sure of it."""
    ends = np.array([middle_line(bend_of(frame))[-1] for frame in range(LAST + 1)])
    _, reasons, tips = follow(HINTS, pictures())
    assert not any(reasons) and np.linalg.norm(tips - ends, axis=1)[TWIN:].min() > 60.0
    corrected = Hints(clamp=HINTS.clamp, tip=HINTS.tip, corrections=(pointed_again(TWIN, bend_of(TWIN), count),))
    follower, reasons, tips = follow(corrected, pictures())
    assert not any(reasons) and np.linalg.norm(tips - ends, axis=1).max() < 4.0
    assert follower.astray == [TWIN]


def test_whoever_points_vouches_for_what_is_hidden():
    """A sleeve covers near half of the arm: its frames are refused, but for the one in which a person says where it is."""
    frames = [picture_of(0.05 * frame, covered=frame >= 4) for frame in range(9)]
    assert all(follow(HINTS, frames)[1][4:])
    corrected = Hints(clamp=HINTS.clamp, tip=HINTS.tip, corrections=(pointed_again(6, 0.3),))
    follower, reasons, tips = follow(corrected, frames)
    assert [k for k, reason in enumerate(reasons) if not reason] == [0, 1, 2, 3, 6]
    assert np.linalg.norm(tips[6] - middle_line(0.3)[-1]) < 3.0
    assert follower.astray == []  # it had been refused, not read
    first_hidden = Hints(clamp=HINTS.clamp, tip=HINTS.tip, corrections=(pointed_again(4, 0.9),))
    assert follow(first_hidden, frames)[0].astray == [], "what would have been refused is no line that has gone astray"


def test_points_where_nothing_like_it_is_are_refused():
    beside = Correction(TWIN, ((200.0, 60.0), (230.0, 20.0)))
    _, reasons, _ = follow(Hints(clamp=HINTS.clamp, tip=HINTS.tip, corrections=(beside,)), [picture_of(0.0)] * 8)
    assert [k for k, reason in enumerate(reasons) if reason] == [TWIN]


def test_corrections_that_cannot_act_are_told(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), picture_of(0.0))
    source = open_frames(tmp_path, None, 30.0)
    late = Hints(clamp=HINTS.clamp, tip=HINTS.tip, corrections=(pointed_again(3, 0.0),))
    alone = Hints(corrections=late.corrections)
    for hints, says in ((late, "frame 3 is not in the film, whose last is 0"), (alone, "camera.clamp and camera.tip")):
        with pytest.raises(InputError, match=says):
            track_frames(source, CALIBRATION, TUBE, hints=hints, vertical="image")


def test_edges_that_lie_elsewhere_are_left_for_the_body(tmp_path):
    """Edges read every frame of the arm's twin; with one correction the film is the arm's, and says what was wrong before it."""
    for number, picture in enumerate(pictures()):
        cv2.imwrite(str(tmp_path / f"{number:03d}.png"), picture)
    source = open_frames(tmp_path, None, 30.0)
    before = track_frames(source, CALIBRATION, TUBE, hints=HINTS, vertical="image")
    assert before.valid.all() and np.ptp(before.dataset["tip"].values[:, 0]) < 1.0
    late = Hints(clamp=HINTS.clamp, tip=HINTS.tip, corrections=(pointed_again(TWIN + 2, bend_of(TWIN + 2)),))
    after = track_frames(source, CALIBRATION, TUBE, hints=late, vertical="image")
    assert after.dataset.attrs["followed_by"] == "body" and after.valid[TWIN + 2 :].all()
    assert "of frame 8 the line had gone elsewhere" in after.dataset.attrs["advice"]
    bent_mm = (middle_line(bend_of(LAST))[-1] - [130.0, 30.0]) / 2.0
    np.testing.assert_allclose(after.dataset["tip"].values[-1], bent_mm * [1, -1], atol=2.0)
