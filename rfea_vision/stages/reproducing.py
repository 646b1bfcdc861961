"""The paper's section on validation, from data to page: Table I, Figs. 4 to 10, two and eight bodies side by side.

Figs. 1 to 3 of the paper are photographs and a drawing of the drive, and another tube's test; they have no counterpart here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import CHOOSING_ROLES, Actuator, ModelFit
from rfea_vision.dynamics.parameters import PAPER_UNITS, PUBLISHED
from rfea_vision.errors import DataError
from rfea_vision.figures import FORMATS, Lines, Plate, Series, save_plates
from rfea_vision.figures.plates import Axis, Role, lines
from rfea_vision.figures.runs import curve, tip_path
from rfea_vision.files import write_text
from rfea_vision.report.collect import collect
from rfea_vision.report.paper import render_paper
from rfea_vision.stages.recipes import load_recipe, run_recipe
from rfea_vision.tube import inner_radius

if TYPE_CHECKING:
    from rfea_vision.stages.workspace import Workspace

MODELS = {"2-DoF": "two-bodies", "8-DoF": "eight-bodies"}
_ROLES: dict[str, Role] = {"2-DoF": "coarse", "8-DoF": "modelled"}  # in drawings
_NAMES = {
    "b_0neg": "Damper coefficient, negative direction", "m_bneg": "Its slope over the inner radius",
    "b_0pos": "Damper coefficient, positive direction", "m_bpos": "Its slope over the inner radius",
    "k_0": "Spring coefficient", "m_k": "Its slope over the inner radius", "r_hyd": "Hydraulic torque arm",
}  # fmt: skip
TIME, X, Y = Axis("time", "s"), Axis("x", "mm"), Axis("y", "mm")


def reproduce(work: Workspace, *, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Fit as the paper did, and write page, table and figures to ``reproduce/``; the page is the first of the files.

    Raises
    ------
    DataError
        If there is no training run, or none of the tip.
    """
    run_recipe(work, load_recipe("reproduce"))
    fits = {column: work.model(name) for column, name in MODELS.items()}
    steps = {step.rung.model: step for step in collect(work.out).steps}
    predictions = {column: steps[name].predictions for column, name in MODELS.items()}
    recordings = {name: item.dataset for name, item in work.recordings().items()}
    runs = {role: _first(work, role) for role in CHOOSING_ROLES}
    if runs["train"] is None or "tip" not in recordings[runs["train"]]:
        raise DataError(
            f"{work.campaign.root}: the paper's figures need the tip in a training run; this campaign has none"
        )
    plates = _model(fits, recordings[runs["train"]], {key: value[runs["train"]] for key, value in predictions.items()})
    for number, role, run in ((7, "train", runs["train"]), (9, "validate", runs["validate"])):
        if run is not None:
            modelled = {column: found[run] for column, found in predictions.items() if run in found}
            plates += _results(number, role, recordings[run], modelled)
    folder = work.out / "reproduce"
    files = save_plates(plates, folder, formats=formats)
    table = table_one(fits)
    header = "parameter,unit,model,published,found,lower_95,upper_95\n"
    write_text(
        folder / "table-1.csv", header + "".join(",".join(_cell(item) for item in row.values()) + "\n" for row in table)
    )
    peaks = {role: _peak_kPa(recordings[run]) for role, run in runs.items() if run is not None}
    page = render_paper(work.campaign.name, plates, table, fits, runs, peaks, _NAMES)
    write_text(folder / "index.html", page)
    return [folder / "index.html", folder / "table-1.csv", *files]


def _first(work: Workspace, role: str) -> str | None:
    return next((item.name for item in work.campaign.with_role(role)), None)


def _peak_kPa(data: xr.Dataset) -> float:
    return float(np.nanmax(data["pressure"].values))


def _cell(value: object) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def table_one(fits: Mapping[str, ModelFit]) -> list[dict[str, object]]:
    """Table I: published beside found with its 95 % interval, in the paper's units, one row per parameter and model."""
    rows = []
    for key in _NAMES:
        for column, fit in fits.items():
            found = fit.paper_parameters.get(key)
            low, high = (None if found is None else found.interval_95) or (None, None)
            rows.append(
                {
                    "parameter": key, "unit": PAPER_UNITS[key], "model": column, "published": getattr(PUBLISHED[column], key),
                    "found": None if found is None else found.value, "lower_95": low, "upper_95": high,
                }
            )  # fmt: skip
    return rows


def _results(number: int, role: str, data: xr.Dataset, modelled: Mapping[str, xr.Dataset]) -> list[Plate]:
    """Figs. 7 and 8 of the run that was fitted, 9 and 10 of the one that was not."""
    what = "fitted" if role == "train" else "not fitted"
    peak = f"pressurised to {_peak_kPa(data):.0f} kPa"
    log = Series("pressure", "measured", data["log_time"].values, data["pressure"].values)
    title = f"Fig. {number}: pressure and tip, {peak} ({what})"
    found = lines(f"fig{number:02d}-pressure", title, TIME, Axis("pressure", "kPa"), [log])
    for letter, (column, prediction) in zip("ab", modelled.items(), strict=False):
        both = [
            curve(data, "tip", "measured", "measured", part=1),
            curve(prediction, "tip", column, "modelled", part=1),
        ]
        name = f"fig{number:02d}{letter}-{column.lower()}"
        found += lines(
            name, f"Fig. {number}{letter}: tip y, {column}, {peak} ({what})", TIME, Axis("tip y", "mm"), both
        )
    for letter, (column, prediction) in zip("ab", modelled.items(), strict=False):
        both = [tip_path(data, "measured", "measured"), tip_path(prediction, column, "modelled")]
        name = f"fig{number + 1:02d}{letter}-{column.lower()}"
        title = f"Fig. {number + 1}{letter}: path of the tip, {column}, {peak} ({what})"
        found += lines(name, title, X, Y, both, equal=True)
    return found


