"""The figures of one run: what was measured, and what a model makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from rfea_vision.arrays import FloatArray
from rfea_vision.figures.plates import Axis, Map, Plate, Role, Series, lines, thinned
from rfea_vision.report.collect import Experiment, LadderStep
from rfea_vision.report.shown import error_over_time, offsets_tried

MOST_ROWS, MOST_COLUMNS = 4000, 600  # more points than a page has dots
TIME, ALONG = Axis("time", "s"), Axis("place along the tube, clamp 0, tip 1")


def run_plates(experiment: Experiment, step: LadderStep | None) -> list[Plate]:
    """Every figure of a run, with the model's curves where the model has been run on it."""
    data = experiment.measured
    if data is None:
        return []
    modelled = step.predictions.get(experiment.name) if step is not None else None
    name = experiment.name
    found = [*_over_time(name, data, modelled), *_loops(name, data, modelled), *_trust(name, data)]
    found += _maps(name, data, modelled) if modelled is not None else []
    return found


def _valid(data: xr.Dataset, key: str, *, part: int | None = None) -> FloatArray | None:
    if key not in data:
        return None
    values = np.asarray(data[key].values, dtype=float)
    values = values if part is None else values[:, part]
    return values if np.isfinite(values).any() else None


def curve(
    data: xr.Dataset | None, key: str, name: str, role: Role, *, part: int | None = None, sigma: str | None = None
) -> Series | None:
    """One quantity over time, thinned to what a page can show."""
    values = None if data is None else _valid(data, key, part=part)
    if data is None or values is None:
        return None
    rows = thinned(len(values), MOST_ROWS)
    errors = _valid(data, sigma, part=part) if sigma else None
    return Series(name, role, data["time"].values[rows], values[rows], None if errors is None else errors[rows])


def _timed(run: str, name: str, axis: Axis, *series: Series | None) -> list[Plate]:
    """A figure over time; none where there is nothing to draw."""
    return lines(f"{run}-{name}", axis.label.capitalize(), TIME, axis, series, wide=True)


def _over_time(run: str, data: xr.Dataset, modelled: xr.Dataset | None) -> list[Plate]:
    found: list[Plate] = []
    if "pressure" in data:
        found += _timed(run, "pressure", Axis("pressure", "kPa"), _logged(data, "measured"))
    for name, key, part, axis in (
        ("tip-x", "tip", 0, Axis("tip x", "mm")), ("tip-y", "tip", 1, Axis("tip y", "mm")),
        ("angle", "bend_angle", None, Axis("bend angle", "deg")),
    ):  # fmt: skip
        if (measured := curve(data, key, "measured", "measured", part=part)) is not None:
            model = curve(modelled, key, "modelled", "modelled", part=part, sigma=f"{key}_stderr")
            found += _timed(run, name, axis, measured, model)
    return found if modelled is None else found + _error(run, modelled)


def _logged(data: xr.Dataset, role: Role) -> Series:
    """The pressure log, thinned to what a page can show."""
    rows = thinned(data.sizes["log_time"], MOST_ROWS)
    return Series("pressure", role, data["log_time"].values[rows], data["pressure"].values[rows])


def _error(run: str, modelled: xr.Dataset) -> list[Plate]:
    """The gap that was kept with the prediction; for an inclinometer that in angle."""
    if (found := error_over_time(modelled)) is None:
        return []
    error, unit = found
    axis, rows = Axis("tip error" if unit == "mm" else "angle error", unit), thinned(len(error), MOST_ROWS)
    return _timed(run, "error", axis, Series("error", "modelled", modelled["time"].values[rows], error[rows]))


def _loops(run: str, data: xr.Dataset, modelled: xr.Dataset | None) -> list[Plate]:
    """What moves against what drives it, and where the tip has been."""

    def against(made: Series | None) -> Series | None:
        if made is None:
            return None
        return replace(made, x=np.interp(made.x, data["log_time"].values, data["pressure"].values))

    found: list[Plate] = []
    for name, key, part, axis in (
        ("loop-angle", "bend_angle", None, Axis("bend angle", "deg")), ("loop-tip", "tip", 1, Axis("tip y", "mm")),
    ):  # fmt: skip
        measured = curve(data, key, "measured", "measured", part=part) if "pressure" in data else None
        if measured is not None:
            both = [against(measured), against(curve(modelled, key, "modelled", "modelled", part=part))]
            title = f"{axis.label.capitalize()} against pressure"
            found += lines(f"{run}-{name}", title, Axis("pressure", "kPa"), axis, both)
    path = [tip_path(data, "measured", "measured"), tip_path(modelled, "modelled", "modelled")]
    return found + lines(f"{run}-path", "Path of the tip", Axis("x", "mm"), Axis("y", "mm"), path, equal=True)


