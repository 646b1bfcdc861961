"""Bodies that show a face in the shade, or a layer of another colour, along one edge."""

import cv2
import numpy as np
import pytest

from tests.measurement.test_gone import HALF, RUBBER, WALL, follower_of, middle_of

SHADE, LAYER = (150, 160, 160), (60, 90, 190)


def two_faced(line: np.ndarray, share: float, colour: tuple[int, int, int], seed: int) -> np.ndarray:
    """A picture of a body of which a `share` of its width, along its right edge, has another colour."""
    picture = np.full((240, 240, 3), WALL, np.uint8)
    heading = np.gradient(line, axis=0)
    normal = HALF * np.column_stack([-heading[:, 1], heading[:, 0]]) / np.linalg.norm(heading, axis=1, keepdims=True)
    cv2.rectangle(picture, (150, 30), (200, 90), RUBBER, -1)
    for inner, shown in ((-1.0, colour), (2.0 * share - 1.0, RUBBER)):
        outline = np.vstack([line + normal, (line + inner * normal)[::-1]])
        cv2.fillPoly(picture, [np.round(16 * outline).astype(np.int32)], shown, cv2.LINE_AA, 4)
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("colour", [SHADE, LAYER], ids=["in the shade", "a layer"])
@pytest.mark.parametrize("seed", range(2))
def test_the_line_keeps_to_the_middle_of_a_body_with_two_faces(colour, seed):
    """The edge of a face that was neither its colour nor the wall's was not seen, and the line lay beside the middle, or was lost."""
    follower = follower_of(middle_of(0.0, 110.0))
    for k in range(16):
        line = middle_of(0.8 - 0.8 * np.cos(np.pi * k / 10), 110.0)
        assert follower.next(two_faced(line, 0.3, colour, seed), 0.1 * k) == "", k
        assert np.linalg.norm(follower.body.points[-1] - line[-1]) < 0.25 * HALF, k
        assert follower.first.fit is not None and follower.first.fit.unseen < 0.1


def test_a_body_that_is_alike_all_across_has_no_sides_of_its_own():
    line = middle_of(0.4, 110.0)
    follower = follower_of(line)
    assert follower.next(two_faced(line, 0.0, SHADE, 0), 0.0) == ""
    assert follower.body.sides is None
