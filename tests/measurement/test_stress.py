"""Scenes in which a tracker is tempted to answer wrongly: it is right, or it says why it does not answer."""

import cv2
import numpy as np

from rfea_vision.artefacts import Actuator
from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from rfea_vision.vision.derive.smooth import best_tau, inflation_of
from testing.scenes import Lens, Look, bending, film, picture, shape
from testing.sources import memory_source, true_calibration, write_grey_film


def tracked(pictures, times, lens):
    return track_frames(memory_source(pictures, times), true_calibration(lens), Actuator())


def off(track, shapes) -> np.ndarray:
    """Distance in mm of the tip from where it is, valid frames only."""
    error = track.dataset["tip"].values - np.array([s.tip for s in shapes])
    return np.linalg.norm(error, axis=1)[track.valid]


def test_a_swing_of_seventy_degrees_between_two_frames_is_followed(small_lens):
    angles = [2, 2, 2, 2, 2, 2, 60, 10, 75, 75, 20, 90, 30]
    pictures, times, shapes = film(small_lens, Look(), angles, rate_Hz=30)
    track = tracked(pictures, times, small_lens)
    assert track.valid.all(), set(track.dataset["reason"].values)
    assert off(track, shapes).max() < 0.15


def test_light_that_halves_and_doubles_is_followed(small_lens):
    rng = np.random.default_rng(2)
    shapes = [shape(a) for a in bending(np.arange(24) / 120)]
    gains = 1 + 0.5 * np.sin(2 * np.pi * 100 * np.arange(24) / 120 + 0.3)
    pictures = [picture(s, small_lens, Look(tube=150), rng, g) for s, g in zip(shapes, gains, strict=True)]
    track = tracked(pictures, np.arange(24) / 120, small_lens)
    assert track.valid.all(), set(track.dataset["reason"].values)
    assert off(track, shapes).max() < 0.1


def test_painted_bands_are_not_taken_for_the_ends(small_lens):
    for bands in (9, 16):
        pictures, times, shapes = film(small_lens, Look(bands=bands), [2.0, 3.0, 6.0, 10.0, 15.0], rate_Hz=60)
        track = tracked(pictures, times, small_lens)
        assert track.valid.all()
        assert off(track, shapes).max() < 0.1
        assert abs(track.dataset["hinge_length"].values.mean() - 155.0) < 0.1


def test_a_hand_in_front_is_said_and_the_tube_found_again(small_lens):
    pictures, times, shapes = film(small_lens, Look(), bending(np.arange(48) / 120), rate_Hz=120)
    width, height = small_lens.size
    hidden = np.arange(18, 36)
    for number in hidden:
        reach = np.sin(np.pi * (number - 17) / 19)
        centre = (int(width * (-0.4 + 0.75 * reach)), int(height * 0.4))
        cv2.ellipse(pictures[number], centre, (int(0.4 * width), int(0.2 * height)), 20, 0, 360, 150, -1)
    track = tracked(pictures, times, small_lens)
    assert track.valid[np.delete(np.arange(48), hidden)].all()
    assert not track.valid[24:30].any()
    assert set(track.dataset["reason"].values[~track.valid]) <= {
        "occluded",
        "edge_lost",
        "tip_hidden",
        "no_tube",
        "no_fit",
    }
    assert off(track, shapes).max() < 0.15


def test_a_tube_that_curls_up_keeps_its_base_and_tip(small_lens):
    shapes = [shape(a) for a in np.linspace(100, 230, 40)]
    rng = np.random.default_rng(1)
    look = Look(clamp_width_mm=12.0)
    pictures = [picture(s, small_lens, look, rng) for s in shapes]
    track = tracked(pictures, np.arange(40) / 120, small_lens)
    assert track.valid.all(), set(track.dataset["reason"].values)
    assert off(track, shapes).max() < 0.15
    np.testing.assert_allclose(track.dataset["bend_angle"].values, np.linspace(100, 230, 40), atol=2)


def test_intervals_widen_for_a_strongly_compressed_video(small_lens, tmp_path):
    """Of one film; of forty, all of whose frames share an error, `benchmarks/compression.py` counts it."""
    times = np.arange(48) / 120
    pictures, _, shapes = film(small_lens, Look(noise=4), bending(times), rate_Hz=120)
    write_grey_film(tmp_path / "v.mp4", pictures, 120, 26)
    clear = tracked(pictures, times, small_lens).dataset
    coded = track_frames(open_video(tmp_path / "v.mp4"), true_calibration(small_lens), Actuator()).dataset
    tips = np.array([s.tip for s in shapes])
    assert coded.attrs["edge_correlation_inflation"] > 3.0 > 2.0 > clear.attrs["edge_correlation_inflation"]
    for data in (clear, coded):
        z = (data["tip"].values - tips) / data["tip_sigma"].values
        assert np.nanmean(np.abs(z) < 1.96) > 0.85
    assert np.nanmedian(coded["tip_sigma"].values) > 1.5 * np.nanmedian(clear["tip_sigma"].values)


def test_the_corners_of_a_blurred_end_do_not_move_it():
    """A slanting end that is blurred by a quarter of the half width lay 0.11 mm too far out, for its corners are blurred, too."""
    lens, angle = Lens(), 20.0
    pictures, times, shapes = film(lens, Look(noise=1.0, blur_px=4.0), np.full(6, angle))
    data = tracked(pictures, times, lens).dataset
    outward = np.array([-np.sin(shapes[0].phi[-1]), -np.cos(shapes[0].phi[-1])])
    assert abs(float(np.mean((data["tip"].values - shapes[0].tip) @ outward))) < 0.06


def test_noise_is_told_from_a_tubes_own_wiggles():
    """Of curves whose slow wiggles are a tube's, under noise that is inflated by a known factor, both are found."""
    rng = np.random.default_rng(3)
    variances = 1e-4 * np.geomspace(0.1, 60.0, 11)
    for inflation, tau_mm in ((1.0, 0.01), (6.0, 0.02), (30.0, 0.05)):
        wiggles = rng.normal(0.0, np.sqrt(inflation * variances + tau_mm**2), (100, 11))
        wiggles[:, 0] += 3.0  # a bend that does not change evenly along the tube
        np.testing.assert_allclose(inflation_of(wiggles, variances), inflation, rtol=0.3)
        np.testing.assert_allclose(best_tau(wiggles[:, 1:], inflation * variances[1:]), tau_mm, rtol=0.5)


def test_the_part_of_the_error_that_all_frames_share_stands_apart(filmed):
    _, _, _, track = filmed
    attributes = track.dataset.attrs
    shared = np.array([attributes["origin_sigma_across_mm"], attributes["origin_sigma_along_mm"]])
    assert np.all(shared > 0)
    assert np.all(track.dataset["tip_sigma"].values >= 0.99 * shared)
