"""The length check: what the photos of the board cannot show, the tube's own length does."""

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.vision import track_frames
from testing.scenes import Look, bending, film
from testing.sources import memory_source


@pytest.fixture(scope="module")
def checked(calibrated, small_lens):
    """What the length check says of a film, by the side of a square that was written to the campaign."""
    photos, plane, _, _ = calibrated
    pictures, times, _ = film(small_lens, Look(), bending(np.arange(24) / 60))
    source = memory_source(pictures, times)

    def said_for(square_m):
        board = Board("checkerboard", (9, 6), square_m)
        calibration = calibrate(photos, plane, board, lens="brown5")
        return track_frames(source, calibration, Actuator()).dataset

    return said_for


def test_the_right_square_gives_the_tubes_length(checked):
    data = checked(0.012)
    assert data.attrs["hinge_length_mm"] == pytest.approx(155.0, rel=0.006)
    assert data.attrs["length_check"].startswith("the inextensible side keeps its length within 0.")
    assert "square" not in data.attrs["length_check"]


@pytest.mark.parametrize(("square_m", "off"), [(0.013, "+8."), (0.0114, "-5.")])
def test_a_wrong_square_shows_as_a_wrong_length(checked, square_m, off):
    data = checked(square_m)
    assert data["valid"].values.mean() > 0.9
    assert data.attrs["hinge_length_mm"] == pytest.approx(155.0 * square_m / 0.012, rel=0.006)
    said = data.attrs["length_check"]
    assert f"it measures {off}" in said
    assert said.endswith("% against actuator.length: check the board's square and the length")
