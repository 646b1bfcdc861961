"""What a careful person would doubt about two clocks, and what the tool says of it."""

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import Track
from rfea_vision.campaign.specs import PressureSpec
from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.pressure import PressureLog, read_pressure
from rfea_vision.readers.tracks import read_track
from rfea_vision.sync import synchronise
from rfea_vision.sync.ambiguity import repetition
from rfea_vision.sync.pulses import _fitting, _matched
from rfea_vision.twin import TwinOptions, simulate

from .test_sync import made


def sync(track, log, **kind):
    kind = {"bends": "left", **kind}
    return synchronise(track, log, experiment="a", role="train", **kind).dataset.attrs


@pytest.fixture(scope="module")
def run():
    return made(0.05)


def within(attributes, true_s, most_ms=1.5):
    error = attributes["offset_s"] - true_s
    assert abs(error) < 1e-3 * most_ms
    assert abs(error) < 4 * attributes["offset_stderr_s"] + 2e-4


def test_gaps_in_the_log_are_said_and_not_aligned_on(run):
    track, log = run
    keep = ~((log.time_s > 1.5) & (log.time_s < 2.1) | (log.time_s > 3.9) & (log.time_s < 4.1))
    found = sync(track, PressureLog(log.time_s[keep], log.pressure_kPa[keep]))
    assert "2 gaps of together 0.80 s, the first at 1.5" in found["sync_notes"]
    within(found, 0.05)


def test_a_slow_log_has_a_wide_error_and_says_so(run):
    track, log = run
    slow = sync(track, PressureLog(log.time_s[::100], log.pressure_kPa[::100]))
    assert "only 10 samples per second" in slow["sync_notes"]
    assert slow["offset_stderr_s"] > 0.008
    assert abs(slow["offset_s"] - 0.05) < 3 * slow["offset_stderr_s"]


@pytest.mark.parametrize("shift_s", [35.0, -70.0, 1.7e9])
def test_clocks_may_lie_far_apart(run, shift_s):
    track, log = run
    within(sync(track, PressureLog(log.time_s + shift_s, log.pressure_kPa)), 0.05 + shift_s)


@pytest.mark.parametrize("part", [lambda t: t > 1.2, lambda t: t < 3.3], ids=["begins late", "ends early"])
def test_the_log_may_begin_after_the_film_or_end_before_it(run, part):
    track, log = run
    keep = part(log.time_s)
    found = sync(track, PressureLog(log.time_s[keep], log.pressure_kPa[keep]))
    assert "of the frames lie outside the log" in found["sync_notes"]
    within(found, 0.05, 3.0)


def test_uneven_samples_and_lost_frames_do_no_harm(run):
    track, log = run
    rng = np.random.default_rng(0)
    times = log.time_s[::5] + rng.uniform(0, 0.004, len(log.time_s[::5]))
    valid = np.ones(len(track.time_s), np.int8)
    valid[400:520] = 0
    valid[rng.integers(0, len(valid), 120)] = 0
    dataset = track.dataset.assign(valid=("time", valid))
    dataset["bend_angle"] = dataset["bend_angle"].where(dataset["valid"] == 1)
    within(sync(Track(dataset), PressureLog(times, np.interp(times, log.time_s, log.pressure_kPa))), 0.05, 2.0)


def test_the_wrong_direction_is_named(run):
    track, log = run
    opposite = Track(track.dataset.assign(bend_angle=-track.dataset["bend_angle"]))
    with pytest.raises(InputError, match=r"bend falls as the pressure rises; actuator\.bends says 'left'"):
        sync(opposite, log)


def test_an_excitation_that_repeats_is_not_guessed_at():
    def angle(t):
        return 20 + 15 * np.sin(2 * np.pi * t / 0.9)

    camera, log = np.arange(0, 6, 1 / 240), np.arange(-5, 11, 0.001)
    rng = np.random.default_rng(0)
    dataset = xr.Dataset(
        {
            "bend_angle": ("time", angle(camera + 0.1) + rng.normal(0, 0.05, len(camera))),
            "valid": ("time", np.ones(len(camera), np.int8)),
            "reason": ("time", np.full(len(camera), "")),
        },
        coords={"time": camera},
    )
    pressure = 100 + 40 * np.sin(2 * np.pi * log / 0.9)
    with pytest.raises(DataError, match=r"the excitation repeats.*sync\.method led, trigger or offset"):
        sync(Track(dataset), PressureLog(log, pressure + rng.normal(0, 0.05, len(log))))


