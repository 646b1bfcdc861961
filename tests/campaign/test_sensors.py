"""What the rows of a log tell of its sensor and its clock."""

from __future__ import annotations

import numpy as np

from rfea_vision.campaign.plausibility import of_times
from rfea_vision.campaign.sensors import of_mixed, of_pauses, of_standstill


def test_what_stands_still_by_right_is_not_taken_for_a_sensor_that_hangs():
    time_s = np.arange(0.0, 4.0, 0.002)
    steps_kPa = 50.0 * np.floor(time_s)  # what a valve was told, with ramps between
    ramped = np.where(time_s % 1 < 0.4, steps_kPa - 50.0 + 125.0 * (time_s % 1), steps_kPa)
    noisy = 40.0 * np.sin(time_s) + np.random.default_rng(0).normal(0.0, 0.3, time_s.size)
    assert of_standstill(steps_kPa) == of_standstill(ramped) == of_standstill(noisy) == []
    assert of_standstill(noisy.round(0)) == []  # noise of less than the last digit
    assert of_standstill(np.maximum(noisy, 0.0)) == []  # many sensors end at zero: nobody is misled
    hangs_at_rest = np.where(time_s > 3.0, 40.0 * np.sin(time_s[1560]) + 0.1, noisy)  # 40 sin(3.12): near zero, and not zero
    assert "for 499 rows" in of_standstill(hangs_at_rest)[0]
    assert of_standstill(np.minimum(noisy, 20.0)) and of_standstill(np.full(100, 3.0)) == []


def test_a_log_that_was_sorted_after_its_clock_had_been_set_back_is_doubted():
    ticks_s = 0.001 * np.arange(3000)
    set_back = np.sort(np.where(ticks_s < 1.8, ticks_s, ticks_s - 0.4002))
    (text,) = of_mixed(set_back)
    assert "from 1.399 to 1.799 s its rows come twice as densely as elsewhere; are two recordings mixed there" in text
    drifting = ticks_s + 2e-5 * np.random.default_rng(0).standard_normal(ticks_s.size)
    on_change = np.cumsum(np.random.default_rng(0).exponential(0.01, 3000))
    faster = np.concatenate([0.002 * np.arange(1500), 3.0 + 0.001 * np.arange(500)])  # of the rate that was set in between
    in_pairs = np.sort(np.concatenate([0.002 * np.arange(1500), 0.002 * np.arange(1500) + 0.0003]))  # as a bus delivers them
    for right_s in (ticks_s, drifting, on_change, faster, in_pairs):
        assert of_mixed(right_s) == []


def test_a_stretch_of_an_even_log_that_is_missing_is_doubted():
    whole = np.arange(0.0, 3.0, 0.002)
    (text,) = of_pauses(whole[(whole < 1.0) | (whole > 1.399)])
    assert text.startswith("has no row from 0.998 to 1.400 s, and a straight line stands in")
    (twice,) = of_times(whole[(whole < 1.0) | ((whole > 1.399) & (whole < 2.0)) | (whole > 2.2)], np.arange(0.0, 3.0, 0.02))
    assert "from 0.998 to 1.400 s and elsewhere" in twice
    on_change = np.cumsum(np.random.default_rng(0).exponential(0.02, 500) ** 2)
    busy = np.delete(whole, np.arange(500, 520))  # 40 ms in which a logger wrote to its disk
    assert of_pauses(whole) == of_pauses(on_change) == of_pauses(busy) == of_pauses(np.array([0.0])) == []


def test_a_plug_that_comes_loose_is_doubted_and_a_valve_that_opens_is_not():
    time_s = np.arange(0.0, 3.0, 0.002)
    steps = 60.0 * (np.sin(4 * time_s) > 0)
    noisy = steps + 100.0 + np.random.default_rng(0).normal(0.0, 0.3, time_s.size)
    (text,) = of_standstill(np.where((time_s > 1.0) & (time_s < 1.08), 0.0, noisy))
    assert "stands at exactly 0 kPa for 39 rows, from row 502 on" in text and "a plug come off?" in text
    assert of_standstill(np.where(steps > 0, noisy, 0.0)) == []  # a sensor that ends at zero, where the tube is emptied
