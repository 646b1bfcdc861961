"""Puts the page together: templates, styles, scripts, packed series and clips in one HTML file."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from rfea_vision.report import formatting, methods, prose
from rfea_vision.report.collect import Evidence, collect
from rfea_vision.report.figures import figures_in
from rfea_vision.report.films import fit_films
from rfea_vision.report.pack import Pack
from rfea_vision.report.series import pack_experiment, pack_step, rung_name
from rfea_vision.report.shown import Shown, errors_of, of_candidate
from rfea_vision.units import finite

SIZE_LIMIT_BYTES = 10_000_000  # so that the page can be mailed
SERIES_LIMIT_BYTES = 5_500_000  # of it for series; the rest is for films and text
TEXT_BYTES = 600_000  # style, scripts, sentences and tables of a long ladder
DETAILS = (1.0, 0.6, 0.35, 0.2, 0.1)  # shares of the usual number of samples
MOST_PHOTOS = 12  # as a contact sheet shows
MOST_CORNERS = 120  # arrows of one photo
# The page reaches nothing: what it draws lies in it, and no form, frame, object or address is opened by it.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; media-src data: blob:; "
    "font-src data:; base-uri 'none'; form-action 'none'"
)
SCRIPTS = ("data", "pen", "plot", "time", "where", "shape", "trust", "fit", "camera", "stage", "controls", "main")


def render(folder: Path, *, title: str, commands: Sequence[str] = (), runs: Collection[str] | None = None) -> str:
    """Make the report of one campaign.

    Parameters
    ----------
    folder : the campaign's ``rfea/`` folder; whatever is missing in it is said on the page
    title : name of the campaign
    commands : command lines that made the artefacts, printed at the end
    runs : the campaign's experiments; default all of which there are results

    Returns
    -------
    str
        One HTML document without any link to another file.
    """
    evidence = collect(folder, runs)
    titles = prose.effect_titles(evidence)
    experiments, rungs, packed = _packed(evidence, titles)
    calibration = _calibration(evidence)
    clips = fit_films(evidence.experiments, experiments, _budget(experiments, rungs, calibration, packed))
    manifest = {
        "title": title,
        "experiments": experiments,
        "rungs": rungs,
        "calibration": calibration,
        "length_mm": length_mm_of(evidence),
        "bends": bends_of(evidence),
    }
    shown = [errors_of(step, evidence) for step in evidence.steps]
    beam = any(said["sentence"] == "middle" for said in _said_of_runs(evidence, "length_kept_by"))
    return environment().get_template("page.html.j2").render(
        title=title, bends=bends_of(evidence), evidence=evidence, titles=titles, experiments=experiments,
        commands=commands, figures=figures_in(shown[-1].unit if shown else "mm", beam=beam),
        checks=_said_of_runs(evidence, "length_check"), placed=_said_of_runs(evidence, "calibration_sentence"),
        headline=prose.headline(evidence, titles), findings=list(prose.findings(evidence, titles)),
        tiles=list(prose.tiles(evidence, titles)), last=evidence.last,
        names=[rung_name(step, titles) for step in evidence.steps], shown=shown, scale=ladder_scale(shown),
        meanings=prose.parameter_words(evidence, titles), of_candidate=of_candidate,
        unit=shown[-1].unit if shown else "mm", in_words=lambda text: prose.in_words(text, evidence, titles),
        ended=prose.how_it_ended(evidence, titles),
        methods=[methods.methods(evidence, step, titles) for step in evidence.steps],
        in_order=lambda scores: _in_order(evidence, scores), bibtex=methods.references(evidence), versions=methods.versions(),
        manifest=safe_json(manifest), packed=Markup(packed), clips=clips, style=static("style.css"),
        scripts=Markup("\n").join(static(f"{name}.js") for name in SCRIPTS),
    )  # fmt: skip


def _packed(evidence: Evidence, titles: Mapping[str, str]) -> tuple[list[dict[str, Any]], list[dict[str, Any]], str]:
    """Records of experiments and rungs, and their series; drawn with fewer samples where they would fill the page."""
    for detail in DETAILS:
        pack = Pack(detail)
        experiments = [pack_experiment(experiment, pack) for experiment in evidence.experiments]
        rungs = [pack_step(step, evidence, pack, titles) for step in evidence.steps]
        packed = pack.base64()
        if len(packed) <= SERIES_LIMIT_BYTES:
            break
    return experiments, rungs, packed  # pyright: ignore[reportPossiblyUnboundVariable]


def _budget(experiments: object, rungs: object, calibration: object, packed: str) -> int:
    """Characters that are left for films."""
    records = len(safe_json([experiments, rungs, calibration]))
    return max(0, SIZE_LIMIT_BYTES - len(packed) - records - TEXT_BYTES)


@cache
def environment() -> jinja2.Environment:
    """Templates with the filters that print numbers, units and laws; made once: to compile them takes as long as to fill them in."""
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("rfea_vision.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    made.globals["policy"] = Markup(POLICY)
    made.filters |= {
        "number": formatting.number,
        "with_unit": formatting.with_unit,
        "with_error": formatting.with_error,
        "to_error": formatting.to_error,
        "unit": formatting.unit_text,
        "lens": formatting.lens_words,
        "law": formatting.law,
        "percent": lambda share: formatting.number(None) if share is None else f"{formatting.number(100 * share, 2)} %",
        "csv_address": _csv_address,
        "listing": formatting.listing,
        "no_stretch": prose.no_stretch,
        "as_added": formatting.as_added,
        "code": formatting.inline_code,
        "log10": math.log10,
        "titled": lambda effects, titles: [formatting.inner_title(titles.get(e, e)) for e in effects],
        "plain": lambda value: None if value is None else float(value),
        "milli": lambda value: None if value is None else 1000 * float(value),
    }
    return made


def _csv_address(pressure: tuple[Sequence[float], Sequence[float]]) -> str:
    """A pressure log as a link that holds its own data."""
    rows = "".join(f"{time:.6g},{value:.6g}\n" for time, value in zip(*pressure, strict=True))
    text = base64.b64encode(f"time_s,pressure_kPa\n{rows}".encode()).decode("ascii")
    return f"data:text/csv;base64,{text}"


def static(name: str) -> Markup:
    """A style sheet or script of the page, to be written inline."""
    return Markup(resources.files("rfea_vision.report").joinpath("static", name).read_text(encoding="utf-8"))


def safe_json(value: object) -> Markup:
    """JSON that may stand inside a script element: no NaN, no closing tag."""
    text = json.dumps(finite(value), separators=(",", ":"), allow_nan=False, default=str)
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def _calibration(evidence: Evidence) -> dict[str, object]:
    """What the calibration knows about itself: residuals by photo, the worst first, and the map of uncertainty."""
    quality = (evidence.camera or {}).get("quality") or {}
    kept = {key: quality[key] for key in ("uncertainty_map", "coverage") if key in quality}
    fields = [
        {key: value[:MOST_CORNERS] if isinstance(value, list) else value for key, value in photo.items()}
        | {"picture": _picture(evidence, str(photo.get("file", "")))}
        for photo in quality.get("residual_fields", [])[:MOST_PHOTOS]
    ]
    size = [evidence.camera.get("image_width"), evidence.camera.get("image_height")] if evidence.camera else None
    return kept | {"photos": fields, "size": size}


def _picture(evidence: Evidence, file: str) -> str | None:
    """The small copy of a photo, as an address that holds its own data."""
    data = evidence.photos.get(file)
    return None if data is None else f"data:image/jpeg;base64,{base64.b64encode(data).decode('ascii')}"


def _in_order(evidence: Evidence, scores: Mapping[str, object]) -> list[tuple[str, object]]:
    """Scores by run, in the same order on every rung."""
    names = [experiment.name for experiment in evidence.experiments]
    return sorted(scores.items(), key=lambda item: names.index(item[0]) if item[0] in names else len(names))


def _said_of_runs(evidence: Evidence, key: str) -> list[dict[str, str]]:
    """A sentence that the measurement has written into its runs, run by run."""
    found = [(e.name, e.measured) for e in evidence.experiments]
    return [
        {"name": name, "sentence": str(data.attrs[key])}
        for name, data in found
        if data is not None and data.attrs.get(key)
    ]


def bends_of(evidence: Evidence) -> str:
    """The side to which the tube bends."""
    return str(evidence.steps[0].fit.actuator.get("bends", "left")) if evidence.steps else "left"


def length_mm_of(evidence: Evidence) -> float | None:
    """Length of the tube; None without a model."""
    for step in evidence.steps:
        if step.fit.actuator.get("length"):
            return 1000 * float(step.fit.actuator["length"])
    return None


def ladder_scale(shown: Sequence[Shown]) -> dict[str, float]:
    """Ends of the ladder's logarithmic axis, in powers of ten of its unit."""
    values = [value for errors in shown for value in (errors.train, errors.validate, errors.floor)]
    known = [math.log10(value) for value in values if value is not None and math.isfinite(value) and value > 0]
    if not known:
        return {"low": -2.0, "high": 1.0}
    return {"low": min(known) - 0.15, "high": max(known) + 0.15}
