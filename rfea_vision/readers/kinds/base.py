"""What every reader gives: columns, or named points over time. And what a reader says of itself."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Container, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rfea_vision.arrays import FloatArray
from rfea_vision.errors import InputError

# 400 MB as float64: a log of two columns at 10 kHz for 40 min. A small file may announce, or unpack to, far more.
MOST_VALUES = 50_000_000


def refuse_too_much(path: Path, values: float) -> None:
    """Raise the error of a file that holds, or says that it holds, more than a log can.

    Raises
    ------
    InputError
        With both numbers of values.
    """
    if values > MOST_VALUES:
        raise InputError(
            f"{path}: announces {values:.2g} values, {MOST_VALUES:.2g} are read at most; export a part of it"
        )


@dataclass(frozen=True)
class Points:
    """Named points over time, as a tracker of poses or a motion capture system gives them.

    Attributes
    ----------
    source : what to call them in an error
    names : of the points
    positions : (time, point, 2 or 3); NaN where a point was not seen. Axes as in the file; `y_down` says if y points down
    unit : ``px`` or a unit of length; empty where the file does not say it
    time_s : (time,), or None where the file counts frames and names no rate
    confidence : (time, point) from 0 to 1, or None
    """

    source: str
    names: tuple[str, ...]
    positions: FloatArray
    unit: str = ""
    time_s: FloatArray | None = None
    confidence: FloatArray | None = None
    y_down: bool = False


@dataclass(frozen=True)
class Table:
    """Named columns; they may differ in length, as the channels of one .mat or .mf4 file do.

    Attributes
    ----------
    source : what to call the table in an error
    columns : name to one-dimensional array
    units : name to unit, where the file itself says it
    times_s : name to the time of each sample, where the file keeps one per channel (.mf4)
    points : by individual (one entry with an empty name where there is only one), where the file holds poses
    zero_s : when `times_s` are 0, in s after 1970, where the file says it
    track : a track of this program whole, as xarray's `Dataset.to_dict` has it
    """

    source: str
    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    times_s: Mapping[str, np.ndarray] = field(default_factory=dict)
    points: Mapping[str, Points] = field(default_factory=dict)
    zero_s: float | None = None
    track: Mapping[str, Any] | None = None

    def numbers(self, name: str) -> np.ndarray:
        """Return a column (rows,) as float64.

        Raises
        ------
        InputError
            If the column holds something that is not a number, naming the first such row (counted from 1).
        """
        values = self.columns[name]
        if values.dtype.kind in "fiub":
            return values.astype(np.float64)
        if values.dtype.kind in "mMc":
            kind = "complex numbers" if values.dtype.kind == "c" else "dates or durations"
            raise InputError(f"{self.source}: column '{name}' holds {kind}; export it as plain numbers with a unit")
        numbers = np.asarray(pd.to_numeric(pd.Series(values), errors="coerce"), dtype=np.float64)
        wrong = np.flatnonzero(np.isnan(numbers) & ~np.asarray(pd.isna(values)))
        if wrong.size:
            row = int(wrong[0])
            if len(wrong) > 1 and np.isnan(numbers).all():
                clock = re.search(r"\d:\d\d", str(values[row])) is not None
                remedy = "export it in s, or as 2026-03-01 14:05:30.25, with the date" if clock else "export it as plain numbers"
                if clock and re.match(r"\d+/\d+/\d+", str(values[row]).strip()):
                    remedy = f"whether the day or the month comes first nobody can tell; {remedy}"
                if re.fullmatch(r"[+-]?\d+,\d+", str(values[row]).strip()):  # of all columns it would have been read
                    remedy = "other columns have decimal points: export all of them with one decimal sign"
                text = f"column '{name}' holds no numbers, but such as '{values[row]}'; {remedy}"
                raise InputError(f"{self.source}: {text}")
            where = f"{self.source}: column '{name}', row {row + 1}"
            if all(re.fullmatch(r"-?\d{1,3}(,\d{3})+(\.\d*)?", str(value).strip()) for value in values[wrong[:1000]]):
                remedy = "export it without separators of thousands"
            else:
                remedy = "correct or remove the row"
            raise InputError(f"{where}: '{values[row]}' is not a number; {remedy}")
        return numbers


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes
    ----------
    title : what people call it
    endings : of the file's name, lower case, with the dot
    read : the reader; whatever it raises is said in one sentence by `read_table`
    is_mine : tells kinds apart that share an ending; the first in the list that says yes reads
    apart : whether its parser may end the process, fill the memory or print tracebacks over a damaged file: it then has its own
    extra : the extra of this package that brings the library it needs, if it is no plain dependency
    """

    title: str
    endings: tuple[str, ...]
    read: Callable[[Path], Table]
    is_mine: Callable[[Path], bool] = lambda path: True
    apart: bool = False
    extra: str = ""


def frame_table(source: str, frame: pd.DataFrame) -> Table:
    """Return a data frame as a table."""
    return Table(source, {str(name).strip(): frame[name].to_numpy() for name in frame.columns})


