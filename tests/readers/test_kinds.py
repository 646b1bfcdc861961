"""One motion, written as every kind of file there is: each reader gives it back, and says in a sentence what it lacks."""

import builtins
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from rfea_vision.campaign.specs import PressureSpec, TrackSpec
from rfea_vision.errors import InputError
from rfea_vision.readers.pressure import read_pressure
from rfea_vision.readers.tables import KINDS, kind_of, read_table
from rfea_vision.readers.tracks import read_track

RATE_Hz = 100.0
TIME_S = np.arange(120) / RATE_Hz
PRESSURE_kPa = 120.0 + 80.0 * np.sin(2 * np.pi * 1.5 * TIME_S)
CLAMP = np.array([400.0, 100.0])
MARKS = ("clamp", "m1", "m2", "tip")
SCALE_mm = 0.25


def swing():
    """An arc of 155 mm that swings, as four marks in px with y down: (time, mark, xy)."""
    angle = 1.2 * np.sin(2 * np.pi * 0.8 * TIME_S)[:, None] + 1e-6
    along = np.linspace(0.0, 155.0, 4)
    phi = angle * along / 155.0
    radius = 155.0 / angle
    mm = np.stack([-radius * (1 - np.cos(phi)), -radius * np.sin(phi)], axis=2)
    return CLAMP + mm * [1.0, -1.0] / SCALE_mm


PIXELS = swing()
TIP_mm = (PIXELS[:, -1] - CLAMP) * [1.0, -1.0] * SCALE_mm


def write_csv(folder):
    frame = pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa})
    frame.to_csv(folder / "log.csv", index=False)
    return PressureSpec(file=folder / "log.csv")


def write_parquet(folder):
    pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa}).to_parquet(folder / "log.parquet")
    return PressureSpec(file=folder / "log.parquet")


def write_mdf(folder):
    mdf = pytest.importorskip("asammdf")
    with mdf.MDF(version="4.10") as file:
        file.append([mdf.Signal(PRESSURE_kPa * 10.0, TIME_S, name="P1", unit="hPa")])
        file.save(folder / "log.mf4", overwrite=True)
    return PressureSpec(file=folder / "log.mf4", pressure="P1")


def write_mat(folder):
    savemat(folder / "log.mat", {"log": {"t": TIME_S, "p": PRESSURE_kPa / 100.0}})
    return PressureSpec(file=folder / "log.mat", time="log.t", pressure="log.p", unit="bar")


