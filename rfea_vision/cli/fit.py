"""The command fit, and how a fitted model is shown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rfea_vision.cli.console import print_json, print_table
from rfea_vision.cli.options import ask, campaign_options, opened
from rfea_vision.options import FitOptions

if TYPE_CHECKING:
    from rfea_vision.artefacts import ModelFit


@click.command("fit")
@campaign_options
@ask("fit", options=FitOptions)
@click.pass_context
def fit_command(
    context: click.Context,
    campaign: Path,
    options: FitOptions,
    out: Path | None,
    force: bool,
    as_json: bool,
    debug: bool,
) -> None:
    """Fit one model, and score it on held-out runs."""
    with opened(campaign, out, force=("fit",) if force else ()) as work:
        model = work.fit(options)
    if as_json:
        print_json(model.model_dump(mode="json"))
    else:
        print_model(model)
        click.echo(str(work.out / "models" / model.name / "model.json"))
    if model.status == "refused":
        context.exit(1)


def print_model(model: ModelFit) -> None:
    """Print the parameters of a fit, its errors, and the studies that were asked for."""
    table = [
        [
            name,
            f"{item.value:.6g}",
            "-" if item.stderr is None else f"{item.stderr:.2g}",
            item.unit,
            "fixed" if item.fixed else item.note,
        ]
        for name, item in model.parameters.items()
    ]
    print_table(f"{model.name}: {model.status}", ["parameter", "value", "std. error", "unit", "note"], table)
    if model.message:
        click.echo(model.message)
    for warning in model.warnings:
        click.echo(f"warning: {warning}")
    print_metrics({model.name: model})
    print_study(model)
    for found in model.profiles.values():
        click.echo(found["sentence"])
    if model.leave_one_out:
        click.echo(f"leaving runs out: {model.leave_one_out['sentence']}")


def print_study(model: ModelFit) -> None:
    """Print errors over the number of segments, with the seconds where they were just measured."""
    if not model.segments_study:
        return
    role = "validate" if "validate_tip_rmse_mm" in model.segments_study[0] else "train"
    rows = [
        [
            row["segments"],
            *(row.get(f"{role}_{key}_rmse_mm") for key in ("tip", "tip_x", "tip_y")),
            model.timings.get(str(row["segments"])),
        ]
        for row in model.segments_study
    ]
    columns = ["segments", "tip mm", "tip x mm", "tip y mm", "seconds"]
    print_table(f"root mean square errors over the number of segments ({role})", columns, rows, left=1)


def print_metrics(models: dict[str, ModelFit]) -> None:
    """Print the errors of models by role, beside the noise floor."""
    rows = [
        [
            name,
            role,
            metrics.tip_rmse_mm,
            metrics.tip_y_rmse_mm,
            metrics.midline_rmse_mm,
            metrics.angle_rmse_deg,
            model.noise_floor_mm,
        ]
        for name, model in models.items()
        for role, metrics in model.metrics.items()
    ]
    columns = ["model", "role", "tip mm", "tip y mm", "midline mm", "angle deg", "noise floor mm"]
    print_table("root mean square errors", columns, rows, left=2)
