"""Cheapest ways over a picture, beside a search that tries every step; the way through the middle of a body; what a mask thins to."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rfea_vision.vision.body.ways import Ways, middle_way
from rfea_vision.vision.find.begin import beside
from testing.thinning import thinned


def _by_relaxing(cost, starts):
    """Cost of the cheapest way to every pixel: every step is taken where it is cheaper, until none is (Bellman and Ford)."""
    total = np.full(np.array(cost.shape) + 2, np.inf)
    wide = np.pad(cost, 1, constant_values=np.inf)
    for row, column in starts:
        total[row + 1, column + 1] = 0.0
    while True:
        before = total.copy()
        for down, right in ((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b):
            step = 0.5 * np.hypot(down, right) * (wide + np.roll(wide, (down, right), (0, 1)))
            total = np.minimum(total, np.roll(before, (down, right), (0, 1)) + step)
        if np.array_equal(total, before):
            return total[1:-1, 1:-1]


@pytest.mark.parametrize("starts", [[(0, 0)], [(3, 4), (30, 35), (3, 4)]])
def test_ways_are_the_cheapest_and_walls_are_not_crossed(starts):
    cost = np.random.default_rng(1).random((40, 50)) + 0.02
    cost[20, 5:] = np.inf
    cost[25:35, 10] = np.inf
    ways = Ways(cost, starts)
    np.testing.assert_allclose(ways.total, _by_relaxing(cost, starts), rtol=1e-12)
    way = ways.to((39, 49))
    assert tuple(way[0]) in starts and tuple(way[-1]) == (39, 49) and np.isfinite(cost[tuple(way.T)]).all()
    steps = np.diff(way, axis=0)
    paid = np.hypot(*steps.T) * 0.5 * (cost[tuple(way[1:].T)] + cost[tuple(way[:-1].T)])
    assert np.abs(steps).max() == 1 and paid.sum() == pytest.approx(ways.total[39, 49])


def test_what_is_walled_in_is_not_reached():
    cost = np.ones((9, 9))
    cost[3:6, 3:6] = np.inf
    cost[4, 4] = 1.0
    total = Ways(cost, [(0, 0)]).total
    assert np.isinf(total[3:6, 3:6]).all() and np.isfinite(total).sum() == 72


def _drawn(*points, wide=9):
    mask = np.zeros((120, 160), np.uint8)
    cv2.polylines(mask, [np.array(points, np.int32)], isClosed=False, color=1, thickness=wide)
    return mask > 0


def test_the_way_through_a_body_goes_to_its_end_and_ends_at_its_outline():
    """Another body beside it is not reached, and a corner of the end is not run into."""
    line = np.array([[20.0, 20.0], [60.0, 90.0], [140.0, 100.0]])
    mask = (_drawn(*line) | _drawn((100, 20), (150, 60))).astype(np.uint8)
    way = middle_way(mask, (20, 20), 4.5)
    assert way is not None
    np.testing.assert_allclose(way[[0, -1]], [[20, 20], [144, 100]], atol=2.0)
    assert max(beside(line, point) for point in way[:-1]) < 3.0
    assert middle_way(mask, (5, 100), 4.5) is None


def test_a_mask_thins_to_a_line_in_its_middle():
    mask = _drawn((20, 20), (60, 90), (140, 100))
    line = thinned(mask)
    distance = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    assert (line <= mask).all() and np.median(distance[line]) >= 0.9 * distance.max() - 0.5
    count, _ = cv2.connectedComponents(line.astype(np.uint8), connectivity=8)
    assert count == 2  # one piece, and what is around it
    reached = Ways(np.where(line, 1.0, np.inf), [tuple(np.argwhere(line)[0])]).total
    assert reached[line].max() > 140  # nearly as long as what was drawn
    assert line.sum() < 1.5 * reached[line].max()  # and thin


def test_a_ring_stays_a_ring_and_nothing_stays_nothing():
    ring = cv2.circle(np.zeros((80, 80), np.uint8), (40, 40), 25, 1, 8) > 0
    line = thinned(ring).astype(np.uint8)
    count, _ = cv2.connectedComponents(1 - line, connectivity=4)
    assert count == 3 and 100 < line.sum() < 260  # inside, outside, the line
    assert not thinned(np.zeros((5, 5), bool)).any() and thinned(np.eye(7, dtype=bool)).sum() >= 2


def test_a_body_that_fills_its_window_has_no_middle_that_is_known():
    """Discs that looked like all of a window: no pixel was outside, depths had no end, and the film ended in an IndexError."""
    assert middle_way(np.ones((40, 12), dtype=np.uint8), (20, 6), 6.0) is None
