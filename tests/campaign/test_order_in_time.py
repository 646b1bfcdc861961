"""Motion follows its pressure: what comes before it, runs backwards or at another rate, is doubted aloud."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from rfea_vision.campaign.check import check_campaign
from rfea_vision.campaign.following import of_order, of_pair, of_sign

from .campaigns import write_campaign


@pytest.mark.parametrize(("late_s", "period_s"), [(-0.8, None), (0.3, None), (0.0, None), (0.3, 1.1), (0.55, 1.05)])
def test_no_tube_moves_before_its_pressure(late_s, period_s):
    """An offset with the wrong sign had passed; of one sine a lead is a delay of the rest of its period."""
    rng = np.random.default_rng(7)
    time_s = np.arange(0, 20, 0.02)
    pressure = 40 + 30 * np.sin(2 * np.pi * time_s / period_s) if period_s else np.repeat(rng.uniform(0, 80, 20), 50)
    bent = np.interp(time_s - late_s, time_s, pressure) + rng.standard_normal(time_s.size)
    track = xr.Dataset({"tip": (("time", "xy"), np.stack([-bent, 0.001 * bent**2 - 150], axis=1))})
    said = of_pair(track, time_s, time_s, pressure)
    assert any("moves 0.8 s before this pressure" in text for text in said) == (late_s < 0), said


def _steps(seconds=20.0, seed=7):
    """Times, a pressure of random steps, and what rubber that creeps makes of it: a bend that never comes before its cause."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0, seconds, 0.02)
    pressure = np.repeat(rng.uniform(0, 80, int(seconds)), 50)
    bent, slow = np.zeros(time_s.size), 0.0
    for k in range(1, time_s.size):
        slow += 0.02 / 0.6 * (pressure[k] - slow)
        bent[k] = bent[k - 1] + 0.02 / 0.05 * (0.8 * pressure[k] + 0.2 * slow - bent[k - 1])
    return time_s, pressure, bent + rng.standard_normal(time_s.size)


def _tip(bent):
    return xr.Dataset({"tip": (("time", "xy"), np.stack([-bent, 0.001 * bent**2 - 150], axis=1))})


def test_a_film_that_runs_backwards_is_told_and_a_run_that_is_its_own_mirror_is_not():
    """It had been called a mirrored track, or a sign of the pressure that is turned."""
    time_s, pressure, bent = _steps()
    assert of_pair(_tip(bent), time_s, time_s, pressure) == []
    (text,) = of_pair(_tip(bent[::-1]), time_s, time_s, pressure)
    assert "does the film, or the track, run backwards?" in text
    mirrored = 40 + 30 * np.sin(2 * np.pi * time_s / 4)
    late = np.interp(time_s - 0.1, time_s, mirrored)
    assert not any("backwards" in text for text in of_pair(_tip(late[::-1]), time_s, time_s, mirrored))


def test_where_no_clock_is_found_the_order_of_the_frames_may_be_why():
    """`sync` had sent people to actuator.bends, the sign of the pressure and the rate."""
    time_s, pressure, bent = _steps()
    log_s = time_s + 0.4  # on a clock of its own
    assert "run backwards?" in of_order(_tip(bent[::-1]), time_s, log_s, pressure)
    assert of_order(_tip(bent), time_s, log_s, pressure) == ""
    assert of_order(_tip(bent), time_s, log_s, pressure[::-1].copy() * 0 + 5) == ""  # a pressure that stands still
    assert of_order(xr.Dataset(), time_s, log_s, pressure) == ""


@pytest.mark.parametrize(("times", "told"), [(8.0, True), (0.5, True), (1.0, False)])
def test_a_rate_that_was_no_slow_motion_is_told_by_the_pressure(times, told):
    """Of 240 Hz for a film of 30, nothing had been said: a log is often longer than its film."""
    time_s, pressure, bent = _steps()
    said = of_pair(_tip(bent), time_s / times, time_s, pressure, own_s=time_s)
    assert any("is video.rate right?" in text for text in said) == told


def test_slow_motion_is_no_wrong_rate():
    time_s, pressure, bent = _steps()
    assert of_pair(_tip(bent), time_s, time_s, pressure, own_s=8 * time_s) == []


@pytest.mark.parametrize(("backwards", "told"), [(True, True), (False, False)])
def test_check_tells_it_where_the_motion_is_to_bring_the_clocks_together(tmp_path, backwards, told):
    folder = write_campaign(tmp_path / "c", {"steps": "train"})
    time_s, pressure, bent = _steps()
    file = folder / "steps" / "experiment.yaml"
    file.write_text(file.read_text().replace("common_clock", "motion"))
    pd.DataFrame({"time_s": time_s + 0.4, "pressure_kPa": pressure}).to_csv(folder / "steps" / "pressure.csv", index=False)
    tip_x, tip_y = _tip(bent[::-1] if backwards else bent)["tip"].values.T
    pd.DataFrame({"time_s": time_s, "tip_x_mm": tip_x, "tip_y_mm": tip_y}).to_csv(folder / "steps" / "track.csv", index=False)
    said = [problem.message for problem in check_campaign(folder).problems]
    assert any("run backwards?" in text for text in said) == told, said


@pytest.mark.parametrize(("value_s", "told"), [(-1.5, True), (1.5, False), (-30.0, False)])
def test_an_offset_of_the_wrong_sign_is_told_where_the_other_puts_the_film_inside_the_log(value_s, told):
    """It was "the log of another run?", or nothing but a part of the frames that lies outside of the log."""
    time_s, pressure, bent = _steps()
    film_s = time_s[time_s < 12]  # on the log's clock from 1.5 s on
    track = _tip(np.interp(film_s + 1.5, time_s, bent))
    said = of_sign(track, film_s + value_s, time_s, pressure, value_s)
    assert ("with sync.value -1.5 s 12 % of the frames lie outside" in said and "is its sign turned round?" in said) == told, said
    assert told or said == ""


def test_of_a_log_that_began_late_the_sign_is_not_doubted():
    """The offset of the other sign puts the film inside the log, too, but the motion does not follow there."""
    time_s, pressure, bent = _steps()
    begun_s = time_s[time_s >= 1.5]
    track = _tip(bent[time_s < 12])
    assert of_sign(track, time_s[time_s < 12] - 1.5, begun_s - 1.5, pressure[time_s >= 1.5], -1.5) == ""
