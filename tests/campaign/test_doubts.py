"""Data that can be read and are not what was meant: `rfea check` doubts them aloud."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from rfea_vision.artefacts import Actuator
from rfea_vision.artefacts.measurement import Hints
from rfea_vision.campaign.check import check_campaign
from rfea_vision.campaign.following import Pair, of_pair, together
from rfea_vision.campaign.plausibility import of_copies, of_times, of_upside_down
from rfea_vision.campaign.pointing import of_hints
from rfea_vision.campaign.repeats import alike, of_repeat, of_rest, rest_of
from rfea_vision.campaign.schema import SyncPart
from rfea_vision.campaign.specs import ExperimentSpec, PressureSpec, TrackSpec
from rfea_vision.errors import DataError
from rfea_vision.readers.pressure import PressureLog
from tests.cli.console import rfea

from .campaigns import write_campaign


def _scaled(column, factor, file="pressure.csv"):
    def spoil(folder):
        table = pd.read_csv(folder / "steps" / file)
        table[column] *= factor
        table.to_csv(folder / "steps" / file, index=False)

    return spoil


def _swapped(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    table[["tip_x_mm", "tip_y_mm"]] = table[["tip_y_mm", "tip_x_mm"]].to_numpy()
    table.to_csv(folder / "steps" / "track.csv", index=False)


def _radians(folder):
    time_s = np.arange(0.0, 0.5, 1 / 240)
    angle = 0.9 * (1.0 - np.exp(-time_s / 0.1))
    pd.DataFrame({"time_s": time_s, "angle_deg": angle}).to_csv(folder / "steps" / "track.csv", index=False)


def _frame_numbers(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    table["time_s"] = range(len(table))
    table.to_csv(folder / "steps" / "track.csv", index=False)


def _time_as_pressure(folder):
    table = pd.read_csv(folder / "steps" / "pressure.csv")
    table["pressure_kPa"] = 100 * table["time_s"]
    table.to_csv(folder / "steps" / "pressure.csv", index=False)


def _copied(folder):
    (folder / "steps" / "pressure.csv").write_bytes((folder / "sine" / "pressure.csv").read_bytes())


def _copied_track(folder):
    (folder / "steps" / "track.csv").write_bytes((folder / "sine" / "track.csv").read_bytes())


def _own_log(folder):
    """Nothing is wrong: the runs of the template share a log, so each gets its own."""
    for name, factor in (("steps", 1.0), ("sine", 1.1)):
        table = pd.read_csv(folder / name / "pressure.csv")
        table["pressure_kPa"] *= factor
        table.to_csv(folder / name / "pressure.csv", index=False)


def _of_another_run(folder):
    table = pd.read_csv(folder / "steps" / "pressure.csv")
    table["pressure_kPa"] = 60.0 + 50.0 * np.sin(2 * np.pi * 9.0 * table["time_s"])
    table.to_csv(folder / "steps" / "pressure.csv", index=False)


def _still(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    rng = np.random.default_rng(0)
    for name in ("tip_x_mm", "tip_y_mm"):
        table[name] = table[name].iloc[0] + 0.002 * rng.standard_normal(len(table))
    table.to_csv(folder / "steps" / "track.csv", index=False)


def _nowhere(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    table.loc[5:6, ["tip_x_mm", "tip_y_mm"]] = 9999.0
    table.to_csv(folder / "steps" / "track.csv", index=False)


def _noisy(table):
    return (table["pressure_kPa"] + np.random.default_rng(0).normal(0.0, 0.03, len(table))).round(4)


def _ends_at_its_range(folder):
    table = pd.read_csv(folder / "steps" / "pressure.csv")
    table["pressure_kPa"] = _noisy(table).clip(upper=98.0)
    table.to_csv(folder / "steps" / "pressure.csv", index=False)


def _hangs(folder):
    table = pd.read_csv(folder / "steps" / "pressure.csv")
    pressure_kPa = _noisy(table)
    pressure_kPa[100:180] = pressure_kPa[100]
    table.assign(pressure_kPa=pressure_kPa).to_csv(folder / "steps" / "pressure.csv", index=False)


SLIPS = pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_scaled("pressure_kPa", 1000.0), "is it in Pa?"),
        (_scaled("pressure_kPa", 100.0), "Or in kPa, where bar or MPa is declared?"),
        (_scaled("pressure_kPa", 0.001), "is it in bar or MPa?"),
        (_scaled("pressure_kPa", -3.0), "below vacuum; is its sign turned in the log?"),
        (_scaled("time_s", 1000.0), "is the time of the log in ms?"),
        (_scaled("time_s", 1 / 86400), "does the log count in units of one day? Then write pressure.time_unit: day"),
        (_scaled("time_s", 1000.0, "track.csv"), "is the time of the pictures in ms?"),
        (_scaled(["tip_x_mm", "tip_y_mm"], 0.001, "track.csv"), "are these mm?"),
        (_scaled(["tip_x_mm", "tip_y_mm"], 1.3, "track.csv"), "is actuator.length that of the part that bends"),
        (_nowhere, "2 rows lie beyond any tube: leave empty those"),
        (_swapped, "are x and y swapped?"),
        (_radians, "are these radians?"),
        (_scaled("tip_x_mm", -1.0, "track.csv"), "is the track mirrored, or the sign of the pressure turned?"),
        (_scaled("tip_y_mm", -1.0, "track.csv"), "does y count downwards, as in pictures?"),
        (_scaled("pressure_kPa", 1 / 6.895), "in any other run; is pressure.unit right?"),
        (_frame_numbers, "is it the number of the frame?"),
        (_time_as_pressure, "is it the column of time?"),
        (_copied, "is the same log, row by row, as that of 'sine'"),
        (_copied_track, "is the same track, row by row, as that of 'sine'"),
        (_of_another_run, "is it the log of another run?"),
        (_still, "is it the right tube?"),
        (_ends_at_its_range, "does the sensor's or the logger's range end there?"),
        (
            _hangs,
            "for 80 rows, from row 101 on, and elsewhere scatters by 0.031 kPa; did the sensor or the logger hang, or a plug come off?",
        ),
    ],
)


@SLIPS
def test_the_usual_slips_are_doubted(tmp_path, spoil, says):
    folder = write_campaign(tmp_path / "campaign")
    _own_log(folder)
    said = [str(problem) for problem in check_campaign(folder).problems]
    assert not [text for text in said if "?" in text], said
    spoil(folder)
    said = [str(problem) for problem in check_campaign(folder).problems if problem.severity == "warning"]
    assert len([text for text in said if says in text]) == 1, said


@pytest.mark.parametrize(("length", "doubted"), [("155 mm", True), ("155 mmm", False)])
def test_nothing_is_doubted_by_a_tube_that_was_assumed_in_place_of_one_that_was_refused(tmp_path, length, doubted):
    """`outer_radius: 17mmm` was refused, and a clamp told to be wider than the tube of 8 mm that was assumed."""
    folder = write_campaign(tmp_path / "campaign")
    file = folder / "campaign.yaml"
    assert "length: 155 mm" in file.read_text()
    file.write_text(file.read_text().replace("length: 155 mm", f"length: {length}"))
    _scaled(["tip_x_mm", "tip_y_mm"], 1.3, "track.csv")(folder)
    said = [str(problem) for problem in check_campaign(folder).problems]
    assert any("is actuator.length that of the part that bends" in text for text in said) == doubted
    assert any("unknown unit 'mmm'" in text for text in said) != doubted


def test_a_clamp_below_its_tip_is_doubted_where_the_tube_hangs():
    swapped = Hints(clamp=((561.0, 1069.0), (608.0, 1069.0)), tip=(580.0, 219.0))
    ((key, text),) = of_hints(swapped, 0.0)
    assert key == "clamp" and text.startswith("lies 850 px below camera.tip in the picture") and "swapped?" in text
    aside = replace(swapped, tip=(20.0, 900.0))  # bent by more than a quarter turn, or a camera on its side
    assert of_hints(swapped, 180.0) == of_hints(swapped, None) == of_hints(aside, 0.0) == of_hints(Hints(), 0.0) == []


def test_a_column_that_stands_still_while_the_tube_moves_is_doubted_unless_it_was_held():
    time_s = np.arange(0.0, 4.0, 0.01)
    supply = 400.0 + np.random.default_rng(0).normal(0.0, 0.03, time_s.size)
    swings, creeps = (np.column_stack([tip_x, np.full(400, -150.0)]) for tip_x in (40 * np.sin(time_s), 3 * (1 - np.exp(-time_s))))
    track = xr.Dataset({"tip": (("time", "axis"), swings)}, attrs={"bends": "right"})
    (text,) = of_pair(track, time_s, time_s, supply)
    assert "kPa of 400 kPa while the tube goes by" in text and "is it the right column?" in text
    assert of_pair(track, time_s, time_s, supply, held=True) == []
    assert of_pair(track.assign(tip=(("time", "axis"), creeps)), time_s, time_s, supply) == []


@pytest.mark.parametrize(("zero_kPa", "place_mm", "told"), [(12, 0, True), (12, 5, False), (2, 0, False), (0, 0, False)])
def test_a_sensor_that_was_not_zeroed_in_one_run_is_doubted_where_the_tube_rests_as_in_others(zero_kPa, place_mm, told):
    time_s = np.arange(0.0, 4.0, 0.01)
    noise = np.random.default_rng(0)

    def begun(zero, place):
        pressure = 200 * np.clip(np.sin(time_s - 1), 0, None)
        tip = np.column_stack([place + 0.4 * pressure, -150 + 0 * time_s]) + noise.normal(0, 0.05, (400, 2))
        return rest_of(xr.Dataset({"tip": (("time", "axis"), tip)}), pressure + zero)

    rests = {"a": begun(0.0, 0.0), "b": begun(0.5, 0.1), "odd": begun(zero_kPa, place_mm)}
    assert [name for name in rests if of_rest(name, rests)] == ["odd"] * told
    assert of_rest("odd", {name: rests[name] for name in ("a", "odd")}) == ""  # of two nobody knows which
    if told:
        assert "begins with +11.8 kPa against every other run" in of_rest("odd", rests)
    rising = xr.Dataset({"tip": (("time", "axis"), np.column_stack([50 * np.sin(time_s), time_s]))})
    assert rest_of(rising, 100 * np.sin(time_s)) is None


@SLIPS
def test_they_are_doubted_where_one_fits(tmp_path, spoil, says, monkeypatch):
    folder = write_campaign(tmp_path / "campaign")
    _own_log(folder)
    spoil(folder)
    monkeypatch.setattr("rfea_vision.stages.mechanics._fitted", _far_enough)
    answer = rfea("fit", folder)
    assert answer.err.count(says) == 1 and "a fault in" not in answer.err, answer.err


@pytest.mark.parametrize(("spoil", "says"), [(_swapped, "are x and y swapped?"), (_copied, "is the same log")])
def test_they_are_doubted_by_each_command_once(tmp_path, spoil, says, monkeypatch):
    folder = write_campaign(tmp_path / "campaign")
    _own_log(folder)
    spoil(folder)
    monkeypatch.setattr("rfea_vision.stages.mechanics._fitted", _far_enough)
    said = {command: rfea(command, folder).err.count(says) for command in ("track", "sync", "fit")}
    assert said == {"track": int(spoil is _swapped), "sync": 1, "fit": 1}


def _far_enough(*_: object) -> None:
    raise DataError("far enough")


@pytest.mark.parametrize(
    ("filmed", "says"), [(True, "such as 240 Hz. Or was the log cut off?"), (False, "only what both cover")]
)
def test_a_film_that_lasts_twice_as_long_as_its_log_may_be_slow_motion(filmed, says):
    (text,) = of_times(np.linspace(0, 6, 600), np.arange(360) / 30, filmed=filmed)
    assert says in text


def test_frames_that_are_counted_are_no_seconds():
    """At 60 Hz they last 38 times as long as the log, which had been too little to be said."""
    (text,) = of_times(np.linspace(0, 3, 300), np.arange(120.0))
    assert "is it the number of the frame?" in text


@pytest.mark.parametrize(("zero_deg", "told"), [(180.0, True), (-90.0, True), (20.0, False), (0.0, False)])
def test_an_angle_from_another_direction_is_doubted(zero_deg, told):
    time_s = np.arange(0, 20, 0.05)
    pressure = np.clip(60 * np.sin(time_s), 0, None)
    track = xr.Dataset({"bend_angle": ("time", zero_deg + 0.5 * pressure)})
    said = of_pair(track, time_s, time_s, pressure)
    assert bool(said) == told and all("0 is where the unloaded tube points" in text for text in said)


def test_a_run_that_is_right_is_not_doubted(tmp_path, monkeypatch):
    folder = write_campaign(tmp_path / "campaign")
    monkeypatch.setattr("rfea_vision.stages.mechanics._fitted", _far_enough)
    assert "warning" not in rfea("fit", folder).err


@pytest.mark.parametrize(("right", "told"), [(0.9, True), (-1.0, False)])
def test_chambers_that_are_blown_up_together_do_not_bend_apart(right, told):
    """A finger with two chambers side by side, said to pull against each other: their signs leave a tenth of what bends it."""
    time_s = np.arange(0, 6, 0.03)
    push = 30 * (0.5 - 0.5 * np.cos(2 * time_s))
    pushes = {"left": push, "right": -(50 + right * push)}
    track = xr.Dataset({"tip": (("time", "xy"), np.stack([-push, -120 + 0 * push], axis=1))}, {"time": time_s})
    said = of_pair(track, time_s, time_s, sum(pushes.values()), pushes)
    assert any("of which their signs leave 3" in text for text in said) == told


@pytest.mark.parametrize(
    ("levers", "signs", "says"),
    [
        ((1.0, -0.2), (1, -1), None),  # as it is
        ((1.0, -0.2), (1, 1), "but 'two' against the others"),
        ((-0.5, 0.4), (1, 1), "but 'one' against the others"),
        ((1.0, 0.05), (1, 1), None),  # one that hardly moves the body, but swings the sum
        ((0.0, 0.0), (1, 1), "is it the log of another run?"),
    ],
)
def test_a_chamber_with_the_wrong_sign_is_not_the_log_of_another_run(levers, signs, says):
    """Two chambers played apart: their sum is nothing that the body follows, each for itself is."""
    time_s = np.arange(0, 40, 0.05)
    pressures = [20 * (1 + np.sin(0.9 * time_s)), 40 * (1 + np.sin(0.37 * time_s + 1))]
    other = 15 * np.sign(np.sin(1.7 * time_s + 0.5))  # what no chamber does
    angle = sum(lever * p for lever, p in zip(levers, pressures, strict=True)) + (
        other if not any(levers) else 0.1 * other
    )
    track = xr.Dataset({"bend_angle": ("time", angle)})
    pushes = {name: sign * p for name, sign, p in zip(("one", "two"), signs, pressures, strict=True)}
    said = of_pair(track, time_s, time_s, sum(pushes.values()), pushes)
    assert said == [] if says is None else len(said) == 1 and says in said[0]


@pytest.mark.parametrize(
    ("lag_s", "gain", "says"),
    [
        (1.2, 0.8, ["at once and to", "1.2 s later"]),
        (1.2, -0.8, ["1.2 s later", "sign: -1"]),
        (0.2, -0.8, ["sign: -1"]),
        (0.2, 0.8, []),
    ],
)
def test_a_bend_that_lags_by_seconds_or_counts_the_other_way_is_said_to(lag_s, gain, says):
    """A lag above half a second had been called the log of another run, and an angle that falls was fitted in silence."""
    rng = np.random.default_rng(4)
    time_s = np.arange(0, 40, 0.05)
    steps = np.repeat(rng.uniform(0, 80, 40), 20)  # one a second
    angle = 100 + gain * np.interp(time_s - lag_s, time_s, steps) + rng.standard_normal(time_s.size)
    said = of_pair(xr.Dataset({"bend_angle": ("time", angle)}), time_s, time_s, steps)
    assert len(said) == bool(says) and all(text in said[0] for text in says), said
    assert all("only; is it the log" not in text for text in said)
    if says == ["sign: -1"]:
        assert "later" not in said[0]


@pytest.mark.parametrize(
    ("first_kPa", "counted_from_deg", "says"), [(30.0, 15.0, "--angle-zero 15deg"), (30.0, 0.0, ""), (1.0, 0.5, "")]
)
def test_an_angle_that_is_counted_from_a_bent_tube_is_doubted(first_kPa, counted_from_deg, says):
    """Cut out of a longer recording and zeroed at its first frame, it had been the zero of the pressure sensor."""
    time_s = np.arange(0, 20, 0.05)
    pressure = first_kPa + 50 * np.sin(2 * np.pi * time_s / 6) ** 2
    angle = 0.5 * pressure - counted_from_deg
    said = of_pair(xr.Dataset({"bend_angle": ("time", angle)}), time_s, time_s, pressure)
    assert len(said) == bool(says) and all(says in one and "from the first frame" in one for one in said)


def _sines(gain, late_s, periods_s):
    """Angles that follow sines of these periods, so much later."""
    time_s = np.arange(0, 40, 0.05)
    pressures = [40 * (1 + np.sin(2 * np.pi * time_s / period_s)) for period_s in periods_s]
    return [Pair(60 + gain * np.interp(time_s - late_s, time_s, p)[:, None], time_s, time_s, p) for p in pressures]


@pytest.mark.parametrize(("gain", "late_s"), [(-0.5, 1.2), (-0.5, 0.0), (0.5, 1.2)])
def test_runs_together_tell_the_sign_that_none_tells_alone(gain, late_s):
    """Of one sine half a period later does as well; of four with a period each, no delay does."""
    runs = _sines(gain, late_s, (3.0, 4.4, 6.1, 9.0))
    assert all(not together([run, run]) for run in runs)
    said = together(runs)
    assert bool(said) == (gain < 0)
    if said:
        assert "sign: -1" in said and ("1.2 s after" in said) == (late_s > 0)


def test_angles_that_all_fall_are_said_to_by_check(tmp_path):
    for name, run in zip("abc", _sines(-0.5, 1.2, (3.0, 4.4, 6.1)), strict=True):
        folder = tmp_path / name
        folder.mkdir()
        columns = {"time_s": run.log_s, "pressure_kPa": run.pressure_kPa}
        pd.DataFrame(columns).to_csv(folder / "pressure.csv", index=False)
        pd.DataFrame({"time_s": run.time_s, "angle_deg": run.motion[:, 0]}).to_csv(folder / "track.csv", index=False)
        (folder / "experiment.yaml").write_text(
            "format: rfea-experiment/1\nrole: train\npressure: {file: pressure.csv}\ntrack: {file: track.csv}\n"
            "sync: {method: common_clock}\n"
        )
    (tmp_path / "campaign.yaml").write_text(
        "format: rfea-campaign/1\nname: arm\nactuator:\n  length: 155 mm\n  outer_radius: 4 mm\n  inner_radius: 2 mm\n  bends: right\n"
    )
    said = [
        problem.message for problem in check_campaign(tmp_path).problems if "in all 3 runs together" in problem.message
    ]
    assert len(said) == 1 and "give the pressure of every run sign: -1" in said[0]


def test_of_a_sine_nobody_says_that_the_angle_falls():
    """Half a period later it rises with the pressure: a lag does the same as a sensor that counts the other way."""
    time_s = np.arange(0, 40, 0.05)
    pressure = 40 * (1 + np.sin(2 * np.pi * time_s / 3))
    angle = 60 - 0.5 * np.interp(time_s - 0.2, time_s, pressure)
    assert of_pair(xr.Dataset({"bend_angle": ("time", angle)}), time_s, time_s, pressure) == []


def test_a_repeat_that_begins_later_on_its_log_is_one_and_a_run_that_looks_alike_is_no_copy():
    time_s = np.arange(0, 4, 0.01)
    pressure = 50 + 40 * np.sin(3 * time_s) * np.sin(7.1 * time_s)
    first, again = PressureLog(time_s, pressure), PressureLog(time_s[30:] - 7, pressure[30:] + 0.5)
    assert not of_repeat(again, first, "first")
    assert "to 0 % only" in of_repeat(PressureLog(time_s, -pressure), first, "first")
    rng = np.random.default_rng(1)
    parts = (None, None, TrackSpec(Path("track.csv")), PressureSpec(), SyncPart())
    runs = [ExperimentSpec(name, Path(), "train", Actuator(), *parts) for name in ("a", "b", "c")]
    motion = {name: (pressure + 0.001 * rng.standard_normal(400))[:, None] for name in "ab"}
    assert alike(runs, motion | {"c": np.zeros((400, 1))}) == []
    assert [item.name for item, _, _ in alike(runs, motion | {"c": motion["a"][50:200].round(2)})] == ["c"]


def test_a_film_that_goes_dark_or_is_upside_down_is_doubted():
    time_s, copies = np.arange(60) / 30, np.zeros(60, dtype=bool)
    copies[[3, 4, 30]] = True
    assert of_copies(time_s, copies) == []
    copies[26:] = True
    assert "stands still from 0.87 to 1.97 s" in of_copies(time_s, copies)[0]
    tip, valid = np.tile([5.0, 150.0], (60, 1)), ("time", np.ones(60, dtype=bool))
    assert (
        "is the film upside down?"
        in of_upside_down(xr.Dataset({"tip": (("time", "xy"), tip), "valid": valid}), 155.0)[0]
    )
    assert of_upside_down(xr.Dataset({"tip": (("time", "xy"), -tip), "valid": valid}), 155.0) == []


def test_a_film_without_gravity_is_not_called_upside_down():
    """Of a body on a level table it was said that the film is upside down, or that the tube stands."""
    track = xr.Dataset({"tip": (("time", "xy"), np.tile([5.0, 150.0], (9, 1))), "valid": ("time", np.ones(9, dtype=bool))})
    (told,) = of_upside_down(track, 155.0, None)
    assert "write vertical: rest in camera" in told and "upside down" not in told and "gravity: up" not in told
