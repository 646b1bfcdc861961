"""Pressure logs: which columns, which units, and whether the clock can be trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import TENSION_kPa
from rfea_vision.errors import InputError
from rfea_vision.readers.columns import (
    as_written,
    clock_zero_s,
    column,
    in_unit,
    meant_column,
    other_unit,
    refuse_other_kind,
    refuse_rows,
    said_unit,
    unit_of,
)
from rfea_vision.readers.database import read_query
from rfea_vision.readers.kinds.base import Table, distinct
from rfea_vision.readers.tables import read_table
from rfea_vision.units import counted, pressure_unit

if TYPE_CHECKING:
    from rfea_vision.campaign.schema import PressurePart
    from rfea_vision.campaign.specs import PressureSpec

#: Why a clock jumps back, by the size of the jump in s: clocks of 24 and of 12 hours, and summer time. The jump may differ from it by
#: so many s, as no log has rows that far apart.
_SET_BACK_S, _NEAR_S = {86400.0: "passes midnight", 43200.0: "passes midnight", 3600.0: "goes from summer to winter time"}, 60.0


#: Where no unit is said: a voltage, or a current, is no measurement before the sensor's scale has made it one.
_RAW = "what a sensor gives out; convert it by the sensor's scale first"
_NO_PRESSURE = {
    "N": "a force and no pressure; where a tendon pulls, write its distance from the middle in campaign.yaml: "
    "'actuator: {section: {kind: rod, tendon: 8 mm}}'",
    "V": _RAW,
    "A": _RAW,
}
_NO_TENSION = {
    "kPa": "a pressure, where actuator.section.tendon says that the log is a force; name the column of the force, or take tendon out",
    "V": _RAW,
    "A": _RAW,
}


@dataclass(frozen=True)
class PressureLog:
    """Gauge pressure over the log's own clock; of a tendon its tension, each newton of it as `TENSION_kPa`.

    Attributes
    ----------
    time_s : (n,) strictly increasing
    pressure_kPa : (n,) gauge pressure
    name, source : what to call the log, and where it came from
    channels : other columns of the same length, by name (a lamp, a trigger)
    chambers : of several chambers the pressure in each, by name; `pressure_kPa` is their sum, each times its sign
    signs : of several chambers the sign of each, by name
    clock_zero_s : when `time_s` is 0, in s after 1970; None where the log names no dates
    doubts : sentences on columns that contradict the way they were read
    tendon : whether it is the tension of a tendon
    """

    time_s: FloatArray
    pressure_kPa: FloatArray
    name: str = ""
    source: str = ""
    channels: Mapping[str, FloatArray] = field(default_factory=dict)
    chambers: Mapping[str, FloatArray] = field(default_factory=dict)
    signs: Mapping[str, int] = field(default_factory=dict)
    clock_zero_s: float | None = None
    doubts: tuple[str, ...] = ()
    tendon: bool = False

    def signal(self, method: str, channel: str | None) -> FloatArray:
        """The column (n,) by which the clocks are brought together: `channel`, or what `method` is called by.

        Raises
        ------
        InputError
            If the log has none.
        """
        named = channel or ("led" if method == "led" else "trigger")
        if named not in self.channels:
            there = sorted(self.channels)
            remedy = f"write sync.channel: {there[0] if len(there) == 1 else 'NAME'}"
            if not there:
                remedy = "record the signal beside time and pressure, or write sync.method: motion"
            raise InputError(f"the log has no column '{named}' (others: {', '.join(there) or 'none'}); {remedy}")
        return np.asarray(self.channels[named], dtype=float)

    def __post_init__(self) -> None:
        where = self.source or self.name or "pressure log"
        if self.time_s.shape != self.pressure_kPa.shape or self.time_s.ndim != 1:
            counts = f"{self.time_s.size} times and {self.pressure_kPa.size} pressures"
            raise InputError(f"{where}: {counts}; the columns of time and pressure must be equally long")
        if self.time_s.size < 2:
            raise InputError(f"{where}: {counted(self.time_s.size, 'row')}; a log of at least two is needed")
        refuse_rows(where, "time", ~np.isfinite(self.time_s), "is not a finite number", "remove the row")
        refuse_rows(where, "pressure", ~np.isfinite(self.pressure_kPa), "is not a finite number", "remove or repair it")
        steps = np.diff(self.time_s, prepend=-np.inf)
        back, held = steps < 0, steps == 0
        remedy = "sort the log by time, or split it"
        if back.sum() == steps.size - 1 and steps.size > 2:
            remedy = "the newest row stands first: turn the order of the rows round"
        elif back.sum() == 1:  # sorted, two stretches would be one, row between row
            on_s = float(np.median(steps[1:][steps[1:] > 0])) - float(steps[back][0]) if (steps[1:] > 0).any() else 0.0
            remedy = (
                f"split the log there if another recording begins; where its clock was set back, add {on_s:.6g} s from that row on, or "
                "what it was set back by (do not sort it: that mixes the two)"
            )
        if back.sum() == 1 and (around := [s for s in _SET_BACK_S if abs(float(steps[back][0]) + s) < _NEAR_S]):
            hour = " (an hour)" * (around[0] == 3600)
            remedy = f"the clock {_SET_BACK_S[around[0]]} there: add {around[0]:g} s{hour} from that row on"
        refuse_rows(where, "time", back, "is earlier than the row before", remedy)
        coarse = held.sum() > self.time_s.size / 3
        remedy = "the clock is too coarse for its rows: export it with more decimals" if coarse else "remove the duplicate"
        refuse_rows(where, "time", held, "repeats the row before", remedy)

    @property
    def pushes_kPa(self) -> dict[str, FloatArray]:
        """What each of several chambers adds to the pressure (n,), with its sign; empty of one."""
        return {name: self.signs.get(name, 1) * values for name, values in self.chambers.items()}

    def zero_apart_s(self, other_s: float | None) -> float:
        """Return at what time of this log another clock's zero lies; 0 unless both name dates: the zeros are then one."""
        return 0.0 if other_s is None or self.clock_zero_s is None else other_s - self.clock_zero_s

    def zero_doubt(self, other_s: float | None) -> str:
        """Doubt a common clock where only one of two tells the time of the day; empty where both do, none, or nothing changes."""
        if (other_s is None) == (self.clock_zero_s is None) or not np.ptp(self.pressure_kPa):
            return ""
        has, other = ("log", "track") if other_s is None else ("track", "log")
        return (
            f"the {has} has the time of the day and the {other} has not, so their zeros are taken for one instant; if they are not, "
            "use sync.method motion or offset"
        )


