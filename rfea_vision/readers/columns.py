"""A column by its name, in the unit asked for: what logs and tracks have in common."""

from __future__ import annotations

import difflib
import re

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Table, listed
from rfea_vision.units import conversion_factor, pressure_unit

_SIGNS = {"°": "deg", "º": "deg", "µs": "us", "sec": "s", "Sek": "s", "mBar": "mbar", "Bar": "bar"}
"""Spellings that no registry of units knows."""


def column(table: Table, name: str, key: str) -> str:
    """Return `name` if there is such a column.

    Raises
    ------
    InputError
        Naming the `key` that asks for it, and the columns there are.
    """
    if name in table.columns:
        return name
    names = list(table.columns)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    example = f"'{key.split('.')[1]}: {close[0] if close else names[0]}'"
    raise InputError(
        f"{table.source}: no column '{name}' ({key}); there are: {listed(names)}; name one, for example {example}"
    )


def unit_of(table: Table, name: str, default: str) -> str:
    """Return the unit that the file or the column's name gives: ``pressure_bar``, ``p [psi]``, ``time (ms)``.

    It must measure what `default` does; with an empty default, pressure.
    """
    said = table.units.get(name)
    match = re.search(r"(?:_|\s*[\[(])([A-Za-z°ºµ]+(?:\([ag]\))?)[\])]?$", name)
    found = said or (match[1] if match else None)
    if found is None:
        return default
    found = _SIGNS.get(found, found)
    try:
        conversion_factor(pressure_unit(found)[0], default or "kPa")
    except ValueError:
        return said or default
    return found


def _seconds(values: np.ndarray) -> NDArray[np.float64] | None:
    """Seconds after the first row, of dates and of text such as ``2026-03-01 14:05:30.25``; None for anything else."""
    if values.dtype.kind != "M":
        if not values.size or not re.match(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d", str(values[0])):
            return None
        try:
            values = pd.to_datetime(pd.Series(values), format="ISO8601", utc=True).dt.tz_localize(None).to_numpy()
        except ValueError:
            return None
    return (values - values[0]) / np.timedelta64(1, "s")


def in_unit(table: Table, name: str, to: str, key: str, unit: str | None = None) -> NDArray[np.float64]:
    """Return a column in the unit `to`; `unit` says what it is in, else the file does. Dates become s after the first row.

    Raises
    ------
    InputError
        If there is no such column, or its unit is unknown or of another kind.
    """
    column(table, name, key)
    moments = _seconds(table.columns[name]) if to == "s" else None
    if moments is not None:
        return moments
    values = table.numbers(name)
    try:
        return values * conversion_factor(unit or unit_of(table, name, to), to)
    except ValueError as error:
        where = key if unit is None else f"{key.split('.')[0]}.{'unit' if to == 'kPa' else 'time_unit'}"
        raise InputError(f"{table.source}: {where}: {error}") from error
