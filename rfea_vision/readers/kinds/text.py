"""Text: commas, semicolons, tabs or blanks, decimal points or commas, with whatever an instrument writes above it.

Columns of a file without a header are ``c1``, ``c2``, and so on.
"""

from __future__ import annotations

import csv
import re
import warnings
from io import StringIO
from itertools import takewhile
from pathlib import Path

import pandas as pd

from rfea_vision.data import column_words
from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Kind, Table, frame_table, refuse_too_much

_BLANKS = r"\s+"
_COLUMNS = r"\s{2,}"  # between names that hold single blanks, as COMSOL writes them
_SEPARATORS = (";", "\t", "|", ",", _BLANKS, _COLUMNS)
_COMMENTS = ("#", "%")  # %: MATLAB and what is written for it, COMSOL
_HEAD_BYTES = 4096  # in which a file that is no text shows it: a page of memory, of which text holds no zero byte
_LOOKED_AT = 200
"""Lines in which the header and the way numbers are written are looked for: more than any instrument writes above."""
_BYTES_PER_VALUE = 10
"""Of text, as logs are written: seven digits, a point, a sign or a blank, a separator."""
_POINT = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$", re.IGNORECASE)
_PARTED = re.compile(r"^[+-]?\d{1,3}(\.\d{3})+(,\d*)?$")
_COMMA = re.compile(r"^[+-]?(\d{1,3}(\.\d{3})+|\d+|),\d+([eE][+-]?\d+)?$")
_UNIT_CELL = re.compile(r"^\s*[\[(]?\s*([^\d\s\[\]()]{1,8}|m/s\^?2)?\s*[\])]?\s*$")


def decoded(path: Path) -> str:
    """Return the text: UTF-8, UTF-16 (of western letters without its mark, too), or the Windows code page of western Europe.

    Raises
    ------
    InputError
        If it is too large, an archive, or no text.
    """
    refuse_too_much(path, path.stat().st_size / _BYTES_PER_VALUE)
    raw = path.read_bytes()
    if raw[:4] == b"PK\x03\x04":
        raise InputError(f"{path}: is a workbook or an archive, whatever its name says; save the table as CSV")
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16")
    head = raw[:_HEAD_BYTES]
    for codec, high in (("utf-16-le", 1), ("utf-16-be", 0)):  # without its mark: of western letters every other byte is zero
        if head and len(raw) % 2 == 0 and not any(head[high::2]) and all(head[1 - high :: 2]):
            return raw.decode(codec)
    if b"\0" in head:
        raise InputError(f"{path}: is no text, whatever its name says; unpack it, or export the table as CSV")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        try:
            return raw.decode("cp1252")
        except UnicodeDecodeError:
            line = error.object[: error.start].count(b"\n") + 1
            raise InputError(f"{path}:{line}: not UTF-8 text; save the file as UTF-8") from error


def _cells(line: str, separator: str) -> list[str]:
    if separator in (_BLANKS, _COLUMNS):
        return re.split(separator, line.strip())
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in (cells[:-1] if cells and not cells[-1].strip() else cells)]


def _as_wide(line: str, names: list[str], separator: str) -> bool:
    """Whether a line has a cell for every name; the last may be empty, as LabVIEW's comments are."""
    cells = _cells(line, separator)
    return len(cells) == len(names) or (len(cells) == len(names) - 1 and line.rstrip(" ").endswith(separator))


def _is_number(cell: str) -> bool:
    return bool(_POINT.match(cell) or _COMMA.match(cell))


def _is_time(cell: str) -> bool:
    words = set(column_words()["time"]) - {"seconds", "sekunden"}  # units, too
    return not words.isdisjoint(re.split(r"[^\w]+|_", cell.lower()))


def _header(lines: list[str], separator: str) -> tuple[int, int] | None:
    """Return the lines (from 0) of the header and of the first data, for the widest table that this separator gives.

    A header holds no number and stands right above the data, or above a line of units that stands there.
    """
    rows = [_cells(line, separator) for line in lines[:_LOOKED_AT]]
    for index, row in enumerate(rows[:-1]):
        if not row or any(_is_number(cell) for cell in row):
            continue
        for first in (index + 1, index + 2):
            if first >= len(rows) or not _as_wide(lines[first], row, separator):
                continue
            units = rows[index + 1] if first == index + 2 else []
            if any(map(_is_time, units)) and not any(map(_is_time, row)):
                break  # no units but the header itself, below a line such as 'Operator;Smith'
            if units and not (len(units) == len(row) and all(_UNIT_CELL.match(cell) for cell in units)):
                continue
            last = lines[-1] if len(lines) <= _LOOKED_AT else lines[first]
            if any(_is_number(cell) for cell in rows[first]) and (not rows[-1] or _as_wide(last, row, separator)):
                return index, first
    return None


def _headers(lines: list[str]) -> dict[str, tuple[int, int]]:
    """The header and the first data by every separator that gives a table."""
    return {separator: place for separator in _SEPARATORS if (place := _header(lines, separator)) is not None}


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _titled(lines: list[str], rows: list[str]) -> list[str]:
    """The rows below the comment that is their header, and one of units where that follows it; the rows alone where none is.

    A comment that is no header may stand below the one that is: the last that fits counts. A line that is drawn holds no names. A sign
    in a cell of its own is a name, of a column in percent or of numbers; before a tab, where there are as many columns.
    """
    comments = [line.strip() for line in takewhile(_is_comment, lines) if any(map(str.isalnum, line))]
    for named in (r"[#%] *[,;|]", r"[#%] *[,;|\t]"):
        above = [line if re.match(named, line) else line.lstrip("".join(_COMMENTS) + " \t") for line in comments]
        for end in range(len(above), 0, -1):
            if _headers(both := [*above[max(end - 2, 0) : end], *rows]):
                return both
    return rows


