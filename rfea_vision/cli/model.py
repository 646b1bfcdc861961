"""Commands right of the fit: compare, diagnose, improve."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rfea_vision.cli.console import drawn_previews, print_columns, print_json, say, say_next, up_to_date
from rfea_vision.cli.fit import print_metrics
from rfea_vision.cli.options import ask, campaign_options, code_option, models_like, opened
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.units import rounded

if TYPE_CHECKING:
    from rfea_vision.artefacts import Comparison, Diagnosis, Ladder, Rung

#: Rivals of an effect that a table names.
_RIVALS = 2


@click.command("compare")
@code_option
@campaign_options
@click.argument("models", nargs=-1, metavar="[MODEL]...", shell_complete=models_like)
def compare_command(campaign: Path, models: tuple[str, ...], out: Path | None, force: bool, as_json: bool) -> None:
    """Model against measurement: how far, where, when.

    Beside the noise floor; all models, or those named.
    """
    with opened(campaign, out, "compare", force=force) as work:
        comparisons = work.compare(*models)
        fits = {name: work.model(name) for name in comparisons}
    if as_json:
        print_json(
            {
                "comparisons": [
                    {**comparison.model_dump(mode="json"), "metrics": fits[name].model_dump(mode="json")["metrics"]}
                    for name, comparison in comparisons.items()
                ]
            }
        )
        return
    if not up_to_date(work):
        print_metrics(fits)
        for name, comparison in comparisons.items():
            print_comparison(name, comparison)
    last = list(comparisons)[-1]
    say_next("rfea diagnose", campaign, last, why="why it fails there")


@click.command("diagnose")
@campaign_options
@click.argument("model", required=False, shell_complete=models_like)
@ask("diagnose", options=CritiqueOptions)
def diagnose_command(
    campaign: Path,
    model: str | None,
    options: CritiqueOptions,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Which effect is missing from a model.

    By default from the one fitted last.
    """
    with opened(campaign, out, "diagnose", force=force) as work:
        diagnosis = work.diagnose(model, options)
    if as_json:
        print_json(diagnosis.model_dump(mode="json", by_alias=True))
    elif up_to_date(work):
        _say_after(diagnosis, campaign, work.out)
    else:
        print_diagnosis(diagnosis, campaign, work.out)


