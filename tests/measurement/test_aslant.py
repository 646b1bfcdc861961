"""Plates whose ends are not cut square to their line."""

import cv2
import numpy as np
import pytest

from tests.measurement.test_gone import HALF, RUBBER, WALL, follower_of, middle_of


def aslant(line: np.ndarray, shorter_px: float) -> np.ndarray:
    """A picture of a plate one side of which ends `shorter_px` before the other."""
    heading = np.gradient(line, axis=0)
    normal = np.column_stack([-heading[:, 1], heading[:, 0]]) / np.linalg.norm(heading, axis=1, keepdims=True)
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    shorter = line[: round(64 * (1.0 - shorter_px / length))] - HALF * normal[: round(64 * (1.0 - shorter_px / length))]
    picture = np.full((240, 240, 3), WALL, np.uint8)
    cv2.rectangle(picture, (150, 30), (200, 90), RUBBER, -1)
    cv2.fillPoly(picture, [np.round(16 * np.vstack([line + HALF * normal, shorter[::-1]])).astype(np.int32)], RUBBER, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


@pytest.mark.parametrize("seed", range(3))
def test_the_line_of_a_plate_that_is_cut_aslant_stays_where_its_first_outline_has_it(seed):
    """Its face was taken for its edge, and the line turned to the corner by ten pixels: what lies off the outline was forgotten."""
    follower, noise, off = follower_of(middle_of(0.3, 60.0)), np.random.default_rng(seed), []
    for k in range(30):
        line = middle_of(0.3 + 0.4 * np.sin(np.pi * k / 15), 60.0)
        picture = aslant(line, 10.0) + noise.normal(0, 2, (240, 240, 3))
        assert follower.next(np.clip(picture, 0, 255).astype(np.uint8), 0.1 * k) == "", k
        off.append(follower.body.points[-1] - line[-1])
    assert np.linalg.norm(np.array(off) - off[0], axis=1).max() < 0.75 * HALF
