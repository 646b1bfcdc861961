"""A column by its name, in the unit asked for: what logs and tracks have in common."""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Table, listed
from rfea_vision.units import conversion_factor, counted, measures, pressure_unit
from rfea_vision.yaml_line import flow

if TYPE_CHECKING:
    from pydantic import BaseModel

_SIGNS = {"°": "deg", "º": "deg", "µs": "us", "sec": "s", "Sek": "s", "mBar": "mbar", "Bar": "bar", "millis": "ms", "micros": "us"}
#: Columns that are called by their unit alone: a microcontroller's clocks, as the functions that read them, and pressures.
_CALLED_BY_UNIT = ("millis", "micros", "Pa", "hPa", "kPa", "MPa", "mbar", "bar", "psi", "psig", "psia")
"""Spellings that no registry of units knows."""

#: Share within which two units are the same: the nearest that are not, at and bar, differ by 2 %.
_SAME_UNIT = 0.005
#: Keys beside that of a column whose quantities are numbers by the time that they are read, and what these are in.
_UNITS = {"ambient": "kPa", "scale": "m", "rate": "Hz"}

#: How a moment is written: year, month, day; day, month, year with dots between them; or the time of the day alone.
_WRITTEN = re.compile(r"(?:(?P<year>\d{4}-\d\d-\d\d)[ T]\d\d:\d\d|(?P<day>\d{1,2}\.\d{1,2}\.\d{4})\s+\d\d?:\d\d|\d\d?:\d\d:\d\d)")
#: A time of the day by the clock of twelve hours.
_HALF_DAY = re.compile(r"(\d\d?)(:\d\d:\d\d[.\d]*)\s*([ap])\.?m\.?$", re.IGNORECASE)

# What loggers call their columns, in the languages of the labs that we know of.
_TIME_WORDS = re.compile(r"time|zeit|temps|tempo|aika|^t$|^t[ _(\[]", re.IGNORECASE)
_PRESSURE_WORDS = re.compile(r"press|druck|pression|presi|paine|^p\d*$|^p\d*[ _(\[]", re.IGNORECASE)
_AIR_WORDS = re.compile(r"ambi|atm|baro|umgebung|luft", re.IGNORECASE)
_FORCE_WORDS = re.compile(r"force|tension|tendon|kraft|zug|effort|fuerza|forza|kracht|voima|load|^f\d*$|^f\d*[ _(\[]", re.IGNORECASE)
_ANGLE_WORDS = re.compile(r"ang[luo]|winkel|bend|theta|^phi", re.IGNORECASE)
#: By the key that names a column: the unit it is in, one that it is not in, and its words.
_MEANT = {
    "time": ("s", "kPa", _TIME_WORDS),
    "pressure": ("kPa", "s", _PRESSURE_WORDS),
    "tension": ("N", "s", _FORCE_WORDS),
    "ambient": ("kPa", "s", _AIR_WORDS),
    "angle": ("deg", "s", _ANGLE_WORDS),
}


def column(table: Table, name: str, key: str, given: Mapping[str, object] | None = None, *, like: str | None = None) -> str:
    """Return `name` if there is such a column; `given` are the keys beside `key`, as they are written.

    `like` is what it holds where that is not what the key is called by.

    Raises
    ------
    InputError
        Naming the `key` that asks for it, the columns there are, and the line to write.
    """
    if name in table.columns:
        return name
    parent, part = key.split(".")
    given = given or {}
    meant = meant_column(table, name, like or part, [value for other, value in given.items() if other != part])
    keys = flow({**given, part: meant or "NAME"})
    line = f"'- {keys}' in the list '{parent}'" if "chamber" in given else f"'{parent}: {keys}'"
    remedy = f"write {line}" if meant else f"say which one it is with {line}"
    raise InputError(f"{table.source}: no column '{name}' ({key}); there are: {listed(list(table.columns))}; {remedy}")


def as_written(keys: BaseModel) -> dict[str, object]:
    """The keys of a part of experiment.yaml that say more than its defaults, as they are written there; no password is repeated."""
    given = keys.model_dump(exclude_defaults=True)
    for name, unit in _UNITS.items():
        if isinstance(given.get(name), float):
            given[name] = f"{given[name]:.9g} {unit}"
    if "url" in given:
        given["url"] = re.sub(r"(//[^:/@]*):[^@$]*@", r"\1:***@", str(given["url"]))
    return given


