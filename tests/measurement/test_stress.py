"""Scenes in which a tracker is tempted to answer wrongly: it is right, or it says why it does not answer."""

import cv2
import numpy as np

from rfea_vision.artefacts import Actuator
from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from testing.scenes import Look, bending, film, picture, shape
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
    assert coded.attrs["length_scatter_over_noise"] > 1.5 > clear.attrs["length_scatter_over_noise"] * 0.9
    for data in (clear, coded):
        z = (data["tip"].values - tips) / data["tip_sigma"].values
        assert np.nanmean(np.abs(z) < 1.96) > 0.85
    assert np.nanmedian(coded["tip_sigma"].values) > 1.5 * np.nanmedian(clear["tip_sigma"].values)


def test_the_part_of_the_error_that_all_frames_share_stands_apart(filmed):
    _, _, _, track = filmed
    attributes = track.dataset.attrs
    shared = np.array([attributes["origin_sigma_across_mm"], attributes["origin_sigma_along_mm"]])
    assert np.all(shared > 0)
    assert np.all(track.dataset["tip_sigma"].values >= 0.99 * shared)