def write_mat73(folder):
    """As MATLAB writes ``save('log.mat', 'log', 'cells', '-v7.3')``: HDF5 behind 512 bytes, arrays transposed."""
    with h5py.File(folder / "log.mat", "w", userblock_size=512) as file:
        for name, values in {"t": TIME_S, "p": PRESSURE_kPa / 100.0}.items():
            file.create_dataset(f"log/{name}", data=values[None, :]).attrs["MATLAB_class"] = b"double"
            file.create_dataset(f"#refs#/{name}", data=values[:, None]).attrs["MATLAB_class"] = b"double"
        cells = file.create_dataset("cells", (2, 1), dtype=h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = b"cell"
        cells[0, 0], cells[1, 0] = file["#refs#/t"].ref, file["#refs#/p"].ref
        runs = file.create_dataset("runs/p", (1, 2), dtype=h5py.ref_dtype)
        runs[0, 0], runs[0, 1] = file["#refs#/t"].ref, file["#refs#/p"].ref
        file.create_dataset("note", data=np.array([[82], [49]], dtype=np.uint16)).attrs["MATLAB_class"] = b"char"
    with (folder / "log.mat").open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return PressureSpec(file=folder / "log.mat", time="log.t", pressure="runs(2).p", unit="bar")


def write_bag(folder):
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    message = kinds["sensor_msgs/msg/FluidPressure"]
    header, stamp = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/pressure", message.__msgtype__, typestore=store)
        for time, pressure in zip(TIME_S, PRESSURE_kPa, strict=True):
            ns = 1_700_000_000_000_000_000 + round(time * 1e9)
            head = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            raw = store.serialize_cdr(message(head, 1e3 * pressure, 0.0), message.__msgtype__)
            writer.write(topic, ns + 3_000_000, raw)
    return PressureSpec(file=next((folder / "bag").glob("*.mcap")), pressure="/pressure.fluid_pressure")


def write_dlc_text(folder):
    names = [("net", part, axis) for part in MARKS for axis in ("x", "y", "likelihood")]
    values = np.concatenate([PIXELS, np.full((*PIXELS.shape[:2], 1), 0.99)], axis=2).reshape(len(TIME_S), -1)
    frame = pd.DataFrame(values, columns=pd.MultiIndex.from_tuples(names, names=["scorer", "bodyparts", "coords"]))
    frame.to_csv(folder / "dlc.csv")
    return TrackSpec(folder / "dlc.csv", scale_mm=SCALE_mm, rate_Hz=RATE_Hz)


def write_dlc(folder):
    """As pandas and PyTables lay it out: one block of values, the names of its columns pickled in protocol 0."""
    names = [("net", part, axis) for part in MARKS for axis in ("x", "y", "likelihood")]
    values = np.concatenate([PIXELS, np.full((*PIXELS.shape[:2], 1), 0.99)], axis=2).reshape(len(TIME_S), -1)
    table = np.zeros(len(TIME_S), dtype=[("index", "i8"), ("values_block_0", "f8", (values.shape[1],))])
    table["values_block_0"] = values
    pickled = "(lp0\n" + "".join("(" + "".join(f"V{word}\n" for word in name) + "ta" for name in names) + "."
    with h5py.File(folder / "dlc.h5", "w") as file:
        file.create_dataset("df_with_missing/table", data=table).attrs["values_block_0_kind"] = np.bytes_(pickled)
    return TrackSpec(folder / "dlc.h5", scale_mm=SCALE_mm, rate_Hz=RATE_Hz)


def write_sleap(folder):
    with h5py.File(folder / "sleap.h5", "w") as file:
        file["tracks"] = PIXELS.transpose(2, 1, 0)[None]
        file["node_names"] = [name.encode() for name in MARKS]
        file["point_scores"] = np.full((1, *PIXELS.shape[1::-1]), 0.9)
    return TrackSpec(folder / "sleap.h5", scale_mm=SCALE_mm, rate_Hz=RATE_Hz)


def write_tierpsy(folder):
    rows = np.zeros(len(TIME_S), dtype=[("worm_index", "i4"), ("timestamp", "i4")])
    rows["timestamp"] = np.arange(len(TIME_S))
    with h5py.File(folder / "tube_featuresN.hdf5", "w") as file:
        file["coordinates/skeletons"] = PIXELS * SCALE_mm * 1000.0
        file["timeseries_data"] = rows
        file["timeseries_data"].attrs["fps"] = RATE_Hz
    return TrackSpec(folder / "tube_featuresN.hdf5", points=(("all",),))


def write_movement(folder):
    import xarray as xr

    position = PIXELS.transpose(0, 2, 1)[..., None]
    dataset = xr.Dataset(
        {
            "position": (("time", "space", "keypoints", "individuals"), position),
            "confidence": (("time", "keypoints", "individuals"), np.full((len(TIME_S), 4, 1), 0.9)),
        },
        {"time": TIME_S, "space": ["x", "y"], "keypoints": list(MARKS), "individuals": ["tube"]},
        {"fps": RATE_Hz, "time_unit": "seconds", "ds_type": "poses", "source_software": "SLEAP"},
    )
    dataset.to_netcdf(folder / "poses.nc", engine="h5netcdf")
    return TrackSpec(folder / "poses.nc", scale_mm=SCALE_mm)


def write_c3d(folder):
    """Markers in mm; the tube's downwards is the file's -z, and the third axis carries nothing."""
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    mm = (PIXELS - CLAMP) * [1.0, -1.0] * SCALE_mm
    space = np.stack([mm[..., 0], np.full(mm.shape[:2], 30.0), mm[..., 1], np.ones(mm.shape[:2])])
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE_Hz]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(MARKS)
    file["data"]["points"] = space.transpose(0, 2, 1)
    file["parameters"]["ANALOG"]["RATE"]["value"] = [RATE_Hz]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = ["P1"]
    file["parameters"]["ANALOG"]["UNITS"]["value"] = ["kPa"]
    file["data"]["analogs"] = PRESSURE_kPa[None, None, :]
    file.write(str(folder / "run.c3d"))
    return TrackSpec(folder / "run.c3d", axes=("x", "z"))


LOGS = [write_csv, write_parquet, write_mdf, write_mat, write_mat73, write_bag]
POSES = [write_dlc_text, write_dlc, write_sleap, write_tierpsy, write_movement, write_c3d]