def test_a_pressure_that_changes_slowly_has_a_wide_error_and_one_that_repeats_is_refused():
    """Offsets that explain a motion equally well within a period of the band are left to the fit; farther ones are not."""
    offsets = np.arange(-10, 10, 0.006)

    def told(*places):
        share = 0.5 + 0.45 * sum(np.exp(-(((offsets - place) / 0.1) ** 2)) for place in places)
        return repetition(offsets, share + 1e-4 * (np.abs(offsets - places[0]) < 0.3), share, slowest_s=1.25, experiment="a")

    assert told(0.35) == ("", 0.0)
    note, doubt_s = told(0.35, -0.3)
    assert "too slowly to tell offsets within 0.65 s apart" in note and doubt_s == pytest.approx(0.65 / np.sqrt(2), rel=0.02)
    with pytest.raises(DataError, match="the excitation repeats"):
        told(0.35, -0.3, 4.0)


def lamp_run(seed, *, rate=240.0, noise=4.0, offset=0.2, drift=0.0, inverted=False, even=False):
    """A lamp that blinks unevenly, seen through noise, and its log."""
    rng = np.random.default_rng(seed)
    switches = np.arange(1, 60) * 0.35 if even else np.cumsum(rng.uniform(0.15, 0.9, 40))
    lit = lambda t: (np.searchsorted(switches, t) % 2).astype(float)  # noqa: E731
    camera, log = np.arange(0, 8, 1 / rate), np.arange(-6, 16, 0.001)
    lamp = 60 + 120 * lit(camera * (1 + drift) + offset) + rng.normal(0, noise, len(camera))
    dataset = xr.Dataset(
        {
            "lamp": ("time", lamp),
            "bend_angle": ("time", np.zeros(len(camera))),
            "valid": ("time", np.ones(len(camera), np.int8)),
            "reason": ("time", np.full(len(camera), "")),
        },
        coords={"time": camera},
    )
    signal = 5 * (1 - lit(log) if inverted else lit(log))
    return Track(dataset), PressureLog(log, np.zeros(len(log)), channels={"led": signal})


@pytest.mark.parametrize("inverted", [False, True])
def test_the_lamp_gives_offset_and_drift_with_honest_errors(inverted):
    z = []
    for seed in range(25):
        offset = 0.2 + 0.0137 * seed
        found = sync(*lamp_run(seed, offset=offset, inverted=inverted), method="led")
        z.append((found["offset_s"] - offset) / found["offset_stderr_s"])
        assert abs(found["offset_s"] - offset) < 0.003
    assert np.mean(np.abs(z) < 1.96) >= 0.85
    drifting = sync(*lamp_run(3, drift=1.5e-3, inverted=inverted), method="led")
    assert drifting["drift_ppm"] == pytest.approx(1500, abs=3 * drifting["drift_stderr_ppm"])


def test_a_lamp_that_blinks_evenly_or_not_at_all_is_said():
    with pytest.raises(DataError, match="blink unevenly"):
        sync(*lamp_run(0, even=True), method="led")
    track, log = lamp_run(0)
    dark = Track(track.dataset.assign(lamp=("time", 60 + np.random.default_rng(0).normal(0, 4, len(track.time_s)))))
    with pytest.raises(InputError, match=r"never switches in the picture; check sync\.box"):
        sync(dark, log, method="led")


def test_pulses_whose_frames_were_dropped_are_told_by_the_time_stamps(run):
    track, log = run
    times = track.time_s
    fine = np.arange(log.time_s[0], log.time_s[-1], 2.5e-4)
    phase = (fine - 0.05) * 240
    pulse = ((phase % 1 < 0.5) & (fine > 0.05 - 1e-3) & (fine < times[-1] + 0.05 + 2e-3)).astype(float)
    keep = np.ones(len(times), bool)
    keep[[100, 101, 102, 500]] = False
    logged = PressureLog(fine, np.interp(fine, log.time_s, log.pressure_kPa), channels={"trigger": pulse})
    found = sync(Track(track.dataset.isel(time=keep)), logged, method="trigger")
    assert "4 of 1200 pulses have no frame" in found["sync_notes"]
    within(found, 0.05)