def _read_thousands(path: Path, frame: pd.DataFrame) -> None:
    """Make numbers of columns with cells such as ``1.002,5``, which pandas leaves as text: it would read dates as numbers, too.

    Refused is a point that might be a decimal one, ``1.5`` or, where no other cell has thousands, ``1.500``.
    """
    for name in frame.select_dtypes(exclude="number"):
        cells = frame[name].astype(str).str.strip()
        parted = cells.str.fullmatch(_PARTED)
        numbers = parted | cells.str.fullmatch(_COMMA) | cells.str.fullmatch(r"[+-]?\d+")
        commas = cells.str.contains(",") & numbers
        if not commas.any():
            continue
        sure = parted & (parted & commas).any()
        odd = cells[cells.str.contains(".", regex=False) & cells.str.fullmatch(_POINT) & ~sure]
        if len(odd):
            where = f"{path}: column '{name}', row {odd.index[0] + 1}"
            text = "has a point among numbers with decimal commas; write all numbers in one way"
            raise InputError(f"{where}: '{odd.iloc[0]}' {text}")
        plain = cells.str.replace(".", "", regex=False).str.replace(",", ".", regex=False)
        cells = cells.where(~numbers, plain).where(frame[name].notna())
        values = pd.Series(pd.to_numeric(cells, errors="coerce"))
        frame[name] = cells if (values.isna() & cells.notna()).any() else values


def _refuse_other_width(path: Path, rows: list[str], separator: str) -> None:
    """Raise InputError if the first row names other than as many columns as the first row of numbers has."""
    names = _cells(rows[0], separator)
    numbers = (cells for line in rows[1:_LOOKED_AT] if all(map(_is_number, cells := _cells(line, separator))))
    if (first := next(numbers, names)) and len(first) != len(names):
        raise InputError(
            f"{path}: '{first[0]}' begins the first row of numbers, of which there are {len(first)}, and no line right above it "
            "names as many columns; put their names there, for example 'time_s,pressure_kPa'"
        )


def _split_by_decimal_commas(header: str, rows: list[str], separator: str) -> int:
    """Number of the first row that has twice the cells of the header, all of them whole numbers; 0 where none has."""
    columns = len(_cells(header, separator))
    for number, line in enumerate(rows[:_LOOKED_AT], start=1):
        cells = _cells(line, separator)
        if separator == "," and len(cells) == 2 * columns and all(re.fullmatch(r"[+-]?\d+", cell) for cell in cells):
            return number
    return 0


def read_text(path: Path) -> Table:
    """Read one table of text.

    Raises
    ------
    InputError
        If it has no header, or nothing tells commas in numbers from those between columns.
    """
    lines = [line for line in decoded(path).splitlines() if line.strip()]
    every = [line for line in lines if not _is_comment(line)]
    found = _headers(every)
    if not found:  # NumPy, MATLAB and COMSOL write it as a comment
        every = _titled(lines, every)
        found = _headers(every)
    if not every:
        raise InputError(f"{path}: holds nothing but comments; export the table with its rows")
    if found:
        separator = max(found, key=lambda sep: len(_cells(every[found[sep][0]], sep)))
        header, first = found[separator]
    else:
        top = every[0]
        separator = max("\t;|,", key=top.count) if any(sign in top for sign in "\t;|,") else _BLANKS
        cells = _cells(top, separator)
        if all(map(_is_number, cells)) and len(cells) > 1:  # nothing but numbers: the columns are counted
            every = [separator.replace(_BLANKS, " ").join(f"c{place + 1}" for place in range(len(cells))), *every]
        elif any(_is_number(cell) or re.match(r"\d[\d.-]*([ T]|:\d\d)", cell) for cell in cells[:1]):  # a clock, too
            raise InputError(f"{path}:1: no header line; name the columns, for example 'time_s,pressure_kPa'")
        if not _split_by_decimal_commas(every[0], every[1:], separator):  # that has a sentence of its own
            _refuse_other_width(path, every, separator)
        header, first = 0, 1
    sample = [cell for line in every[first : first + _LOOKED_AT] for cell in _cells(line, separator)]
    commas = [cell for cell in sample if _COMMA.match(cell)]
    thousands = any("." in cell for cell in commas)
    comma = bool(commas) and (thousands or not any("." in cell and _POINT.match(cell) for cell in sample))
    wide = _split_by_decimal_commas(every[header], every[first:], separator)
    if wide:
        raise InputError(
            f"{path}: row {wide}: commas stand between the columns and in the numbers, so nothing tells which is which; "
            "export it with decimal points, or with semicolons between the columns"
        )
    body = [every[header], *every[first:]]
    if separator == _COLUMNS:  # pandas knows no such separator but in its slow reader
        separator, body = "\t", ["\t".join(_cells(line, _COLUMNS)) for line in body]
    with warnings.catch_warnings(action="error", category=pd.errors.ParserWarning):  # cells would be dropped in silence
        frame = pd.read_csv(
            StringIO("\n".join(body)),
            sep=separator,
            decimal="," if comma else ".",
            skipinitialspace=True,
            index_col=False,
        )
    refuse_too_much(path, frame.size)
    if comma:
        _read_thousands(path, frame)
    table = frame_table(str(path), frame)
    if first == header + 2:
        cells = [cell.strip("[]() ") for cell in _cells(every[header + 1], separator)]
        units = {name: unit for name, unit in zip(table.columns, cells, strict=False) if unit}
        return Table(table.source, table.columns, units)
    return table


KINDS = (Kind("text", (".csv", ".txt", ".tsv", ".dat", ".asc"), read_text),)
