"""Arms of discs on a thin rod: their skin repeats itself, and between discs wall is seen."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.lines import at
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.body.marks import find_marks, marks_in, place_of, row_of
from rfea_vision.vision.body.model import SHARES, SeenBody
from rfea_vision.vision.body.shown import Shown
from rfea_vision.vision.scene import make_scene

FOOT, SIZE, HALF, PITCH = np.array([230.0, 270.0]), (360, 300), 12.0, 9.0
LENGTH = 207.0  # 23 discs


def middle_of(bend: float) -> np.ndarray:
    """Points (65, 2) px from the clamp on, upwards, to the left by `bend` rad at the end."""
    heading = -np.pi / 2 - bend * SHARES
    steps = LENGTH / 64 * np.column_stack([np.cos(heading), np.sin(heading)])
    return FOOT + np.vstack([[0.0, 0.0], np.cumsum(0.5 * (steps[1:] + steps[:-1]), axis=0)])


def drawn(
    line: np.ndarray, *, rod: int = 2, plain: bool = False, hidden: bool = False, pitch: float = PITCH, colour: tuple = (30, 30, 30)
) -> np.ndarray:
    picture = np.full((*SIZE[::-1], 3), (150, 165, 160), np.uint8)
    cv2.rectangle(picture, (200, 270), (260, 300), (35, 30, 30), -1)
    cv2.polylines(picture, [np.round(16 * line).astype(np.int32)], False, (30, 30, 30), 24 if plain else rod, cv2.LINE_AA, 4)
    for far in np.arange(pitch, LENGTH + 0.1, pitch):
        place, before = at(line, np.array([far, far - 3.0]))
        across = (place - before)[::-1] * [-HALF / 3.0, HALF / 3.0]
        ends = [np.round(16 * (place + side * across)).astype(int).tolist() for side in (-1, 1)]
        cv2.line(picture, ends[0], ends[1], colour, 3, cv2.LINE_AA, 4)
    if hidden:
        cv2.rectangle(picture, (0, 0), (360, 200), (40, 160, 60), -1)
    noise = np.random.default_rng(0).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def begun(picture: np.ndarray, line: np.ndarray) -> BodyFollower:
    points = tuple((float(x), float(y)) for x, y in line[[20, 44]])
    clamp = ((FOOT[0] - HALF, FOOT[1]), (FOOT[0] + HALF, FOOT[1]))
    hints = Hints(clamp=clamp, tip=(float(line[-1, 0]), float(line[-1, 1])), centre_line=points)
    actuator = Actuator(outer_radius=HALF / 1e3, inner_radius=HALF / 2e3, length=LENGTH / 1e3)
    scene = make_scene(scaled_by_distance(SIZE, [[10, 10], [110, 10]], 100.0), actuator, "image", hints, SIZE)
    follower = BodyFollower(scene, 1.0)
    assert follower.next(picture, 0.0) == ""
    return follower


@pytest.mark.parametrize(("discs", "said"), [(23, ""), (21, ""), (18, ""), (16, "length_off")])
def test_a_line_that_ends_at_a_disc_before_the_end_is_told_by_its_skin_how_much_is_missing(discs, said):
    """Beyond it there is wall, and then more of the arm: its standard error holds that."""
    follower = begun(drawn(line := middle_of(0.2)), line)
    lab, length = follower.last.lab, follower.body.length
    short = replace(follower.body, points=at(line, SHARES * (discs * PITCH + 1.0)))
    fit = follower._judged(lab, follower._fit(lab, short, 1e-6 * follower.pointed.covariance, 0.8))
    assert np.ptp(fit.body.points[-1] - short.points[-1]) < 4.0
    assert fit.reason.startswith(said) and bool(fit.reason) == bool(said), fit.reason
    assert abs(fit.another - (length - fit.body.length)) < 1.0
    follower._accept(lab, fit)
    stderr = follower.work.numbers["tip_variance"][0] ** 0.5 * follower.px_per_mm
    assert stderr > length - fit.body.length


def lost(picture: np.ndarray, line: np.ndarray) -> BodyFollower:
    """One that has measured the arm on `line` in a picture, and has missed it since."""
    follower = begun(picture, line)
    follower.missed = 1
    return follower


def sought(follower: BodyFollower, picture: np.ndarray) -> list[SeenBody]:
    """Outlines of all in a picture that looks like the arm."""
    lines = follower._reached(shown := Shown(picture))
    lab = follower.wall.look(shown, *follower.looked_at(*lines))
    return [follower._outlined(lab, line)[0] for line in lines]


def test_an_arm_whose_discs_do_not_hang_together_is_sought_as_long_as_it_was():
    """The rod is too thin to be seen: what looks like the arm and hangs together with its clamp is less than half of it."""
    follower = lost(drawn(line := middle_of(0.6), rod=1), line)
    gaps = drawn(line, rod=1)
    cv2.circle(gaps, np.round(at(line, np.array([120.0]))[0]).astype(int).tolist(), 16, (150, 165, 160), -1)
    found = sought(follower, gaps)
    assert found[0].length == pytest.approx(follower.body.length, rel=0.03)


def test_another_arm_at_the_same_clamp_is_not_taken_for_one_that_is_not_seen():
    """An arm of discs that is gripped by another one: both look alike, but that one was there before."""
    line, other = middle_of(1.0), middle_of(-1.0)
    follower = lost(np.minimum(drawn(line), drawn(other)), line)
    assert all(np.linalg.norm(found.points[-1] - other[-1]) > 2.0 * HALF for found in sought(follower, drawn(other)))


def test_an_arm_that_was_lost_may_be_as_long_as_when_its_end_was_last_seen():
    follower = begun(drawn(line := middle_of(0.6)), line)
    known = float(follower.work.numbers["tip_variance"][0])
    follower.end_offsets, follower.missed = None, 1  # as where it was not seen in the first frame, and has been lost
    follower.known_length = follower.body.length + PITCH
    found = follower.next(drawn(middle_of(0.65)), 0.0)
    assert found == "" and float(follower.work.numbers["tip_variance"][0]) > known + 0.9 * PITCH**2
    found = follower.next(drawn(middle_of(0.67)), 0.0)  # its rays agree in the frame before
    assert found == "" and float(follower.work.numbers["tip_variance"][0]) < known + 0.1 * PITCH**2
    assert follower.known_length == follower.body.length


FEW = {"rod": 1, "pitch": 23.0, "colour": (50, 60, 200)}  # nine red discs, two half widths apart: most of such an arm is wall


def test_an_arm_of_few_discs_is_read_by_these():
    """Of what was pointed at a tenth looks like a body: outlines, rays through the end and rules saw the wall between the discs."""
    lines = [middle_of(bend) for bend in 0.2 + 0.6 * (1 - np.cos(np.linspace(0, np.pi, 25)))]
    follower = begun(drawn(lines[0], **FEW), lines[0])
    assert len(follower.marks) == 9
    for k, line in enumerate(lines[1:], 1):
        assert follower.next(drawn(line, **FEW), k / 30) == "", f"frame {k}"
        assert np.linalg.norm(follower.body.points - line, axis=1).max() < 0.25 * HALF, f"frame {k}"


@pytest.mark.parametrize("slipped", [-23.0, 23.0])
def test_a_disc_is_not_taken_for_the_next_one(slipped):
    """Flow that has slipped by a disc along the outer half of an arm: the row of discs is one short then, or two lie too far apart."""
    follower = begun(picture := drawn(line := middle_of(0.4), **FEW), line)
    lab = follower.last.lab
    assert lab.shape == picture.shape
    far = SHARES * (LENGTH + slipped * np.clip((SHARES - 0.4) / 0.2, 0.0, 1.0))
    predicted = replace(follower.body, points=at(np.vstack([line, 2 * line[-1:] - line[-9:-8]]), far))
    found = marks_in(lab, follower.marks, predicted, follower.body, follower.wall)
    assert len(found) >= 7
    assert max(np.linalg.norm(seen.place - place_of(seen.mark, follower.body)) for seen in found) < 2.0


@pytest.mark.parametrize("hidden", [(0, 1, 2), (3, 4, 5), (1, 2, 3, 7)])
def test_a_disc_beyond_hidden_ones_is_the_one_that_it_is(hidden):
    """Its distance from the next one that is seen tells, though that is farther than neighbours are."""
    follower = begun(picture := drawn(line := middle_of(0.4), **FEW), line)
    for number in hidden:
        x, y = np.round(at(line, np.array([23.0 * (number + 1)]))[0]).astype(int).tolist()
        cv2.circle(picture, (x, y), 14, (150, 165, 160), -1)
    turned = replace(follower.body, points=middle_of(0.46))
    lab = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2LAB))
    found = marks_in(lab, follower.marks, turned, follower.body, follower.wall)
    assert len(found) == 9 - len(hidden)
    assert max(np.linalg.norm(seen.place - place_of(seen.mark, follower.body)) for seen in found) < 2.0


def test_windings_of_a_thread_are_no_marks():
    """Nearer to one another than three quarters of a half width none is told from the next, nor where some of them are not seen."""
    for pitch, count in ((7.0, 0), (15.0, 13)):
        body = begun(picture := drawn(line := middle_of(0.2), plain=True, pitch=pitch, colour=(50, 60, 200)), line).body
        lab = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2LAB))
        assert len(find_marks(lab, body, None)) == count
        for far in (52.0, 150.0):
            x, y = np.round(at(line, np.array([far]))[0]).astype(int).tolist()
            cv2.circle(picture, (x, y), 16, (30, 30, 30), -1)
        found = find_marks(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)), body, None)
        assert bool(found) == bool(count)


def test_things_in_a_row_behind_a_body_are_no_discs():
    """Unevenly apart, of different sizes, or not from edge to edge."""
    body = begun(picture := drawn(line := middle_of(0.2), plain=True), line).body
    for thick, far in ((3, [20, 43, 66, 110, 121, 168, 190]), (3, [20, 43, 66])):
        marked = picture.copy()
        for at_px in far:
            place, before = at(line, np.array([at_px, at_px - 3.0]))
            across = (place - before)[::-1] * [-HALF / 3.0, HALF / 3.0]
            cv2.line(marked, *(np.round(place + side * across).astype(int).tolist() for side in (-1, 1)), (50, 60, 200), thick)
        assert row_of(find_marks(np.asarray(cv2.cvtColor(marked, cv2.COLOR_BGR2LAB)), body, None)) == []