def test_pulses_are_told_though_the_clocks_drift_apart_by_frames():
    """100 ppm over a minute is six tenths of a frame at 100 frames/s, and one pulse has no frame."""
    frames = np.arange(6000) / 100.0
    pulses = 3.0 + np.arange(6001) / 100.0 * (1 + 1e-4)
    seen = np.delete(frames, 2000)
    found = _matched(seen, pulses, 0, 1e-4)
    assert found is not None and found[0].drift_ppm == pytest.approx(100, abs=1)
    assert found[0].offset_s == pytest.approx(3.0, abs=1e-4)


def test_as_many_frames_dropped_as_pulses_came_early_are_no_match():
    frames = np.delete(np.arange(305) / 60.0, [50, 90, 130, 170, 210])
    pulses = np.arange(-5, 295) / 60.0
    assert _fitting(frames, pulses, 1e-4) is None


def test_a_lamp_in_a_slow_log_or_in_a_part_of_the_film():
    track, log = lamp_run(1)
    every = slice(None, None, 40)
    slow = PressureLog(log.time_s[every], log.pressure_kPa[every], channels={"led": log.channels["led"][every]})
    found = sync(track, slow, method="led")
    assert abs(found["offset_s"] - 0.2) < 3 * found["offset_stderr_s"] < 0.02
    part = (log.time_s > 0) & (log.time_s < 3.5)
    short = PressureLog(log.time_s[part], log.pressure_kPa[part], channels={"led": log.channels["led"][part]})
    assert abs(sync(track, short, method="led")["offset_s"] - 0.2) < 0.003


def test_short_flashes_are_seen_and_noise_is_not_taken_for_them():
    track, log = lamp_run(0)
    flashes = np.array([1.0, 1.7, 2.9, 5.05, 6.6])
    rng = np.random.default_rng(0)
    dark = 50 + rng.normal(0, 2, len(track.time_s))
    lit = dark + 150 * (np.abs(track.time_s[:, None] - flashes) < 0.006).any(axis=1)
    logged = (np.abs(log.time_s[:, None] - flashes - 0.2) < 0.006).any(axis=1).astype(float)
    flashed = PressureLog(log.time_s, log.pressure_kPa, channels={"led": logged})
    found = sync(Track(track.dataset.assign(lamp=("time", lit))), flashed, method="led")
    assert abs(found["offset_s"] - 0.2) < 0.003
    with pytest.raises(InputError, match="never switches in the picture"):
        sync(Track(track.dataset.assign(lamp=("time", dark))), flashed, method="led")


def pulsed(run, offset_s: float, before: int, after: int) -> PressureLog:
    """The log with an even pulse per frame, and more of them before and after the film."""
    track, log = run
    rate = 1 / float(np.median(np.diff(track.time_s)))
    fine = np.arange(log.time_s[0], log.time_s[-1], 2.5e-4)
    phase = (fine - offset_s - track.time_s[0]) * rate
    pulse = (phase % 1 < 0.5) & (phase > -0.1 - before) & (phase < len(track.time_s) + after - 0.4)
    return PressureLog(fine, np.interp(fine, log.time_s, log.pressure_kPa), channels={"trigger": pulse.astype(float)})


@pytest.fixture(scope="module")
def whole_tube(tmp_path_factory):
    """Track of a whole centre line, its log, and the offset between them."""
    folder = tmp_path_factory.mktemp("sync") / "twin"
    options = TwinOptions(seed=301, joints=8, noise_mm=0.03, roles=("train",), kinds=("steps",), duration_s=4.0)
    (name, known), *_ = simulate(folder, options)["experiments"].items()
    log = read_pressure(PressureSpec(file=folder / name / "pressure.csv", folder=folder))
    return (read_track(folder / name / "track.csv", bends="left"), log), known["offset_s"]


@pytest.mark.parametrize(("before", "after"), [(0, 10), (7, 3), (9, 0)])
def test_pulses_before_and_after_the_film_are_told_by_the_motion(whole_tube, before, after):
    run, offset_s = whole_tube
    found = sync(run[0], pulsed(run, offset_s, before, after), method="trigger")
    assert f"by the motion, {before} came before the film and {after} after it" in found["sync_notes"]
    within(found, offset_s, 0.3)


def test_pulses_that_no_motion_tells_apart_are_said(run):
    logged = pulsed(run, 0.05, 0, 10)
    still = PressureLog(logged.time_s, np.full_like(logged.pressure_kPa, 5.0), channels=logged.channels)
    found = sync(run[0], still, method="trigger")
    assert "first pulse was taken for the first frame, and 10 come after the last" in found["sync_notes"]
    assert "too small, by 0.00417 s for each" in found["sync_notes"]
    within(found, 0.05)
