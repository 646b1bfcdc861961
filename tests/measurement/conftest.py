"""Shared, costly things: a small calibrated scene and one tracked film of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.vision import track_frames
from testing.scenes import Lens, Look, bending, board_pictures, film, plane_picture
from testing.sources import memory_source, true_calibration

SMALL = 0.5


@pytest.fixture(scope="session")
def small_lens() -> Lens:
    return Lens().scaled(SMALL)


@pytest.fixture
def unadvised(monkeypatch) -> None:
    """Hints for a film that is refused are not tried: that takes longer than the film, and has tests of its own."""
    monkeypatch.setattr("rfea_vision.vision.track.next_hint", lambda *_, **__: "no hint is tried")
    monkeypatch.setattr("rfea_vision.vision.track.clicked_aside", lambda *_: "")


@pytest.fixture(scope="session")
def calibrated(tmp_path_factory, small_lens):
    """Photos on disk and the calibration made from them."""
    folder = tmp_path_factory.mktemp("photos")
    photos = []
    for k, picture in enumerate(board_pictures(small_lens, 10, seed=4)):
        photos.append(folder / f"board_{k:02d}.png")
        cv2.imwrite(str(photos[-1]), picture)
    plane = folder / "plane.png"
    cv2.imwrite(str(plane), plane_picture(small_lens))
    board = Board("checkerboard", (9, 6), 0.012)
    return photos, plane, board, calibrate(photos, plane, board)


@pytest.fixture(scope="session")
def filmed(small_lens):
    """A quick bend, its true shapes, and its track with the true camera."""
    times = np.arange(72) / 240
    pictures, times, shapes = film(small_lens, Look(), bending(times))
    track = track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator())
    return pictures, times, shapes, track
