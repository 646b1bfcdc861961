"""Columns of numbers from CSV, Parquet, MATLAB and MDF files, whatever wrote them."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rfea_vision.errors import InputError

# 400 MB as float64: a log of two columns at 10 kHz for 40 min. A small file may announce, or unpack to, far more.
MOST_VALUES = 50_000_000
_MOST_TEXT_BYTES = 500_000_000
_HEAD_BYTES = 100_000
_FORMULA = 3  # conversion type of a channel that is computed by a formula in the file (ASAM MDF 4, cc_type 3)


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
        if values.dtype.kind in "mMc":
            kind = "complex numbers" if values.dtype.kind == "c" else "dates or durations"
            raise InputError(f"{self.source}: column '{name}' holds {kind}; export it as plain numbers with a unit")
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
    if path.stat().st_size > _MOST_TEXT_BYTES:
        raise too_much(path, path.stat().st_size / 8)
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES).decode("utf-8-sig", errors="replace")
    lines = (line for line in head.splitlines() if line.strip() and not line.startswith("#"))
    header, first = next(lines, ""), next(lines, "")
    separator = max("\t;,", key=header.count)
    if header.count(separator) == 0 and len(header.split()) > 1:
        separator = r"\s+"
    if _is_number(header.split(separator)[0]):
        raise InputError(f"{path}:1: no header line; name the columns, for example 'time_s,pressure_kPa'")
    decimal = "," if separator == ";" and re.search(r"\d,\d", first) else "."
    rows = MOST_VALUES // (1 + header.count(separator)) + 1
    try:
        frame = pd.read_csv(
            path, sep=separator, decimal=decimal, comment="#", skipinitialspace=True, index_col=False, nrows=rows,
            encoding="utf-8-sig",
        )  # fmt: skip
    except UnicodeDecodeError as error:
        raise InputError(f"{path}:{_line_of_damage(path)}: not UTF-8 text; save the file as UTF-8") from error
    if frame.size > MOST_VALUES:
        raise too_much(path, frame.size)
    return frame_table(str(path), frame)


def _line_of_damage(path: Path) -> int:
    with path.open("rb") as stream:
        for number, line in enumerate(stream, start=1):
            try:
                line.decode()
            except UnicodeDecodeError:
                return number
    return 1


def too_much(path: Path, values: float) -> InputError:
    """The error of a file that holds, or says that it holds, more than a log can."""
    return InputError(f"{path}: announces {values:.2g} values, {MOST_VALUES:.2g} are read at most; export a part of it")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_parquet(path: Path) -> Table:
    """Read Parquet; what it announces is looked at first, as one repeated value may stand for any number of them."""
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        about = file.metadata
        groups = [about.row_group(index) for index in range(about.num_row_groups)]
        columns = [group.column(index) for group in groups for index in range(group.num_columns)]
        values = max(about.num_rows * about.num_columns, sum(column.num_values for column in columns))
        texts = {column.path_in_schema for column in columns if column.physical_type.endswith("BYTE_ARRAY")}
    if values > MOST_VALUES:
        raise too_much(path, values)
    with parquet.ParquetFile(path, read_dictionary=sorted(texts)) as file:
        return frame_table(str(path), file.read().to_pandas())


def _read_mat(path: Path) -> Table:
    """Read MATLAB files to version 7; struct fields become ``name.field``, of struct arrays ``name(3).field``."""
    from scipy.io import loadmat

    with path.open("rb") as stream:
        if b"MATLAB 7.3" in stream.read(32):
            raise InputError(f"{path}: is a MATLAB 7.3 file; save it with '-v7'")
    announced = _unpacked_bytes(path)
    if announced > 8 * MOST_VALUES:
        raise too_much(path, announced / 8)
    columns: dict[str, np.ndarray] = {}
    for name, value in loadmat(path, squeeze_me=True, struct_as_record=False).items():
        if not name.startswith("__"):
            _collect_mat(name, value, columns)
    return Table(str(path), columns)


def _unpacked_bytes(path: Path) -> int:
    """How large the compressed variables of a MATLAB 5 file say that they are (MAT-File Format, 1-7 to 1-10)."""
    raw = path.read_bytes()
    order, at, total = "little" if raw[126:128] == b"IM" else "big", 128, 0
    while at + 8 <= len(raw):
        kind, size = (int.from_bytes(raw[at + shift : at + shift + 4], order) for shift in (0, 4))
        if kind == 15:  # miCOMPRESSED
            inner = zlib.decompressobj().decompress(raw[at + 8 : at + 8 + min(size, 1000)], 8)
            total += int.from_bytes(inner[4:8], order)
        at += 8 + size
    return total


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
        announced = sum(group.channel_group.cycles_nr * len(group.channels) for group in file.groups)
        if announced > MOST_VALUES:
            raise too_much(path, announced)
        for group in file.groups:
            for channel in group.channels:
                if getattr(getattr(channel, "conversion", None), "conversion_type", None) == _FORMULA:
                    what = f"channel '{channel.name}' is computed by a formula in the file, which is not run"
                    raise InputError(f"{path}: {what}; export it with its values")
        for signal in file.iter_channels(skip_master=True):
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "fiu":
                columns[signal.name] = np.asarray(signal.samples)
                units[signal.name] = signal.unit
                times[signal.name] = np.asarray(signal.timestamps, dtype=np.float64)
    return Table(str(path), columns, units, times)
