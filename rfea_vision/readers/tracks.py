"""Tracks made by other tools: a tip, nodes along the centre line, or an inclinometer's angle, over time; and our own."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Track, bend_sign
from rfea_vision.artefacts.measurement import ESTIMATED_ERRORS
from rfea_vision.errors import InputError
from rfea_vision.lines import from_down
from rfea_vision.readers.columns import as_written, clock_zero_s, in_unit, meant_column, refuse_rows
from rfea_vision.readers.kinds.base import Points, Table
from rfea_vision.readers.poses import Lengths, nodes_of_points, points_in
from rfea_vision.readers.tables import read_table
from rfea_vision.scatter import rounding_noise, third_difference_noise
from rfea_vision.units import counted
from rfea_vision.yaml_line import flow

if TYPE_CHECKING:
    from rfea_vision.campaign.schema import TrackPart


_NODE = re.compile(r"^([xy])(\d+)_mm$")
_KNOWN = "tip_x_mm and tip_y_mm, or nodes x00_mm, y00_mm, x01_mm, ..., or angle_deg"
_OF_POINTS = ("individual", "axes", "scale", "rate", "origin", "confidence")
"""Keys of `track` that say something of named points alone."""
_LAST_CHORDS = 4
"""Chords at the tip end over which the tangent's angle is carried on to the tip."""


def read_track(
    path: Path, *, bends: str = "left", spec: TrackPart | None = None, to_rig_mm: Lengths | None = None
) -> Track:
    """Read a table of positions in the rig frame (camera-right x, mm) or of angles (deg), poses of another tool, or a track of our own.

    Parameters
    ----------
    path : any table with ``time_s`` and at least one of the groups above; optional ``sigma_mm``, ``sigma_deg``; or a
        file of named points, of which `spec` says which lie on the tube; or a ``track.nc``, which is taken as it is
    bends : the direction in which angles are positive
    spec : which points, axes, scale and rate; needed where the file holds named points
    to_rig_mm : pixels to mm along the rig's axes, where a calibrated camera is known

    Returns
    -------
    Track
        Rows with a gap are kept as not valid, with the reason ``not_tracked``, or ``low_confidence`` where a point was seen and
        not trusted. Where no sigma is given, the noise is
        estimated from the track's own high frequencies; the attribute ``sigma_source`` says which.

    Raises
    ------
    InputError
        If columns are missing or do not belong together, time does not increase, or no row is complete.
    """
    table = read_table(path)
    if table.track is not None:
        return _own(table, table.track, bends, spec)
    points = points_in(table, spec)
    if points is None:
        _refuse_keys_of_points(path, spec)
        time_s = _time(table, spec)
        nodes, tip, angle = _nodes(table), _pair(table), _angle(table, spec)
    else:
        assert spec is not None
        (time_s, nodes, tip), angle = nodes_of_points(points, spec, to_rig_mm), None
    if nodes is not None:  # some tools write 0 or 9999 everywhere where they saw no tube
        nodes[(np.diff(nodes, axis=1) == 0).all(axis=(1, 2))] = np.nan
    valid = _complete(table, spec, len(time_s), nodes, tip, angle)
    sigma_mm, sigma_deg = _sigma(table, "sigma_mm", valid), _sigma(table, "sigma_deg", valid)
    given = sigma_deg is not None if nodes is None and tip is None else sigma_mm is not None
    dataset = xr.Dataset(
        {
            "valid": ("time", valid.astype(np.int8)),
            "reason": ("time", np.where(valid, "", _why_not(points, spec)).astype(object)),
        },
        coords={"time": ("time", time_s, {"units": "s"}), "xy": ["x", "y"]},
        attrs={"source": path.name, "bends": bends, "sigma_source": "given in the track" if given else ESTIMATED_ERRORS},
    )
    name = (spec and spec.time) or "time_s"
    zero_s = clock_zero_s(table, name if name in table.columns else None)
    if zero_s is not None:
        dataset.attrs["clock_zero_s"] = zero_s
    if nodes is not None:
        _add_nodes(dataset, nodes, valid, _errors(sigma_mm, nodes, valid), bends)
    if tip is not None:
        _add_with_sigma(dataset, "tip", ("time", "xy"), tip, _errors(sigma_mm, tip[:, None], valid), valid, "mm")
    if angle is not None:
        sigma = _errors(sigma_deg, angle[:, None, None], valid)[:, 0]
        _add_with_sigma(dataset, "bend_angle", ("time",), angle, sigma, valid, "deg")
    return Track(dataset)


