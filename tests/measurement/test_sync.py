"""Offset between camera and log."""

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from rfea_vision.artefacts import Track
from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.pressure import PressureLog
from rfea_vision.stages.warnings import warnings_of
from rfea_vision.sync import synchronise
from rfea_vision.sync.synchronise import check_log


def pressure_at(t):
    steps = np.interp(t, [0.5, 0.55, 1.6, 1.65, 2.8, 2.9, 4.0, 4.05], [0, 150, 150, 60, 60, 220, 220, 0])
    return steps + 4 * np.sin(9 * t)


def made(offset_s: float, *, noise_deg: float = 0.02, rate: float = 240.0, seconds: float = 5.0, seed: int = 0):
    """A swinging tube (3.4 Hz, lightly damped, stiffness rising with the bend) seen by a camera with its own clock."""

    def law(t, y):
        return [y[1], 21.0**2 * (pressure_at(t) / 150 - y[0] - 0.1 * y[0] ** 3) - 4.0 * y[1]]

    log_time = np.arange(-0.5, seconds + 1.0, 0.001)
    camera = np.arange(0, seconds, 1 / rate)
    solution = solve_ivp(law, (-0.5, seconds + 1.0), [0, 0], rtol=1e-9, atol=1e-10, dense_output=True)
    rng = np.random.default_rng(seed)
    angle = np.degrees(solution.sol(camera + offset_s)[0]) + rng.normal(0, noise_deg, len(camera))
    dataset = xr.Dataset(
        {
            "bend_angle": ("time", angle),
            "valid": ("time", np.ones(len(camera), np.int8)),
            "reason": ("time", np.full(len(camera), "")),
        },
        coords={"time": camera},
    )
    return Track(dataset), PressureLog(log_time, pressure_at(log_time) + rng.normal(0, 0.05, len(log_time)))


@pytest.mark.parametrize("offset_s", [0.0, 0.123, -0.31])
def test_motion_finds_the_offset_within_a_millisecond(offset_s):
    track, log = made(offset_s)
    recording = synchronise(track, log, experiment="a", role="train", bends="left")
    found, error = recording.dataset.attrs["offset_s"], recording.dataset.attrs["offset_stderr_s"]
    assert abs(found - offset_s) < 0.001
    assert 0.005 < error < 0.03  # one angle does not show the delay along a real tube
    np.testing.assert_allclose(recording.time_s - track.time_s, found, atol=1e-4)


def test_one_angle_says_what_it_cannot_show():
    track, log = made(0.05, noise_deg=0.05)
    recording = synchronise(track, log, experiment="a", role="train", bends="left")
    assert "tip or angle alone do not show the tube's shape" in recording.dataset.attrs["sync_notes"]
    assert warnings_of(recording) == []  # nobody need do anything about it


def test_offset_common_clock_and_trigger():
    track, log = made(0.2)
    given = synchronise(track, log, experiment="a", role="train", bends="left", method="offset", value_s=0.2)
    assert given.dataset.attrs["offset_s"] == 0.2
    same = synchronise(track, log, experiment="a", role="train", bends="left", method="common_clock")
    np.testing.assert_array_equal(same.time_s, track.time_s)
    pulse = (np.abs(log.time_s - 0.2) < 0.005).astype(float)
    triggered = PressureLog(log.time_s, log.pressure_kPa, channels={"trigger": pulse})
    found = synchronise(track, triggered, experiment="a", role="train", bends="left", method="trigger")
    assert abs(found.dataset.attrs["offset_s"] - 0.195) < 0.002
    every = 0.5 + 0.5 * np.sign(np.sin(2 * np.pi * 240 * (log.time_s - 0.2) + 0.1)) * (log.time_s > 0.199) * (
        log.time_s < 5.2
    )
    with pytest.raises(InputError, match=r"sync\.channel"):
        synchronise(
            track,
            PressureLog(log.time_s, log.pressure_kPa, channels={"x": every}),
            experiment="a",
            role="train",
            bends="left",
            method="trigger",
        )


def test_a_lamp_in_the_picture():
    track, log = made(0.2)
    on = lambda t: (((t % 1.3) < 0.4) ^ ((t % 1.7) < 0.2)).astype(float)  # noqa: E731
    lit = Track(track.dataset.assign(lamp=("time", 50 + 100 * on(track.time_s + 0.2))))
    logged = PressureLog(log.time_s, log.pressure_kPa, channels={"led": on(log.time_s)})
    a = synchronise(lit, logged, experiment="a", role="train", bends="left", method="led").dataset.attrs
    assert abs(a["offset_s"] - 0.2) < 0.003


