"""From named points of another tool to the nodes or the tip of a tube in the rig frame."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.errors import InputError
from rfea_vision.lines import along, evenly
from rfea_vision.readers.columns import as_written, in_unit, refuse_rows
from rfea_vision.readers.kinds.base import Points, Table, listed, points_of_columns, unseen
from rfea_vision.units import conversion_factor

if TYPE_CHECKING:
    from rfea_vision.campaign.schema import TrackPart

_TURNED = re.compile(r"(?i)(?:^|[^a-z])(?:q|quat\w*|rot\w*|orient\w*)[ _.]*[xyzw0-3]$")
"""Headers of a quaternion: qx, q0, quat_w, pose.orientation.z, Rotation X."""
_OF_LENGTH_ONE = 1e-2
"""How far the sum of its squares may be from one: two digits, as they may be written."""
_NO_RATE = "is missing; the file counts frames, write 'rate: 240 Hz'"
Lengths = Callable[[FloatArray], FloatArray]

_FINE = 8
"""Points per stretch between two marks at which the spline's arc length is taken: a quarter circle of three marks is then
off by less than 0.01 % of its length."""
_FAR = 1e9
"""Pixels, or a thousand kilometres in mm: no place on a tube, and squares of much more overflow."""


def points_in(table: Table, spec: TrackPart | None) -> Points | None:
    """Return the points that `spec` asks for, or None for a table in which it asks for none.

    Raises
    ------
    InputError
        If poses need a word that is missing: which points, which individual.
    """
    if not table.points and (spec is None or not spec.groups):
        return None
    if table.points:
        individual = spec.individual if spec is not None else None
        known = list(table.points)
        if individual is None and len(known) > 1:
            raise InputError(f"{table.source}: track.individual: one of several is needed: {listed(known)}")
        if individual is not None and individual not in known and len(known) > 1:
            raise InputError(f"{table.source}: track.individual: no '{individual}'; there are: {listed(known)}")
        points = table.points.get(individual or known[0], table.points[known[0]])
    else:
        assert spec is not None
        time = spec.time or ("time_s" if "time_s" in table.columns else None)
        time_s = None if time is None else in_unit(table, time, "s", "track.time", spec.time_unit, as_written(spec))
        asked = {name for group in spec.groups for name in group}
        found = points_of_columns(table.source, table.columns, table.units, time_s, asked)
        if found is None:
            names = listed(list(table.columns))
            raise InputError(
                f"{table.source}: track.points: no columns such as tip_x_mm, tip_y_mm; there are: {names}; a point of any columns is "
                "written as their names, 'c2,c3'"
            )
        points = found
    if spec is None or not spec.groups:
        example = f"points: [{', '.join(points.names[:1] + points.names[-1:])}]"
        what = f"name those from the clamp to the tip, for example '{example}'"
        raise InputError(f"{table.source}: track.points: {what}; there are: {listed(points.names)}")
    return points


def nodes_of_points(
    points: Points, spec: TrackPart, to_rig_mm: Lengths | None
) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
    """Bring points into the rig frame.

    Returns
    -------
    time_s : (n,)
    nodes : (n, node, 2) mm evenly spaced along a cubic spline through three or more points, or None
    tip : (n, 2) mm, where there are fewer, or None

    Raises
    ------
    InputError
        If a point, an axis, the scale, the rate or the clamp is not there.
    """
    marks = _chosen(points, spec)
    to_mm = _to_mm(points, spec, to_rig_mm)
    marks_mm = to_mm(marks)
    if spec.origin is not None:
        if len(spec.origin) != points.positions.shape[2]:
            axes = points.positions.shape[2]
            raise InputError(f"{points.source}: track.origin: {len(spec.origin)} numbers, the file has {axes} axes")
        marks_mm = marks_mm - to_mm(np.asarray(spec.origin, dtype=float))
    elif len(spec.groups) == 1 and marks.shape[1] == 1:
        raise InputError(f"{points.source}: track.origin: is missing; one point alone does not say where the clamp is")
    else:
        clamp_mm = marks_mm[np.isfinite(marks_mm[:, 0]).all(axis=1), 0]
        if not len(clamp_mm):
            raise InputError(
                f"{points.source}: track.points: the first, at the clamp, is seen in no frame; name another"
            )
        marks_mm = marks_mm - np.median(clamp_mm, axis=0)
    time_s = _times(points, spec)
    if marks.shape[1] < 3:
        return time_s, None, marks_mm[:, -1]
    return time_s, even_nodes(marks_mm), None


def _chosen(points: Points, spec: TrackPart) -> FloatArray:
    """Return (time, mark, axis) of the points asked for; of a group the mean."""
    positions = unseen(points.positions, points.confidence, spec.confidence)
    positions = np.where(np.abs(positions) < _FAR, positions, np.nan)
    if spec.groups == (("all",),) and "all" not in points.names:
        return positions
    out = []
    for group in spec.groups:
        for name in group:
            if name not in points.names:
                close = difflib.get_close_matches(name, points.names, n=1)
                hint = f"did you mean '{close[0]}'?" if close else "name one of these"
                raise InputError(
                    f"{points.source}: track.points: no '{name}'; there are: {listed(points.names)}; {hint}"
                )
        out.append(positions[:, [points.names.index(name) for name in group]].mean(axis=1))
    return np.stack(out, axis=1)


def _to_mm(points: Points, spec: TrackPart, to_rig_mm: Lengths | None) -> Lengths:
    """Return what turns (..., axis) of the file into (..., 2) mm along the rig's axes."""
    dimensions = points.positions.shape[2]
    if to_rig_mm is not None and spec.scale is None and points.unit in ("", "px", "pixels") and dimensions == 2:
        return to_rig_mm
    axes = spec.axes or (("x", "-y" if points.y_down else "y") if dimensions == 2 else None)
    if axes is None:
        example = "'axes: [x, -z]': the file's axes that point to the camera's right, and up along the hanging tube"
        raise InputError(f"{points.source}: track.axes: is missing for positions in space; write for example {example}")
    if any("xyz".index(axis[-1]) >= dimensions for axis in axes):
        raise InputError(f"{points.source}: track.axes: {list(axes)}, but the file has only {'xyz'[:dimensions]}")
    if spec.scale is not None:
        scale_mm = 1e3 * spec.scale
    else:
        if points.unit in ("", "px", "pixels"):
            what = "positions are pixels" if points.unit else "the file does not say its unit"
            remedy = "write 'scale: 0.25 mm' (the length of one), or a camera with its calibration"
            also = f"; track.rate: {_NO_RATE}" if points.time_s is None and spec.rate is None else ""
            raise InputError(f"{points.source}: track.scale: is missing; {what}; {remedy}{also}")
        try:
            scale_mm = conversion_factor(points.unit, "mm")
        except ValueError as error:
            raise InputError(
                f"{points.source}: track.scale: {error}; write the length of one as 'scale: 1 mm'"
            ) from error
    matrix = np.zeros((2, dimensions))
    for row, axis in enumerate(axes):
        matrix[row, "xyz".index(axis[-1])] = -scale_mm if axis.startswith("-") else scale_mm
    return lambda values: values @ matrix.T