def _own(table: Table, track: Mapping[str, Any], bends: str, spec: TrackPart | None) -> Track:
    """Return a track of this program as it was written, doubts included: nothing is estimated, and no key says anything of it."""
    asked = sorted((spec.model_fields_set if spec is not None else set()) - {"file"})
    if asked:
        raise InputError(f"{table.source}: track.{asked[0]}: means nothing for a track that rfea has made; leave it out")
    dataset = xr.Dataset.from_dict(track)
    bent = str(dataset.attrs.get("bends", bends))
    if bent != bends:
        remedy = f"write {bent} there, or track the film again"
        raise InputError(f"{table.source}: was made with 'bends: {bent}', and actuator.bends is {bends}; {remedy}")
    try:
        return Track(dataset)
    except InputError as error:
        raise InputError(f"{table.source}: {error}; export it again") from error


def _errors(sigma: FloatArray | None, places: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Standard errors (time, place) of measured places (time, place, axis): as given (time,), else by their own noise."""
    count, each, _ = places.shape
    if sigma is not None:
        return np.repeat(sigma[:, None], each, axis=1)
    return np.tile([noise_of(places[valid, place]) for place in range(each)], (count, 1))


def _complete(table: Table, spec: TrackPart | None, count: int, *measured: FloatArray | None) -> NDArray[np.bool_]:
    """Which of `count` rows have every number of what was measured; an error where fewer than two have."""
    columns = [values.reshape(count, -1) for values in measured if values is not None]
    if not columns:
        line = flow({**(as_written(spec) if spec else {}), "angle": meant_column(table, "angle_deg", "angle") or "NAME"})
        raise InputError(
            f"{table.source}: no columns of a track; needed are time_s and {_KNOWN}; there are: {', '.join(table.columns)}; where one "
            f"of them is an angle, write 'track: {line}'"
        )
    valid = np.asarray(np.isfinite(np.concatenate(columns, axis=1)).all(axis=1))
    if np.count_nonzero(valid) < 2:
        blank = [name for name, values in table.columns.items() if len(values) and np.all(pd.isna(values))]
        if blank:
            raise InputError(
                f"{table.source}: column '{blank[0]}' holds no number in any row; fill it, or export the track again"
            )
        raise InputError(f"{table.source}: {np.count_nonzero(valid)} complete rows of {count}; at least two are needed")
    return valid


def _refuse_keys_of_points(path: Path, spec: TrackPart | None) -> None:
    """Refuse keys about named points in a file without any: they would be ignored."""
    if spec is None:
        return
    for key in _OF_POINTS:
        if getattr(spec, key) != type(spec).model_fields[key].default:
            text = "means nothing without 'points'; leave it out, or name the points on the tube with 'track.points'"
            raise InputError(f"{path}: track.{key}: {text}")


def _why_not(points: Points | None, spec: TrackPart | None) -> NDArray[np.str_]:
    """Reasons (time,), or one for all, for which rows lack a number."""
    if points is None or spec is None or points.confidence is None:
        return np.array("not_tracked")
    asked = {name for group in spec.groups for name in group}
    chosen = [place for place, name in enumerate(points.names) if name in asked or asked == {"all"}]
    return np.where((points.confidence[:, chosen] < spec.confidence).any(axis=1), "low_confidence", "not_tracked")


def noise_of(values: FloatArray) -> float:
    """Estimate white noise from third differences.

    Parameters
    ----------
    values : (time, column), evenly sampled, all finite

    Returns
    -------
    float
        Standard deviation per column, from the median of the absolute differences, so that fast motion in less than
        half of the record does not count as noise. Never below what the rounding of the numbers gives.
    """
    if len(values) < 8:
        return float(np.ptp(values, axis=0).max() / np.sqrt(12.0)) or 1e-3
    spread = float(np.sqrt(np.mean(third_difference_noise(values) ** 2)))
    return float(max(spread, rounding_noise(values) or 1e-3, 1e-6))


def _time(table: Table, spec: TrackPart | None) -> FloatArray:
    """Times of the rows: as named, or those that the file itself keeps of the angle."""
    given, angle = spec and spec.time, (spec and spec.angle) or "angle_deg"
    name = given or "time_s"
    own = given is None and name not in table.columns and angle in table.times_s
    name = angle if own else name
    time_s = (
        np.asarray(table.times_s[name], dtype=float)
        if own
        else in_unit(table, name, "s", "track.time", spec and spec.time_unit, spec and as_written(spec))
    )
    if time_s.size < 2:
        raise InputError(f"{table.source}: {counted(time_s.size, 'row')}; a track of at least two is needed")
    refuse_rows(table.source, name, ~np.isfinite(time_s), "is not a finite number")
    fault = "its time does not increase" if own else "does not increase"
    refuse_rows(table.source, name, np.diff(time_s, prepend=-np.inf) <= 0, fault)
    return time_s


def _angle(table: Table, spec: TrackPart | None) -> FloatArray | None:
    given = spec and spec.angle
    if given is None and "angle_deg" not in table.columns:
        return None
    return in_unit(table, given or "angle_deg", "deg", "track.angle", spec and spec.unit, spec and as_written(spec))


def _sigma(table: Table, name: str, valid: NDArray[np.bool_]) -> FloatArray | None:
    """Standard errors (row,) where the table gives them; every valid row needs one."""
    if name not in table.columns:
        return None
    sigma = table.numbers(name)
    refuse_rows(table.source, name, valid & ~(np.isfinite(sigma) & (sigma >= 0)), "is no finite number, or below 0")
    return sigma


def _pair(table: Table) -> FloatArray | None:
    there = [name for name in ("tip_x_mm", "tip_y_mm") if name in table.columns]
    if len(there) == 1:
        other = "tip_y_mm" if there == ["tip_x_mm"] else "tip_x_mm"
        raise InputError(f"{table.source}: '{there[0]}' stands without '{other}'; a tip needs both")
    return np.stack([table.numbers(name) for name in there], axis=1) if there else None


def _nodes(table: Table) -> FloatArray | None:
    """Return nodes (time, node, xy), or None; x and y must have the same numbers, from 0 without a gap."""
    found: dict[str, dict[int, str]] = {"x": {}, "y": {}}
    for name in table.columns:
        if match := _NODE.match(name):
            found[match[1]][int(match[2])] = name
    if not found["x"] and not found["y"]:
        return None
    count = max(len(found["x"]), len(found["y"]))
    for axis in "xy":
        lacking = [index for index in range(count) if index not in found[axis]]
        if lacking:
            name = f"{axis}{lacking[0]:02d}_mm"
            raise InputError(f"{table.source}: column '{name}' is missing; nodes need x and y from 00 on without a gap")
    if count < 3:
        raise InputError(f"{table.source}: {count} nodes; a centre line needs at least three")
    return np.stack(
        [np.stack([table.numbers(found[axis][index]) for index in range(count)], axis=1) for axis in "xy"], axis=2
    )


def _add_with_sigma(
    dataset: xr.Dataset,
    name: str,
    dims: tuple[str, ...],
    values: FloatArray,
    sigma: FloatArray,
    valid: NDArray[np.bool_],
    units: str,
) -> None:
    """Add what was measured and its standard error, of (time, 1) that of either axis; nothing where a row is not valid."""
    sigma = np.repeat(sigma, values.shape[1], axis=1) if sigma.shape[1:] == (1,) else sigma
    for key, given in ((name, values), (f"{name}_sigma", sigma)):
        shown = given.copy()
        shown[~valid] = np.nan
        dataset[key] = (dims[: given.ndim], shown, {"units": units})


def _add_nodes(
    dataset: xr.Dataset, nodes: FloatArray, valid: NDArray[np.bool_], sigma: FloatArray, bends: str
) -> None:
    """Add the centre line, its standard errors (time, node) in mm, its tip and the tangent's angle there."""
    _add_with_sigma(dataset, "midline", ("time", "node", "xy"), nodes, sigma, valid, "mm")
    _add_with_sigma(dataset, "tip", ("time", "xy"), nodes[:, -1], sigma[:, -1:], valid, "mm")
    angle, angle_sigma = _tip_angle(nodes, sigma, bends)
    _add_with_sigma(dataset, "bend_angle", ("time",), angle, angle_sigma, valid, "deg")
    chords = min(_LAST_CHORDS, nodes.shape[1] - 1)
    dataset["bend_angle"].attrs["source"] = f"tangent at the tip, from the last {chords} chords"


def _tip_angle(nodes: FloatArray, sigma: FloatArray, bends: str) -> tuple[FloatArray, FloatArray]:
    """Return the tangent's angle at the tip and its standard error, deg, by a straight line through the last chords."""
    chords = np.diff(nodes, axis=1)
    lengths = np.linalg.norm(chords, axis=2)
    phi = np.unwrap(from_down(chords, bend_sign(bends)), axis=1)
    count = min(_LAST_CHORDS, phi.shape[1])
    place = np.arange(count) + 0.5  # middles of the chords, in chords
    design = np.stack([np.ones(count), place - count], axis=1)
    weights = np.linalg.pinv(design)[0]
    angle = phi[:, -count:] @ weights
    node_weights = -np.diff(weights, prepend=0.0, append=0.0)  # d(angle)/d(normal displacement of node) times the chord
    step = lengths[:, -count:].mean(axis=1)
    error = np.sqrt(sigma[:, -count - 1 :] ** 2 @ node_weights**2) / step
    return np.rad2deg(angle), np.rad2deg(error)
