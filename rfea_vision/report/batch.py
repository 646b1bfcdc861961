"""Several campaigns on one page: an index for batches, and two campaigns side by side."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from rfea_vision.artefacts import Parameter
from rfea_vision.errors import RfeaError
from rfea_vision.report import methods, prose
from rfea_vision.report.collect import Evidence, LadderStep, collect
from rfea_vision.report.formatting import unit_text, with_unit
from rfea_vision.report.pack import Pack, nearest, stride
from rfea_vision.report.page import environment, safe_json, static
from rfea_vision.report.series import MOST_SAMPLES, rung_name
from rfea_vision.report.shown import PER_JOINT, errors_of, of_the_tube

PAIR_SCRIPTS = ("data", "pen", "plot", "pair")


def render_index(folders: Sequence[Path], *, beside: Path | None = None) -> str:
    """Make an index of many campaigns: rows are experiments, columns are rungs.

    Parameters
    ----------
    folders : ``rfea/`` folders; one that cannot be read is listed with the reason
    beside : folder in which the page will be saved, so that it can link to each report

    Returns
    -------
    str
        One HTML document.
    """
    return render_rows([campaign_row(folder, beside=beside) for folder in folders])


def campaign_row(folder: Path, *, beside: Path | None = None, why: str = "") -> dict[str, Any]:
    """Read what the index shows of one campaign: its ``rfea/`` folder, and `why` something is missing, where that is known."""
    name = folder.parent.name if folder.name == "rfea" else folder.name
    try:
        row = _campaign(collect(folder), name, beside)
    except Exception as error:  # whatever is wrong with one campaign, the others are listed
        said = str(error) if isinstance(error, RfeaError) else f"its results cannot be read ({error!r})"
        row = {"name": name, "why": said, "steps": [], "experiments": [], "link": None, "floor": None}
    return {**row, "why": why or row["why"]}


def render_rows(rows: Sequence[dict[str, Any]]) -> str:
    """Make the index of rows that `campaign_row` gave."""
    columns = max((len(row["steps"]) for row in rows), default=0)
    scales = {}
    for unit in ("mm", "deg"):
        errors = [error for row in rows if row.get("unit") == unit for run in row["experiments"] for error in run["errors"]]
        found = [math.log10(error) for error in errors if error]
        scales[unit] = {"low": min(found, default=-2.0), "high": max(found, default=1.0)}
    return environment().get_template("index.html.j2").render(
        title="Campaigns", campaigns=rows, columns=columns, style=static("style.css"), scales=scales,
    )  # fmt: skip


def _campaign(evidence: Evidence, name: str, beside: Path | None) -> dict[str, Any]:
    titles = prose.effect_titles(evidence)
    page = evidence.folder / "report" / "index.html"
    steps = evidence.climbed
    names = {experiment.name: experiment.role for experiment in evidence.experiments}
    for step in steps:
        names |= {key: score.role for key, score in step.fit.experiments.items() if key not in names}
    last = evidence.last
    shown = errors_of(last, evidence) if last else None
    unit = shown.unit if shown else "mm"
    tested = (evidence.ladder.test if evidence.ladder else None) or {}
    return {
        "name": name,
        "unit": unit,
        "why": next(iter(evidence.absent.values()), "") if not steps else "",
        "headline": prose.headline(evidence, titles),
        "verdict": last.outcome if last else "",
        "floor": shown.floor if shown else None,
        "link": quote(Path(os.path.relpath(page, beside)).as_posix()) if beside is not None and page.exists() else None,
        "steps": [rung_name(step, titles) for step in steps],
        "experiments": [
            {"name": key, "role": role, "errors": [_error(step, key, unit, tested) for step in steps]}
            for key, role in names.items()
        ],
    }


def _error(step: LadderStep, experiment: str, unit: str, tested: Mapping[str, Any]) -> float | None:
    """Error of one rung on one run; a test run has one on the first and the last rung only, scored at the end."""
    score = step.fit.experiments.get(experiment)
    if score is None:
        ends = {tested.get("first_model"): "first_model_experiments", tested.get("model"): "experiments"}
        return (tested.get(ends.get(step.rung.model, "")) or {}).get(experiment)
    return score.tip_rmse_mm if unit == "mm" else score.angle_rmse_deg


def render_comparison(first: Path, second: Path, *, names: tuple[str, str] | None = None) -> str:
    """Put two campaigns side by side: two tubes, two materials, or the same tube before and after.

    Parameters
    ----------
    first, second : their ``rfea/`` folders
    names : what to call them; by default the names of the campaigns' folders

    Returns
    -------
    str
        One HTML document without any link to another file.
    """
    both = [collect(first), collect(second)]
    called = names or (_name_of(first), _name_of(second))
    pack = Pack()
    manifest = {
        "experiments": [],
        "rungs": [],
        "names": list(called),
        "parameters": _parameters(both),
        "pair": [_side(evidence, pack) for evidence in both],
    }
    sides = []
    for name, evidence, side in zip(called, both, manifest["pair"], strict=True):
        titles, climbed = prose.effect_titles(evidence), evidence.climbed
        sides.append({
            "name": name, "absent": side["absent"], "headline": prose.headline(evidence, titles), "last": evidence.last,
            "evidence": evidence, "shown": [errors_of(step, evidence) for step in climbed],
            "names": [rung_name(step, titles) for step in climbed],
        })  # fmt: skip
    return environment().get_template("pair.html.j2").render(
        title=f"{called[0]} and {called[1]}", sides=sides, parameters=manifest["parameters"], style=static("style.css"),
        manifest=safe_json(manifest), packed=Markup(pack.base64()), versions=methods.versions(),
        scripts=Markup("\n").join(static(f"{name}.js") for name in PAIR_SCRIPTS),
    )  # fmt: skip


def _name_of(folder: Path) -> str:
    return folder.resolve().parent.name if folder.name == "rfea" else folder.name


def _parameters(both: Sequence[Evidence]) -> list[dict[str, Any]]:
    """One row per parameter of either final model: value and 95 % interval on both sides, or why there is none."""
    steps = [evidence.last for evidence in both]
    fits = [of_the_tube(step.fit) if step else {} for step in steps]
    units = {key: item.unit for fit in reversed(fits) for key, item in fit.items()}
    names = dict.fromkeys(name for fit in fits for name in fit)
    return [
        {
            "name": f"{key}, whole tube" if key.startswith(PER_JOINT) else key,
            "unit": unit_text(units[key]),
            "sides": [
                _of_side(fit.get(key), units[key], fitted=bool(step)) for fit, step in zip(fits, steps, strict=True)
            ],
        }
        for key in names
    ]


def _of_side(item: Parameter | None, unit: str, *, fitted: bool) -> dict[str, Any]:
    if item is None:
        return {"value": None, "interval": None, "text": "not in its model" if fitted else "no model"}
    if item.unit != unit:
        return {"value": None, "interval": None, "text": with_unit(item.value, item.unit, 4)}
    return {"value": item.value, "interval": item.interval_95, "text": with_unit(item.value, unit, 4)}


def _side(evidence: Evidence, pack: Pack) -> dict[str, Any]:
    """Curves of one campaign: steady state, elongation profiles, and the loop of every run."""
    last = evidence.last
    loops = []
    for experiment in evidence.experiments:
        data = experiment.recording
        if data is None or "bend_angle" not in data:
            continue
        rows = stride(data.sizes["time"], MOST_SAMPLES)
        at = nearest(data["log_time"].values, data["time"].values[rows])
        loops.append({
            "name": experiment.name, "role": experiment.role, "pressure": pack.add(data["pressure"].values[at]),
            "angle": pack.add(np.asarray(data["bend_angle"].values)[rows]),
        })  # fmt: skip
    steady = last.fit.steady_state if last else {}
    profiles = last.comparison.elongation.get("profiles", []) if last and last.comparison else []
    synchronised = any(experiment.recording is not None for experiment in evidence.experiments)
    no_loops = "no bend angle was measured." if synchronised else "no run has been synchronised: run `rfea sync`."
    angled = any(angle is not None for angle in steady.get("angle_deg", []))
    no_rest = "its model has no steady state: no rest at a pressure was found."
    absent = {
        "intervals": "" if last else "no model has been fitted, so it has no parameters.",
        "loops": "" if loops else no_loops,
        "steady": "" if angled else "no bend angle was measured." if steady.get("pressure_kPa") else no_rest,
        "profiles": "" if any(row.get("measured") for row in profiles) else "no elongation along the tube was measured.",
    }
    return {"steady": steady, "profiles": profiles, "loops": loops, "absent": absent}