@click.command("improve")
@campaign_options
@ask("improve", fit=FitOptions, critique=CritiqueOptions)
def improve_command(
    campaign: Path,
    fit: FitOptions,
    critique: CritiqueOptions,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Fit, diagnose, add one effect, again.

    Until a verdict ends it; then the report is written.
    """
    with opened(campaign, out, "improve", force=force) as work:
        ladder = work.improve(fit, critique)
        report = work.report()
    if as_json:
        print_json({**ladder.model_dump(mode="json"), "report": str(report)})
    else:
        if not up_to_date(work):
            print_ladder(ladder)
            say(f"report: {report}")
        last = ladder.rungs[-1] if ladder.rungs else None
        if last is not None and last.outcome in ("unexplained", "uncertain"):
            _say_after(last, campaign, work.out)
        elif any(rung.tied for rung in ladder.rungs):
            tied = next(i for i, rung in enumerate(ladder.rungs) if rung.tied)
            say_next("rfea diagnose", campaign, ladder.rungs[tied - 1].model, why="what would split the tie")
        else:
            say_next("open in a browser:", report, why="'rfea export' takes the model along")


def print_comparison(name: str, comparison: Comparison) -> None:
    """Print where a model fails."""
    click.echo(f"\n{name}")
    for sentence in dict.fromkeys([*comparison.sentences, *(place.sentence for place in comparison.where)]):
        say(sentence, indent="  ")


def print_diagnosis(diagnosis: Diagnosis, campaign: Path, out: Path) -> None:
    """Print the verdict, the evidence and what to do next."""
    rivals = {name: diagnosis.rivals_of(name) for name in diagnosis.named}
    told = [f"{name} (or {' or '.join(others)}: these data cannot tell)" if others else name for name, others in rivals.items()]
    say(": ".join(filter(None, (f"{diagnosis.model}: {diagnosis.said}", ", ".join(told)))))
    if diagnosis.sentence:
        say(diagnosis.sentence)
    if diagnosis.verdict == "unexplained" and diagnosis.where:  # what shows it comes before what it may be
        say(f"where it shows: {diagnosis.where[0].sentence}")
    _print_candidates(diagnosis)
    _print_floors(diagnosis)
    if diagnosis.remainder and diagnosis.remainder.sentence:
        say(diagnosis.remainder.sentence)
    for tie in diagnosis.tied:
        say(f"cannot be told apart here: {', '.join(tie.effects)}; {tie.split_by}")
    for warning in diagnosis.warnings:
        say(f"warning: {warning}")
    planned = diagnosis.next_experiment
    if planned is not None and not planned.decides:
        say(planned.sentence)
    elif planned is not None:
        file = out / "models" / diagnosis.model / Path(planned.pressure).name
        say(f"next experiment: {planned.sentence} Pressure to play: {file}")
    _say_after(diagnosis, campaign, out)


def _print_candidates(diagnosis: Diagnosis) -> None:
    """Print the candidates, best first: what ranks them stands in the table."""
    unit = "mm" if diagnosis.noise_floor_deg is None else "deg"
    rows = diagnosis.candidates[:12]
    columns = {"candidate": lambda c: c.effect + (f" ({c.form})" if c.form else ""), "at": lambda c: c.at}
    columns |= {"probability": lambda c: _percent(c.probability), "share": lambda c: _percent(c.share)}
    for name in ("predicted", "train", "validate"):
        columns[f"{name} {unit}"] = lambda c, key=f"{name}_rmse_{unit}": getattr(c, key)
    columns["delta BIC"] = lambda c: None if c.delta_bic is None else f"{c.delta_bic:z.0f}"
    columns["matters"] = lambda c: "yes" if c.matters else "no" if c.refitted else "unknown"
    print_columns("", columns, rows, always=("candidate",))


def _print_floors(diagnosis: Diagnosis) -> None:
    floors = diagnosis.floors
    if floors is None:
        return
    known = {name: getattr(floors, name) for name in ("measurement", "irreproducible")}
    whence = {"measurement": f" (from {floors.source})" if floors.source else ""}
    parts = [f"{name} {rounded(value)} {floors.unit}{whence.get(name, '')}" for name, value in known.items() if value is not None]
    if parts:
        say(f"noise floors, below which an error says nothing about the model: {', '.join(parts)}")


def _percent(share: float | None) -> str | None:
    return None if share is None else f"{100 * share:z.0f} %"


def _say_after(judged: Diagnosis | Rung, campaign: Path, out: Path) -> None:
    """Say the next command after a verdict, and what for."""
    from rfea_vision.artefacts.judgement import TRACK_UNCERTAIN, UNCERTAIN

    verdict = judged.outcome
    if verdict == "missing":
        say_next("rfea improve", campaign, why="adds it, fits again, and judges what is left")
    elif verdict == "complete":
        say_next("rfea report", campaign, why="one page, offline")
    elif verdict == UNCERTAIN and judged.uncertain_because not in ("", TRACK_UNCERTAIN):
        say_next("rfea check", campaign, why="see what may be declared wrong; then fit again")
    elif verdict == UNCERTAIN and (drawn := drawn_previews(out)):
        say_next("look at", drawn[0], why="the track over the film: better seen ends and a board lower the floor")
    elif verdict == UNCERTAIN:
        say_next("rfea track", campaign, "--preview", why="draws the track over the film: better seen ends and a board lower the floor")
    else:
        say_next("rfea propose", campaign, why="a law for what is left; 'rfea effects new FILE' writes one of your own")


def print_ladder(ladder: Ladder) -> None:
    """Print the ladder, rung by rung, in the unit of what was measured."""
    unit = ladder.rungs[0].unit if ladder.rungs else "mm"
    columns = {
        "model": lambda r: r.model,
        "added": lambda r: f"{r.added} (stand-in)" if r.added and r.grade == "stand-in" else r.added,
        "cannot be told from": lambda r: _first(r.tied),
        f"train {unit}": lambda r: r.error("train"),
        f"validate {unit}": lambda r: r.error("validate"),
        "share": lambda r: _percent(r.share),
        "probability": lambda r: _percent(r.probability),
        "delta BIC": lambda r: None if r.delta_bic is None else f"{r.delta_bic:z.0f}",
        "verdict": lambda r: r.said,
    }
    title = f"error ladder ({'tip' if unit == 'mm' else 'bend angle'}, root mean square)"
    print_columns(title, columns, ladder.rungs, always=("model", "added", "verdict"), left=2)
    for rung in ladder.rungs:
        if len(rung.tied) > _RIVALS:
            say(f"{rung.model}: {rung.added} cannot be told from {', '.join(rung.tied)}")
    for finding in ladder.findings or [f"Stopped because {ladder.stopped_because}"]:
        say(finding)


def _first(rivals: Sequence[str]) -> str | None:
    """As many rivals as leave the figures beside them their room; the others stand below the table."""
    named, more = rivals[:_RIVALS], len(rivals) - _RIVALS
    return ", ".join([*named, *([f"{more} more"] if more > 0 else [])]) or None
