"""Motion capture: c3d, and the tables that Motive (OptiTrack) exports."""

from __future__ import annotations

import csv
import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Kind, Points, Table, begins_with, distinct, points_table
from rfea_vision.readers.kinds.text import decoded


def read_c3d(path: Path) -> Table:
    """Read markers, and analog channels (a pressure among them) as columns with their own times."""
    import ezc3d

    file = ezc3d.c3d(str(path))
    parameters, data = file["parameters"], file["data"]
    point = parameters["POINT"]
    names = tuple(str(name).strip() for name in point["LABELS"]["value"])
    positions = np.asarray(data["points"], dtype=float)[:3].transpose(2, 1, 0)
    rate = float(point["RATE"]["value"][0])
    unit = str(point["UNITS"]["value"][0]).strip() if point["UNITS"]["value"] else ""
    time_s = np.arange(len(positions)) / rate
    table = points_table({"": Points(str(path), names, positions, unit, time_s)})
    times = dict.fromkeys(table.columns, time_s)
    units = dict.fromkeys(table.columns, unit)
    analog = parameters.get("ANALOG", {})
    samples = np.asarray(data["analogs"], dtype=float)
    samples = samples[0] if samples.ndim == 3 and samples.size else np.empty((0, 0))
    columns = dict(table.columns)
    said = [str(item).strip() for item in analog.get("UNITS", {}).get("value", [])]
    for index, values in enumerate(samples):
        name = distinct(str(analog["LABELS"]["value"][index]).strip(), columns)
        columns[name], units[name] = values, said[index] if index < len(said) else ""
        times[name] = np.arange(len(values)) / float(analog["RATE"]["value"][0])
    return Table(str(path), columns, units, times, table.points)


_MOTIVE_UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "inches": "inch", "feet": "foot"}


def read_motive(path: Path) -> Table:
    """Read the positions of markers and rigid bodies; above the data stand, line by line, kinds, names, ids and quantities.

    Raises
    ------
    InputError
        If its header is not there, or it holds no positions.
    """
    rows = [row for row in csv.reader(decoded(path).splitlines()) if any(map(str.strip, row))]
    head = next((at for at, row in enumerate(rows[:12]) if row[0] == "Frame" and row[1:2] and "Time" in row[1]), 0)
    if head < 3:
        raise InputError(f"{path}: no line 'Frame,Time,X,Y,Z'; export it again from Motive, with its header")
    names, quantities, axes = rows[2], rows[head - 1], rows[head]
    found: dict[str, dict[str, int]] = {}
    for place, (name, quantity, axis) in enumerate(zip(names, quantities, axes, strict=False)):
        if quantity == "Position" and axis in ("X", "Y", "Z"):
            found.setdefault(name, {}).setdefault(axis, place)
    parts = {name: place for name, place in found.items() if len(place) == 3}
    if not parts:
        raise InputError(f"{path}: holds no positions; export markers or rigid bodies from Motive")
    places = [1, *(place[axis] for place in parts.values() for axis in "XYZ")]
    data = rows[head + 1 :]
    cells = [[row[place] if place < len(row) and row[place].strip() else "nan" for place in places] for row in data]
    values = np.array(cells, dtype=float).reshape(len(cells), -1)
    said = dict(pairwise(rows[0])).get("Length Units", "")
    unit = _MOTIVE_UNITS.get(said.lower(), re.sub(r"\W", "", said))
    points = Points(str(path), tuple(parts), values[:, 1:].reshape(len(values), -1, 3), unit, values[:, 0])
    return points_table({"": points})


KINDS = (
    Kind("Motive", (".csv",), read_motive, begins_with(b"Format Version,", within=20)),
    Kind("c3d", (".c3d",), read_c3d, apart=True, extra="capture"),
)