def tip_path(data: xr.Dataset | None, name: str, role: Role) -> Series | None:
    """Where the tip travels."""
    tip = None if data is None else _valid(data, "tip")
    if tip is None:
        return None
    rows = thinned(len(tip), MOST_ROWS)
    return Series(name, role, tip[rows, 0], tip[rows, 1])


def _maps(run: str, data: xr.Dataset, modelled: xr.Dataset) -> list[Plate]:
    columns = thinned(modelled.sizes["time"], MOST_COLUMNS)
    time = modelled["time"].values[columns]

    def over_tube(
        name: str, title: str, source: xr.Dataset, key: str, unit: str, scale: float, signed: bool
    ) -> list[Plate]:
        values = _valid(source, key)
        if values is None or len(values) != modelled.sizes["time"]:
            return []
        count, at_nodes = values.shape[1], key in ("normal_residual", "width")
        place = np.linspace(0.0, 1.0, count) if at_nodes else (np.arange(count) + 0.5) / count
        axis = Axis(title.lower(), unit)
        shown = scale * values[columns].T
        return [Map(f"{run}-{name}", title, TIME, ALONG, axis, time, place, shown, signed, y_down=True, wide=True)]

    return [
        *over_tube("carpet", "Error along the tube", modelled, "normal_residual", "mm", 1.0, True),
        *over_tube("torque", "Residual torque", modelled, "residual_torque", "mN m", 1.0, True),
        *over_tube("elongation", "Elongation", data, "elongation", "%", 100.0, False),
        *over_tube("width", "Width of the tube", data, "width", "mm", 1.0, False),
    ]


def _trust(run: str, data: xr.Dataset) -> list[Plate]:
    """What tells how far the measurement can be trusted."""
    found: list[Plate] = []
    if "tip_sigma" in data:  # in the norm of the tip error
        data = data.assign(tip_sigma=("time", np.hypot(*data["tip_sigma"].values.T)))
    for name, key, axis in (
        ("tracking", "tip_sigma", Axis("standard error of the tip", "mm")), ("seen", "seen", Axis("share of the edges seen")),
        ("blur", "blur", Axis("blur of the edges", "px")),
    ):  # fmt: skip
        found += _timed(run, name, axis, curve(data, key, name, "measured"))
    hinge, angle = _valid(data, "hinge_length"), _valid(data, "bend_angle")
    if hinge is not None and angle is not None:
        rows = thinned(len(hinge), 1500)
        kept_by = str(data.attrs.get("length_kept_by", "inner side"))
        dots = [Series(kept_by, "dots", angle[rows], hinge[rows])]
        found += lines(f"{run}-hinge", f"Length of the {kept_by}", Axis("bend angle", "deg"), Axis("length", "mm"), dots)
    if (offsets := offsets_tried(data)) is not None:
        share = Axis("share of the motion explained")
        tried_at = [Series(share.label, "measured", *offsets)]
        found += lines(f"{run}-offsets", "Offsets tried", Axis("offset", "ms"), share, tried_at)
    return found + _clocks(run, data)


def _clocks(run: str, data: xr.Dataset) -> list[Plate]:
    """Pressure and motion, each stretched to the full height."""
    motion = curve(data, "bend_angle", "bend angle", "measured") or curve(data, "tip", "tip y", "measured", part=1)
    if motion is None or "pressure" not in data:
        return []
    both = [
        replace(item, y=(item.y - np.nanmin(item.y)) / (np.nanmax(item.y) - np.nanmin(item.y) or 1.0))
        for item in (_logged(data, "modelled"), motion)
    ]
    return lines(f"{run}-sync", "Pressure and motion on one clock", TIME, Axis("share of the full range"), both, wide=True)
