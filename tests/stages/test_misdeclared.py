"""What of a log's doubts is the reason why it cannot be used."""

import numpy as np

from rfea_vision.readers.pressure import PressureLog
from rfea_vision.stages.warnings import log_doubts, misdeclared


def test_a_stretch_that_stands_still_is_no_reason_why_clocks_are_not_found():
    """A warning of a flat end, beyond the film, was given as the error of `rfea sync`, and hid it."""
    time_s = np.arange(0, 12, 0.02)
    pressure_kPa = 60 * np.clip((time_s - 3) / 5, 0, 1) + np.random.default_rng(0).normal(0, 0.1, len(time_s))
    pressure_kPa[450:] = 55.5
    log, film_s = PressureLog(time_s, pressure_kPa), np.arange(0, 8, 1 / 30)
    assert "stands at exactly 55.5 kPa" in log_doubts(log, film_s)[0]
    assert misdeclared(log, film_s) == []
    in_ms = PressureLog(1e3 * time_s, pressure_kPa)
    assert "is the time of the log in ms?" in misdeclared(in_ms, film_s)[0]