def read_pressure(spec: PressureSpec, name: str = "") -> PressureLog:
    """Read a log as its specification says; those of several chambers at the times of the first, where all have them.

    Raises
    ------
    InputError
        If the source cannot be read, a column is not there, a unit is unknown, or the clock is not strictly increasing.
    """
    if spec.constant:
        raise InputError(f"{spec.folder}: pressure.value: a constant pressure has no log; use `constant_pressure`")
    if not spec.name and spec.keys.sign > 0:
        return _read_one(spec, name)
    logs = [None if part.constant_kPa is not None else _read_one(part, name) for part in spec.chambers]
    first = next(log for log in logs if log is not None)
    logs = [
        log and replace(log, time_s=log.time_s + first.zero_apart_s(log.clock_zero_s), clock_zero_s=first.clock_zero_s)
        for log in logs
    ]
    read = [log for log in logs if log is not None]
    begin, end = max(log.time_s[0] for log in read), min(log.time_s[-1] for log in read)
    common = (first.time_s >= begin) & (first.time_s <= end)
    if common.sum() < 2:
        raise InputError(
            f"{spec.folder}: pressure: the logs of its chambers have no time in common; are their clocks the same?"
        )
    time_s = first.time_s[common]
    kept = {key: values[common] for key, values in first.channels.items()}
    doubts = tuple(text for log in read for text in log.doubts)
    summed = _summed(spec, time_s, logs, name, first.source, kept)
    return replace(summed, clock_zero_s=first.clock_zero_s, doubts=doubts, tendon=spec.tendon)


def _summed(
    spec: PressureSpec,
    time_s: FloatArray,
    logs: Sequence[PressureLog | None],
    name: str,
    source: str,
    channels: Mapping[str, FloatArray],
) -> PressureLog:
    """Bring the chambers' pressures to common times and add them up; None where a chamber has a constant pressure."""
    each = {
        part.name: np.full(time_s.size, part.constant_kPa)
        if log is None
        else np.interp(time_s, log.time_s, log.pressure_kPa)
        for part, log in zip(spec.chambers, logs, strict=True)
    }
    total = np.sum([part.keys.sign * each[part.name] for part in spec.chambers], axis=0)
    if not spec.name:
        return PressureLog(time_s, total, name, source, channels)
    return PressureLog(time_s, total, name, source, channels, each, {part.name: part.keys.sign for part in spec.chambers})


