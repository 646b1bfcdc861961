"""Light that changes all over the picture is taken back before a body is followed in it."""

import numpy as np
import pytest

from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.light import levelled
from tests.measurement.test_clicks import drawn, pointed_at


def film_of(gains):
    for k, gain in enumerate(gains):
        yield k / 30.0, np.clip(gain * drawn(body=170, number=k).astype(float), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gains", [[1.0, 1.0, 0.6, 0.6, 1.3, 1.0], [1.0 - 0.03 * k for k in range(12)]])
def test_light_that_steps_or_drifts_far_is_that_of_the_first_picture(gains):
    light = [float(np.median(picture)) for _, picture in levelled(film_of(gains))]
    assert np.abs(np.array(light) / light[0] - 1.0).max() < 0.13, "what is less than a step is left"
    assert abs(light[-1] / light[0] - 1.0) < max(0.03, 0.13 * (gains[-1] != 1.0))


def test_pictures_of_even_light_are_left_as_they_are():
    gains = [1.0 + 0.04 * np.sin(k) for k in range(8)]
    assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(levelled(film_of(gains)), film_of(gains), strict=True))


def test_a_hand_before_the_camera_is_no_light():
    pictures = [drawn(number=k) for k in range(4)]
    for picture in pictures[1:3]:
        picture[:180] = (135, 160, 205)
    shown = levelled(iter_of(pictures))
    assert all(np.array_equal(seen, picture) for (_, seen), picture in zip(shown, pictures, strict=True))


def iter_of(pictures):
    yield from ((k / 30.0, picture) for k, picture in enumerate(pictures))


def test_a_body_is_followed_through_a_step_of_the_light():
    """By 40 %: it was lost from there on."""
    gains = [1.0] * 3 + [0.6] * 3
    for pictures, lost in ((film_of(gains), True), (levelled(film_of(gains)), False)):
        follower = BodyFollower(pointed_at(), 1.0)
        said = [follower.next(picture, time_s) for time_s, picture in pictures]
        assert said[:3] == [""] * 3 and any(said[3:]) == lost, said
