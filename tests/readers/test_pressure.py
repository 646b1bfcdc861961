from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sqlalchemy
from scipy.io import savemat

from rfea_vision.campaign import PressureSpec
from rfea_vision.campaign.schema import PressurePart, TrackPart
from rfea_vision.errors import InputError
from rfea_vision.readers.pressure import PressureLog, read_pressure
from rfea_vision.readers.tracks import read_track
from rfea_vision.sync import synchronise

TIME_S = np.arange(200) * 0.001
PRESSURE_kPa = 120.0 + 80.0 * np.sin(2 * np.pi * 7.0 * TIME_S)
FRAME = pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa, "lamp": (TIME_S > 0.1).astype(float)})


def write_csv(folder):
    FRAME.to_csv(folder / "p.csv", index=False)
    return PressureSpec(file=folder / "p.csv")


def write_semicolons(folder):
    FRAME.to_csv(folder / "p.csv", index=False, sep=";", decimal=",")
    return PressureSpec(file=folder / "p.csv")


def write_tabs_with_comments(folder):
    (folder / "p.txt").write_text("# rig 3\n" + FRAME.to_csv(index=False, sep="\t"))
    return PressureSpec(file=folder / "p.txt")


def write_parquet(folder):
    FRAME.to_parquet(folder / "p.parquet")
    return PressureSpec(file=folder / "p.parquet")


def write_mat(folder):
    savemat(folder / "p.mat", {"log": {"t": TIME_S, "p": PRESSURE_kPa / 100.0}})
    return PressureSpec(folder / "p.mat", PressurePart(time="log.t", pressure="log.p", unit="bar"))


def write_mdf(folder):
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([Signal(PRESSURE_kPa / 100.0, TIME_S, name="P1", unit="bar")])
        file.save(folder / "p.mf4", overwrite=True)
    return PressureSpec(folder / "p.mf4", PressurePart(pressure="P1"))


def write_database(folder):
    engine = sqlalchemy.create_engine(f"sqlite:///{folder / 'log.db'}")
    frame = pd.DataFrame({"run": 7, "t": TIME_S, "p": PRESSURE_kPa})
    pd.concat([frame, frame.assign(run=8, p=0.0)]).to_sql("log", engine, index=False)
    engine.dispose()
    return PressureSpec(None, PressurePart(url="sqlite:///log.db", query="SELECT t, p FROM log WHERE run = 7"), folder)


@pytest.mark.parametrize(
    "write",
    [write_csv, write_semicolons, write_tabs_with_comments, write_parquet, write_mat, write_mdf, write_database],
)
def test_every_reader_gives_the_same_log(tmp_path, write):
    log = read_pressure(write(tmp_path), "run")
    np.testing.assert_allclose(log.time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa, rtol=1e-9)
    assert log.name == "run"


def test_other_columns_come_along(tmp_path):
    log = read_pressure(write_csv(tmp_path))
    np.testing.assert_array_equal(log.channels["lamp"], FRAME["lamp"])


