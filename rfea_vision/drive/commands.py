"""What the valves are told: a table of times and states, or an on/off control with a duty cycle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rfea_vision.arrays import FloatArray
from rfea_vision.errors import InputError

COLUMNS = ("time_s", "supply", "drain")


@dataclass(frozen=True)
class ValveCommands:
    """Commands that hold from each time on: time_s (m,) rising; supply, drain (m,) 1 open, 0 closed."""

    time_s: FloatArray
    supply: FloatArray
    drain: FloatArray

    def at(self, time_s: float, pressure_Pa: float = 0.0) -> tuple[float, float]:
        """Supply and drain at a time; closed before the first. The pressure does not matter to a table."""
        index = int(np.searchsorted(self.time_s, time_s + 1e-9, side="right")) - 1
        return (0.0, 0.0) if index < 0 else (float(self.supply[index]), float(self.drain[index]))


def read_commands(path: Path) -> ValveCommands:
    """Read a CSV file with the columns time_s, supply, drain.

    Raises
    ------
    InputError
        The file is missing, lacks a column, or holds anything but rising times and 0 or 1.
    """
    if not path.is_file():
        raise InputError(f"{path}: not found; write a CSV file with the columns time_s, supply, drain")
    try:
        table = pd.read_csv(path, comment="#")
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a table ({error}); write the columns time_s, supply, drain") from error
    for name in COLUMNS:
        if name not in table:
            raise InputError(f"{path}: no column '{name}'; the columns are time_s, supply, drain")
    numbers: Any = table[list(COLUMNS)].apply(pd.to_numeric, errors="coerce")
    values = {name: numbers[name].to_numpy(dtype=float) for name in COLUMNS}
    if not values["time_s"].size or not np.all(np.diff(values["time_s"]) > 0):
        raise InputError(f"{path}: time_s must rise from row to row; sort the rows and drop doubles")
    for name in COLUMNS[1:]:
        wrong = np.flatnonzero(~np.isin(values[name], (0.0, 1.0)))
        if wrong.size:
            raise InputError(f"{path}: row {wrong[0] + 1}: {name} must be 0 (closed) or 1 (open)")
    return ValveCommands(**values)


@dataclass(frozen=True)
class DutyControl:
    """Follow a pressure with a duty cycle: per period the supply, or the drain, is open for a share of it.

    target_Pa : pressure wanted at a time (s); period_s, full_Pa : error at which a valve stays open (assumed)
    dead_Pa : error within which both stay closed (assumed)
    """

    target_Pa: Callable[[float], float]
    period_s: float = 0.02
    full_Pa: float = 40e3
    dead_Pa: float = 2e3

    def at(self, time_s: float, pressure_Pa: float) -> tuple[float, float]:
        """Supply and drain at a time, by the pressure measured then."""
        error = self.target_Pa(time_s) - pressure_Pa
        share = min(max((abs(error) - self.dead_Pa) / self.full_Pa, 0.0), 1.0)
        is_open = float((time_s / self.period_s) % 1.0 < share)
        return (is_open, 0.0) if error > 0 else (0.0, is_open)
