"""A body that was hidden while it moved on, and bodies that are small in the picture."""

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.readers.pictures import scaled
from rfea_vision.vision.body.begin import scale_for
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.scene import make_scene

SIZE = (260, 240)


def scene_of(half_px, size=SIZE):
    calibration = scaled_by_distance(size, [[0, 0], [100, 0]], 50.0)
    actuator = Actuator(outer_radius=half_px / 2e3, inner_radius=half_px / 4e3, length=0.085)
    clamp = (130.0 - half_px, 30.0), (130.0 + half_px, 30.0)
    return make_scene(calibration, actuator, "image", Hints(clamp=clamp, tip=(130.0, 200.0)), size)


def test_what_was_covered_while_it_bent_on_is_found_where_it_has_gone():
    """For 13 frames a sleeve covers near half of an arm whose end goes 8 px per frame: no frame is accepted, and it is found."""
    follower = BodyFollower(scene_of(10.0), 1.0)
    share = np.linspace(0, 1, 80)
    wall = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 14, (240, 260, 3)), (0, 0), 2.0)
    reasons, off = [], []
    for frame in range(24):
        bend = 0.09 * frame * share
        line = np.array([130.0, 30.0]) + np.column_stack([np.cumsum(np.sin(bend)), np.cumsum(np.cos(bend))]) * 170 / 80
        picture = np.clip(215 + 2 * wall, 0, 255).astype(np.uint8)
        drawn = np.round(line * 16).astype(np.int32)
        cv2.polylines(picture, [drawn], False, (60, 160, 90), 19, cv2.LINE_AA, 4)
        if 4 <= frame < 17:
            cv2.polylines(picture, [drawn[24:60]], False, (200, 60, 60), 25, cv2.LINE_AA, 4)
        reasons.append(follower.next(picture, float(frame)))
        off.append(float(np.linalg.norm(follower.body.points[-1] - line[-1])))
    good = np.array([not reason for reason in reasons])
    np.testing.assert_array_equal(good, [*[True] * 4, *[False] * 13, *[True] * 7])
    assert max(np.array(off)[good]) < 6.0  # px: of the arm's 19


@pytest.mark.parametrize(
    ("half_px", "size", "scale"),
    [
        (24.0, SIZE, 0.5),
        (12.0, SIZE, 1.0),
        (5.0, SIZE, 2.375),
        (1.5, SIZE, 4.0),
        (5.0, (1920, 1080), 1.0),
        (24.0, (1920, 1080), 0.5),
    ],
)
def test_windows_of_the_fit_suit_a_body_of_any_size(half_px, size, scale):
    """Pictures are scaled until the body is 24 px wide, in eighths up to four times, and no larger than a film of two megapixels."""
    assert scale_for(scene_of(half_px, size), size) == pytest.approx(scale)


def test_a_picture_is_enlarged_about_its_corners():
    """A place keeps its place: (x + 1/2) times the scale, less 1/2."""
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[8, 12] = 200
    large = scaled(picture, 4.0)[:, :, 0].astype(float)
    assert large.shape == (80, 120)
    middle = np.array([np.sum(np.arange(n) * large.sum(axis=a)) / large.sum() for n, a in ((120, 0), (80, 1))])
    np.testing.assert_allclose(middle, [49.5, 33.5], atol=0.2)
