"""Films that do not begin, look or move as most do: what is measured is right, and what is not is called what it is."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.vision import track_frames
from rfea_vision.vision.edges import fitted
from rfea_vision.vision.edges.edgels import SIDE, U
from rfea_vision.vision.edges.sides import gaps
from rfea_vision.vision.follow.bump import CameraWatch
from rfea_vision.vision.follow.judge import RULES, Tube
from testing.scenes import Lens, Look, bending, film, smeared_film
from testing.sources import memory_source, true_calibration

LIGHT = Look()
DARK = Look(tube=40.0, background=200.0, clamp=120.0)


def tracked(pictures, times, lens):
    return track_frames(memory_source(pictures, times), true_calibration(lens), Actuator())


def error_px(track, shapes) -> np.ndarray:
    error = track.dataset["tip"].values - np.array([s.tip for s in shapes])
    return np.linalg.norm(error, axis=1) * track.dataset.attrs["px_per_mm"]


@pytest.mark.parametrize("look", [LIGHT, DARK])
def test_a_tube_that_enters_late(look, small_lens):
    """Seven empty pictures; what is taken for a tube in them does not bind the rest of the film."""
    pictures, _, shapes = film(small_lens, look, bending(np.arange(12) / 100))
    empty, _, _ = film(small_lens, replace(look, tube=look.background), np.full(7, 2.0), seed=3)
    track = tracked([*empty, *pictures], np.arange(19) / 100, small_lens)
    assert track.valid.tolist() == [False] * 7 + [True] * 12
    assert np.all(track.dataset["reason"].values[:7] == "no_tube")
    assert error_px(track, [shapes[0]] * 7 + shapes)[7:].max() < 0.3


def test_a_tube_with_bands_all_along_it(small_lens):
    pictures, times, shapes = film(small_lens, Look(bands=30), bending(np.arange(12) / 100 + 0.1))
    track = tracked(pictures, times, small_lens)
    assert track.valid.all()
    assert error_px(track, shapes).max() < 0.8


@pytest.mark.parametrize("swing_deg", [12.0, 25.0])
def test_a_start_faster_than_predicted_loses_no_frame(swing_deg, small_lens):
    angles = np.concatenate([np.full(5, 2.0), 2.0 + swing_deg * np.arange(1, 4), np.full(4, 2.0 + 3 * swing_deg)])
    pictures, times, shapes = film(small_lens, replace(LIGHT, flicker=0.2), angles, rate_Hz=120)
    track = tracked(pictures, times, small_lens)
    assert track.valid.all()
    assert error_px(track, shapes).max() < 0.6


def test_frames_that_a_slow_shutter_smears_are_called_blurred(small_lens):
    def thrown(times):
        return 2.0 + 900.0 * np.clip(times - 0.1, 0.0, 0.06)

    pictures, times, _ = smeared_film(small_lens, LIGHT, thrown, np.arange(24) / 100, 0.009, steps=9)
    track = tracked(pictures, times, small_lens)
    assert set(track.dataset["reason"].values[~track.valid]) <= {"blurred"}
    assert track.valid.sum() >= 18


def test_a_ferrule_of_another_grey_belongs_to_the_tube(small_lens):
    """As wide as the tube: that the light changes is no end while what follows still stands out from the wall."""
    shade = replace(LIGHT, band_mm=(149.0, 155.0))
    pictures, times, shapes = film(small_lens, shade, np.linspace(2.0, 12.0, 10))
    track = tracked(pictures, times, small_lens)
    assert track.valid.all()
    error = track.dataset["tip"].values - np.array([s.tip for s in shapes])
    assert np.abs(error).max() < 1.0  # mm; the ferrule is 6 mm long
    assert np.abs(error / track.dataset["tip_sigma"].values).max() < 4.0


@pytest.mark.study
def test_a_camera_that_is_bumped_and_stays_moved(small_lens):
    angles = 2.0 + 30.0 * np.sin(np.arange(56) / 12) ** 2
    pictures, times, shapes = film(small_lens, LIGHT, angles, rate_Hz=100)
    by = np.array([[1.0, 0.0, 4.0], [0.0, 1.0, -3.0]])
    for number in range(36, 56):
        pictures[number] = cv2.warpAffine(pictures[number], by, small_lens.size, borderMode=cv2.BORDER_REPLICATE)
    track = tracked(pictures, times, small_lens)
    off = error_px(track, shapes)
    assert np.nanmax(off[:36]) < 0.3
    assert np.nanmax(off[42:]) < 0.3  # until it is sure, it says that it is not
    z = (track.dataset["tip"].values - np.array([s.tip for s in shapes])) / track.dataset["tip_sigma"].values
    assert np.nanmax(np.abs(z)) < 4.0


def test_a_clamp_is_elsewhere_only_where_it_is_seen_there_again():
    watch = CameraWatch(np.zeros((30, 2)), 2.5)
    place = np.array([0.5, 0.3])
    assert not watch.due(np.zeros(2), np.array([0.0, -1.0]), 33)
    assert watch.due(place, np.array([0.0, -1.0]), 33)  # across the tube
    assert [watch.see(p) for p in (place, None, place, place)] == [False] * 4
    assert watch.see(place)
    np.testing.assert_allclose(watch.moved_mm, place)
    assert not watch.see(np.array([40.0, 0.0]))  # a hand
    assert watch.due(place, np.array([0.0, -1.0]), 33)  # while the new place is being averaged


@pytest.mark.parametrize("scale", [0.5, 1.0])
def test_a_round_end_is_no_sleeve(scale):
    """The edges turn inwards before the end; its shape is known from the first frame on."""
    lens = Lens().scaled(scale)
    pictures, times, shapes = film(lens, replace(LIGHT, round_end=True), np.linspace(2.0, 30.0, 6))
    track = tracked(pictures, times, lens)
    assert track.valid.all()
    tips = np.array([s.tip + s.radius_mm * np.array([-np.sin(s.phi[-1]), -np.cos(s.phi[-1])]) for s in shapes])
    error = track.dataset["tip"].values - tips
    assert np.linalg.norm(error, axis=1).max() < 0.1  # mm
    assert np.abs(error / track.dataset["tip_sigma"].values).max() < 4.0


@pytest.mark.parametrize(("right_from", "refused"), [(0.72, True), (0.83, False), (2.0, False)])
def test_one_edge_beside_what_hides_the_tube_does_not_count(right_from, refused):
    """The left edge is not seen from 0.55 to 0.86 of the length, the right one from `right_from` on."""
    work, numbers = fitted.new_buffers(), np.zeros(1, dtype=fitted.FRAME)
    u = np.tile((np.arange(640) + 0.5) / 640, 2)
    side = np.repeat([1.0, -1.0], 640)
    work.stations[:1280, U], work.stations[:1280, SIDE] = u, side
    work.keep[:1280] = (u < np.where(side > 0, 0.55, right_from)) | (u > 0.86)
    gaps(work, 1280, numbers[0], 1.0)
    (unseen,) = (rule for rule in RULES if "unseen on both sides" in rule.limit)
    tube = Tube(half_px=10.0, half_mm=4.0, picture_px=(720, 1280), well_seen=True)
    assert unseen.broken(fitted.FrameFit(*numbers[0]), tube) == refused
