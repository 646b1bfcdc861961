"""One motion, written as every kind of file there is: each reader gives it back, and says in a sentence what it lacks."""

import builtins
import re
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from rfea_vision.campaign.guess import look
from rfea_vision.campaign.schema import PressurePart, TrackPart
from rfea_vision.campaign.specs import PressureSpec
from rfea_vision.errors import InputError
from rfea_vision.readers.kinds import own
from rfea_vision.readers.pressure import read_pressure
from rfea_vision.readers.tables import KINDS, kind_of, read_table
from rfea_vision.readers.tracks import read_track
from testing.written import (
    LOGS,
    MARKS,
    POSES,
    TIME_S,
    PRESSURE_kPa,
    SCALE_mm,
    TIP_mm,
    write_bag,
    write_c3d,
    write_csv,
    write_dlc,
    write_dlc_text,
    write_sleap,
)


@pytest.mark.parametrize("write", LOGS)
def test_a_log_comes_back(tmp_path, write):
    log = read_pressure(write(tmp_path))
    np.testing.assert_allclose(log.time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa, rtol=1e-9)


@pytest.mark.parametrize("write", POSES)
def test_poses_become_a_track(tmp_path, write):
    spec = write(tmp_path)
    precise = 1e-3 if spec.file.suffix == ".c3d" else 1e-9  # c3d keeps 32 bits
    keys = spec.keys.model_copy(update={"points": spec.keys.points or list(MARKS)})
    track = read_track(spec.file, spec=keys)
    np.testing.assert_allclose(track.time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(track.dataset["tip"], TIP_mm, atol=precise)
    nodes = track.dataset["midline"].values
    assert nodes.shape[1:] == (7, 2)
    steps = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[:, :1], steps.shape), rtol=0.02)
    np.testing.assert_allclose(steps.sum(axis=1), 155.0, rtol=0.03)


