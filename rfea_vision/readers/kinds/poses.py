"""Trackers of poses: DeepLabCut, SLEAP, Tierpsy, and movement's netCDF. Positions are pixels, y down, unless said."""

from __future__ import annotations

import csv
import io
import pickle
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Kind, Points, Table, has_members, hdf5, points_table
from rfea_vision.readers.kinds.text import decoded

_DLC_COORDINATES = ("x", "y", "likelihood")


def _is_dlc_text(path: Path) -> bool:
    """Whether a table begins as DeepLabCut's; a spreadsheet that saved it again may have put a mark before it, and other separators."""
    with path.open("rb") as stream:
        return bool(re.match(rb"(\xef\xbb\xbf)?scorer[,;\t]", stream.read(16)))


def read_dlc_text(path: Path) -> Table:
    """Read DeepLabCut's CSV: three rows of header, four where there are several animals."""
    text = decoded(path)
    separator = text[len("scorer")]
    rows = [row for row in csv.reader(text.splitlines(), delimiter=separator) if row]
    heads = [row for row in rows[:4] if row[0] in ("scorer", "individuals", "bodyparts", "coords")]
    point = {ord(","): "."} if separator != "," else {}
    data = np.array([[float(cell.translate(point)) if cell else np.nan for cell in row[1:]] for row in rows[len(heads) :]])
    return _dlc(path, list(zip(*[row[1:] for row in heads], strict=True)), data)


class _PlainText(pickle.Unpickler):
    """PyTables pickles the names of columns; nothing but text, tuples and lists is let through."""

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        raise pickle.UnpicklingError(f"holds an object of {module_name}.{global_name}; give the CSV beside it")


def read_dlc(path: Path) -> Table:
    """Read DeepLabCut's HDF5, in both layouts of pandas, without PyTables."""
    with hdf5(path) as file:
        group = file["df_with_missing"]
        if "table" in group:
            table = group["table"]
            kept = table.attrs["values_block_0_kind"]
            names = _PlainText(io.BytesIO(bytes(kept)), encoding="utf-8").load()
            data = np.asarray(table[()]["values_block_0"], dtype=float)
        else:
            depth = sum(key.startswith("block0_items_level") for key in group)
            levels = [[_text(item) for item in group[f"block0_items_level{i}"][()]] for i in range(depth)]
            codes = [group[f"block0_items_label{i}"][()] for i in range(depth)]
            names = [
                tuple(level[code] for level, code in zip(levels, item, strict=True))
                for item in zip(*codes, strict=True)
            ]
            data = np.asarray(group["block0_values"][()], dtype=float)
    return _dlc(path, names, data)


def _dlc(path: Path, names: Sequence[Sequence[str]], data: np.ndarray) -> Table:
    """Gather columns named (scorer, [individual,] body part, coordinate)."""
    places: dict[str, dict[str, dict[str, int]]] = {}
    for column, name in enumerate(names):
        individual = name[1] if len(name) == 4 else ""
        places.setdefault(individual, {}).setdefault(name[-2], {})[name[-1]] = column
    found = {}
    for individual, parts in places.items():
        if any(set(columns) != set(_DLC_COORDINATES) for columns in parts.values()):
            raise InputError(f"{path}: not every body part has x, y and likelihood; export it again")
        x, y, trust = (data[:, [columns[key] for columns in parts.values()]] for key in _DLC_COORDINATES)
        found[individual] = Points(str(path), tuple(parts), np.stack([x, y], axis=2), "px", None, trust, y_down=True)
    return points_table(found)


def read_sleap(path: Path) -> Table:
    """Read SLEAP's analysis file: tracks (individual, xy, node, frame).

    Raises
    ------
    InputError
        If the shapes of tracks and nodes do not belong together.
    """
    with hdf5(path) as file:
        positions = np.asarray(file["tracks"][()], dtype=float)
        nodes = tuple(_text(name) for name in file["node_names"][()])
        individuals = [_text(name) for name in file["track_names"][()]] if "track_names" in file else []
        scores = np.asarray(file["point_scores"][()], dtype=float) if "point_scores" in file else None
    if positions.ndim != 4 or positions.shape[1] != 2 or positions.shape[2] != len(nodes):
        raise InputError(f"{path}: tracks are {positions.shape}, not (individual, 2, node, frame); export it again")
    found = {}
    for index, track in enumerate(positions):
        name = individuals[index] if index < len(individuals) and len(positions) > 1 else ""
        trust = scores[index].T if scores is not None else None
        found[name or ("" if len(positions) == 1 else str(index))] = Points(
            str(path), nodes, track.transpose(2, 1, 0), "px", None, trust, y_down=True
        )
    return points_table(found)


