"""Of a picture that is enlarged, or turned back, only what is looked at is worked out."""

import cv2
import numpy as np
import pytest

from rfea_vision.vision.body.shown import Shown


@pytest.mark.parametrize("enlarged", [0.5, 0.6875, 1.0, 1.375, 2.0, 2.625, 4.0])
@pytest.mark.parametrize("moved", [np.eye(2, 3), np.array([[0.999, -0.02, 3.3], [0.02, 0.999, -1.7]])])
def test_a_window_is_what_all_of_the_picture_has_there(enlarged, moved):
    rng = np.random.default_rng(0)
    picture = cv2.GaussianBlur(rng.uniform(0, 255, (121, 143, 3)), (0, 0), 2.0).astype(np.uint8)
    shown = Shown(picture, enlarged, moved)
    whole = shown.colours(shown.whole)
    assert whole.shape == shown.shape
    for top, bottom, left, right in ((0, 30, 0, 30), (11, 47, 7, 60), (25, shown.shape[0], 33, shown.shape[1])):
        window = slice(top, bottom), slice(left, right)
        np.testing.assert_allclose(shown.colours(window), whole[window], atol=2)


def test_places_are_where_they_were():
    """A place keeps its place: (x + 1/2) times the scale, less 1/2; and where the camera has gone on it is where it was before."""
    picture = np.zeros((60, 90, 3), np.uint8)
    cv2.circle(picture, (40, 30), 5, (200, 200, 200), -1)
    for enlarged, moved in ((2.375, np.eye(2, 3)), (1.5, np.array([[1.0, 0.0, 6.0], [0.0, 1.0, -4.0]]))):
        shown = Shown(picture, enlarged, moved)
        seen = shown.colours((slice(10, shown.shape[0]), slice(20, shown.shape[1])))[..., 0].astype(float)
        middle = np.array([np.sum(np.arange(n) * seen.sum(axis=a)) / seen.sum() for n, a in zip(seen.shape[::-1], (0, 1), strict=True)])
        np.testing.assert_allclose(middle, (np.array([40.0, 30.0]) - moved[:, 2] + 0.5) * enlarged - [20.5, 10.5], atol=0.1)
