"""A figure before it is drawn: its data with labels and units. What is drawn and what stands in the CSV are the same numbers."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray

Role = Literal["measured", "modelled", "coarse", "other", "dots", "rings"]


@dataclass(frozen=True)
class Axis:
    """What an axis shows, and its unit; empty for a pure number."""

    label: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.label} ({self.unit})" if self.unit else self.label


@dataclass(frozen=True)
class Series:
    """One curve: its name in the legend, what it is (which chooses colour and stroke), its values and standard errors."""

    name: str
    role: Role
    x: FloatArray
    y: FloatArray
    sigma: FloatArray | None = None


@dataclass(frozen=True)
class Plate(ABC):
    """What all figures have: a title for lists, and a name that is safe as that of a file and as a mark in SVG."""

    name: str
    title: str
    wide: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        """Leave out of the name, which may hold what a person called a run or a design variable, all but plain signs."""
        object.__setattr__(self, "name", re.sub(r"[^\w.-]+", "-", self.name))

    @abstractmethod
    def table(self) -> pd.DataFrame:
        """The data drawn, one column per quantity, units in the names."""


@dataclass(frozen=True)
class Lines(Plate):
    """Curves over a common axis; `equal` for paths in the plane, `log_y` for costs and errors over decades."""

    x: Axis
    y: Axis
    series: tuple[Series, ...]
    equal: bool = False
    log_y: bool = False
    whole_x: bool = False

    def table(self) -> pd.DataFrame:
        parts = []
        for item in self.series:
            frame = pd.DataFrame({"series": item.name, _column(self.x): item.x, _column(self.y): item.y})
            if item.sigma is not None:
                frame[f"standard error {_column(self.y)}"] = item.sigma
            parts.append(frame)
        return pd.concat(parts, ignore_index=True)


@dataclass(frozen=True)
class Map(Plate):
    """Values over two axes; `signed` has its middle colour at zero, and no colour tells more than `most` from it."""

    x: Axis
    y: Axis
    value: Axis
    x_values: FloatArray
    y_values: FloatArray
    values: FloatArray
    signed: bool = False
    y_down: bool = False
    names: tuple[str, ...] = ()
    most: float | None = None

    def table(self) -> pd.DataFrame:
        x, y = np.meshgrid(self.x_values, self.y_values)
        columns = {_column(self.x): x.ravel(), _column(self.y): y.ravel(), _column(self.value): self.values.ravel()}
        frame = pd.DataFrame(columns)
        if self.names:
            frame.insert(0, "row", [self.names[int(i)] for i in y.ravel()])
            frame.insert(1, "column", [self.names[int(i)] for i in x.ravel()])
        return frame


@dataclass(frozen=True)
class Bars(Plate):
    """Values by category, one set of bars per series; with `log_y` dots, as no bar has a foot there."""

    categories: tuple[str, ...]
    y: Axis
    sets: tuple[tuple[str, FloatArray], ...]
    x: Axis = Axis("")
    log_y: bool = False

    def table(self) -> pd.DataFrame:
        name = self.x.label or "category"
        return pd.DataFrame(
            {name: self.categories, **{f"{label} {_column(self.y)}": values for label, values in self.sets}}
        )


def told_apart(plates: Sequence[Plate]) -> list[Plate]:
    """The same, those whose names differ in signs or letters' size alone, as files may not, with a number behind."""
    taken: set[str] = set()
    found = []
    for plate in plates:
        names = (plate.name if number == 1 else f"{plate.name}-{number}" for number in count(1))
        name = next(name for name in names if name.casefold() not in taken)
        taken.add(name.casefold())
        found.append(replace(plate, name=name))
    return found


def _column(axis: Axis) -> str:
    return f"{axis.label} [{axis.unit}]" if axis.unit else axis.label


def thinned(count: int, most: int) -> NDArray[np.intp]:
    """Rows (drawn,) that are drawn: all, or evenly chosen ones, the last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).round().astype(np.intp))


def lines(name: str, title: str, x: Axis, y: Axis, series: Sequence[Series | None], **more: bool | str) -> list[Plate]:
    """A figure of the series that there are; none if there is nothing to draw."""
    kept = tuple(item for item in series if item is not None and np.isfinite(item.y).any())
    return [Lines(name, title, x, y, kept, **more)] if kept else []  # type: ignore[arg-type]
