"""What a file seems to be: a film, a picture, a log, a track; and why it is taken for that."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.campaign.tension import TENDON, TENDON_WHY, tension_of
from rfea_vision.campaign.tracked import across
from rfea_vision.data import column_words
from rfea_vision.errors import RfeaError
from rfea_vision.readers.columns import column, in_unit, said_unit, says_other_kind, unread_clock, unread_pressure
from rfea_vision.readers.kinds.base import AXIS, Points, Table, points_of_columns
from rfea_vision.readers.pictures import PICTURES
from rfea_vision.readers.poses import turned_body
from rfea_vision.readers.tables import endings, read_table
from rfea_vision.units import conversion_factor, pressure_unit

FILMS = (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm", ".mpg", ".mts", ".gif")

_WORKBOOKS = (".xlsx", ".xls", ".xlsm", ".ods")

#: Of an open line, from 1,500 m above the sea to the highest air pressure recorded.
_ATMOSPHERE_kPa = (85.0, 108.0)
#: Largest pressures of a run: what soft actuators are driven with lies between (some 10 kPa of air in silicone to 1 MPa of water).
_LEAST_kPa, _MOST_kPa = 8.0, 2000.0
#: An angle that never exceeds this is one in radians, up to half a turn.
_LEAST_deg = 3.2
_BY_NAME = "by their names, from the clamp to the tip"
_BARE = "the only column beside the time"
_ALONE = "the only column left, and no other file holds a motion; is it an angle?"
#: Of a table in which a motion can be said to follow one pressure and not another.
_LEAST_ROWS = 20
#: Between two samples of a log: slower ones show no motion of a tube.
_LONGEST_STEP_S = 0.5


@dataclass(frozen=True)
class Key:
    """A key of experiment.yaml or campaign.yaml; `why` says why the value was guessed and is empty where it is certain.

    A value of None is one that nobody can guess: the line is written as a comment, with an `example`, and `why` as what is needed.
    """

    name: str
    value: Any
    why: str = ""
    example: str = ""


@dataclass(frozen=True)
class FileGuess:
    """One file: what it holds, and the keys that say how to read it; with several chambers those of each.

    A log with a single column that nothing explains has keys of motion, too: it may be an angle.
    """

    path: Path
    what: str
    pressure: tuple[Key, ...] = ()
    chambers: tuple[tuple[Key, ...], ...] = ()
    motion: tuple[Key, ...] = ()
    actuator: tuple[Key, ...] = ()
    note: str = ""


@dataclass
class _Columns:
    """The columns of a table that have been given a meaning."""

    table: Table
    taken: set[str] = field(default_factory=set)

    def words(self, name: str) -> list[str]:
        return [word.lower() for word in re.split(r"[^\w]+|_|(?<=[a-z])(?=[A-Z0-9])", name) if word]

    def numeric(self) -> list[str]:
        return [
            name
            for name, values in self.table.columns.items()
            if name not in self.taken and values.size > 1 and values.dtype.kind in "fiu" and np.isfinite(values).any()
        ]

    def measured(self, names: Sequence[str]) -> list[str]:
        """Return `names` without those of set points and computed values, unless there are no others."""
        words = column_words()
        other = self.called(names, [*words["supply"], *words["computed"]])
        return [name for name in names if name not in other] or list(names)

    def moving(self, names: Sequence[str]) -> list[str]:
        """Return `names` without those that hold one value throughout (a zero, an air's pressure), unless all do."""
        values = self.table.columns
        return [name for name in names if np.nanmin(values[name]) < np.nanmax(values[name])] or list(names)

    def called(self, names: Sequence[str], words: Sequence[str]) -> list[str]:
        return [name for name in names if set(self.words(name)) & set(words)]


def look(path: Path) -> FileGuess:
    """Look at one file; whatever is wrong with it becomes its note."""
    ending = path.suffix.lower()
    if ending in FILMS:
        return FileGuess(path, "film", motion=(Key("file", path),))
    if ending in PICTURES:
        return FileGuess(path, "picture")
    if ending not in endings():
        return FileGuess(path, "unknown", note=f"no reader for '{ending}'" + "; save it as CSV" * (ending in _WORKBOOKS))
    try:
        return _table(path)
    except RfeaError as error:
        return FileGuess(path, "unknown", note=str(error).removeprefix(f"{path}: ").removeprefix(f"{path}:1: "))


def _table(path: Path) -> FileGuess:
    columns = _Columns(read_table(path))
    time = _time(columns)
    motion, actuator = _motion(columns, time)
    pressure = _pressure(columns, time, _moved(columns, motion))
    if pulled := _pulled(columns, time, pressure):
        pressure, actuator = pulled, (*actuator, Key("section", TENDON, TENDON_WHY))
    if pressure is None and motion is None:
        bare = "c1" in columns.table.columns  # of a file without a header
        if unread := (not time and unread_clock(columns.table)) or unread_pressure(columns.table):
            return FileGuess(path, "unknown", note=unread)
        remedy = "; write a line of names above its numbers, for example 'time_s,p_kPa,angle_deg'" if bare else ""
        return FileGuess(path, "unknown", note=f"no column looks like a pressure, a tip or an angle{remedy}")
    what = "log" if motion is None else "track" if pressure is None else "both"
    file = Key("file", path)
    each = tuple((file, *keys) for keys in pressure or ((),))
    if motion is None:
        pressures = {key.value for keys in each for key in keys if key.why != _BARE}
        rest = columns.measured([name for name in columns.numeric() if name not in pressures])
        if len(rest) == 1 and not says_other_kind(columns.table, rest[0], "deg"):
            motion = (*time, Key("angle", rest[0], _ALONE), *_angle_unit(columns.table, rest[0]))
    note = turned_body(columns.table)
    return FileGuess(path, what, each[0], each if len(each) > 1 else (), (file, *(motion or ())), actuator, note)


def _time(columns: _Columns) -> tuple[Key, ...]:
    """The column of time: called so, or else the one that rises most evenly."""
    table = columns.table
    if "time_s" in table.columns:
        columns.taken.add("time_s")
        return ()
    if table.times_s:  # the file keeps the times of each channel beside it
        return ()
    dated = [name for name, values in table.columns.items() if values.dtype.kind in "MOUT" and _is_clock(table, name)]
    rising = dated + [name for name in columns.numeric() if np.all(np.diff(table.columns[name]) > 0)]
    if not rising:
        return ()
    called = columns.called(rising, column_words()["time"])
    if called or dated:
        name, why = (called or dated)[0], "its header and its values say so"
    else:
        name = min(rising, key=lambda item: _unevenness(table.columns[item]))
        why = "no header says time; of the columns that only rise it does so most evenly"
    columns.taken.add(name)
    keys = [Key("time", name, why)]
    if name not in dated and said_unit(table, name, "s") is None:
        step = float(np.median(np.diff(table.columns[name])))
        unit = "s" if step < _LONGEST_STEP_S else "ms" if step < 1e3 * _LONGEST_STEP_S else "us"
        keys.append(Key("time_unit", unit, f"the file names no unit; its steps are {step:.3g}"))
    return tuple(keys)


def _is_clock(table: Table, name: str) -> bool:
    try:
        return bool(np.all(np.diff(in_unit(table, name, "s", "pressure.time")) > 0))
    except (RfeaError, TypeError):
        return False


def _unevenness(values: np.ndarray) -> float:
    steps = np.diff(values.astype(float))
    return float(np.std(steps) / np.mean(steps))


def _moved(columns: _Columns, motion: tuple[Key, ...] | None) -> np.ndarray | None:
    """What moves in the same table (rows, columns), where the table holds the motion."""
    angles, table = [key.value for key in motion or () if key.name == "angle"], columns.table.columns
    names = angles or [name for name in ("tip_x_mm", "tip_y_mm") if name in table]
    return np.column_stack([table[name] for name in names]).astype(float) if names else None


def _most_followed(columns: _Columns, names: Sequence[str], moved: np.ndarray) -> str:
    """Of several pressures the one that a motion (rows, columns) of the same table explains best."""
    shares = dict.fromkeys(names, -1.0)
    for name in names:
        values = columns.table.columns[name].astype(float)
        good = np.isfinite(values) & np.isfinite(moved).all(axis=1)
        if good.sum() >= _LEAST_ROWS and np.ptp(values[good]) > 0:
            design = np.column_stack([moved[good], np.ones(good.sum())])
            left = values[good] - design @ np.linalg.lstsq(design, values[good], rcond=None)[0]
            shares[name] = 1.0 - float(np.var(left) / np.var(values[good]))
    return max(names, key=lambda name: shares[name])


def _pressure(
    columns: _Columns, time: tuple[Key, ...], moved: np.ndarray | None = None
) -> tuple[tuple[Key, ...], ...] | None:
    """How the pressure is read, or that of every chamber; None where no column looks like one."""
    table = columns.table
    if not time and "time_s" not in table.columns and not table.times_s:
        return None
    names = columns.numeric()
    by_unit = [name for name in names if said_unit(table, name, "kPa") is not None]
    by_word = columns.called(names, column_words()["pressure"])
    air = column_words()["ambient"]
    ambient = columns.called(by_unit + by_word, air) or columns.called(names, air)
    found = columns.moving(columns.measured([name for name in dict.fromkeys(by_word + by_unit) if name not in ambient]))
    if chambers := _chambers(columns, found):
        return tuple((*time, *said, *_column(table, name, ambient, tuple(chambers))) for name, said in chambers.items())
    bare = not found and len(names) == 1 and len(table.columns) == 2
    found = names if bare else found
    if not found:
        return None
    name = found[0] if moved is None else _most_followed(columns, found, moved)
    why = _BARE if bare else "its header and its unit say so" if name in by_unit else "its header says so"
    others = [other for other in found if other != name]
    best = "the motion follows this one best; " * (moved is not None)
    why += f"; {best}there are also {', '.join(others[:3])}: of several chambers, make this a list" if others else ""
    if name == "pressure_kPa" and not others:
        return ((*time, *_column(table, name, ambient)),)
    return ((*time, Key("pressure", name, "" if name == "pressure_kPa" else why), *_column(table, name, ambient)),)


def _pulled(
    columns: _Columns, time: tuple[Key, ...], pressure: tuple[tuple[Key, ...], ...] | None
) -> tuple[tuple[Key, ...], ...] | None:
    """How the tension of a tendon is read, where nothing but its being alone makes another column a `pressure`; None without one."""
    told = pressure is not None and not any(key.why == _BARE for keys in pressure for key in keys)
    measured = columns.measured(columns.numeric())
    there = time or "time_s" in columns.table.columns
    found = None if told or not there else tension_of(columns.table, measured, columns.called(measured, column_words()["tension"]))
    return None if found is None else ((*time, Key("pressure", *found)),)


def _column(table: Table, name: str, ambient: list[str], beside: Sequence[str] = ()) -> tuple[Key, ...]:
    """Unit and reference of a pressure; sensors `beside` it that say the same unit are of its kind."""
    unit = said_unit(table, name, "kPa")
    guessed, why = _unit_by_size(table.columns[name])
    alike = [name, *(one for one in beside if said_unit(table, one, "kPa") == unit)]
    return (() if unit else (Key("unit", guessed, why),)) + _reference(table, alike, unit or guessed, ambient)


def _unit_by_size(values: np.ndarray) -> tuple[str, str]:
    """The unit in which these would be pressures that bend a tube."""
    largest, lowest = (float(np.abs(bound(values[np.isfinite(values)]))) for bound in (np.max, np.min))
    why = f"the file names no unit; the largest value is {largest:.4g}"
    if _is_air(lowest / 10.0):
        return "hPa", f"{why}, the lowest that of air in hPa"
    fitting = "bar" if largest < _LEAST_kPa else "Pa" if largest > _MOST_kPa else "kPa"
    return fitting, why


def _chambers(columns: _Columns, names: list[str]) -> dict[str, tuple[Key, ...]]:
    """Chamber, column and sign of every pressure, where all headers name a chamber or a side of the tube; else nothing."""
    words = {name: columns.words(name) for name in names}
    shared = set.intersection(*map(set, words.values())) if words else set()
    own = {name: [word for word in words[name] if word not in shared] for name in names}
    known = column_words()
    sides = [set(own[name]) & {*known["side"], *known["opposite"]} for name in names]
    spoken = bool(shared & set(known["chamber"]))
    if len(names) < 2 or not all(own.values()) or not (spoken or all(sides)):
        return {}
    called = {name: re.sub(r"^(?=\d)", "chamber", "_".join(own[name])) for name in names}
    if len(set(called.values())) < len(names):
        return {}
    apart = [side & set(known["opposite"]) for side in sides]
    both = len(names) == 2 and bool(apart[0]) != bool(apart[1])
    why = "nothing says which way it bends the tube; -1 for the other"
    if both:
        why = "the two sides bend the tube to both; which of them as 'bends' says is not known: exchange the signs if needed"
    return {
        name: (Key("chamber", called[name], "its header says so"), Key("pressure", name), Key("sign", -1 if opposite else 1, why))
        for name, opposite in zip(names, apart, strict=True)
    }


def _reference(table: Table, alike: list[str], unit: str, ambient: list[str]) -> tuple[Key, ...]:
    """Absolute, where the unit does not say it, if what is lowest of all sensors of one kind is the air's pressure."""
    bare, said = pressure_unit(unit)
    lowest_kPa = min(float(np.nanmin(table.columns[one])) for one in alike) * conversion_factor(bare, "kPa")
    airy, why = _is_air(lowest_kPa), f"the lowest value is {lowest_kPa:.1f} kPa, that of air"
    for other in ambient[:1]:  # a line that is never open is told by the air's pressure beside it
        air_kPa = float(np.nanmin(table.columns[other])) * conversion_factor(
            pressure_unit(said_unit(table, other, "kPa") or unit)[0], "kPa"
        )
        if not airy and _is_air(air_kPa) and lowest_kPa > air_kPa:
            airy, why = True, f"it is never below that of the air, which '{other}' keeps"
    if said == "gauge":
        return ()
    keys = [] if said or not airy else [Key("reference", "absolute", why)]
    if ambient and (said == "absolute" or airy):
        keys.append(Key("ambient", ambient[0], "its header says so"))
    return tuple(keys)


def _is_air(pressure_kPa: float) -> bool:
    return _ATMOSPHERE_kPa[0] <= pressure_kPa <= _ATMOSPHERE_kPa[1]


def _motion(columns: _Columns, time: tuple[Key, ...]) -> tuple[tuple[Key, ...] | None, tuple[Key, ...]]:
    """What of the tube's motion a table holds, and what that tells of the tube."""
    table = columns.table
    clock = time if time and time[0].name == "time" else ()
    if table.points:
        return _poses(next(iter(table.points.items())), len(table.points))
    if {"tip_x_mm", "tip_y_mm"} <= set(table.columns) or {"x00_mm", "y00_mm"} <= set(table.columns):
        return clock, _tube(table)
    if "angle_deg" in table.columns:
        columns.taken.add("angle_deg")
        return (*clock, Key("angle", "angle_deg")), ()
    marked = points_of_columns(table.source, table.columns, table.units, table.columns.get("time_s"))
    if marked is not None and any(word in name.lower() for name in marked.names for word in column_words()["tip"]):
        places = {name: AXIS.match(name) for name in columns.numeric()}
        columns.taken |= {name for name, match in places.items() if match and match["name"] in marked.names}
        return _poses(("", marked), 1, clock)
    names = columns.measured(columns.numeric())
    called = columns.called(names, column_words()["angle"])
    by_unit = [name for name in names if said_unit(table, name, "deg") is not None]
    found = list(dict.fromkeys([*(name for name in called if name in by_unit), *called, *by_unit]))
    if not found or (not clock and "time_s" not in table.columns and found[0] not in table.times_s):
        return None, ()
    name = found[0]
    columns.taken.add(name)
    keys = (*clock, Key("angle", name, "its header says so"))
    return (*keys, *_angle_unit(table, name)), ()


def _angle_unit(table: Table, name: str) -> tuple[Key, ...]:
    if said_unit(table, name, "deg") is not None:
        return ()
    largest = float(np.nanmax(np.abs(table.columns[name])))
    unit = "rad" if largest < _LEAST_deg else "deg"
    return (Key("unit", unit, f"the file names no unit; the largest value is {largest:.4g}"),)


def _tube(table: Table) -> tuple[Key, ...]:
    """The tube's length and side, from where its tip has been."""
    last = max((name for name in table.columns if re.match(r"x\d+_mm$", name)), default="tip_x_mm")
    other = "tip_y_mm" if last == "tip_x_mm" else last.replace("x", "y", 1)
    x, y = (table.numbers(name) for name in (last, column(table, other, "track.file")))
    seen = (np.abs(x) < np.inf) & (np.abs(y) < np.inf)
    return _reached(x[seen], y[seen]) if seen.any() else ()


def _reached(x: np.ndarray, y: np.ndarray) -> tuple[Key, ...]:
    """The tube's length and side, from where its tip has been (rows,) mm from the clamp."""
    farthest = float(np.percentile(np.hypot(x, y), 99))  # a single leap of the track is no length
    sides = np.percentile(across(np.column_stack([x, y])), (1, 99))
    return (
        Key("length", f"{farthest:.4g} mm", "the farthest that the tip has been from the clamp, but for a hundredth of the rows"),
        Key("bends", "left" if sides.sum() < 0 else "right", "where the tip has gone farthest"),
    )


def _poses(
    first: tuple[str, Points], count: int, clock: tuple[Key, ...] = ()
) -> tuple[tuple[Key, ...], tuple[Key, ...]]:
    individual, points = first
    keys = [Key("individual", individual, f"the first of {count}")] if count > 1 else []
    order = _order(points)
    keys.append(order)
    axes, actuator = _hanging(points, order)
    if points.positions.shape[2] == 3 or axes.value not in (None, ["x", "y"]):
        keys.append(axes)
    if points.unit in ("px", "pixels", ""):
        keys.append(Key("scale", None, "the length of one pixel; or a camera in campaign.yaml", "0.25 mm"))
    if points.time_s is None and not clock:
        keys.append(Key("rate", None, "of the frames, the file does not say it", "100 Hz"))
    return (*clock, *keys), actuator


def _hanging(points: Points, order: Key) -> tuple[Key, tuple[Key, ...]]:
    """The axes to the camera's right and up along the tube, and what its ends tell of the tube, where both are named."""
    unknown = Key("axes", None, "the file's axes that point to the camera's right, and up along the hanging tube", "[x, -z]")
    if points.y_down or order.why != _BY_NAME:
        return unknown, ()
    ends = [[group] if isinstance(group, str) else group for group in (order.value[0], order.value[-1])]
    clamp, tip = (points.positions[:, [points.names.index(name) for name in end]].mean(axis=1) for end in ends)
    way = (tip - clamp)[np.isfinite(tip - clamp).all(axis=1)]
    if not len(way):
        return unknown, ()
    along = int(np.argmax(np.abs(np.median(way, axis=0))))
    right = max((axis for axis in range(way.shape[1]) if axis != along), key=lambda axis: float(np.ptp(way[:, axis])))
    up = f"-{'xyz'[along]}" if np.median(way[:, along]) > 0 else "xyz"[along]
    seen = f"from the clamp the tip lies along {'xyz'[along]}, and moves most along {'xyz'[right]}"
    axes = Key("axes", ["xyz"[right], up], seen)
    if points.unit in ("px", "pixels", ""):
        return axes, ()
    return axes, _reached(*(conversion_factor(points.unit, "mm") * way[:, [right, along]]).T)


def _order(points: Points) -> Key:
    """The points from the clamp to the tip: by their names, else in the file's order."""
    names = list(points.names)
    if len(names) > 12:
        return Key("points", "all", "taken to lie along the tube, from the clamp to the tip")

    def named(words: Sequence[str]) -> Callable[[str], bool]:
        return lambda name: any(word in name.lower() for word in words)

    clamp, tip = list(filter(named(column_words()["clamp"]), names)), list(filter(named(column_words()["tip"]), names))
    middle = [name for name in names if name not in clamp + tip]
    why = _BY_NAME if clamp and tip else "in the file's order; from the clamp to the tip?"
    groups = [clamp] * bool(clamp) + [[name] for name in middle] + [tip] * bool(tip)
    return Key("points", [group[0] if len(group) == 1 else group for group in groups], why)