def _times(points: Points, spec: TrackPart) -> FloatArray:
    count = len(points.positions)
    if spec.rate is not None:
        return np.arange(count) / spec.rate
    if points.time_s is None:
        raise InputError(f"{points.source}: track.rate: {_NO_RATE}")
    right = np.isfinite(points.time_s) & (np.diff(points.time_s, prepend=-np.inf) > 0)
    refuse_rows(points.source, "time", ~right, "is not finite or does not increase")
    return points.time_s


def even_nodes(marks_mm: FloatArray) -> FloatArray:
    """Return nodes (time, 2 k - 1, xy), evenly spaced along a cubic spline through marks (time, k, xy); NaN stays NaN."""
    from scipy.interpolate import CubicSpline

    count = 2 * marks_mm.shape[1] - 1
    nodes = np.full((len(marks_mm), count, 2), np.nan)
    for row in np.flatnonzero(np.isfinite(marks_mm).all(axis=(1, 2))):
        marks = marks_mm[row]
        chord = along(marks)
        if np.any(np.diff(chord) <= 0):
            continue  # two marks in one place: no line through them
        fine = CubicSpline(chord, marks)(np.linspace(0.0, chord[-1], _FINE * count))
        nodes[row] = evenly(fine, count)
    return nodes


def turned_body(table: Table) -> str:
    """What to write where a table holds how a rigid body is turned, as a quaternion; empty where it does not."""
    found = {name: values for name, values in table.columns.items() if _TURNED.search(name) and values.dtype.kind in "fiu"}
    if len({values.size for values in found.values()}) != 1 or len(found) != 4:
        return ""
    if not np.nanmedian(np.abs(sum(values.astype(float) ** 2 for values in found.values()) - 1)) < _OF_LENGTH_ONE:
        return ""
    return (
        f"a log, and how a body is turned ({', '.join(found)}), which is not read as a motion; write beside it a column angle_deg: how "
        "far the body has turned from its unloaded pose, about the axis of the bend"
    )
