"""Ends: what is fixed to them, and how they bend from frame to frame."""

import cv2
import numpy as np
import pytest

from rfea_vision.vision.body import fit
from rfea_vision.vision.body.model import SHARES

from .test_gone import FOOT, HALF, RUBBER, drawn, follower_of, middle_of

HOSE = (70, 60, 210)


def with_hose(line: np.ndarray, half: float, hose: float) -> np.ndarray:
    """The body, and a hose of `hose` half widths that leaves its end and goes back over it to the picture's border."""
    picture = drawn(line, np.full(65, half))
    out = line[-1] - line[-4]
    out = out / np.linalg.norm(out)
    turn = np.linspace(0.0, 0.9 * np.pi, 30)[:, None]
    bow = line[-1] + hose * half * out + 14.0 * (np.sin(turn) * out + (1.0 - np.cos(turn)) * np.array([out[1], -out[0]]) * -1.0)
    points = np.vstack([bow, bow[-1:] + 150.0 * (bow[-1:] - bow[-2:-1]) / np.linalg.norm(bow[-1] - bow[-2])])
    over = picture.copy()
    cv2.polylines(over, [np.round(16 * points).astype(np.int32)], False, HOSE, round(2 * hose * half), cv2.LINE_AA, 4)
    return cv2.GaussianBlur(over, (0, 0), 0.6)


@pytest.mark.parametrize("hose", [0.4, 0.7])
def test_an_end_with_a_hose_on_it_is_measured(hose):
    """A smooth body that grows by a quarter: nothing else shows how long it is."""
    follower, off = None, []
    for k in range(40):
        line = middle_of(0.1 + 0.03 * k, 100.0 * (1.0 + 0.25 * k / 39))
        follower = follower or follower_of(line)
        assert follower.next(with_hose(line, HALF, hose), 0.05 * k) == "", k
        off.append(float(np.linalg.norm(follower.body.points[-1] - line[-1])) / HALF)
        seen = follower.end_offsets
        assert seen is not None and np.abs(seen).max() < 0.2 * HALF, "all rays see it, and not where the hose ends"
    assert max(off) < 0.2


def curled(turn: float) -> np.ndarray:
    """Points (65, 2) px of a line of 120 px that turns by `turn` rad, most of it near its end."""
    heading = np.pi - turn * SHARES**3
    steps = 120.0 / 64 * np.column_stack([np.cos(heading), np.sin(heading)])
    return FOOT + np.vstack([[0.0, 0.0], np.cumsum(0.5 * (steps[1:] + steps[:-1]), axis=0)])


def test_an_end_that_curls_more_than_the_rest_is_not_held_to_one_side():
    """That a frame was to bend the body by 0.6 px at most held it 0.06 half widths aside (root mean square), before a plain wall."""
    lines = [curled(1.2 * np.sin(0.06 * k)) for k in range(20)]
    follower, aside = follower_of(lines[0]), []
    for k, line in enumerate(lines):
        assert follower.next(drawn(line, np.full(65, HALF)), 0.05 * k) == "", k
        off, out = follower.body.points[-1] - line[-1], line[-1] - line[-3]
        aside.append(float(out[0] * off[1] - out[1] * off[0]) / float(np.linalg.norm(out)))
    assert np.sqrt(np.mean(np.square(aside))) < 0.045 * HALF


@pytest.mark.parametrize("grown", [0.0, 0.2])
def test_an_end_that_nothing_measures_is_known_no_better_than_what_may_have_grown(grown):
    """A smooth body that bends before a plate of its colour: its line ended 1.4 half widths short, by seven standard errors."""
    follower, off, stderr = follower_of(middle_of(0.1, 100.0)), 0.0, 0.0
    for k in range(31):
        line = middle_of(0.1 + 0.03 * k, 100.0 * (1.0 + grown * k / 39))
        assert follower.next(drawn(line, np.full(65, HALF), [((0, 30, 60, 230), RUBBER)]), 0.05 * k) == "", k
        off = float(np.linalg.norm(follower.body.points[-1] - line[-1])) / HALF
        stderr = follower.work.numbers["tip_variance"][0] ** 0.5 * follower.px_per_mm / HALF
        assert follower.end_offsets is None and off < 3.0 * stderr, k
    # A fifth of the end's way, 44 and 39 px, and a tenth of the length, which nothing tells: 1.14 and 1.09.
    assert stderr < 1.3 and off < (0.3 if grown == 0.0 else 2.0)


