"""Clocks of a run whose pressure changes so slowly that the bend alone tells them."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import Track
from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.pressure import PressureLog
from rfea_vision.sync import motion, synchronise

LOG_S = np.arange(0, 14, 0.02)
RAMP = ([0, 3.0, 7.0, 14], [0, 0, 90, 90])
CURVED = ([0, 3.2, 4, 5, 6.5, 8, 14], [0, 0, 25, 45, 65, 80, 80])
TRIANGLE = ([0, 3.0, 5.5, 6.0, 8.5, 14], [0, 0, 80, 80, 20, 20])
LONG = ([0, 0.5, 13.5, 14], [0, 0, 90, 90])


def film(shape, offset_s, *, seed=0, lag_s=0.03, seconds=8.0):
    """A tube that follows a pressure after a short lag, stiffer as it bends, its angle read 30 times a second with lasting noise."""
    rng = np.random.default_rng(seed)
    camera = np.arange(0, seconds, 1 / 30)
    pressure = np.interp(camera + offset_s - lag_s, *shape)
    noise = np.convolve(rng.normal(0, 0.3, len(camera) + 4), np.ones(5) / np.sqrt(5), "valid")
    angle = 0.7 * pressure - 0.001 * pressure**2 + noise
    ones = np.ones(len(camera), np.int8)
    variables = {"bend_angle": ("time", angle), "valid": ("time", ones), "reason": ("time", np.full(len(camera), ""))}
    return Track(xr.Dataset(variables, coords={"time": camera}))


def log(shape, *, seed=0, noise_kPa=0.3):
    return PressureLog(LOG_S, np.interp(LOG_S, *shape) + np.random.default_rng(seed).normal(0, noise_kPa, len(LOG_S)))


def sync(track, logged):
    return synchronise(track, logged, experiment="a", role="train", bends="left").dataset.attrs


@pytest.mark.parametrize("shape", [RAMP, CURVED, TRIANGLE], ids=["ramp", "curved", "triangle"])
def test_a_slow_pressure_that_the_bend_explains_is_aligned_and_its_error_is_honest(shape):
    """It was said that the motion explains a tenth of the pressure at any offset: the rest was noise within the band."""
    errors = []
    for seed in range(6):
        offset_s = 1.1 + 0.27 * seed
        found = sync(film(shape, offset_s, seed=seed), log(shape, seed=seed, noise_kPa=(0.05, 0.3, 1.0)[seed % 3]))
        assert found["sync_explained"] > 0.95
        assert abs(found["offset_s"] - offset_s) < 0.15
        assert 0.02 < found["offset_stderr_s"] < 0.5
        assert "changes too slowly to tell offsets within" in found["sync_notes"]
        errors.append((found["offset_s"] - offset_s) / found["offset_stderr_s"])
    assert np.max(np.abs(errors)) < 2.5
    assert np.sqrt(np.mean(np.square(errors))) < 1.3


@pytest.mark.parametrize("shape", [RAMP, CURVED, TRIANGLE], ids=["ramp", "curved", "triangle"])
def test_what_a_body_may_rub_is_in_the_error_of_a_slow_offset(shape):
    """A body that takes up 9 % of its pressure on the way out and back looks late: offsets 0.2 s off were known to 0.05 s."""
    fine = np.arange(-4.0, 8.0, 1 / 300)
    for seed in range(3):
        offset_s, bend = 1.1 + 0.27 * seed, np.zeros(len(fine))
        for k, pressure in enumerate(np.interp(fine + offset_s, *shape)):
            bend[k] = np.clip(bend[max(k - 1, 0)], pressure - 8.0, pressure + 8.0)
        track = film(([*(fine + offset_s), 99.0], [*bend, 0.0]), offset_s, seed=seed)
        found = sync(track, log(shape, seed=seed))
        assert abs(found["offset_s"] - offset_s) < 1.5 * found["offset_stderr_s"]


def test_a_ramp_beyond_both_ends_of_the_film_tells_no_offset_and_that_is_said():
    """The log was told not to belong to the film, or an offset that was seconds off was given to some milliseconds."""
    with pytest.raises(DataError, match=r"changes too slowly to tell the offset: .*let film and log begin before the pressure rises"):
        sync(film(LONG, 3.0), log(LONG))


@pytest.mark.parametrize(
    "other",
    [
        ([0, 1, 3.5, 6, 8.5, 11, 14], [40, 60, 10, 60, 10, 60, 10]),
        ([0, 14], [0, 4]),
    ],
    ids=["up and down", "drift"],
)
def test_a_slow_log_of_something_else_is_refused(other):
    with pytest.raises(DataError, match=r"explains only .* check that motion and log belong together"):
        sync(film(RAMP, 1.5), log(other))


def test_a_tube_that_moves_fast_is_not_aligned_with_a_slow_pressure():
    steps = ([0, 2, 2.1, 4, 4.1, 5, 5.1, 6, 6.1, 8, 8.1, 14], [0, 0, 80, 80, 30, 30, 90, 90, 40, 40, 80, 80])
    with pytest.raises(DataError, match=r"the motion explains only .* check that motion and log belong together"):
        sync(film(steps, 1.0), log(RAMP))


def test_a_slow_bend_to_the_wrong_side_is_named():
    track = film(TRIANGLE, 1.5)
    opposite = Track(track.dataset.assign(bend_angle=-track.dataset["bend_angle"]))
    with pytest.raises(InputError, match=r"bend falls as the pressure rises; actuator\.bends says 'left'"):
        sync(opposite, log(TRIANGLE))


@pytest.mark.parametrize("shape", [RAMP, CURVED], ids=["ramp", "curved"])
def test_a_slow_pressure_is_aligned_though_the_track_leaps_in_single_frames(shape):
    """A marker that was mistaken in seven frames made a ramp look fast: it was told not to belong to its log."""
    track = film(shape, 1.5)
    leaping = track.dataset.copy(deep=True)
    leaping["bend_angle"][[11, 40, 77, 103, 131, 170, 201]] += np.array([25.0, -30, 28, 31, -24, 35, -29])
    whole, found = sync(track, log(shape)), sync(Track(leaping), log(shape))
    assert found["offset_s"] == pytest.approx(whole["offset_s"], abs=0.03)
    assert found["offset_stderr_s"] == pytest.approx(whole["offset_stderr_s"], rel=0.3)


def test_a_log_that_is_flat_but_for_its_noise_is_named_as_that():
    """Of a run at a constant 50 kPa the track was doubted to belong to its log."""
    track = film(RAMP, 1.0)
    with pytest.raises(DataError, match=r"the log is flat but for its noise .* say 'pressure: \{value: 50 kPa\}' of a run at constant"):
        sync(track, log(([0, 14], [50, 50])))


def test_an_offset_at_which_less_is_explained_than_where_it_was_sought_is_not_taken(monkeypatch):
    """Of a finger that rubs, driven by a sine, the steps from the peak went 0.44 s astray, and claimed 0.03 s."""
    steps = ([0, 2, 2.1, 4, 4.1, 5, 5.1, 7, 7.2, 14], [0, 0, 60, 60, 20, 20, 80, 80, 0, 0])
    track, logged = film(steps, 1.0), log(steps)
    right = sync(track, logged)
    refine = motion.refine

    def astray(*asked):
        found = refine(*asked)
        return replace(found, offset_s=found.offset_s - 0.44, offset_stderr_s=0.03, explained=0.57)

    monkeypatch.setattr(motion, "refine", astray)
    found = sync(track, logged)
    assert found["offset_s"] == pytest.approx(right["offset_s"], abs=0.06) and found["offset_stderr_s"] > 0.35
    assert "the fit is left to find the best offset" in found["sync_notes"]