def _read_one(spec: PressureSpec, name: str) -> PressureLog:
    """Read the log of one chamber."""
    keys = spec.keys
    if keys.url is not None:
        table = read_query(keys.url, keys.query or "", spec.folder)
    elif spec.file is not None:
        table = read_table(spec.file)
    else:
        raise InputError(
            f"{spec.folder}: pressure: no file and no url; write for example 'pressure: {{file: pressure.csv}}'"
        )
    time_name, pressure_name = _choose_columns(table, keys, tendon=spec.tendon)
    if spec.tendon:
        if keys.unit is None:
            refuse_other_kind(table, pressure_name, "pressure.pressure", _NO_TENSION)
        pressure_kPa = TENSION_kPa * in_unit(table, pressure_name, "N", "pressure.pressure", keys.unit)
    else:
        pressure_kPa, said = _in_kPa(table, pressure_name, keys.unit)
        if (keys.reference or said) == "absolute":
            pressure_kPa = pressure_kPa - _ambient_kPa(table, pressure_name, keys)
    zero_s = clock_zero_s(table, time_name)
    if time_name is None:
        time_s = table.times_s[pressure_name]
    else:
        time_s = in_unit(table, time_name, "s", "pressure.time", keys.time_unit)
    if time_name is not None and (np.diff(time_s) < 0).any() and (np.diff(pressure_kPa) > 0).all():
        text = (
            f"goes up and down, and '{pressure_name}' rises in every row, as a clock does; are the two columns swapped?"
        )
        raise InputError(f"{table.source}: pressure.time: '{time_name}' {text}")
    others = {
        other: table.numbers(other)
        for other, values in table.columns.items()
        if other not in (time_name, pressure_name) and values.shape == time_s.shape and values.dtype.kind in "fiub"
    }
    like = "N" if spec.tendon else "kPa"
    doubts = [other_unit(table, pressure_name, like, "pressure.unit", keys.unit), _twice(table, pressure_name)]
    doubts += [other_unit(table, time_name, "s", "pressure.time_unit", keys.time_unit)] if time_name is not None else []
    return PressureLog(
        time_s,
        pressure_kPa,
        name,
        table.source,
        others,
        clock_zero_s=zero_s,
        doubts=tuple(filter(None, doubts)),
        tendon=spec.tendon,
    )


def _twice(table: Table, name: str) -> str:
    """Doubt a column where another one, with other numbers, has the same name (readers number these); else empty."""
    second = distinct(name, [name])
    if second not in table.columns or np.array_equal(table.columns[name], table.columns[second]):
        return ""
    return f"'{name}' is the name of two columns, with other numbers; is the first the right one? 'pressure: {second}' names the second"


def constant_pressure(spec: PressureSpec, from_s: float, to_s: float, name: str = "") -> PressureLog:
    """Return the log of a run at constant pressure, 100 rows a second over and beyond the frames of its track."""
    time_s = np.arange(from_s - 0.5, to_s + 0.5, 0.01)
    return _summed(spec, time_s, [None] * len(spec.chambers), name, "constant pressure", {})


def _in_kPa(table: Table, name: str, given: str | None) -> tuple[FloatArray, str | None]:
    """Return a column of pressures in kPa, and whether its unit says gauge or absolute."""
    if given is None:
        refuse_other_kind(table, name, "pressure.pressure", _NO_PRESSURE)
    unit, said = pressure_unit(given or unit_of(table, name, "kPa"))
    return in_unit(table, name, "kPa", "pressure.pressure", unit), said


def _ambient_kPa(table: Table, pressure: str, keys: PressurePart) -> FloatArray | float:
    """Return what is subtracted from an absolute pressure: a number, or a column brought to the pressure's times."""
    if not isinstance(keys.ambient, str):
        return keys.ambient
    name = column(table, keys.ambient, "pressure.ambient", as_written(keys) | {"pressure": pressure})
    unit = None if said_unit(table, name, "kPa") else keys.unit
    ambient_kPa, _ = _in_kPa(table, name, unit)
    if name in table.times_s and pressure in table.times_s:
        return np.interp(table.times_s[pressure], table.times_s[name], ambient_kPa)
    if ambient_kPa.shape != table.columns[pressure].shape:
        counts = f"{ambient_kPa.size} and {table.columns[pressure].size} rows"
        raise InputError(
            f"{table.source}: pressure.ambient: '{name}' and '{pressure}' have {counts}; give equally long ones"
        )
    return ambient_kPa


def _choose_columns(table: Table, keys: PressurePart, *, tendon: bool = False) -> tuple[str | None, str]:
    """Return the columns of time (None: the file keeps time with every channel) and pressure, or of a tendon its tension."""
    names = list(table.columns)
    bare_pair = keys.time is None and keys.pressure is None and len(names) == 2 and keys.url is not None
    if bare_pair and not {"time_s", "pressure_kPa", "tension_N"} & set(names):
        return names[0], names[1]  # SELECT t, p FROM ...
    given, time = as_written(keys), keys.time or "time_s"
    if time not in names and not table.times_s and (meant := meant_column(table, time, "time")):
        given["time"] = meant  # one line mends both
    usual, like = ("tension_N", "tension") if tendon else ("pressure_kPa", "pressure")
    pressure = column(table, keys.pressure or usual, "pressure.pressure", given, like=like)
    if keys.time is None and pressure in table.times_s:
        return None, pressure
    return column(table, time, "pressure.time", given), pressure
