"""Pressure logs: which columns, which units, and whether the clock can be trusted."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rfea_vision.errors import InputError
from rfea_vision.readers.database import read_query
from rfea_vision.readers.tables import Table, read_table
from rfea_vision.units import conversion_factor

if TYPE_CHECKING:
    from rfea_vision.campaign.specs import PressureSpec

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PressureLog:
    """Gauge pressure over the log's own clock.

    Attributes
    ----------
    time_s : (n,) strictly increasing
    pressure_kPa : (n,) gauge pressure
    name, source : what to call the log, and where it came from
    channels : other columns of the same length, by name (a lamp, a trigger)
    """

    time_s: FloatArray
    pressure_kPa: FloatArray
    name: str = ""
    source: str = ""
    channels: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        where = self.source or self.name or "pressure log"
        if self.time_s.shape != self.pressure_kPa.shape or self.time_s.ndim != 1:
            counts = f"{self.time_s.size} times and {self.pressure_kPa.size} pressures"
            raise InputError(f"{where}: {counts}; the columns of time and pressure must be equally long")
        if self.time_s.size < 2:
            raise InputError(f"{where}: {self.time_s.size} rows; a log of at least two is needed")
        _refuse_rows(where, "time", ~np.isfinite(self.time_s), "is not a finite number", "remove the row")
        _refuse_rows(
            where, "pressure", ~np.isfinite(self.pressure_kPa), "is not a finite number", "remove or repair it"
        )
        steps = np.diff(self.time_s, prepend=-np.inf)
        _refuse_rows(where, "time", steps < 0, "is earlier than the row before", "sort the log by time, or split it")
        _refuse_rows(where, "time", steps == 0, "repeats the row before", "remove the duplicate")


def _refuse_rows(where: str, column: str, wrong: np.ndarray, fault: str, remedy: str) -> None:
    rows = np.flatnonzero(wrong)
    if rows.size:
        more = f" (and {rows.size - 1} more rows)" if rows.size > 1 else ""
        raise InputError(f"{where}: {column}, row {rows[0] + 1}: {fault}{more}; {remedy}")


def read_pressure(spec: PressureSpec, name: str = "") -> PressureLog:
    """Read a log as its specification says.

    Raises
    ------
    InputError
        If the source cannot be read, a column is not there, a unit is unknown, or the clock is not strictly increasing.
    """
    if spec.url is not None:
        table = read_query(spec.url, spec.query or "", spec.folder)
    elif spec.file is not None:
        table = read_table(spec.file)
    else:
        raise InputError(
            f"{spec.folder}: pressure: no file and no url; write for example 'pressure: {{file: pressure.csv}}'"
        )
    time_name, pressure_name = _choose_columns(table, spec)
    pressure = table.numbers(pressure_name)
    pressure_unit = spec.unit or _unit_of(table, pressure_name, "kPa")
    pressure_kPa = pressure * _factor(table, pressure_unit, "kPa", "pressure.unit")
    if spec.reference == "absolute":
        pressure_kPa = pressure_kPa - spec.ambient_kPa
    if time_name is None:
        time_s = table.times_s[pressure_name]
    else:
        unit = spec.time_unit or _unit_of(table, time_name, "s")
        time_s = table.numbers(time_name) * _factor(table, unit, "s", "pressure.time_unit")
    others = {
        column: table.numbers(column)
        for column, values in table.columns.items()
        if column not in (time_name, pressure_name) and values.shape == time_s.shape and values.dtype.kind in "fiub"
    }
    return PressureLog(time_s, pressure_kPa, name, table.source, others)


def _choose_columns(table: Table, spec: PressureSpec) -> tuple[str | None, str]:
    """Return the columns of time (None: the file keeps time with every channel) and pressure."""
    names = list(table.columns)
    bare_pair = spec.time is None and spec.pressure is None and len(names) == 2 and spec.url is not None
    if bare_pair and not {"time_s", "pressure_kPa"} & set(names):
        return names[0], names[1]  # SELECT t, p FROM ...
    pressure = _column(table, spec.pressure or "pressure_kPa", "pressure.pressure")
    if spec.time is None and pressure in table.times_s:
        return None, pressure
    return _column(table, spec.time or "time_s", "pressure.time"), pressure


def _column(table: Table, name: str, key: str) -> str:
    if name in table.columns:
        return name
    names = list(table.columns)
    shown = ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    example = f"'{key.split('.')[1]}: {close[0] if close else names[0]}'"
    raise InputError(f"{table.source}: no column '{name}' ({key}); there are: {shown}; name one, for example {example}")


def _unit_of(table: Table, name: str, default: str) -> str:
    """Return the unit that the file or the column's name gives: ``pressure_bar``, ``p [psi]``, ``time (ms)``."""
    if table.units.get(name):
        return table.units[name]
    match = re.search(r"(?:_|\s*[\[(])([A-Za-z]+)[\])]?$", name)
    if match:
        try:
            conversion_factor(match[1], default)
        except ValueError:
            return default
        return match[1]
    return default


def _factor(table: Table, unit: str, to: str, key: str) -> float:
    try:
        return conversion_factor(unit, to)
    except ValueError as error:
        raise InputError(f"{table.source}: {key}: {error}") from error
