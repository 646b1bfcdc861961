"""What saves time in a frame: the tabulated edge, and where the tube is expected. Both against slower ways."""

import numpy as np
import pytest
from scipy.special import ndtr

from rfea_vision.vision.curve import COEFFICIENTS, fit_curve
from rfea_vision.vision.edges.edgels import Expected, Line, _blur_row, cross_edge
from rfea_vision.vision.edges.step import BLUR_PX, steps
from rfea_vision.vision.follow.motion import CurvePredictor


def seen(x: np.ndarray, blur: float) -> np.ndarray:
    """Share of the light step in pixels at `x`: the mean of the blurred edge over each, by brute force."""
    inside = x[:, None] + (np.arange(400) + 0.5) / 400 - 0.5
    return ndtr(-inside / blur).mean(axis=1)


@pytest.mark.parametrize("along_row", [True, False])
@pytest.mark.parametrize("outward", [1, -1])
@pytest.mark.parametrize("blur", [0.4, 0.8, 2.3])
def test_an_edge_off_its_expected_place_is_put_right_in_one_step(blur, outward, along_row):
    table, rng = steps(), np.random.default_rng(2)
    row = _blur_row(table.blurs, blur, 0)
    assert abs(table.blurs[row, BLUR_PX] / blur - 1) < 0.016
    for _ in range(20):
        place, off = rng.uniform(28, 32), rng.uniform(-0.35, 0.35)
        line = 60.0 + 120.0 * seen(outward * (np.arange(60.0) - place), blur)
        picture = np.tile(line, (3, 1)) if along_row else np.tile(line, (3, 1)).T
        sums, pixels = np.zeros((1, 6)), picture.reshape(-1)
        edge = Expected(place - off * outward, outward, blur, row, 180.0, 60.0, 50.0)
        crossed = Line(pixels, 60, 1, 60) if along_row else Line(pixels, 1, 3, 60)
        shift, info, misfit, lighter = cross_edge(crossed, edge, table, sums, 0)
        assert abs(shift - off) < (0.02 if blur < 0.5 else 0.004)
        slope = 120.0 * np.diff(ndtr((np.arange(61.0) - 0.5 - place + off * outward) / blur))
        assert abs(info / np.sum(slope**2) - 1) < 0.1  # to the nearest tabulated place and blur
        assert misfit < 30.0 and abs(lighter) < 0.6
        assert np.allclose(sums[0, [0, 2]] / sums[0, [1, 3]], [180.0, 60.0], atol=0.6)


def test_pixels_that_are_not_there_are_not_read():
    table, picture = steps(), np.full((4, 20), 90, np.uint8)
    row = _blur_row(table.blurs, 0.8, 0)
    for place in (3.0, 17.0):
        edge = Expected(place, 1, 0.8, row, 180.0, 60.0, 50.0)
        answer = cross_edge(Line(picture.reshape(-1), 20, 1, 20), edge, table, np.zeros((1, 6)), 0)
        assert answer[1] < 0


def swung(angle: float) -> np.ndarray:
    """Coefficients of an arc of 155 mm that turns by `angle`."""
    phi = angle * np.linspace(0, 1, 400)
    steps_mm = 155 / 399 * np.column_stack([np.sin(phi), -np.cos(phi)])
    return fit_curve(np.vstack([[0, 0], np.cumsum(steps_mm, axis=0)]))


def foretold(angles, dt=1 / 240, noise=0.0):
    """Largest distance in mm of the predicted from the true coefficients, over the second half."""
    motion, rng, off = CurvePredictor(), np.random.default_rng(0), []
    out = np.empty((COEFFICIENTS, 2))
    motion.begin(swung(angles[0]))
    for n, angle in enumerate(angles):
        true = swung(angle)
        if motion.past:
            motion.predict(n * dt, out)
            off.append(np.abs(out - true)[1:-1].max())
        motion.follow(true + rng.normal(0, noise, true.shape), n * dt)
    return max(off[len(off) // 2 :])


def test_a_swing_is_predicted_better_than_by_going_on_evenly():
    angles = 0.8 + 0.6 * np.sin(2 * np.pi * 3 * np.arange(60) / 240)
    even = max(np.abs(2 * swung(b) - swung(a) - swung(c)).max() for a, b, c in zip(angles, angles[1:], angles[2:]))  # noqa: B905
    assert foretold(angles) < 0.3 * even


def test_noise_of_a_tube_at_rest_does_not_grow():
    assert foretold(np.full(400, 0.5), noise=0.02) < 0.1


def test_a_clamp_that_is_hardly_seen_does_not_run_away():
    motion, rng = CurvePredictor(), np.random.default_rng(1)
    base = swung(0.3)
    motion.begin(base)
    state = base.copy()
    for n in range(300):  # nothing ever corrects the first coefficient; all others are seen
        if motion.past:
            motion.predict(n / 240, state)
        state[1:] = base[1:] + rng.normal(0, 0.02, base[1:].shape)
        state[0] += rng.normal(0, 0.005, 2)
        motion.follow(state, n / 240)
    assert np.abs(state[0] - base[0]).max() < 1.0
