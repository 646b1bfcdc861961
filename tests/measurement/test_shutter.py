"""A rolling shutter: rows that are read one after the other, and `camera.line_delay` that says how fast."""

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.errors import InputError
from rfea_vision.vision import track_frames
from rfea_vision.vision.derive.shutter import Shutter
from testing.scenes import Look, picture, shape
from testing.sources import memory_source, true_calibration

RATE_HZ, READ = 60.0, 0.6  # of a frame, in which all rows are read
BANDS = 80  # each shows one instant: with fewer the edges have steps


def bend_deg(time_s: float) -> float:
    return 35.0 - 30.0 * np.cos(2 * np.pi * 2.5 * time_s)


@pytest.fixture(scope="module")
def rolling(small_lens):
    """A film whose rows are read from the top down, its times, and its line delay; a frame's time is that of its middle row."""
    height = small_lens.size[1]
    delay = READ / RATE_HZ / height
    rng = np.random.default_rng(5)
    times = np.arange(11) / RATE_HZ
    pictures = []
    for time in times:
        rows = np.array_split(np.arange(height), BANDS)
        bands = [
            picture(shape(bend_deg(time + delay * (part.mean() - (height - 1) / 2))), small_lens, Look(), rng)[part]
            for part in rows
        ]
        pictures.append(np.vstack(bands))
    return pictures, times, delay


def test_a_line_delay_brings_every_row_to_the_time_of_its_frame(rolling, small_lens):
    pictures, times, delay = rolling
    truth = [shape(bend_deg(time)) for time in times]
    tips = np.array([one.tip for one in truth])
    swing = float(np.linalg.norm(np.diff(tips, axis=0), axis=1).max())
    errors = {}
    for given in (None, delay, -delay):
        source = memory_source(pictures, times)
        data = track_frames(source, true_calibration(small_lens), Actuator(), line_delay_s=given).dataset
        assert data["valid"].values.all()
        errors[given] = np.linalg.norm(data["tip"].values - tips, axis=1)[1:-1].max()
    assert swing > 5.0  # mm from frame to frame
    assert errors[None] > 1.0 and errors[-delay] > 2.0
    assert errors[delay] < 0.1  # with all rows at once 0.05, and in one frame 0.25


@pytest.mark.parametrize(("turns", "row"), [(0, 20.0), (1, 10.0), (2, 79.0), (3, 39.0)])
def test_rows_are_those_of_the_file_whichever_way_a_film_is_held(turns, row):
    shutter = Shutter(1e-5, (10.0, 20.0), turns, (50, 100))
    assert shutter.rows(np.array([10.0, 20.0])) == row
    stored = np.arange(100 * 50).reshape((50, 100) if turns % 2 else (100, 50))
    assert np.rot90(stored, turns)[20, 10] // stored.shape[1] == row
    assert shutter.late_s(np.array([10.0, 20.0])) == 0.0


def test_a_line_delay_that_is_longer_than_a_frame_is_refused(rolling, small_lens):
    pictures, times, delay = rolling
    with pytest.raises(InputError, match=r"camera\.line_delay: \d+ rows take .* ms at .* us each, and the frames of memory"):
        track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator(), line_delay_s=3 * delay)