@pytest.mark.parametrize(
    ("columns", "keys"),
    [
        ({"t": TIME_S, "p": PRESSURE_kPa}, {"time": "t", "pressure": "p"}),
        ({"t": TIME_S, "p": PRESSURE_kPa * 1e3}, {"time": "t", "pressure": "p", "unit": "Pa"}),
        ({"time_ms": TIME_S * 1e3, "p_bar": PRESSURE_kPa / 100}, {"time": "time_ms", "pressure": "p_bar"}),
        ({"t [ms]": TIME_S * 1e3, "p [psi]": PRESSURE_kPa / 6.894757293168}, {"time": "t [ms]", "pressure": "p [psi]"}),
        ({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa + 101.325}, {"reference": "absolute"}),
        ({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa + 99.0}, {"reference": "absolute", "ambient": "99 kPa"}),
        ({"tick": TIME_S * 1e3, "pressure_kPa": PRESSURE_kPa}, {"time": "tick", "time_unit": "ms"}),
    ],
)
def test_columns_and_units_are_chosen(tmp_path, columns, keys):
    pd.DataFrame(columns).to_csv(tmp_path / "p.csv", index=False)
    log = read_pressure(PressureSpec(tmp_path / "p.csv", PressurePart(**keys)))
    np.testing.assert_allclose(log.time_s, TIME_S, atol=1e-12)
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa, rtol=1e-9)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("time_s,pressure_kPa\n", "0 rows; a log of at least two is needed"),
        ("time_s,pressure_kPa\n0,1\n", "1 row;"),
        ("time_s,pressure_kPa\n0,1\n0.1,nan\n0.2,3\n", "pressure, row 2: is not a finite number"),
        ("time_s,pressure_kPa\n0,1\n0.1,\n0.2,3\n", "pressure, row 2: is not a finite number"),
        ("time_s,pressure_kPa\n0,1\nnan,2\n0.2,3\n", "time, row 2: is not a finite number"),
        (
            "time_s,pressure_kPa\n0,1\n0.2,2\n0.1,3\n0.05,3\n",
            "time, row 3: is earlier than the row before (and 1 more row)",
        ),
        (
            "pressure_kPa,time_s\n0,1\n0.1,2\n0.2,1\n",
            "'time_s' goes up and down, and 'pressure_kPa' rises in every row",
        ),
        ("time_s,pressure_kPa\n0,1\n0.1,2\n0.1,3\n", "time, row 3: repeats the row before; remove the duplicate"),
        ("time_s,pressure_kPa\n03/11/2026 12:30:00,1\n03/11/2026 12:30:01,2\n", "day or the month comes first nobody can tell"),
        ("time_s,pressure_kPa\n86398,1\n86399,2\n0,1\n1,4\n", "passes midnight there: add 86400 s from that row on"),
        ("time_s,pressure_kPa\n5,1\n6,2\n0,1\n1,4\n", "clock was set back, add 7 s from that row on"),
        ("time_s,pressure_kPa\n5,1\n6,2\n0,1\n1,4\n0.5,3\n", "sort the log by time, or split it"),
        ("time_s,pressure_kPa\n3,1\n2,2\n1,1\n0,4\n", "turn the order of the rows round"),
        ("time_s,pressure_kPa\n5,1\n5,2\n6,3\n6,2\n", "too coarse for its rows: export it with more decimals"),
        ("time_s,pressure_kPa\n5,1\n5,2\n5,3\n5,2\n6,4\n", "too coarse for its rows: export it with more decimals"),
        ("time_s,pressure_kPa\n0,1\n0.1,full\n", "column 'pressure_kPa', row 2: 'full' is not a number"),
        (
            "time_s,pressure_kpa\n0,1\n0.1,2\n",
            "no column 'pressure_kPa' (pressure.pressure); there are: time_s, pressure_kpa",
        ),
        ("t,pressure_kPa\n0,1\n0.1,2\n", "no column 'time_s' (pressure.time)"),
        ("0,one\n0.1,two\n", ":1: no header line"),
        ("0,1\n0.1,2\n", "no column 'pressure_kPa' (pressure.pressure); there are: c1, c2"),
    ],
)
def test_a_bad_log_is_named_with_row_and_remedy(tmp_path, text, says):
    file = tmp_path / "p.csv"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_pressure(PressureSpec(file=file))
    assert str(caught.value).startswith(str(file)) and says in str(caught.value)


@pytest.mark.parametrize("name", ["p.parquet", "p.mat", "p.mf4"])
def test_a_file_that_is_not_what_its_name_says(tmp_path, name):
    (tmp_path / name).write_bytes(b"not at all what the name says" * 10)
    with pytest.raises(InputError, match=f"{name}.*export it again"):
        read_pressure(PressureSpec(file=tmp_path / name))


def test_unknown_kinds_and_encodings_are_named(tmp_path):
    (tmp_path / "p.xyz").write_text("a")
    with pytest.raises(InputError, match=r"unknown kind of table '.xyz'"):
        read_pressure(PressureSpec(file=tmp_path / "p.xyz"))
    (tmp_path / "p.csv").write_bytes(b"time_s,pressure_kPa\n0,\xe9\n")
    with pytest.raises(InputError, match="row 1: 'é' is not a number"):  # a Windows code page is text, too
        read_pressure(PressureSpec(file=tmp_path / "p.csv"))


@pytest.mark.parametrize(
    ("url", "query", "says"),
    [
        ("sqlite:///gone.db", "SELECT 1", "no database 'gone.db'"),
        ("not a url", "SELECT 1", "is not a database URL"),
        ("sqlite:///log.db", "SELECT t FROM nowhere", "no such table"),
        ("sqlite:///log.db", "SELECT t, p FROM log WHERE run = 99", "returns no rows"),
        ("sqlite:///log.db", "DELETE FROM log", "refuses it"),
        ("madeup://user:secret@host/db", "SELECT 1", "pressure.url"),
    ],
)
def test_a_bad_database_is_named(tmp_path, url, query, says):
    write_database(tmp_path)
    with pytest.raises(InputError) as caught:
        read_pressure(PressureSpec(None, PressurePart(url=url, query=query), tmp_path))
    assert says in str(caught.value) and "secret" not in str(caught.value)
    assert not (tmp_path / "gone.db").exists()


def test_a_real_file_of_another_rig(shared_data):
    spec = PressureSpec(
        Path(shared_data) / "static-pressure-tip" / "OverLapMat.mat",
        PressurePart(time="config(1).x", pressure="config(1).p"),
    )
    with pytest.raises(InputError, match="goes up and down"):  # tip positions are no clock, and that is noticed
        read_pressure(spec)


