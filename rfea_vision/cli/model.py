"""Commands right of the fit: compare, diagnose, improve."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rfea_vision.cli.console import print_json, print_table
from rfea_vision.cli.fit import print_metrics
from rfea_vision.cli.options import ask, campaign_options, opened
from rfea_vision.options import CritiqueOptions, FitOptions

if TYPE_CHECKING:
    from rfea_vision.artefacts import Comparison, Diagnosis, Ladder


@click.command("compare")
@campaign_options
@click.argument("models", nargs=-1, metavar="[MODEL]...")
def compare_command(
    campaign: Path, models: tuple[str, ...], out: Path | None, force: bool, as_json: bool, debug: bool
) -> None:
    """Model against measurement: how far, where, when.

    Beside the noise floor; all models, or those named.
    """
    with opened(campaign, out, force=("compare",) if force else ()) as work:
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
    print_metrics(fits)
    for name, comparison in comparisons.items():
        print_comparison(name, comparison)


@click.command("diagnose")
@campaign_options
@click.argument("model", required=False)
@ask("diagnose", options=CritiqueOptions)
def diagnose_command(
    campaign: Path,
    model: str | None,
    options: CritiqueOptions,
    out: Path | None,
    force: bool,
    as_json: bool,
    debug: bool,
) -> None:
    """Which effect is missing from a model.

    By default from the one fitted last.
    """
    with opened(campaign, out, force=("diagnose",) if force else ()) as work:
        diagnosis = work.diagnose(model, options)
    if as_json:
        print_json(diagnosis.model_dump(mode="json", by_alias=True))
    else:
        print_diagnosis(diagnosis)


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
    debug: bool,
) -> None:
    """Fit, diagnose, add one effect, again.

    Until a verdict ends it; then the report is written.
    """
    with opened(campaign, out, force=("improve",) if force else ()) as work:
        ladder = work.improve(fit, critique)
        report = work.report()
    if as_json:
        print_json({**ladder.model_dump(mode="json"), "report": str(report)})
    else:
        print_ladder(ladder)
        click.echo(f"report: {report}")


def print_comparison(name: str, comparison: Comparison) -> None:
    """Print where a model fails."""
    click.echo(f"\n{name}")
    for sentence in comparison.sentences:
        click.echo(f"  {sentence}")
    for place in comparison.where:
        if place.sentence not in comparison.sentences:
            click.echo(f"  {place.sentence}")


def print_diagnosis(diagnosis: Diagnosis) -> None:
    """Print the verdict, the evidence and what to do next."""
    named = f": {', '.join(diagnosis.named)}" if diagnosis.named else ""
    click.echo(f"{diagnosis.model}: {diagnosis.verdict}{named}")
    if diagnosis.sentence:
        click.echo(diagnosis.sentence)
    unit = "mm" if diagnosis.noise_floor_deg is None else "deg"
    rows = [
        [
            item.effect,
            item.at,
            None if item.score_p is None else f"{item.score_p:.1e}",
            *(getattr(item, f"{name}_rmse_{unit}") for name in ("predicted", "train", "validate")),
            item.delta_bic,
            "yes" if item.matters else "no" if item.refitted else "not refitted",
        ]
        for item in diagnosis.candidates[:12]
    ]
    errors = [f"{name} {unit}" for name in ("predicted", "train", "validate")]
    columns = ["candidate", "at", "score p", *errors, "delta BIC", "matters"]
    print_table("", columns, rows, left=2)
    for tie in diagnosis.tied:
        click.echo(f"cannot be told apart here: {', '.join(tie.effects)}; {tie.split_by}")
    for warning in diagnosis.warnings:
        click.echo(f"warning: {warning}")
    if diagnosis.next_experiment is not None:
        click.echo(f"next experiment: {diagnosis.next_experiment.sentence}")


def print_ladder(ladder: Ladder) -> None:
    """Print the ladder, rung by rung."""
    rows = [
        [
            rung.model,
            rung.added,
            rung.train_tip_rmse_mm,
            rung.validate_tip_rmse_mm,
            None if rung.delta_bic is None else f"{rung.delta_bic:.0f}",
            rung.verdict,
        ]
        for rung in ladder.rungs
    ]
    print_table(
        "error ladder (tip, root mean square)",
        ["model", "added", "train mm", "validate mm", "delta BIC", "verdict"],
        rows,
        left=2,
    )
    for finding in ladder.findings or [f"Stopped because {ladder.stopped_because}"]:
        click.echo(finding)
