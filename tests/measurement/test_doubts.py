"""Pictures whose errors are not noise: measured right, claimed as uncertain, or refused with the reason."""

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.errors import DataError
from rfea_vision.vision import track_frames
from testing.scenes import Look, bending, film, smeared_film
from testing.sources import memory_source, true_calibration

DARK = {"tube": 40.0, "background": 200.0, "clamp": 120.0}
ANGLES = bending(np.arange(12) / 100 + 0.08)


def claimed(pictures, times, shapes, lens) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Error of the tip over its standard error (t, 2), the error in px (t,), and which frames count."""
    track = track_frames(memory_source(pictures, times), true_calibration(lens), Actuator())
    error = track.dataset["tip"].values - np.array([s.tip for s in shapes])
    z = error / track.dataset["tip_sigma"].values
    return z[track.valid], np.linalg.norm(error, axis=1)[track.valid] * track.dataset.attrs["px_per_mm"], track.valid


SCENES = {
    "a highlight as light as the wall": Look(**DARK, highlight=(0.75, 0.98, 200)),
    "a highlight beside the edge": Look(**DARK, highlight=(0.65, 0.9, 150)),
    "a soft highlight": Look(**DARK, highlight=(0.3, 0.7, 80)),
    "a band just below the clamp": Look(band_mm=(1.0, 3.0)),
    "a band just below a clamp that is not seen": Look(band_mm=(0.5, 2.0), clamp=None),
    "the hard shadow of a thing in front": Look(**DARK, shadow=0.5),
    "a wall brighter than the camera can tell": Look(tube=60, background=340, clamp=120),
    "a tube brighter than the camera can tell": Look(tube=330, background=110),
}


@pytest.mark.parametrize("name", SCENES)
def test_what_noise_does_not_explain_is_in_the_standard_error(name, small_lens):
    z, off_px, valid = claimed(*film(small_lens, SCENES[name], ANGLES, rate_Hz=100), small_lens)
    assert valid.all()
    assert off_px.max() < 3.0
    assert np.abs(z).max() < 4.0
    assert np.sqrt(np.mean(z**2)) < 2.2


def swinging(times: np.ndarray) -> np.ndarray:
    return 40 + 35 * np.sin(2 * np.pi * 1.5 * times)


@pytest.mark.parametrize("exposure_s", [1 / 120, 1 / 60, 1 / 40])
def test_a_shutter_open_while_the_tube_moves(exposure_s, small_lens):
    pictures, times, shapes = smeared_film(small_lens, Look(), swinging, np.arange(12) / 30, exposure_s, steps=7)
    z, off_px, valid = claimed(pictures, times, shapes, small_lens)
    assert valid.mean() > (0.9 if exposure_s <= 1 / 60 else 0.5)
    assert off_px.max() < (0.5 if exposure_s < 1 / 60 else 3.0)
    assert np.abs(z).max() < 3.5
    assert np.sqrt(np.mean(z**2)) < 1.6


@pytest.mark.usefixtures("unadvised")
def test_a_film_in_which_nothing_is_measured_has_no_lucky_frame(small_lens):
    def steadily(times: np.ndarray) -> np.ndarray:
        return 10 + 250 * times  # no turning point, where even a slow shutter sees it sharp

    pictures, times, _ = smeared_film(small_lens, Look(), steadily, np.arange(12) / 30, 1 / 15, steps=5)
    with pytest.raises(DataError, match="no tube found"):
        track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator())


def test_a_camera_that_was_bumped_is_no_motion_of_the_tube(small_lens):
    pictures, times, shapes = film(small_lens, Look(), bending(np.arange(40) / 100 + 0.3), rate_Hz=100)
    bumped = np.arange(20, 26)
    for number, by in zip(bumped, [1.5, -2.5, 2.0, -1.5, 1.2, -1.0], strict=True):
        turned = np.array([[1.0, 0.0, by], [0.0, 1.0, 0.4 * by]])
        pictures[number] = cv2.warpAffine(pictures[number], turned, small_lens.size, borderMode=cv2.BORDER_REPLICATE)
    z, off_px, valid = claimed(pictures, times, shapes, small_lens)
    assert valid.all()
    assert off_px[bumped].max() > 1.0 > off_px[:20].max()
    assert np.abs(z).max() < 4.0


@pytest.mark.usefixtures("unadvised")
@pytest.mark.parametrize("sleeve", [(12.0, 1.5), (8.0, 1.25)])
def test_a_sleeve_on_the_end_is_not_taken_for_the_tube(sleeve, small_lens):
    pictures, times, _ = film(small_lens, Look(ferrule=sleeve), ANGLES, rate_Hz=100)
    with pytest.raises(DataError, match=r"width_off|edge_lost"):
        track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator())


def test_an_even_picture_raises_no_doubts(filmed):
    data = filmed[3].dataset
    shared = np.hypot(data.attrs["origin_sigma_across_mm"], data.attrs["origin_sigma_along_mm"])
    noise = np.linalg.norm(data["tip_noise_sigma"].values, axis=1)
    assert np.median(np.linalg.norm(data["tip_sigma"].values, axis=1) / np.hypot(noise, shared)) < 1.15
