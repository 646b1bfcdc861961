"""A column by its name, in the unit asked for: what logs and tracks have in common."""

from __future__ import annotations

import contextlib
import difflib
import json
import re

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Table, listed
from rfea_vision.units import conversion_factor, counted, pressure_unit

_SIGNS = {"°": "deg", "º": "deg", "µs": "us", "sec": "s", "Sek": "s", "mBar": "mbar", "Bar": "bar"}
"""Spellings that no registry of units knows."""

#: Share within which two units are the same: the nearest that are not, at and bar, differ by 2 %.
_SAME_UNIT = 0.005
_NEEDS_QUOTES = re.compile(r"[\[\]{},:#\"'&*!|>%@`]")

# What loggers call their columns, in the languages of the labs that we know of.
_TIME_WORDS = re.compile(r"time|zeit|temps|tempo|aika|^t$|^t[ _(\[]", re.IGNORECASE)
_PRESSURE_WORDS = re.compile(r"press|druck|pression|presi|paine|^p\d*$|^p\d*[ _(\[]", re.IGNORECASE)


def column(table: Table, name: str, key: str) -> str:
    """Return `name` if there is such a column.

    Raises
    ------
    InputError
        Naming the `key` that asks for it, and the columns there are.
    """
    if name in table.columns:
        return name
    part = key.split(".")[1]
    meant = _meant(table, name, part)
    if meant and _NEEDS_QUOTES.search(meant):
        meant = json.dumps(meant, ensure_ascii=False)  # within the braces of one line brackets and commas are YAML's own
    remedy = f"write '{part}: {meant}'" if meant else f"say which one it is with '{part}: NAME'"
    raise InputError(f"{table.source}: no column '{name}' ({key}); there are: {listed(list(table.columns))}; {remedy}")


def refuse_rows(
    where: str, column: str, wrong: NDArray[np.bool_], fault: str, remedy: str = "correct or remove the row"
) -> None:
    """Raise an InputError for the first row (counted from 1) in which `wrong` (rows,) is set, if there is one."""
    rows = np.flatnonzero(wrong)
    if rows.size:
        more = f" (and {counted(rows.size - 1, 'more row')})" if rows.size > 1 else ""
        raise InputError(f"{where}: {column}, row {rows[0] + 1}: {fault}{more}; {remedy}")


def _meant(table: Table, name: str, part: str) -> str | None:
    """The column that was probably meant, by its unit, its name, or its likeness to `name`; None if none will do."""
    unit, other, words = ("s", "kPa", _TIME_WORDS) if part == "time" else ("kPa", "s", _PRESSURE_WORDS)
    possible = [item for item in table.columns if not said_unit(table, item, other)]
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
    for found in [table.units[name]] if table.units.get(name) else written:
        found = _SIGNS.get(found, found)
        with contextlib.suppress(ValueError):
            conversion_factor(pressure_unit(found)[0], like)
            return found
    return None


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
    """Moments, of dates and of text such as ``2026-03-01 14:05:30.25``; None for anything else."""
    if values.dtype.kind != "M":
        if not values.size or not re.match(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d", str(values[0])):
            return None
        try:
            values = pd.to_datetime(pd.Series(values), format="ISO8601", utc=True).dt.tz_localize(None).to_numpy()
        except ValueError:
            return None
    return values


def clock_zero_s(table: Table, name: str | None) -> float | None:
    """Return when the times that `in_unit` gives of a column of dates, or without its name the file's own, begin.

    In s after 1970; None of anything else.
    """
    if name is None:
        return table.zero_s
    moments = _moments(table.columns[name])
    return None if moments is None else float((moments[0] - np.datetime64(0, "s")) / np.timedelta64(1, "s"))


def in_unit(table: Table, name: str, to: str, key: str, unit: str | None = None) -> NDArray[np.float64]:
    """Return a column (rows,) in the unit `to`; `unit` says what it is in, else the file does. Dates become s after the first
    row, which is at `clock_zero_s`.

    Raises
    ------
    InputError
        If there is no such column, or its unit is unknown or of another kind.
    """
    column(table, name, key)
    moments = _moments(table.columns[name]) if to == "s" else None
    if moments is not None:
        return (moments - moments[0]) / np.timedelta64(1, "s")
    values = table.numbers(name)
    try:
        return values * conversion_factor(unit or unit_of(table, name, to), to)
    except ValueError as error:
        where = key if unit is None else f"{key.split('.')[0]}.{'time_unit' if to == 's' else 'unit'}"
        raise InputError(f"{table.source}: {where}: {error}") from error
