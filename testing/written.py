"""One motion and one pressure, written as every kind of file that there is a reader for."""

from __future__ import annotations

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from rfea_vision.campaign.schema import PressurePart, TrackPart
from rfea_vision.campaign.specs import PressureSpec, TrackSpec

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
    return PressureSpec(folder / "log.mf4", PressurePart(pressure="P1"))


def write_mat(folder):
    savemat(folder / "log.mat", {"log": {"t": TIME_S, "p": PRESSURE_kPa / 100.0}})
    return PressureSpec(folder / "log.mat", PressurePart(time="log.t", pressure="log.p", unit="bar"))


def write_simulink(folder):
    """As 'To Workspace' writes a structure with time: a signal without a label first, then the pressure."""
    signals = [{"values": TIME_S[:, None] ** 2, "label": ""}, {"values": PRESSURE_kPa[:, None], "label": "p line"}]
    savemat(folder / "sim.mat", {"out": {"time": TIME_S[:, None], "signals": signals, "blockName": "rig/To Workspace"}})
    return PressureSpec(folder / "sim.mat", PressurePart(time="out.time", pressure="out.p line", unit="kPa"))


def write_simulink73(folder):
    with h5py.File(folder / "sim73.mat", "w", userblock_size=512) as file:
        file.create_dataset("out/time", data=TIME_S[None, :])
        for field, first, second in (("values", TIME_S[None] ** 2, PRESSURE_kPa[None]), ("label", "q", "p line")):
            items = file.create_dataset(f"out/signals/{field}", (1, 2), dtype=h5py.ref_dtype)
            for place, value in enumerate((first, second)):
                data = np.array([[ord(sign)] for sign in value], np.uint16) if isinstance(value, str) else value
                items[0, place] = file.create_dataset(f"#refs#/{field}{place}", data=data).ref
    with (folder / "sim73.mat").open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return PressureSpec(folder / "sim73.mat", PressurePart(time="out.time", pressure="out.p line", unit="kPa"))


def write_numbers(folder):
    """No header at all, as many a logger of one's own writes it."""
    np.savetxt(folder / "plain.txt", np.stack([TIME_S, 0.0 * TIME_S, PRESSURE_kPa], axis=1), fmt="%.12f")
    return PressureSpec(folder / "plain.txt", PressurePart(time="c1", pressure="c3"))


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
    return PressureSpec(folder / "log.mat", PressurePart(time="log.t", pressure="runs(2).p", unit="bar"))


def write_lvm(folder):
    """As LabVIEW saves two channels in pieces, without times and with decimal commas."""
    lines = [
        "LabVIEW Measurement\t",
        "Separator\tTab",
        "Decimal_Separator\t,",
        "X_Columns\tNo",
        "***End_of_Header***\t",
        "",
    ]
    for part in np.split(np.arange(TIME_S.size), 3):
        steps = "\t".join(["0,01"] * 2)
        first = "\t".join([str(TIME_S[part[0]]).replace(".", ",")] * 2)
        lines += ["Channels\t2", "Y_Unit_Label\tbar\tV", f"X0\t{first}", f"Delta_X\t{steps}", "***End_of_Header***\t\t"]
        lines += ["X_Value\tPressure\tValve\tComment"]
        lines += [f"\t{float(value)!r}\t0".replace(".", ",") for value in PRESSURE_kPa[part] / 100.0] + [""]
    (folder / "log.lvm").write_text("\n".join(lines), encoding="cp1252")
    return PressureSpec(folder / "log.lvm", PressurePart(pressure="Pressure"))


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
    return PressureSpec(next((folder / "bag").glob("*.mcap")), PressurePart(pressure="/pressure.fluid_pressure"))


def write_dlc_text(folder):
    names = [("net", part, axis) for part in MARKS for axis in ("x", "y", "likelihood")]
    values = np.concatenate([PIXELS, np.full((*PIXELS.shape[:2], 1), 0.99)], axis=2).reshape(len(TIME_S), -1)
    frame = pd.DataFrame(values, columns=pd.MultiIndex.from_tuples(names, names=["scorer", "bodyparts", "coords"]))
    frame.to_csv(folder / "dlc.csv")
    return TrackSpec(folder / "dlc.csv", TrackPart(scale=f"{SCALE_mm} mm", rate=f"{RATE_Hz} Hz"))