_TIERPSY = ("coordinates/skeletons", "skeleton", "skeletons")


def _is_tierpsy(path: Path) -> bool:
    return any(has_members(name)(path) for name in _TIERPSY)


def read_tierpsy(path: Path) -> Table:
    """Read the midlines of Tierpsy: (row, point, xy) of one worm after the other, in µm (features) or px (skeletons)."""
    with hdf5(path) as file:
        name = next(item for item in _TIERPSY if item in file)
        midlines = np.asarray(file[name][()], dtype=float)
        rows = next((file[key][()] for key in ("timeseries_data", "trajectories_data") if key in file), None)
        attributes = {key: node.attrs[key] for node in (file, *file.values()) for key in node.attrs}
    rate, unit = float(attributes.get("fps", np.nan)), "um" if name == _TIERPSY[0] else "px"
    names = tuple(f"p{index:02d}" for index in range(midlines.shape[1]))
    keys = rows.dtype.names if rows is not None else ()
    worm_key = next((key for key in keys if key.startswith("worm_index")), None)
    frame_key = next((key for key in keys if key in ("timestamp", "frame_number")), None)
    worms = rows[worm_key] if rows is not None and worm_key else np.zeros(len(midlines), dtype=int)
    frames = rows[frame_key] if rows is not None and frame_key else np.arange(len(midlines))
    several = np.unique(worms)
    found = {}
    for worm in several:
        mine = worms == worm
        time_s = np.asarray(frames[mine], dtype=float) / rate if np.isfinite(rate) and rate > 0 else None
        label = str(worm) if len(several) > 1 else ""
        found[label] = Points(str(path), names, midlines[mine], unit, time_s, y_down=True)
    return points_table(found)


def read_movement(path: Path) -> Table:
    """Read movement's netCDF of poses: position (time, space, keypoints, individuals).

    Raises
    ------
    InputError
        If it holds no position over x and y.
    """
    import xarray as xr

    with hdf5(path):
        pass  # looks for what lies elsewhere
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        if "position" not in dataset or "space" not in dataset["position"].dims:
            raise InputError(f"{path}: no 'position' over 'space'; this is not a file of movement's poses")
        position = dataset["position"].load()
        trust = dataset["confidence"].load() if "confidence" in dataset else None
        frames = str(dataset.attrs.get("time_unit", "seconds")) == "frames"
    space = [str(axis) for axis in position["space"].values]
    if not set(space) <= set("xyz"):
        raise InputError(f"{path}: space is {', '.join(space)}; Cartesian x and y are needed")
    if "keypoints" not in position.dims:  # of bounding boxes the middle is what moves
        position = position.expand_dims(keypoints=["centroid"])
        trust = trust.expand_dims(keypoints=["centroid"]) if trust is not None else None
    time_s = None if frames else np.asarray(position["time"].values, dtype=float)
    unit = str(position.attrs.get("units", "px"))
    names = tuple(str(name) for name in position["keypoints"].values)
    individuals = [str(item) for item in position["individuals"].values]
    found = {}
    for item in individuals:
        values = position.sel(individuals=item).transpose("time", "keypoints", "space").values.astype(float)
        sure = None if trust is None else trust.sel(individuals=item).transpose("time", "keypoints").values
        label = item if len(individuals) > 1 else ""
        sure = None if sure is None or np.all(np.isnan(sure)) else sure
        found[label] = Points(str(path), names, values, unit, time_s, sure, y_down=unit in ("px", "pixels"))
    return points_table(found)


def _text(value: object) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


KINDS = (
    Kind("DeepLabCut", (".csv",), read_dlc_text, _is_dlc_text),
    Kind("DeepLabCut", (".h5", ".hdf5"), read_dlc, has_members("df_with_missing"), apart=True),
    Kind("SLEAP analysis", (".h5", ".hdf5"), read_sleap, has_members("tracks", "node_names"), apart=True),
    Kind("Tierpsy", (".h5", ".hdf5"), read_tierpsy, _is_tierpsy, apart=True),
    Kind("movement", (".nc",), read_movement, apart=True),
)