def refuse_rows(
    where: str, column: str, wrong: NDArray[np.bool_], fault: str, remedy: str = "correct or remove the row"
) -> None:
    """Raise an InputError for the first row (counted from 1) in which `wrong` (rows,) is set, if there is one."""
    rows = np.flatnonzero(wrong)
    if rows.size:
        more = f" (and {counted(rows.size - 1, 'more row')})" if rows.size > 1 else ""
        raise InputError(f"{where}: {column}, row {rows[0] + 1}: {fault}{more}; {remedy}")


def meant_column(table: Table, name: str, part: str, taken: Sequence[object] = ()) -> str | None:
    """The column, none of those `taken`, that was probably meant: by its unit, its name, its likeness to `name`; or None."""
    unit, other, words = _MEANT[part]
    free = [item for item in table.columns if item not in taken and not item.startswith("sigma")]
    possible = [item for item in free if not said_unit(table, item, other)]
    by_unit = [item for item in possible if said_unit(table, item, unit)]
    by_word = [item for item in possible if words.search(item)]
    return next(iter([*by_unit, *by_word, *difflib.get_close_matches(name, possible, n=1, cutoff=0.6)]), None)


def said_unit(table: Table, name: str, like: str) -> str | None:
    """Return the unit that the file or the column's name gives: ``pressure_bar``, ``p [psi]``, ``time (ms)``, ``p [kPa abs]``.

    None where none is given, or what stands at the end of the name, or in brackets within it, is no unit of what `like` measures.
    ``p_atm`` is the pressure of the atmosphere, not one in atmospheres.
    """
    counted = r"\([ag]\)|[ _](?:abs|gauge|rel)[a-z]*\.?"  # from where a pressure counts
    unit = rf"([A-Za-z°ºµ]+(?:{counted})?)"
    at_end, bracketed = rf"(?:_(?!(?i:atm?)\b)|\s*[\[(]){unit}[\])]?(?:\.\d+)?$", rf"[\[(]{unit}[\])]"
    written = [found[1] for found in (re.search(at_end, name), re.search(bracketed, name)) if found]
    written += [name] * (name in _CALLED_BY_UNIT)
    for found in [table.units[name]] if table.units.get(name) else written:
        found = _SIGNS.get(found, found)
        with contextlib.suppress(ValueError):
            conversion_factor(pressure_unit(found)[0], like)
            return found
    return None


def says_other_kind(table: Table, name: str, like: str) -> bool:
    """Whether a column names a unit, in brackets or in the file itself, but none of what `like` measures: ``T [°C]`` no angle."""
    return said_unit(table, name, like) is None and bool(table.units.get(name) or re.search(r"[\[(][^\])]+[\])]", name))


def refuse_other_kind(table: Table, name: str, key: str, remedies: Mapping[str, str]) -> None:
    """Refuse a column whose name has in brackets a unit that measures what one of `remedies` does: a force is no pressure.

    A single letter in round brackets may as well name a chamber: ``p (A)``.

    Raises
    ------
    InputError
        With the remedy for that kind.
    """
    found = re.search(r"\[\s*([^\]]+?)\s*\]|\(\s*([^)]{2,}?|N)\s*\)", name)
    unit = (found[1] or found[2]) if found else ""
    for kind, remedy in remedies.items():
        if unit and measures(pressure_unit(unit)[0], kind):
            raise InputError(f"{table.source}: {key}: the column '{name}' is in {unit} by its own head, which is {remedy}")


def unit_of(table: Table, name: str, default: str) -> str:
    """Return the unit that the file gives, or `default`; one that the file itself names for the column must fit."""
    return said_unit(table, name, default) or table.units.get(name) or default


def other_unit(table: Table, name: str, like: str, key: str, given: str | None) -> str:
    """Doubt a unit that is `given` as `key` where the file, or the column's name, says another; empty where they agree."""
    said = said_unit(table, name, like)
    if given is None or said is None:
        return ""
    times = conversion_factor(pressure_unit(said)[0], like) / conversion_factor(pressure_unit(given)[0], like)
    if abs(times - 1) < _SAME_UNIT:
        return ""
    return f"the column '{name}' is in {said} by its own head, and in {given} by {key}; which is right?"


