"""The plane from one photo, with a lens that is known, is that of the whole calibration."""

import numpy as np
import pytest

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.calibration.placing import place_in_plane
from rfea_vision.calibration.projection import pixels_to_plane_mm
from rfea_vision.calibration.region import place_covariance_mm2


@pytest.fixture(scope="module")
def photos(shared_data):
    folder = shared_data / "boards-640x480"
    return [folder / f"left{number:02d}.jpg" for number in (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12)], folder / "left13.jpg"


def test_a_known_lens_and_one_photo_give_the_plane(photos):
    board = Board("checkerboard", (9, 6), 0.025)
    whole = calibrate(photos[0], photos[1], board)
    lens_only = calibrate(photos[0], None, board)
    placed = place_in_plane(lens_only, photos[1], board, board_offset_mm=0.0)
    pixels = np.array([[250.0, 150.0], [400.0, 300.0]])
    distance_whole = np.linalg.norm(np.diff(pixels_to_plane_mm(whole, pixels), axis=0))
    distance_placed = np.linalg.norm(np.diff(pixels_to_plane_mm(placed, pixels), axis=0))
    first, second = pixels_to_plane_mm(placed, pixels)
    sigma_mm = np.sqrt(np.trace(place_covariance_mm2(placed, second[None], first)[0]))
    assert 0.001 < sigma_mm < 2.0
    assert distance_placed == pytest.approx(distance_whole, abs=3 * sigma_mm)
    assert placed.plane_tilt_deg == pytest.approx(whole.plane_tilt_deg, abs=1.0)


def test_the_board_lies_in_front_of_the_axis(photos):
    board = Board("checkerboard", (9, 6), 0.025)
    lens = calibrate(photos[0], None, board)
    on, behind = (place_in_plane(lens, photos[1], board, board_offset_mm=offset) for offset in (0.0, 5.0))
    away = behind.plane_translation_mm - on.plane_translation_mm
    assert np.linalg.norm(away) == pytest.approx(5.0)
    assert away[2] > 0  # the axis is farther from the camera than the printed face
