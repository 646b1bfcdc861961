"""The page that reproduces the paper: Table I and its figures, drawn as SVG inside, offline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from rfea_vision.artefacts import ModelFit
from rfea_vision.figures import Plate
from rfea_vision.figures.saving import as_svg
from rfea_vision.report.page import environment, static


def render_paper(
    title: str,
    plates: Sequence[Plate],
    table: Sequence[Mapping[str, object]],
    fits: Mapping[str, ModelFit],
    runs: Mapping[str, str | None],
    peaks_kPa: Mapping[str, float],
    names: Mapping[str, str],
) -> str:
    """Make the page.

    Parameters
    ----------
    title : name of the campaign
    plates : the figures, in order
    table : rows of Table I: parameter, unit, model, published, found, lower_95, upper_95
    fits : the models by their column in the table
    runs, peaks_kPa : the run that was fitted (``train``), the one that was not (``validate``), and their largest pressures
    names : what the table calls each parameter
    """
    numbers: dict[str, list[dict[str, Any]]] = {}
    for plate in plates:
        drawn = {"name": plate.name, "title": plate.title, "svg": Markup(as_svg(plate))}
        numbers.setdefault(plate.name[:5], []).append(drawn)
    rows: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in table:
        rows.setdefault(str(row["parameter"]), {})[str(row["model"])] = row
    at_a_bound = any("bound" in item.note for fit in fits.values() for item in fit.parameters.values())
    return environment().get_template("paper.html.j2").render(
        title=title, figures=list(numbers.values()), rows=rows, fits=fits, runs=runs, peaks=peaks_kPa, names=names,
        at_a_bound=at_a_bound, style=static("style.css"),
    )  # fmt: skip
