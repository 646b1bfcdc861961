"""Measurement files of LabVIEW (.lvm): text with a header of its own, then one table or several in a row.

Source: NI, "Specification for the LabVIEW Measurement File (.lvm)". Where no times are written they follow from `X0` and
`Delta_X` of each channel.
"""

from __future__ import annotations

from itertools import dropwhile, takewhile
from pathlib import Path

import numpy as np

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Kind, Table, begins_with, distinct
from rfea_vision.readers.kinds.text import decoded

_MARK = b"LabVIEW Measurement"
_END = "***End_of_Header***"


def read_lvm(path: Path) -> Table:
    """Read one table; every channel keeps its own times. Of a file with several tables the rows follow one another.

    Raises
    ------
    InputError
        If its header does not end, or its tables have different channels.
    """
    lines = decoded(path).splitlines()
    ends = [index for index, line in enumerate(lines) if line.strip() == _END]
    if len(ends) < 2:
        raise InputError(f"{path}: has no {_END} above its values; export it again")
    separator = "," if "," in lines[0] else "\t"
    about = _keys(lines[: ends[0]], separator)
    parts = [
        _part(path, lines[begin + 1 : end], lines[end + 1 : following], separator, about)
        for begin, end, following in zip(ends, ends[1:], [*ends[2:], len(lines)], strict=False)
    ]
    first = parts[0]
    if any(part.columns.keys() != first.columns.keys() for part in parts):
        raise InputError(f"{path}: its tables have different channels; export one of them")
    columns, times = (
        {name: np.concatenate([getattr(part, what)[name] for part in parts]) for name in first.columns}
        for what in ("columns", "times_s")
    )
    return Table(str(path), columns, first.units, times)


def _keys(lines: list[str], separator: str) -> dict[str, list[str]]:
    """The header: what follows each key, channel by channel."""
    return {cells[0]: cells[1:] for line in lines if (cells := line.rstrip(separator).split(separator))[0]}


def _part(path: Path, header: list[str], body: list[str], separator: str, about_file: dict[str, list[str]]) -> Table:
    """One table: `X_Columns` says whether the times stand in a column for all channels (One), in one each (Multi) or nowhere.

    Where a channel has no value its cell is empty: that row is left out of it, with its time.
    """
    about, point = _keys(header, separator), about_file.get("Decimal_Separator", ["."])[0]
    x_columns = about_file.get("X_Columns", ["One"])[0]
    # below the rows stands an empty line, and perhaps the header of the next table
    filled = takewhile(str.strip, dropwhile(lambda line: not line.strip(), body))
    rows = [[cell.strip().replace(point, ".") for cell in line.split(separator)] for line in filled]
    if len(rows) < 2:
        raise InputError(f"{path}: a header without values stands in it; export it again")
    columns, times, units = {}, {}, {}
    for channel, place in enumerate(range(1, len(rows[0]), 2 if x_columns == "Multi" else 1)):
        name = rows[0][place]
        if name in ("", "Comment"):
            continue
        name = distinct(name, columns)
        full = [index for index, row in enumerate(rows) if index and place < len(row) and row[place]]
        columns[name] = np.array([float(rows[index][place]) for index in full])
        if x_columns == "No":
            first, step = (float(about[key][channel].replace(point, ".")) for key in ("X0", "Delta_X"))
            times[name] = first + step * (np.array(full) - 1)
        else:
            of_times = place - 1 if x_columns == "Multi" else 0
            times[name] = np.array([float(rows[index][of_times]) for index in full])
        units[name] = "".join(about.get("Y_Unit_Label", [])[channel : channel + 1])
    return Table(str(path), columns, {name: unit for name, unit in units.items() if unit}, times)


KINDS = (Kind("LabVIEW measurement file", (".lvm",), read_lvm, begins_with(_MARK, within=len(_MARK) + 3)),)