@pytest.mark.parametrize("write", LOGS)
def test_a_log_comes_back(tmp_path, write):
    log = read_pressure(write(tmp_path))
    np.testing.assert_allclose(log.time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa, rtol=1e-9)


@pytest.mark.parametrize("write", POSES)
def test_poses_become_a_track(tmp_path, write):
    spec = write(tmp_path)
    precise = 1e-3 if spec.file.suffix == ".c3d" else 1e-9  # c3d keeps 32 bits
    spec = TrackSpec(**{**vars(spec), "points": spec.points or tuple((name,) for name in MARKS)})
    track = read_track(spec.file, spec=spec)
    np.testing.assert_allclose(track.time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(track.dataset["tip"], TIP_mm, atol=precise)
    nodes = track.dataset["midline"].values
    assert nodes.shape[1:] == (7, 2)
    steps = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[:, :1], steps.shape), rtol=0.02)
    np.testing.assert_allclose(steps.sum(axis=1), 155.0, rtol=0.03)


def test_every_kind_has_its_file_here(tmp_path):
    found = set()
    for write in (*LOGS, *POSES):
        folder = tmp_path / write.__name__
        folder.mkdir()
        found.add(kind_of(write(folder).file))
    assert found == set(KINDS)


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
        ({"points": (("clamp",), ("tipp",))}, "no 'tipp'; there are: clamp, m1, m2, tip; did you mean 'tip'?"),
        ({"points": (("clamp",), ("tip",)), "scale_mm": None}, "track.scale: is missing; positions are pixels"),
        ({"points": (("clamp",), ("tip",)), "rate_Hz": None}, "track.rate: is missing"),
        ({"points": (("tip",),)}, "track.origin: is missing"),
        ({"points": (("clamp",), ("tip",)), "axes": ("x", "z")}, "track.axes"),
    ],
)
def test_what_poses_lack_is_said(tmp_path, changes, says):
    spec = write_sleap(tmp_path)
    with pytest.raises(InputError) as caught:
        read_track(spec.file, spec=TrackSpec(**{**vars(spec), **changes}))
    assert says in str(caught.value)


def test_a_camera_turns_pixels_into_mm_and_a_doubtful_point_is_a_gap(tmp_path):
    spec = write_sleap(tmp_path)
    with h5py.File(spec.file, "r+") as file:
        file["point_scores"][0, 3, 5] = 0.1
    spec = TrackSpec(**{**vars(spec), "points": (("clamp",), ("tip",)), "scale_mm": None})
    track = read_track(spec.file, spec=spec, to_rig_mm=lambda px: px * [SCALE_mm, -SCALE_mm])
    assert not track.valid[5] and track.valid.sum() == len(TIME_S) - 1
    np.testing.assert_allclose(track.dataset["tip"].values[track.valid], TIP_mm[track.valid], atol=1e-9)


def test_groups_of_columns_are_points(tmp_path, shared_data):
    beam = Path(shared_data) / "clamped-beam" / "gravity_a.csv"
    tips, bases = (tuple(f"{name}{i}" for i in (1, 2, 3)) for name in ("tip", "base"))
    track = read_track(beam, spec=TrackSpec(beam, points=(bases, tips), axes=("x", "-z")))
    frame = pd.read_csv(beam)
    across = (
        frame[[f"{name}_x_mm" for name in tips]].mean(axis=1)
        - frame[[f"{name}_x_mm" for name in bases]].mean(axis=1).median()
    )
    np.testing.assert_allclose(track.dataset["tip"].values[:, 0], across, atol=1e-9)
    assert np.ptp(track.dataset["tip"].values[:, 0]) > 10.0


def test_another_tools_midlines(shared_data):
    file = Path(shared_data) / "worm-midlines" / "datasets" / "sample_data" / "features.h5"
    track = read_track(file, spec=TrackSpec(file, points=(("all",),), scale_mm=0.01, rate_Hz=30.0))
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
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
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
    log = read_pressure(PressureSpec(file=tmp_path / "log.csv", pressure=next(iter(columns)), **keys))
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa, rtol=1e-9, atol=1e-9)


def test_an_ambient_column_that_is_not_there(tmp_path):
    spec = write_csv(tmp_path)
    with pytest.raises(InputError, match=r"no column 'room' \(pressure.ambient\)"):
        read_pressure(PressureSpec(file=spec.file, reference="absolute", ambient="room"))