def points_table(points: Mapping[str, Points]) -> Table:
    """Return poses as a table; its columns are those of the first individual, named ``point.x``."""
    first = next(iter(points.values()))
    columns = {
        f"{name}.{axis}": first.positions[:, index, place]
        for index, name in enumerate(first.names)
        for place, axis in enumerate("xyz"[: first.positions.shape[2]])
    }
    return Table(first.source, columns, points=dict(points))


@contextmanager
def hdf5(path: Path) -> Generator[Any]:
    """Open an HDF5 file to read.

    Raises
    ------
    InputError
        If it leads to other files, or announces more than a log holds.
    """
    import h5py

    with h5py.File(path, "r") as file:
        links: dict[str, Any] = {}
        file.visititems_links(links.__setitem__)
        announced = 0
        for name, link in links.items():
            node = file[name] if isinstance(link, h5py.HardLink) else None
            if node is None or getattr(node, "external", None) or getattr(node, "is_virtual", False):
                raise InputError(f"{path}: '{name}' lies in another file, or is a link; export it with its values")
            announced += int(node.size or 0) if isinstance(node, h5py.Dataset) else 0
        refuse_too_much(path, announced)
        yield file


def begins_with(mark: bytes, within: int = 0) -> Callable[[Path], bool]:
    """Return a test whether a file begins with `mark`, or has it among its first `within` bytes."""

    def is_mine(path: Path) -> bool:
        with path.open("rb") as stream:
            return mark in stream.read(max(within, len(mark)))

    return is_mine


def has_members(*names: str) -> Callable[[Path], bool]:
    """Return a test whether an HDF5 file holds all of these datasets or groups."""

    def is_mine(path: Path) -> bool:
        import h5py

        try:
            with h5py.File(path, "r") as file:
                return all(file.get(name, getlink=True) is not None for name in names)
        except Exception:  # of a damaged file h5py raises whatever HDF5 stumbled over
            return False

    return is_mine


AXIS = re.compile(r"^(?P<name>.*?)[._ ]?(?P<axis>[xyzXYZ])(?:[_ ]*[\[(]?(?P<unit>px|um|µm|mm|cm|m)[\])]?)?$")
"""A column that holds a coordinate: ``tip1_x_mm``, ``/tip.point.x``."""


def points_of_columns(
    source: str,
    columns: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    time_s: FloatArray | None,
    asked: Collection[str] = (),
) -> Points | None:
    """Gather columns (row,) such as ``tip1_x_mm, tip1_y_mm`` or ``/tip.point.x`` as points; None where there are none.

    They lie in space where one that is `asked` for (none: any) has all three axes, and have the unit that these agree on. A name
    that is asked for may list its two or three columns: ``c2,c3``.
    """
    rows = max((values.size for values in columns.values()), default=0) if time_s is None else time_s.size
    numeric = {name for name, values in columns.items() if values.size == rows and values.dtype.kind in "fiu"}
    found: dict[str, dict[str, str]] = {}
    said: dict[str, str] = {}
    for column in columns:
        match = AXIS.match(column)
        if match and match["name"] and column in numeric:
            found.setdefault(match["name"], {})[match["axis"].lower()] = column
            said[column] = match["unit"] or units.get(column, "")
    for name in asked:
        listed_columns = [column.strip() for column in name.split(",")]
        if len(listed_columns) in (2, 3) and numeric.issuperset(listed_columns):
            found[name] = dict(zip("xyz", listed_columns, strict=False))
            said |= {column: units.get(column, "") for column in listed_columns}
    wanted = {name: item for name, item in found.items() if name in asked} or found
    axes = ("x", "y", "z") if any(len(item) == 3 for item in wanted.values()) else ("x", "y")
    whole = {name: item for name, item in found.items() if all(axis in item for axis in axes)}
    if not whole:
        return None
    kinds = {said[whole[name][axis]] for name in (wanted.keys() & whole or whole) for axis in axes}
    values = [np.stack([columns[item[axis]].astype(float) for axis in axes], axis=1) for item in whole.values()]
    unit = kinds.pop() if len(kinds) == 1 else ""
    return Points(source, tuple(whole), np.stack(values, axis=1), unit, time_s, y_down=unit == "px")


def unseen(positions: FloatArray, confidence: FloatArray | None, least: float) -> FloatArray:
    """Return the positions (rows, points, 2) with NaN where the tracker trusts itself less than `least`."""
    if confidence is None:
        return positions
    return np.where((confidence >= least)[..., None], positions, np.nan)


def distinct(name: str, taken: Container[str]) -> str:
    """Return `name`; or, where it is taken, with a number as pandas gives columns of one name: ``p``, ``p.1``, ``p.2``."""
    return next(free for free in chain([name], (f"{name}.{number}" for number in count(1))) if free not in taken)


def listed(names: Sequence[str]) -> str:
    """Return names for a sentence, the first of many."""
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")
