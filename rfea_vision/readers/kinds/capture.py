"""Motion capture: c3d."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rfea_vision.readers.kinds.base import Kind, Points, Table, distinct, points_table


def read_c3d(path: Path) -> Table:
    """Read markers, and analog channels (a pressure among them) as columns with their own times."""
    import ezc3d

    file = ezc3d.c3d(str(path))
    parameters, data = file["parameters"], file["data"]
    point = parameters["POINT"]
    names = tuple(str(name).strip() for name in point["LABELS"]["value"])
    positions = np.asarray(data["points"], dtype=float)[:3].transpose(2, 1, 0)
    rate = float(point["RATE"]["value"][0])
    unit = str(point["UNITS"]["value"][0]).strip() if point["UNITS"]["value"] else ""
    time_s = np.arange(len(positions)) / rate
    table = points_table(str(path), {"": Points(str(path), names, positions, unit, time_s)})
    times = dict.fromkeys(table.columns, time_s)
    units = dict.fromkeys(table.columns, unit)
    analog = parameters.get("ANALOG", {})
    samples = np.asarray(data["analogs"], dtype=float)
    samples = samples[0] if samples.ndim == 3 and samples.size else np.empty((0, 0))
    columns = dict(table.columns)
    said = [str(item).strip() for item in analog.get("UNITS", {}).get("value", [])]
    for index, values in enumerate(samples):
        name = distinct(str(analog["LABELS"]["value"][index]).strip(), columns)
        columns[name], units[name] = values, said[index] if index < len(said) else ""
        times[name] = np.arange(len(values)) / float(analog["RATE"]["value"][0])
    return Table(str(path), columns, units, times, table.points)


KINDS = (Kind("c3d", (".c3d",), read_c3d, apart=True, extra="capture"),)