def _model(fits: Mapping[str, ModelFit], data: xr.Dataset, modelled: Mapping[str, xr.Dataset]) -> list[Plate]:
    """Figs. 4 to 6: the tube that is modelled, the joint, and a segment, to scale and with the values found."""
    return [*_postures(data, modelled), *_joint(fits, modelled), *_segment(fits["8-DoF"], modelled["8-DoF"])]


def _postures(data: xr.Dataset, modelled: Mapping[str, xr.Dataset]) -> list[Plate]:
    """Fig. 4: the tube at rest and at its largest bend, measured and with two and eight bodies."""
    if "bend_angle" not in data:
        return []
    angle = np.asarray(data["bend_angle"].values, dtype=float)
    series: list[Series | None] = []
    for row in (int(np.nanargmin(np.abs(angle))), int(np.nanargmax(np.abs(angle)))):
        if "midline" in data:
            line = data["midline"].values[row]
            series.append(Series("measured", "measured", line[:, 0], line[:, 1]))
        for column, prediction in modelled.items():
            at = int(np.argmin(np.abs(prediction["time"].values - data["time"].values[row])))
            if "midline" in prediction:
                line = prediction["midline"].values[at]
                series.append(Series(column, _ROLES[column], line[:, 0], line[:, 1]))
    return lines(
        "fig04-modelled-tube",
        "Fig. 4: the tube that is modelled, at rest and at its largest bend",
        X,
        Y,
        series,
        equal=True,
    )


def _joint(fits: Mapping[str, ModelFit], modelled: Mapping[str, xr.Dataset]) -> list[Plate]:
    """Fig. 5: spring and damper of the joint over its angle, per 1/n of the tube, so that the models can be compared."""
    spring: list[Series | None] = []
    damper: list[Series | None] = []
    for column, fit in fits.items():
        values = {key: item.value / fit.segments for key, item in fit.parameters.items()}
        theta = np.linspace(0.0, np.deg2rad(float(np.nanmax(modelled[column]["theta"].values))), 60)
        grown = _radius_mm(fit, theta) * 1e-3 - fit.actuator["inner_radius"]
        whole_deg = np.rad2deg(theta) * fit.segments
        k, b_pos, b_neg = (values[f"{law}_ref"] + values[f"{law}_slope"] * grown for law in ("k", "b_pos", "b_neg"))
        spring.append(Series(column, _ROLES[column], whole_deg, k))
        damper.append(Series(f"{column}, b+", _ROLES[column], whole_deg, 1e3 * b_pos))
        damper.append(Series(f"{column}, b-", "other", whole_deg, 1e3 * b_neg))
    bend = Axis("bend of the whole tube", "deg")
    return [
        *lines(
            "fig05a-spring", "Fig. 5: spring of the joint, of the whole tube", bend, Axis("k / n", "N m/rad"), spring
        ),
        *lines(
            "fig05b-damper",
            "Fig. 5: damper of the joint, in both directions",
            bend,
            Axis("b / n", "mN m s/rad"),
            damper,
        ),
    ]


def _radius_mm(fit: ModelFit, theta: FloatArray) -> FloatArray:
    actuator = Actuator(**fit.actuator)
    return 1e3 * inner_radius(actuator, theta, actuator.length / fit.segments)


def _segment(fit: ModelFit, prediction: xr.Dataset) -> list[Plate]:
    """Fig. 6: one of eight segments to scale, at rest and bent: the hinge side keeps its length, the bore widens."""
    outer = 1e3 * fit.actuator["outer_radius"]
    length = 1e3 * fit.actuator["length"] / fit.segments
    theta = np.deg2rad(float(np.nanmax(prediction["theta"].values)))
    series: list[Series] = []
    drawn: tuple[tuple[str, float, Role], ...] = (
        ("at rest", 0.0, "coarse"), (f"bent by {np.rad2deg(theta):.1f} deg", theta, "modelled"),
    )  # fmt: skip
    for label, angle, role in drawn:
        bore = float(_radius_mm(fit, np.array([angle]))[0])
        for across in ((0.0, 2 * outer), (outer - bore, outer + bore)):  # the tube, then its bore
            x, y = _outline(angle, length, across)
            series.append(Series(label, role, x, y))
    title = "Fig. 6: a segment of the tube, from its hinge side at x = 0"
    return [Lines("fig06-segment", title, X, Y, tuple(series), equal=True)]


def _outline(angle: float, length: float, across: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """A segment between two distances from the hinge side, hanging down from y = 0, bent towards -x."""
    along = np.linspace(0.0, 1.0, 25)
    if angle == 0.0:
        inner, outer = (np.stack([np.full(25, d), -length * along], axis=1) for d in across)
    else:
        radius, phi = length / angle, angle * along
        inner, outer = (
            np.stack([-radius + (radius + d) * np.cos(phi), -(radius + d) * np.sin(phi)], axis=1) for d in across
        )
    ring = np.concatenate([inner, outer[::-1], inner[:1]])
    return ring[:, 0], ring[:, 1]