TIMES_S = np.arange(0, 20, 0.005)
WAVE = 150 - 150 * np.cos(2 * np.pi * 0.3 * TIMES_S)
RAMPS = np.interp(TIMES_S % 4, [0, 1, 1.5, 2.5, 3, 4], [0, 0, 200, 200, 0, 0])
FILLED = lfilter([0.05], [1, -0.95], np.where(TIMES_S % 4 < 2, 0.0, 200.0))  # a first-order line, 0.1 s


def of_12_bits(pressure_kPa):
    return np.round(pressure_kPa * 4096 / 300) * 300 / 4096


@pytest.mark.parametrize(
    "log", [FILLED, of_12_bits(FILLED), RAMPS, of_12_bits(RAMPS), WAVE, np.where(WAVE > 100, 200.0, 0.0)]
)
def test_a_hold_at_the_highest_pressure_is_no_saturated_sensor(log):
    assert check_log(TIMES_S, log, "a", moving=True) == []


@pytest.mark.parametrize(
    "log", [FILLED, of_12_bits(FILLED), WAVE, FILLED + np.random.default_rng(0).normal(0, 0.3, 4000)]
)
@pytest.mark.parametrize("end", [150, 190])
def test_a_sensor_that_is_run_into_its_end_is_asked_for(log, end):
    assert "is the sensor saturated?" in check_log(TIMES_S, np.minimum(log, end), "a", moving=True)[0]


@pytest.mark.parametrize(
    ("rate", "film_s", "log_s", "says"),
    [
        (240.0, 0.65, (-0.5, 6.0), r"156 tracked frames over 0.65 s are too few .* needs 60 over 1 s; record longer, or use"),
        (30.0, 5.0, (0.0, 1.3), r"too few of 150 tracked frames lie within the log.*; the film lasts 4.97 s and the log 1.30 s, "),
        (30.0, 5.0, (0.5, 2.0), r"explains only \d+ % .* and the log 1.50 s, which .*; give the log of the whole run, or use"),
    ],
)
def test_what_is_short_is_told_and_what_helps(rate, film_s, log_s, says):
    """Where the log was short the film's frames had been called too few, or their motion another one than the log's."""
    track, log = made(0.0, rate=rate)
    track = Track(track.dataset.sel(time=slice(0.0, film_s - 1e-6)))
    within = (log.time_s >= log_s[0] - 1e-6) & (log.time_s <= log_s[1] + 1e-6)
    with pytest.raises(DataError, match=says):
        synchronise(track, PressureLog(log.time_s[within], log.pressure_kPa[within]), experiment="a", role="train", bends="left")


def test_frames_too_few_for_the_terms_of_a_motion_are_told_as_that():
    """Of 2 s at 30 Hz, whose motion and pressure belong together, it was said that the motion explains 0 %."""
    track, log = made(0.0, rate=25.0)
    seen = np.repeat(np.arange(31) % 2 == 0, 4)[:124]  # of what is seen in bursts none is far from a gap
    track = Track(track.dataset.isel(time=np.flatnonzero(seen)))
    with pytest.raises(DataError, match=r"too few of 64 tracked frames lie within the log.*; record longer, or at"):
        synchronise(track, log, experiment="a", role="train", bends="left")


def test_a_flat_short_or_unrelated_log_is_said():
    track, log = made(0.0)
    flat = PressureLog(log.time_s, np.full_like(log.time_s, 3.0))
    with pytest.raises(DataError, match="flat"):
        synchronise(track, flat, experiment="a", role="train", bends="left")
    short = PressureLog(log.time_s[:300], log.pressure_kPa[:300] + np.arange(300))
    with pytest.raises(DataError, match="too short"):
        synchronise(track, short, experiment="a", role="train", bends="left")
    rng = np.random.default_rng(0)
    other = PressureLog(log.time_s, np.cumsum(rng.normal(0, 1, len(log.time_s))) + 100 * rng.random(len(log.time_s)))
    with pytest.raises(DataError, match="explains only"):
        synchronise(track, other, experiment="a", role="train", bends="left")
    saturated = PressureLog(log.time_s, np.minimum(log.pressure_kPa, 190.0))
    assert (
        "saturated"
        in synchronise(track, saturated, experiment="a", role="train", bends="left").dataset.attrs["sync_notes"]
    )