def test_an_encoder_of_a_robot_is_a_track_on_its_own_clock(tmp_path):
    """A joint's position is in rad by the message's definition, and its times are those of its messages."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    message, header, stamp = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    angle, none = 0.3 * np.sin(TIME_S), np.zeros(0)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/finger", message.__msgtype__, typestore=store)
        for time, value in zip(TIME_S, angle, strict=True):
            ns = round((1000.0 + time) * 1e9)
            head = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            state = message(head, ["bend"], np.array([value]), none, none)
            writer.write(topic, ns + 3_000_000, store.serialize_cdr(state, message.__msgtype__))
    file = next((tmp_path / "bag").glob("*.mcap"))
    guessed = look(file)
    assert guessed.what == "track" and {key.name: key.value for key in guessed.motion}["angle"] == "/finger.position(1)"
    track = read_track(file, spec=TrackPart(angle="/finger.position(1)"))
    np.testing.assert_allclose(track.time_s, TIME_S, atol=1e-6)
    np.testing.assert_allclose(np.deg2rad(track.dataset["bend_angle"]), angle, atol=1e-12)


def test_every_kind_has_its_file_here(tmp_path):
    found = set()
    for write in (*LOGS, *POSES):
        folder = tmp_path / write.__name__
        folder.mkdir()
        found.add(kind_of(write(folder).file))
    assert found == set(KINDS) - set(own.KINDS)  # that of our own tracks has it in test_tracks.py


@pytest.mark.parametrize("write", [write_bag, write_c3d])
def test_a_missing_extra_is_one_sentence(tmp_path, write, monkeypatch):
    file = write(tmp_path).file
    kind, usual = kind_of(file), builtins.__import__

    def without(name, *rest):
        if name.split(".")[0] in ("rosbags", "ezc3d"):
            raise ModuleNotFoundError(f"No module named '{name}'", name=name.split(".")[0])
        return usual(name, *rest)

    monkeypatch.setattr("rfea_vision.readers.tables.serving", lambda: True)  # read here, where the extra can be hidden
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=rf"pip install 'rfea-vision\[{kind.extra}\]'"):
        read_table(file)


@pytest.mark.parametrize("ending", sorted({ending for kind in KINDS for ending in kind.endings}))
def test_a_file_that_is_not_what_its_name_says(tmp_path, ending):
    file = tmp_path / f"log{ending}"
    file.write_bytes(b"\x00\x01 not at all\n" * 20)
    with pytest.raises(InputError) as caught:
        read_pressure(PressureSpec(file=file))
    assert str(caught.value).startswith(str(file)) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ",")])
def test_a_table_of_deeplabcut_that_a_spreadsheet_saved_again_is_read(tmp_path, separator, point):
    spec = write_dlc_text(tmp_path)
    text = spec.file.read_text().replace(",", separator)
    spec.file.write_bytes(re.sub(r"(?<=\d)\.(?=\d)", point, text).encode("utf-8-sig"))
    track = read_track(spec.file, spec=spec.keys.model_copy(update={"points": ["clamp", "tip"]}))
    np.testing.assert_allclose(track.dataset["tip"].values, TIP_mm, atol=1e-9)


def test_no_code_in_a_file_is_run(tmp_path):
    spec = write_dlc(tmp_path)
    with h5py.File(spec.file, "r+") as file:
        file["df_with_missing/table"].attrs["values_block_0_kind"] = np.bytes_(b"cos\nsystem\n(Vtouch ran\ntR.")
    with pytest.raises(InputError, match=r"holds an object of os\.system"):
        read_table(spec.file)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, "track.points: name those from the clamp to the tip, for example 'points: [clamp, tip]'"),
        ({"points": ["clamp", "tipp"]}, "no 'tipp'; there are: clamp, m1, m2, tip; did you mean 'tip'?"),
        ({"points": ["clamp", "tip"], "scale": None}, "track.scale: is missing; positions are pixels"),
        ({"points": ["clamp", "tip"], "rate": None}, "track.rate: is missing"),
        ({"points": ["clamp", "tip"], "scale": None, "rate": None}, "calibration; track.rate: is missing"),
        ({"points": ["tip"]}, "track.origin: is missing"),
        ({"points": ["clamp", "tip"], "axes": ("x", "z")}, "track.axes"),
    ],
)
def test_what_poses_lack_is_said(tmp_path, changes, says):
    spec = write_sleap(tmp_path)
    with pytest.raises(InputError) as caught:
        read_track(spec.file, spec=spec.keys.model_copy(update=changes))
    assert says in str(caught.value)


def test_a_camera_turns_pixels_into_mm_and_a_doubtful_point_is_a_gap(tmp_path):
    spec = write_sleap(tmp_path)
    with h5py.File(spec.file, "r+") as file:
        file["point_scores"][0, 3, 5] = 0.1
    keys = spec.keys.model_copy(update={"points": ["clamp", "tip"], "scale": None})
    track = read_track(spec.file, spec=keys, to_rig_mm=lambda px: px * [SCALE_mm, -SCALE_mm])
    assert not track.valid[5] and track.valid.sum() == len(TIME_S) - 1
    np.testing.assert_allclose(track.dataset["tip"].values[track.valid], TIP_mm[track.valid], atol=1e-9)


def test_groups_of_columns_are_points(tmp_path, shared_data):
    beam = Path(shared_data) / "clamped-beam" / "gravity_a.csv"
    tips, bases = ([f"{name}{i}" for i in (1, 2, 3)] for name in ("tip", "base"))
    track = read_track(beam, spec=TrackPart(points=[bases, tips], axes=("x", "-z")))
    frame = pd.read_csv(beam)
    across = (
        frame[[f"{name}_x_mm" for name in tips]].mean(axis=1)
        - frame[[f"{name}_x_mm" for name in bases]].mean(axis=1).median()
    )
    np.testing.assert_allclose(track.dataset["tip"].values[:, 0], across, atol=1e-9)
    assert np.ptp(track.dataset["tip"].values[:, 0]) > 10.0


def test_another_tools_midlines(shared_data):
    file = Path(shared_data) / "worm-midlines" / "datasets" / "sample_data" / "features.h5"
    track = read_track(file, spec=TrackPart(points="all", scale="0.01 mm", rate="30 Hz"))
    assert (~track.valid).sum() == 280 and len(track.time_s) == 1000


@pytest.mark.parametrize(
    "text",
    [
        "time_s;pressure_kPa\n0;100,5\n0,1;110,25\n0,2;98\n",
        "time_s\tpressure_kPa\n0\t100,5\n0,1\t110,25\n0,2\t98\n",
        'time_s,pressure_kPa\n"0","100,5"\n"0,1","110,25"\n"0,2","98"\n',
        "Prüfstand 3;\nDatum: 01.03.2026\nRate;1000\n\ntime_s;pressure_kPa\n0;100,5\n0,1;110,25\n0,2;98\n",
        "time_s;pressure_kPa\n[s];[kPa]\n0;100,5\n0,1;110,25\n0,2;98\n",
        "time_s;pressure_kPa\ns;mbar\n0;1.005,0\n0,1;1.102,5\n0,2;980,0\n",
        "time_s   pressure_kPa\n0   100,5\n0,1 110,25\n0,2   98\n",
        "time_s;pressure_kPa;\n0;100.5;\n0.1;110.25;\n0.2;98;\n",
        "time_s,pressure_kPa\n2026-03-01 14:05:30.0,100.5\n2026-03-01 14:05:30.1,110.25\n2026-03-01 14:05:30.2,98\n",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_numbers_as_people_elsewhere_write_them(tmp_path, text, encoding):
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    log = read_pressure(PressureSpec(file=tmp_path / "log.csv"))
    np.testing.assert_allclose(log.time_s, [0.0, 0.1, 0.2], atol=1e-9)
    np.testing.assert_allclose(log.pressure_kPa, [100.5, 110.25, 98.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("columns", "keys"),
    [
        ({"p_hPa": PRESSURE_kPa * 10}, {}),
        ({"p [mbar]": PRESSURE_kPa * 10}, {}),
        ({"p [bar(a)]": (PRESSURE_kPa + 101.325) / 100}, {}),
        ({"p [kPa abs]": PRESSURE_kPa + 101.325}, {}),
        ({"p_kPa_abs": PRESSURE_kPa + 101.325}, {}),
        ({"Druck [bar absolut]": (PRESSURE_kPa + 101.325) / 100}, {}),
        ({"p (mbar rel.)": PRESSURE_kPa * 10}, {}),
        ({"Pressure (Pa), Point: 3": PRESSURE_kPa * 1000}, {}),
        ({"p [hPa] valve_a": PRESSURE_kPa * 10}, {}),
        ({"p_psig": PRESSURE_kPa / 6.894757293168361}, {}),
        ({"p": (PRESSURE_kPa + 97.5) / 100, "amb": np.full(120, 0.975)}, {"unit": "bara", "ambient": "amb"}),
        (
            {"p_kPa": PRESSURE_kPa + 97.5, "amb_mbar": np.full(120, 975.0)},
            {"reference": "absolute", "ambient": "amb_mbar"},
        ),
        ({"p_psia": PRESSURE_kPa / 6.894757293168361}, {"reference": "gauge"}),
    ],
)
def test_units_and_what_pressure_is_measured_against(tmp_path, columns, keys):
    pd.DataFrame({"time_s": TIME_S, **columns}).to_csv(tmp_path / "log.csv", index=False)
    log = read_pressure(PressureSpec(tmp_path / "log.csv", PressurePart(pressure=next(iter(columns)), **keys)))
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa, rtol=1e-9, atol=1e-9)


def test_an_ambient_column_that_is_not_there(tmp_path):
    spec = write_csv(tmp_path)
    with pytest.raises(InputError, match=r"no column 'room' \(pressure.ambient\); .* '.*ambient: NAME.*'$"):  # not the pressure itself
        read_pressure(PressureSpec(spec.file, PressurePart(reference="absolute", ambient="room")))


def test_frames_of_an_unsure_tracker_say_so(tmp_path):
    spec = write_sleap(tmp_path)
    with h5py.File(spec.file, "r+") as file:
        file["point_scores"][0, 1, 7] = 0.2
        file["tracks"][0, :, 2, 9] = np.nan
    track = read_track(spec.file, spec=spec.keys.model_copy(update={"points": list(MARKS)}))
    assert list(track.dataset["reason"].values[6:10]) == ["", "low_confidence", "", "not_tracked"]


@pytest.mark.parametrize("x_columns", ["No", "One"])
def test_an_empty_cell_of_labview_leaves_its_row_out(tmp_path, x_columns):
    head = f"LabVIEW Measurement\nSeparator\tTab\nX_Columns\t{x_columns}\n***End_of_Header***\n"
    keys = "X0\t0\t0\nDelta_X\t0.1\t0.1\n***End_of_Header***\n"
    rows = [[0.0, 10, 1], [0.1, "", 2], [0.2, 12, 3]]
    cells = [row if x_columns == "One" else ["", *row[1:]] for row in rows]
    body = "\n".join("\t".join(map(str, row)) for row in [["X_Value", "p", "p"], *cells])
    (tmp_path / "a.lvm").write_text(head + keys + body + "\n")
    table = read_table(tmp_path / "a.lvm")
    np.testing.assert_allclose(table.times_s["p"], [0.0, 0.2])
    np.testing.assert_allclose(table.columns["p"], [10, 12])
    np.testing.assert_allclose(table.columns["p.1"], [1, 2, 3])  # a second channel of the same name is a second one


def test_files_of_one_run_that_begin_apart_are_brought_to_one_clock(tmp_path):
    from asammdf import MDF, Signal

    for name, begun in (("log", 7), ("track", 10)):
        with MDF(version="4.10") as file:
            file.header.start_time = datetime(2026, 3, 1, 12, 0, begun, tzinfo=UTC)
            file.append([Signal(PRESSURE_kPa, TIME_S, name="p", unit="kPa"), Signal(TIME_S, TIME_S, name="bend", unit="deg")])
            file.save(tmp_path / f"{name}.mf4", overwrite=True)
    log = read_pressure(PressureSpec(tmp_path / "log.mf4", PressurePart(pressure="p")))
    track = read_track(tmp_path / "track.mf4", spec=TrackPart(angle="bend"))
    assert log.zero_apart_s(track.dataset.attrs["clock_zero_s"]) == pytest.approx(3.0)


def test_channels_of_one_name_are_all_there(tmp_path):
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        for factor in (1, 2):
            file.append([Signal(factor * PRESSURE_kPa, TIME_S, name="p", unit="bar")])
        file.save(tmp_path / "a.mf4", overwrite=True)
    table = read_table(tmp_path / "a.mf4")
    np.testing.assert_allclose(table.columns["p.1"], 2 * table.columns["p"])
    assert table.units == {"p": "bar", "p.1": "bar"}
    (tmp_path / "a.csv").write_text("time_s,p [bar],p [bar]\n0,1,2\n1,1,2\n")
    np.testing.assert_allclose(
        read_pressure(PressureSpec(tmp_path / "a.csv", PressurePart(pressure="p [bar].1"))).pressure_kPa, 200
    )


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("Sample #;pressure_kPa;note\n1;2.5;run #3\n2;3.5;\n", [2.5, 3.5]),
        ("# rig 3\n# time_s;pressure_kPa\n0;2.5\n1;3.5\n", [2.5, 3.5]),
        ("% from MATLAB, 27-Nov-2026\n% time_s,pressure_kPa\n0,2.5\n1,3.5\n", [2.5, 3.5]),
        ("% time_s,pressure_kPa\n% written by export.m\n0,2.5\n1,3.5\n", [2.5, 3.5]),
        ("% Version:       COMSOL 6.1\n% Time (s)       pressure_kPa\n0                2.5\n1                3.5\n", [2.5, 3.5]),
        ("% Point: 3, 4\ntime_s,pressure_kPa\n0,2.5\n% pump on\n1,3.5\n", [2.5, 3.5]),
        ("# rig 3\n# time_s pressure_kPa\n# ------ ------------\n0 2.5\n1 3.5\n", [2.5, 3.5]),
        ("# rig 3, of 4\n" * 240 + "time_s,pressure_kPa\n0,2.5\n1,3.5\n", [2.5, 3.5]),
        ("%,time_s,pressure_kPa\n50,0,2.5\n51,1,3.5\n", [2.5, 3.5]),
        ("%\ttime_s\tpressure_kPa\n50\t0\t2.5\n51\t1\t3.5\n", [2.5, 3.5]),
        ("%\ttime_s\tpressure_kPa\n0\t2.5\n1\t3.5\n", [2.5, 3.5]),
        ("# Channels\t1\nX_Value\tpressure_kPa\tComment\n0.0\t2.5\t\n0.1\t3.5\t\n", [2.5, 3.5]),
        ("time_s;pressure_kPa\n0,5;1.002,5\n1;1.003\n", [1002.5, 1003.0]),
    ],
)
def test_signs_that_mean_two_things_in_text(tmp_path, text, wanted):
    (tmp_path / "a.csv").write_text(text)
    np.testing.assert_allclose(read_table(tmp_path / "a.csv").numbers("pressure_kPa"), wanted)


@pytest.mark.parametrize(
    "text",
    ["%,time_s,p\n50,0,2\n51,1,3\n", "%\ttime_s\tp\n50\t0\t2\n51\t1\t3\n", "# ; time_s; p\n50;0;2\n51;1;3\n"],
)
def test_a_sign_that_is_a_column_of_its_own_names_it(tmp_path, text):
    """Percent: the column was called 'Unnamed: 0', or all three c1 to c3."""
    (tmp_path / "a.csv").write_text(text)
    table = read_table(tmp_path / "a.csv")
    assert list(table.columns) == [text[0], "time_s", "p"] and table.numbers(text[0]).tolist() == [50.0, 51.0]


def test_units_in_a_comment_below_a_header_in_one(tmp_path):
    (tmp_path / "a.csv").write_text("# rig 3\n# time,pressure\n# s,bar\n0,2.5\n1,3.5\n")
    assert read_table(tmp_path / "a.csv").units == {"time": "s", "pressure": "bar"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("% a\n# b\n", "holds nothing but comments; export the table"),
        ("Rig three log\nTime Pressure kPa\n0 1.5\n1 2\n", "'0' begins the first row of numbers, of which there are 2"),
    ],
)
def test_text_without_a_table_is_told_what_it_lacks(tmp_path, text, said):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_table(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("first", "odd", "fault"),
    [
        ("2,5", "1.5", "has a point among numbers with decimal commas"),
        ("1.000,5", "1.5", "has a point among numbers with decimal commas"),
        ("2,5", "1.500", "has a point among numbers with decimal commas"),
        ("1.000,5", "01.03.2026", "is not a number"),
        ("2,5", "full", "is not a number"),
    ],
)
def test_a_point_is_not_read_over_among_decimal_commas(tmp_path, first, odd, fault):
    rows = "".join(f"{row},0;2,5\n" for row in range(1, 300))
    (tmp_path / "a.csv").write_text(f"time_s;pressure_kPa\n0,0;{first}\n{rows}300,0;{odd}\n")
    with pytest.raises(InputError, match=f"row 301: '{odd}' {fault}"):
        read_table(tmp_path / "a.csv").numbers("pressure_kPa")


@pytest.mark.parametrize("more", [{"rate_Hz": 1.0}, {"force_z": 1.0}, {"force_x": 1.0, "force_y": 1.0, "force_z": 1.0}])
def test_other_columns_do_not_put_points_into_space(tmp_path, more):
    """Nor is the column of time that is named forgotten beside points."""
    columns = {"t [ms]": 1e3 * TIME_S} | {f"a_{axis}_mm": 0.0 * TIME_S for axis in "xy"}
    columns |= {"b_x_mm": TIP_mm[:, 0], "b_y_mm": TIP_mm[:, 1]}
    pd.DataFrame(columns | more).to_csv(tmp_path / "a.csv", index=False)
    track = read_track(tmp_path / "a.csv", spec=TrackPart(points=["a", "b"], time="t [ms]"))
    np.testing.assert_allclose(track.dataset["tip"], TIP_mm)
    np.testing.assert_allclose(track.time_s, TIME_S)


@pytest.mark.parametrize(
    ("key", "given"),
    [("rate", {"rate": "120 Hz"}), ("scale", {"scale": "0.1 mm"}), ("origin", {"origin": [0.0, 0.0]}),
     ("axes", {"axes": ("x", "-y")}), ("individual", {"individual": "a"}), ("confidence", {"confidence": 0.9})],
)  # fmt: skip
def test_what_is_said_of_points_that_there_are_not_is_refused(tmp_path, key, given):
    pd.DataFrame({"time_s": TIME_S, "angle_deg": TIME_S}).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(InputError, match=f"track.{key}: means nothing without 'points'"):
        read_track(tmp_path / "a.csv", spec=TrackPart(**given))


def test_columns_of_any_name_are_a_point(tmp_path):
    """Of a table without a header, with a clock of its own; the clamp and the tip, in mm."""
    time = np.arange(60) / 100
    tip = np.stack([-20 * np.sin(time), -100 * np.cos(time)], axis=1)
    np.savetxt(tmp_path / "raw.txt", np.column_stack([1e3 * time, np.full((60, 2), 3.0), np.ones(60), tip + 3.0]))
    keys = TrackPart(points=["c2,c3", "c5, c6"], scale="1 mm", time="c1", time_unit="ms")
    track = read_track(tmp_path / "raw.txt", spec=keys)
    np.testing.assert_allclose(track.dataset["tip"], tip, atol=1e-9)
    np.testing.assert_allclose(track.time_s, time, atol=1e-9)
    with pytest.raises(InputError, match=r"c1, c2, .*written as their names, 'c2,c3'"):
        read_track(tmp_path / "raw.txt", spec=keys.model_copy(update={"points": ["c2,c9", "c7,c8"]}))


@pytest.mark.parametrize("names", ["t;p", "Zeit;Druck"])
def test_two_words_above_a_header_are_not_taken_for_it(tmp_path, names):
    """Of an instrument's head that ends with two cells the header was read as its units: 'no column p; there are: Operator, Smith'."""
    (tmp_path / "a.csv").write_text(f"Rig;3\nOperator;Smith\n{names}\n0,0;2,5\n0,1;3,5\n")
    assert list(read_table(tmp_path / "a.csv").columns) == names.split(";")