def test_an_end_is_known_by_the_skin_where_that_shows_how_long_the_body_is():
    """The same body with spots on it."""
    rng = np.random.default_rng(5)
    spots = rng.uniform([0.05, -0.6], [0.97, 0.6], (60, 2))

    def seen(line: np.ndarray) -> np.ndarray:
        picture = drawn(line, np.full(65, HALF), [((0, 30, 60, 230), RUBBER)])
        ahead = np.gradient(line, axis=0)
        aside = np.column_stack([-ahead[:, 1], ahead[:, 0]]) / np.linalg.norm(ahead, axis=1, keepdims=True)
        for share, side in spots:
            k = int(share * 64)
            x, y = line[k] + (share * 64 - k) * (line[k + 1] - line[k]) + side * HALF * aside[k]
            cv2.circle(picture, (round(16 * x), round(16 * y)), 20, (120, 130, 140), -1, cv2.LINE_AA, 4)
        return picture

    follower = follower_of(middle_of(0.1, 100.0))
    for k in range(40):
        line = middle_of(0.1 + 0.03 * k, 100.0 * (1.0 + 0.2 * k / 39))
        assert follower.next(seen(line), 0.05 * k) == "", k
        off = float(np.linalg.norm(follower.body.points[-1] - line[-1])) / HALF
        stderr = follower.work.numbers["tip_variance"][0] ** 0.5 * follower.px_per_mm / HALF
        assert off < max(3.0 * stderr, 0.1), k
    assert off < 0.3


def test_an_end_that_is_seen_holds_the_line_where_marks_do_not_reach():
    """An arm glued at its end: up to a mark it stretches by a quarter, beyond not at all. Its line ended 0.19 half widths off."""
    follower = None
    for k in range(40):
        stretch, bend = 1.0 + 0.25 * k / 39, 0.1 + 0.02 * k
        heading = np.pi - bend * SHARES
        steps = 105.0 / 64 * np.where(SHARES < 0.85, stretch, 1.0)[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        line = FOOT + np.vstack([[0.0, 0.0], np.cumsum(0.5 * (steps[1:] + steps[:-1]), axis=0)])
        picture = drawn(line, np.full(65, HALF))
        x, y = line[54]
        cv2.circle(picture, (round(16 * x), round(16 * y)), round(16 * 0.5 * HALF), (40, 40, 200), -1, cv2.LINE_AA, 4)
        follower = follower or follower_of(line)
        assert follower.next(picture, 0.05 * k) == "", k
        assert len(follower.marks) == 1 and follower.end_offsets is not None
        off = float(np.linalg.norm(follower.body.points[-1] - line[-1])) / HALF
    assert off < 0.15


def test_an_end_that_pulls_marks_off_is_another_one(monkeypatch):
    """A cable that crossed beyond an arm's end was taken for that, and its last mark lay ten of its standard errors off the line."""
    line, picture = middle_of(0.1, 100.0), drawn(middle_of(0.1, 100.0), np.full(65, HALF))
    x, y = line[54]
    cv2.circle(picture, (round(16 * x), round(16 * y)), round(16 * 0.5 * HALF), (40, 40, 200), -1, cv2.LINE_AA, 4)
    follower = follower_of(line)
    assert follower.next(picture, 0.0) == "" and len(follower.marks) == 1
    seen = fit.end_rays
    monkeypatch.setattr(fit, "end_rays", lambda *place: seen(*place) * 0.0 + HALF)
    for k in range(1, 10):  # never the same picture: that is a duplicate
        assert follower.next(np.roll(picture, k % 2, axis=1), 0.05 * k) == "", k
    assert float(np.linalg.norm(follower.body.points[-1] - line[-1])) < 0.3 * HALF


@pytest.mark.parametrize("off_px", [-10.0, 0.0, 5.0])
def test_what_rays_see_an_end_off_the_line_is_in_its_standard_error(off_px):
    """An arm that snapped round by half its length ended a half width before its line, and was said to be known to a fifth of that."""
    follower = follower_of(line := middle_of(0.1, 100.0))
    for k in range(2):
        assert follower.next(drawn(line, np.full(65, HALF)), 0.05 * k) == ""
    found = follower._fit(follower.last.lab, follower.body, follower._spread(), 0.8)
    found.end[:] = off_px
    follower._accept(follower.last.lab, found)
    stderr = follower.work.numbers["tip_variance"][0] ** 0.5 * follower.px_per_mm
    assert abs(off_px) <= stderr < abs(off_px) + 2.0


@pytest.mark.parametrize("dotted", [True, False])
def test_a_click_on_a_mark_before_the_end_means_the_mark(dotted):
    """Real arms with a dot a third of a half width before their end, clicked on the dot: the line went on to the end."""
    line, off = middle_of(0.1, 100.0), []
    at = 64 - round(0.35 * HALF / 100.0 * 64)  # of the stations
    clicked = line[at] + [1.0, -0.7] if dotted else line[-1] + [-0.7, 0.7]
    follower = follower_of(np.vstack([line[:-1], clicked]))
    for k in range(25):
        line = middle_of(0.1 + 0.04 * k, 100.0)
        picture = drawn(line, np.full(65, HALF))
        cv2.circle(picture, np.round(16 * line[at]).astype(int).tolist(), round(16 * 0.3 * HALF), (40, 40, 200), -1, cv2.LINE_AA, 4)
        assert follower.next(picture, 0.05 * k) == "", k
        off.append(float(np.linalg.norm(follower.body.points[-1] - (line[at] if dotted else line[-1]))))
    assert max(off) < (0.5 if dotted else 1.2)
