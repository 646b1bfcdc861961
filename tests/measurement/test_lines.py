"""Skeletons and cheapest ways, held against scikit-image and against what must be true of any."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric
from skimage.morphology import skeletonize

from rfea_vision.vision.body.lines import skeleton_of, way_to, ways_from


def drawn(seed: int) -> NDArray[np.bool_]:
    """A mask with a few bent bodies of random width, and specks."""
    rng = np.random.default_rng(seed)
    mask = (rng.random(rng.integers(60, 200, 2)) < 0.003).astype(np.uint8)
    share = np.linspace(0, 1, 60)[:, None]
    for _ in range(rng.integers(1, 4)):
        p = rng.integers(0, mask.shape[::-1], (4, 2))
        curve = (1 - share) ** 3 * p[0] + 3 * share * (1 - share) * ((1 - share) * p[1] + share * p[2]) + share**3 * p[3]
        cv2.polylines(mask, [curve.astype(np.int32)], False, 1, int(rng.integers(2, 20)))
    return mask.astype(bool)


def bodies(mask: NDArray[np.bool_]) -> int:
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[0]


@pytest.mark.parametrize("seed", range(12))
def test_a_skeleton_keeps_every_body_whole_and_lies_where_that_of_another_library_does(seed: int) -> None:
    mask = drawn(seed)
    skeleton, other = skeleton_of(mask), skeletonize(mask)
    assert not (skeleton & ~mask).any()
    assert bodies(skeleton) == bodies(mask)
    assert np.array_equal(skeleton, skeleton_of(skeleton))
    assert skeleton.sum() < 1.15 * other.sum()  # as thin as that one: a line of two pixels would be 2
    off = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[skeleton]
    assert np.median(off) <= 1.0


def test_a_square_of_four_pixels_stays() -> None:
    mask = np.zeros((6, 6), dtype=bool)
    mask[2:4, 2:4] = True
    assert skeleton_of(mask).any()


@pytest.mark.parametrize("seed", range(6))
def test_ways_cost_what_another_library_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.random(rng.integers(10, 90, 2)) + 0.02
    cost[rng.random(cost.shape) < 0.25] = np.inf
    cost[0, 0] = cost[-1, -1] = 1.0
    total, before = ways_from(cost, np.array([[0, 0], [0, 0]]))
    expected, _ = MCP_Geometric(cost).find_costs([(0, 0)])
    np.testing.assert_allclose(total, expected, rtol=1e-12)
    end = tuple(int(k) for k in np.argwhere(np.isfinite(total))[-1])
    way = way_to((end[0], end[1]), before)
    assert tuple(way[0]) == (0, 0)
    assert tuple(way[-1]) == end
    steps = 0.5 * (cost[tuple(way[1:].T)] + cost[tuple(way[:-1].T)]) * np.hypot(*np.diff(way, axis=0).T)
    assert steps.sum() == pytest.approx(total[end], rel=1e-9)