def _moments(values: np.ndarray) -> NDArray[np.datetime64] | None:
    """Moments, of dates and of text such as ``2026-03-01 14:05:30.25``,
    ``1.3.2026 14:05:30,25`` or ``2:05:30 PM``; None for anything else.

    Of the time of the day alone, ``14:05:30.25``, they lie on the first day of 1970 and, once past midnight, on those after it.
    """
    if values.dtype.kind == "M":
        return values
    if not values.size or (found := _WRITTEN.match(str(values[0]).strip())) is None:
        return None
    text = pd.Series(values).astype(str).str.strip().str.replace(r"(:\d\d),(?=\d)", r"\1.", regex=True)
    text = text.str.replace(_HALF_DAY, _of_twenty_four, regex=True)
    if found["day"]:
        text = text.str.replace(r"^(\d{1,2})\.(\d{1,2})\.(\d{4})\s+", _from_dotted, regex=True)
    elif not found["year"]:
        text = "1970-01-01 " + text.str.replace(r"^(?=\d:)", "0", regex=True)
    try:
        moments = pd.to_datetime(text, format="ISO8601", utc=True).dt.tz_localize(None).to_numpy()
    except ValueError:
        return None
    if not found["day"] and not found["year"]:
        midnights = np.cumsum(np.append(False, np.diff(moments) < -np.timedelta64(12, "h")))
        moments = moments + midnights * np.timedelta64(1, "D")
    return moments


def _from_dotted(date: re.Match[str]) -> str:
    return f"{date[3]}-{int(date[2]):02d}-{int(date[1]):02d} "


def _of_twenty_four(time: re.Match[str]) -> str:
    return f"{int(time[1]) % 12 + 12 * (time[3].lower() == 'p'):02d}{time[2]}"


def unread_clock(table: Table) -> str:
    """Why a column that tells the time of the day cannot be read, or is no clock that rises; empty where there is none."""
    for name, values in table.columns.items():
        if values.dtype.kind not in "fiubM" and values.size and re.search(r"\d:\d\d", str(values[0])):
            try:
                in_unit(table, name, "s", "pressure.time")
            except InputError as error:
                return str(error).removeprefix(f"{table.source}: ")
            return f"column '{name}' is a clock that does not rise from row to row; export it with its fractions of a second, or in s"
    return ""


def unread_pressure(table: Table) -> str:
    """Why a column that tells a pressure is none of a log: a row of it that is no number, or no time beside it; empty without one."""
    if (name := meant_column(table, "", "pressure")) is None:
        return ""
    try:
        table.numbers(name)
    except InputError as error:
        return str(error).removeprefix(f"{table.source}: ")
    return f"column '{name}' has no time beside it that rises from row to row; add a column 'time_s'"


def clock_zero_s(table: Table, name: str | None) -> float | None:
    """Return when the times that `in_unit` gives of a column of dates, or without its name the file's own, begin.

    In s after 1970; None of anything else.
    """
    if name is None:
        return table.zero_s
    moments = _moments(table.columns[name])
    return None if moments is None else float((moments[0] - np.datetime64(0, "s")) / np.timedelta64(1, "s"))


def in_unit(
    table: Table, name: str, to: str, key: str, unit: str | None = None, given: Mapping[str, object] | None = None
) -> NDArray[np.float64]:
    """Return a column (rows,) in the unit `to`; `unit` says what it is in, else the file does. Dates become s after the first
    row, which is at `clock_zero_s`.

    Raises
    ------
    InputError
        If there is no such column, or its unit is unknown or of another kind.
    """
    column(table, name, key, given)
    moments = _moments(table.columns[name]) if to == "s" else None
    if moments is not None:
        return (moments - moments[0]) / np.timedelta64(1, "s")
    values = table.numbers(name)
    try:
        return values * conversion_factor(unit or unit_of(table, name, to), to)
    except ValueError as error:
        where = key if unit is None else f"{key.split('.')[0]}.{'time_unit' if to == 's' else 'unit'}"
        raise InputError(f"{table.source}: {where}: {error}") from error