def _chambers(folder, right_s):
    pd.DataFrame({"time_s": TIME_S, "p1": PRESSURE_kPa}).to_csv(folder / "left.csv", index=False)
    pd.DataFrame({"time_s": right_s, "p2": 3.0 + 2.0 * right_s}).to_csv(folder / "right.csv", index=False)
    right = PressureSpec(folder / "right.csv", PressurePart(pressure="p2", chamber="right", sign=-1))
    bias = PressureSpec(keys=PressurePart(value="5 kPa", chamber="bias"))
    return PressureSpec(folder / "left.csv", PressurePart(pressure="p1", chamber="left"), further=(right, bias))


def test_chambers_are_added_with_their_signs_where_all_have_a_log(tmp_path):
    right_s = np.linspace(TIME_S[0] - 1.0, TIME_S[len(TIME_S) // 2], 50)
    log = read_pressure(_chambers(tmp_path, right_s))
    common = right_s[-1] >= TIME_S
    np.testing.assert_allclose(log.time_s, TIME_S[common])
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa[common] - 3.0 - 2.0 * TIME_S[common] + 5.0, atol=1e-9)
    np.testing.assert_allclose(log.chambers["right"], 3.0 + 2.0 * TIME_S[common], atol=1e-9)
    assert list(log.chambers) == ["left", "right", "bias"]


def test_chambers_whose_logs_do_not_meet_are_refused(tmp_path):
    spec = _chambers(tmp_path, np.linspace(TIME_S[-1] + 1.0, TIME_S[-1] + 2.0, 50))
    with pytest.raises(InputError, match="no time in common"):
        read_pressure(spec)


def test_logs_and_a_track_with_dates_keep_what_lies_between_them(tmp_path):
    """A log from 14:05:25 on, a second chamber and a track from 14:05:30 on: one clock, and their first rows are 5 s apart."""
    seconds = np.arange(0.0, 20.0, 0.1)
    for name, first in (("left", 25), ("right", 30), ("track", 30)):
        frame = pd.DataFrame({"clock": pd.Timestamp(f"2026-03-01 14:05:{first}") + pd.to_timedelta(seconds, unit="s")})
        frame["pressure_kPa"] = frame["angle_deg"] = seconds + (first - 25)
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    left, right = (
        PressureSpec(tmp_path / f"{name}.csv", PressurePart(time="clock", chamber=name), tmp_path)
        for name in ("left", "right")
    )
    log = read_pressure(replace(left, further=(right,)))
    np.testing.assert_allclose(log.time_s[[0, -1]], [5.0, 19.9])
    np.testing.assert_allclose(log.pressure_kPa, 2 * log.time_s)
    track = read_track(tmp_path / "track.csv", spec=TrackPart(time="clock"))
    for method, value_s in (("common_clock", None), ("offset", -1.0)):
        found = synchronise(
            track, read_pressure(left), experiment="a", role="train", bends="left", method=method, value_s=value_s
        )
        np.testing.assert_allclose(found.time_s[0], 5.0 + (value_s or 0.0))


@pytest.mark.parametrize(
    ("channels", "remedy"),
    [(["lamp"], "write sync.channel: lamp"), (["a", "b"], "write sync.channel: NAME"), ([], "record the signal beside")],
)
def test_a_log_without_the_column_of_a_signal_is_told_what_can_be_done(channels, remedy):
    """Of one with time and pressure alone it was said that the column is to be named."""
    log = PressureLog(np.arange(3.0), np.zeros(3), channels={name: np.zeros(3) for name in channels})
    with pytest.raises(InputError, match=f"no column 'trigger' .*; {remedy}"):
        log.signal("trigger", None)


@pytest.mark.parametrize(
    "written",
    [
        ["2026-11-03 14:03:11,500", "2026-11-03 14:03:12", "2026-11-03 14:03:12,25"],
        ["3.11.2026 14:03:11.500", "3.11.2026 14:03:12", "3.11.2026 14:03:12,25"],
        ["14:03:11.500", "14:03:12", "14:03:12,25"],
        ["23:59:59,5", "0:00:00", "00:00:00.25"],
        ["11:59:59.5 AM", "12:00:00 PM", "12:00:00.25 p.m."],
        ["2026-11-03 11:59:59.5 PM", "2026-11-04 12:00:00 AM", "2026-11-04 12:00:00.25 AM"],
    ],
    ids=["decimal comma", "dots", "time of the day", "over midnight", "twelve hours", "twelve hours with a date"],
)
def test_clock_times_are_read_as_loggers_write_them(tmp_path, written):
    """Each was refused with the advice to export it otherwise."""
    file = tmp_path / "log.csv"
    file.write_text("Zeit;Druck [bar]\n" + "".join(f"{moment};0,{k}\n" for k, moment in enumerate(written)))
    log = read_pressure(PressureSpec(file, PressurePart(time="Zeit", pressure="Druck [bar]"), tmp_path))
    np.testing.assert_allclose(log.time_s, [0.0, 0.5, 0.75])
    np.testing.assert_allclose(log.pressure_kPa, [0.0, 10.0, 20.0])
