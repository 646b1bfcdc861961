"""Columns of numbers from CSV, Parquet, MATLAB and MDF files, whatever wrote them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rfea_vision.errors import InputError


@dataclass(frozen=True)
class Table:
    """Named columns; they may differ in length, as the channels of one .mat or .mf4 file do.

    Attributes
    ----------
    source : what to call the table in an error
    columns : name to one-dimensional array
    units : name to unit, where the file itself says it
    times_s : name to the time of each sample, where the file keeps one per channel (.mf4)
    """

    source: str
    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    times_s: Mapping[str, np.ndarray] = field(default_factory=dict)

    def numbers(self, name: str) -> np.ndarray:
        """Return a column as float64.

        Raises
        ------
        InputError
            If the column holds something that is not a number, naming the first such row (counted from 1).
        """
        values = self.columns[name]
        if values.dtype.kind in "fiub":
            return values.astype(np.float64)
        numbers = np.asarray(pd.to_numeric(pd.Series(values), errors="coerce"), dtype=np.float64)
        wrong = np.flatnonzero(np.isnan(numbers) & ~np.asarray(pd.isna(values)))
        if wrong.size:
            row = int(wrong[0])
            where = f"{self.source}: column '{name}', row {row + 1}"
            raise InputError(f"{where}: '{values[row]}' is not a number; correct or remove the row")
        return numbers


def read_table(path: Path) -> Table:
    """Read a table by the ending of its name.

    Raises
    ------
    InputError
        If the file is missing, empty, of an unknown kind or cannot be read.
    """
    readers: dict[str, Callable[[Path], Table]] = {
        ".csv": _read_csv,
        ".txt": _read_csv,
        ".tsv": _read_csv,
        ".parquet": _read_parquet,
        ".mat": _read_mat,
        ".mf4": _read_mdf,
        ".mdf": _read_mdf,
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: unknown kind of table '{path.suffix}'; known are {', '.join(readers)}")
    if not path.is_file():
        raise InputError(f"{path}: not found; correct the name or put the file there")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: is empty; record or export it again")
    try:
        table = reader(path)
    except InputError:
        raise
    except Exception as error:
        # Each of the parsers has its own family of exceptions; all mean that the file is not what its name says.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: cannot be read as {path.suffix} ({reason[:200]}); export it again") from error
    if not table.columns:
        raise InputError(f"{path}: holds no columns; export it again with a header line")
    return table


def frame_table(source: str, frame: pd.DataFrame) -> Table:
    """Return a data frame as a table."""
    return Table(source, {str(name).strip(): frame[name].to_numpy() for name in frame.columns})


def _read_csv(path: Path) -> Table:
    """Read text with commas, semicolons or tabs; with semicolons a decimal comma is understood."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}:{line}: not UTF-8 text; save the file as UTF-8") from error
    lines = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    header, first = next(lines, ""), next(lines, "")
    separator = max("\t;,", key=header.count)
    if header.count(separator) == 0 and len(header.split()) > 1:
        separator = r"\s+"
    if _is_number(header.split(separator)[0]):
        raise InputError(f"{path}:1: no header line; name the columns, for example 'time_s,pressure_kPa'")
    decimal = "," if separator == ";" and re.search(r"\d,\d", first) else "."
    from io import StringIO

    frame = pd.read_csv(
        StringIO(text), sep=separator, decimal=decimal, comment="#", skipinitialspace=True, index_col=False
    )
    return frame_table(str(path), frame)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_parquet(path: Path) -> Table:
    return frame_table(str(path), pd.read_parquet(path))


def _read_mat(path: Path) -> Table:
    """Read MATLAB files to version 7; struct fields become ``name.field``, of struct arrays ``name(3).field``."""
    from scipy.io import loadmat

    with path.open("rb") as stream:
        if b"MATLAB 7.3" in stream.read(32):
            raise InputError(f"{path}: is a MATLAB 7.3 file; save it with '-v7'")
    columns: dict[str, np.ndarray] = {}
    for name, value in loadmat(path, squeeze_me=True, struct_as_record=False).items():
        if not name.startswith("__"):
            _collect_mat(name, value, columns)
    return Table(str(path), columns)


def _collect_mat(name: str, value: Any, columns: dict[str, np.ndarray]) -> None:
    if hasattr(value, "_fieldnames"):
        for key in value._fieldnames:
            _collect_mat(f"{name}.{key}", getattr(value, key), columns)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for index, item in enumerate(value.ravel(), start=1):
            _collect_mat(f"{name}({index})", item, columns)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.size > 1:
        columns[name] = value
    elif isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "fiu":
        columns |= {f"{name}({index})": column for index, column in enumerate(value.T, start=1)}


def _read_mdf(path: Path) -> Table:
    from asammdf import MDF

    columns, units, times = {}, {}, {}
    with MDF(path) as file:
        for signal in file.iter_channels(skip_master=True):
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "fiu":
                columns[signal.name] = np.asarray(signal.samples)
                units[signal.name] = signal.unit
                times[signal.name] = np.asarray(signal.timestamps, dtype=np.float64)
    return Table(str(path), columns, units, times)
