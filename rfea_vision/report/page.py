"""Puts the page together: templates, styles, scripts, packed series and clips in one HTML file."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from rfea_vision.report import formatting, prose
from rfea_vision.report.collect import Evidence, Experiment, collect
from rfea_vision.report.figures import FIGURES
from rfea_vision.report.pack import Pack
from rfea_vision.report.series import pack_experiment, pack_step, rung_name

SIZE_LIMIT_BYTES = 10_000_000
MOST_PHOTOS = 12
MOST_CORNERS = 120
SCRIPTS = ("data", "pen", "plot", "time", "where", "shape", "trust", "camera", "stage", "controls", "main")


def render(folder: Path, *, title: str, commands: Sequence[str] = ()) -> str:
    """Make the report of one campaign.

    Parameters
    ----------
    folder : the campaign's ``rfea/`` folder; whatever is missing in it is said on the page
    title : name of the campaign
    commands : command lines that made the artefacts, printed at the end

    Returns
    -------
    str
        One HTML document without any link to another file.
    """
    evidence = collect(folder)
    titles = prose.effect_titles(evidence)
    pack = Pack()
    experiments = [pack_experiment(experiment, pack) for experiment in evidence.experiments]
    manifest = {
        "title": title,
        "experiments": experiments,
        "rungs": [pack_step(step, evidence, pack, titles) for step in evidence.steps],
        "calibration": _calibration(evidence),
        "length_mm": _length_mm(evidence),
        "bends": _bends(evidence),
    }
    packed = pack.base64()
    clips = _clips(evidence.experiments, experiments, SIZE_LIMIT_BYTES - len(packed) - 700_000)
    return environment().get_template("page.html.j2").render(
        title=title, bends=_bends(evidence), evidence=evidence, titles=titles, experiments=experiments,
        commands=commands, figures=FIGURES, checks=_length_checks(evidence),
        headline=prose.headline(evidence, titles), findings=list(prose.findings(evidence)),
        tiles=list(prose.tiles(evidence, titles)), last=prose.last_step(evidence),
        names=[rung_name(step, titles) for step in evidence.steps], scale=ladder_scale(evidence),
        methods=[prose.methods(evidence, step) for step in evidence.steps],
        bibtex=prose.BIBTEX, versions=prose.versions(),
        manifest=safe_json(manifest), packed=Markup(packed), clips=clips, style=static("style.css"),
        scripts=Markup("\n").join(static(f"{name}.js") for name in SCRIPTS),
    )  # fmt: skip


def environment() -> jinja2.Environment:
    """Templates with the filters that print numbers, units and laws."""
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("rfea_vision.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    made.filters |= {
        "number": formatting.number, "with_unit": formatting.with_unit, "unit": formatting.unit_text,
        "law": formatting.law, "listing": formatting.listing, "code": formatting.inline_code, "log10": math.log10,
        "plain": lambda value: None if value is None else float(value),
        "milli": lambda value: None if value is None else 1000 * float(value),
    }  # fmt: skip
    return made


def static(name: str) -> Markup:
    """A style sheet or script of the page, to be written inline."""
    return Markup(resources.files("rfea_vision.report").joinpath("static", name).read_text(encoding="utf-8"))


def safe_json(value: Any) -> Markup:
    """JSON that may stand inside a script element: no NaN, no closing tag."""
    text = json.dumps(_finite(value), separators=(",", ":"), allow_nan=False, default=str)
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _calibration(evidence: Evidence) -> dict[str, Any]:
    """What the calibration knows about itself: residuals by photo, the worst first, and the map of uncertainty."""
    quality = (evidence.camera or {}).get("quality") or {}
    kept = {key: quality[key] for key in ("uncertainty_map", "coverage") if key in quality}
    fields = [
        {key: value[:MOST_CORNERS] if isinstance(value, list) else value for key, value in photo.items()}
        for photo in quality.get("residual_fields", [])[:MOST_PHOTOS]
    ]
    size = [evidence.camera.get("image_width"), evidence.camera.get("image_height")] if evidence.camera else None
    return kept | {"photos": fields, "size": size}


def _length_checks(evidence: Evidence) -> list[dict[str, str]]:
    """What tracking says of the length of the inner side, run by run."""
    found = [(e.name, e.recording if e.recording is not None else e.track) for e in evidence.experiments]
    return [
        {"name": name, "sentence": str(data.attrs["length_check"])}
        for name, data in found
        if data is not None and "length_check" in data.attrs
    ]


def _bends(evidence: Evidence) -> str:
    return str(evidence.steps[0].fit.actuator.get("bends", "left")) if evidence.steps else "left"


def _length_mm(evidence: Evidence) -> float | None:
    for step in evidence.steps:
        if step.fit.actuator.get("length"):
            return 1000 * float(step.fit.actuator["length"])
    return None


def _clips(
    experiments: Sequence[Experiment], records: Sequence[dict[str, Any]], budget: int
) -> list[tuple[str, Markup]]:
    """Clips as base64, the smallest first, as many as the size limit allows; the others say why they are missing."""
    chosen = []
    films = [(e, record) for e, record in zip(experiments, records, strict=True) if e.clip is not None]
    for experiment, record in sorted(films, key=lambda film: len(film[0].clip or b"")):
        text = base64.b64encode(experiment.clip or b"").decode("ascii")
        if len(text) <= budget:
            budget -= len(text)
            chosen.append((experiment.name, Markup(text)))
        else:
            record["clip"] = None
            record["why"]["clip"] = (
                f"The film of {experiment.name} was left out to keep this page below 10 MB; "
                f"it is in rfea/{experiment.name}/{experiment.clip_info.get('file', 'clip.mp4')}."
            )
    return chosen


def ladder_scale(evidence: Evidence) -> dict[str, float]:
    """Ends of the ladder's logarithmic axis, in powers of ten of a millimetre."""
    values = [evidence.ladder.noise_floor_mm if evidence.ladder else None]
    for step in evidence.steps:
        values += [step.rung.train_tip_rmse_mm, step.rung.validate_tip_rmse_mm, step.fit.noise_floor_mm]
    known = [math.log10(value) for value in values if value is not None and math.isfinite(value) and value > 0]
    if not known:
        return {"low": -2.0, "high": 1.0}
    return {"low": min(known) - 0.15, "high": max(known) + 0.15}