def write_dlc(folder):
    """As pandas and PyTables lay it out: one block of values, the names of its columns pickled in protocol 0."""
    names = [("net", part, axis) for part in MARKS for axis in ("x", "y", "likelihood")]
    values = np.concatenate([PIXELS, np.full((*PIXELS.shape[:2], 1), 0.99)], axis=2).reshape(len(TIME_S), -1)
    table = np.zeros(len(TIME_S), dtype=[("index", "i8"), ("values_block_0", "f8", (values.shape[1],))])
    table["values_block_0"] = values
    pickled = "(lp0\n" + "".join("(" + "".join(f"V{word}\n" for word in name) + "ta" for name in names) + "."
    with h5py.File(folder / "dlc.h5", "w") as file:
        file.create_dataset("df_with_missing/table", data=table).attrs["values_block_0_kind"] = np.bytes_(pickled)
    return TrackSpec(folder / "dlc.h5", TrackPart(scale=f"{SCALE_mm} mm", rate=f"{RATE_Hz} Hz"))


def write_sleap(folder):
    with h5py.File(folder / "sleap.h5", "w") as file:
        file["tracks"] = PIXELS.transpose(2, 1, 0)[None]
        file["node_names"] = [name.encode() for name in MARKS]
        file["point_scores"] = np.full((1, *PIXELS.shape[1::-1]), 0.9)
    return TrackSpec(folder / "sleap.h5", TrackPart(scale=f"{SCALE_mm} mm", rate=f"{RATE_Hz} Hz"))


def write_tierpsy(folder):
    rows = np.zeros(len(TIME_S), dtype=[("worm_index", "i4"), ("timestamp", "i4")])
    rows["timestamp"] = np.arange(len(TIME_S))
    with h5py.File(folder / "tube_featuresN.hdf5", "w") as file:
        file["coordinates/skeletons"] = PIXELS * SCALE_mm * 1000.0
        file["timeseries_data"] = rows
        file["timeseries_data"].attrs["fps"] = RATE_Hz
    return TrackSpec(folder / "tube_featuresN.hdf5", TrackPart(points="all"))


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
    return TrackSpec(folder / "poses.nc", TrackPart(scale=f"{SCALE_mm} mm"))


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
    return TrackSpec(folder / "run.c3d", TrackPart(axes=("x", "z")))


def write_motive(folder):
    """An export of OptiTrack's Motive: m, y up; a rigid body with quaternions between the markers, one cell not seen."""
    mm = (PIXELS - CLAMP) * [1.0, -1.0] * SCALE_mm
    columns = [("Rigid Body", "plate", "1", "Rotation", axis) for axis in "XYZW"]
    columns += [
        ("Marker", f"set:{mark}", str(place), "Position", axis) for place, mark in enumerate(MARKS) for axis in "XYZ"
    ]
    space = np.stack([mm[..., 0], mm[..., 1], np.full(mm.shape[:2], 30.0)], axis=2).reshape(len(TIME_S), -1) / 1e3
    said = "Format Version,1.23,Take Name,run,Export Frame Rate,100.000000,Length Units,Meters,Coordinate Space,Global"
    head = [said, ""]
    for place, label in enumerate(("Type", "Name", "ID", "")):
        head.append(",".join(["", label, *(column[place] for column in columns)]))
    head.append(",".join(["Frame", "Time (Seconds)", *(column[4] for column in columns)]))
    rows = [
        ",".join([str(place), f"{time:.6f}", "0", "0", "0", "1", *(f"{value:.12f}" for value in row)])
        for place, (time, row) in enumerate(zip(TIME_S, space, strict=True))
    ]
    (folder / "take.csv").write_text("\n".join([*head, *rows]) + "\n")
    return TrackSpec(folder / "take.csv", TrackPart(axes=("x", "y"), points=[f"set:{mark}" for mark in MARKS]))


LOGS = [write_csv, write_parquet, write_mdf, write_mat, write_mat73, write_simulink, write_simulink73, write_numbers]
LOGS += [write_lvm, write_bag]
POSES = [write_dlc_text, write_dlc, write_sleap, write_tierpsy, write_movement, write_c3d, write_motive]
