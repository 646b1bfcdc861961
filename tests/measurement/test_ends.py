"""Ends: what is fixed to them, and how they bend from frame to frame."""

import cv2
import numpy as np
import pytest

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


@pytest.mark.parametrize(("things", "share"), [(((0, 30, 60, 230), RUBBER), 1.0), (None, 0.25)])
def test_an_end_that_is_not_measured_is_known_no_better_than_its_length_has_varied(things, share):
    """A plate of the body's colour at its end: nothing measures how long it is, and all that its length has done may be drift."""
    follower = follower_of(middle_of(0.0, 100.0))
    for k in range(3):
        follower.lengths = follower.lengths if k < 2 else (90.0, 110.0)
        assert follower.next(drawn(middle_of(0.02 * k, 100.0), np.full(65, HALF), [things] if things else []), 0.05 * k) == ""
    assert (follower.end_offsets is None) == (things is not None)
    stderr_px = follower.work.numbers["tip_variance"][0] ** 0.5 * follower.px_per_mm
    assert share * 20.0 <= stderr_px < 1.3 * share * 20.0
