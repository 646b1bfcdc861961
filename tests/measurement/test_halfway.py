"""Where edges and ends lie to a part of a pixel, and what an end that was pointed at is known to."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.vision.body.first import END_NEAR, END_PLACED, RANGE, end_among
from rfea_vision.vision.body.fit import NORMAL, TURN_ROWS, UNKNOWNS, Evidence
from rfea_vision.vision.body.model import NOWHERE, SHARES, STATIONS, SeenBody
from rfea_vision.vision.body.sampling import RAYS, Behind, measure_edges, measure_end
from rfea_vision.vision.body.wall import Wall

SIZE, HALF, LEFT = 80, 12.0, 40.0
BODY, WALL = np.array([150.0, 140.0, 130.0]), np.array([60.0, 125.0, 128.0])
SHADED, PLAIN = np.array([30.0, 8.0, 8.0]) ** 2, np.array([12.0, 4.0, 4.0]) ** 2
NOTHING = np.stack([np.full(3, NOWHERE), np.ones(3)])


def looked_at(end: float, half: float) -> Behind:
    """A bar from the left border to x = `end` px, `half` px to either side of y = 40 px, blurred, before an unknown wall."""
    fine = 16
    cover = np.zeros((SIZE * fine, SIZE * fine), dtype=np.float32)
    low, high, last = (round((place + 0.5) * fine) for place in (LEFT - half, LEFT + half, end))
    cover[low:high, :last] = 1.0
    cover = cv2.GaussianBlur(cv2.resize(cover, (SIZE, SIZE), interpolation=cv2.INTER_AREA), (0, 0), 1.0)[..., None]
    picture = np.round(cover * BODY + (1.0 - cover) * WALL).astype(np.uint8)
    nothing = np.zeros(picture.shape, np.float32)
    return Behind(picture, nothing, np.zeros(picture.shape[:2], np.int32), nothing)


@pytest.mark.parametrize("more", [-0.4, -0.2, 0.0, 0.2, 0.4])
def test_the_edges_of_a_body_that_is_shaded_more_than_its_wall_are_its_edges(more):
    points = np.column_stack([np.linspace(10.0, 50.0, 9), np.full(9, LEFT)])
    normals = np.tile([0.0, 1.0], (9, 1))
    inside, flanks = np.tile(np.stack([BODY, SHADED]), (9, 1, 1)), np.tile(np.stack([BODY, SHADED]), (9, 2, 1, 1))
    outside = np.tile(np.stack([WALL, PLAIN]), (9, 2, 1, 1))
    edges = measure_edges(looked_at(70.0, HALF + more), points, normals, np.full(9, HALF), inside, flanks, outside, 8.0)
    assert np.isfinite(edges[:, :, 1]).all()
    assert np.abs(edges[:, :, 0] - more).max() < 0.1, "they were found to whole pixels"


@pytest.mark.parametrize("more", [-0.4, 0.0, 0.3])
def test_the_end_of_such_a_body_is_its_end(more):
    tip, tangent = np.array([50.0, LEFT]), np.array([1.0, 0.0])
    seen = looked_at(50.0 + more, HALF)
    end = measure_end(seen, tip, tangent, HALF, np.stack([BODY, SHADED]), np.stack([WALL, PLAIN]), NOTHING, 10.0)
    assert np.abs(end - more).max() < 0.1


def test_what_is_outside_of_a_picture_is_wall():
    """Colours that were never read there had been whatever lay in memory, and an end near the border another in every run."""
    tip, tangent = np.array([SIZE - 5.0, LEFT]), np.array([1.0, 0.0])
    seen = looked_at(SIZE - 5.0, HALF)
    found = [measure_end(seen, tip, tangent, HALF, np.stack([BODY, SHADED]), np.stack([WALL, PLAIN]), NOTHING, 10.0) for _ in range(20)]
    assert np.array_equal(found, [found[0]] * 20, equal_nan=True) and np.abs(found[0]).max() < 0.3


def test_rays_that_differ_know_an_end_by_so_much_less():
    level, aslant = np.full(RAYS, 1.0), np.linspace(-3.0, 3.0, RAYS)
    assert end_among(level, HALF) == (1.0, END_PLACED * HALF)
    beyond, stderr = end_among(aslant, HALF)
    assert beyond == 0.0 and stderr == pytest.approx(np.hypot(END_PLACED * HALF, 6.0 / RANGE))
    assert end_among(np.where(np.arange(RAYS) < 3, level, np.nan), HALF) == (0.0, END_NEAR * HALF), "three of seven are not most"
    assert end_among(level + HALF, HALF) == (0.0, END_NEAR * HALF), "it is another thing's"


@pytest.mark.parametrize("turned", [-0.2, 0.2])
def test_a_line_that_has_turned_at_its_straight_end_is_turned_back(turned):
    """Edges let it: the corners of its end lie as far to either side."""
    heading = turned * np.clip((SHARES - 0.8) / 0.2, 0.0, 1.0)
    steps = 60.0 / (STATIONS - 1) * np.column_stack([np.cos(heading), np.sin(heading)])
    points = np.array([0.0, LEFT]) + np.vstack([[0.0, 0.0], np.cumsum(steps[1:], axis=0)])
    around = np.tile(np.stack([WALL, PLAIN]), (STATIONS, 2, 1, 1))
    body = SeenBody(points, np.full(STATIONS, HALF), np.tile(np.stack([BODY, SHADED]), (STATIONS, 1, 1)), around)
    seen = looked_at(60.0, HALF)
    wall = Wall(seen.picture.shape, still=True)
    evidence = Evidence(seen.picture, wall, np.array([points[0], [1.0, 0.0]]), body.half, None, end_offsets=np.zeros(RAYS))
    matrix, vector = np.eye(UNKNOWNS) * 1e-3, np.zeros(UNKNOWNS)
    end = evidence.add_end(matrix, vector, body, 10.0)
    assert np.isfinite(end).all()
    turn = TURN_ROWS[-1] @ np.linalg.solve(matrix, vector)[NORMAL] / body.length
    assert turn == pytest.approx(-turned, abs=0.03)

    matrix, vector = np.eye(UNKNOWNS) * 1e-3, np.zeros(UNKNOWNS)
    round_end = HALF * (np.sqrt(1.0 - np.linspace(-0.6, 0.6, RAYS) ** 2) - 1.0)
    replace(evidence, end_offsets=round_end).add_end(matrix, vector, body, 10.0)
    assert not vector[NORMAL].any(), "a round end looks the same wherever the line turns to"
