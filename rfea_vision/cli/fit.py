"""The command fit, and the options by which a person says what is known beforehand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rfea_vision.cli.console import print_json, print_table
from rfea_vision.cli.options import Quantity, campaign_options, model_options, opened

if TYPE_CHECKING:
    from rfea_vision.artefacts import ModelFit

_Command = TypeVar("_Command", bound=Callable[..., Any])


def knowledge_options(command: _Command) -> _Command:
    """Add what fit and improve may be told of parameters and of the data."""
    command = click.option(
        "--pressure-zero",
        "pressure_zero_sd",
        type=Quantity("Pa", "1kPa"),
        metavar="SD",
        help="Standard error of the pressure sensor's zero, then found for every run, such as 1kPa.",
    )(command)
    command = click.option(
        "--loss",
        type=click.Choice(["auto", "linear", "huber"]),
        default="auto",
        show_default=True,
        help="huber: for tracks with wrong frames; auto takes it where a track leaves the model in jumps.",
    )(command)
    command = click.option(
        "--bound", multiple=True, metavar="NAME=LOW..HIGH", help="Other bounds, as in r_hyd=3mm..4mm; may be repeated."
    )(command)
    command = click.option(
        "--prior",
        multiple=True,
        metavar="NAME=VALUE±SD",
        help="What was weighed or measured, as in payload.m=2g±0.1g or modulus=2MPa±0.3MPa; may be repeated.",
    )(command)
    return click.option(
        "--fix", multiple=True, metavar="NAME=VALUE", help="Hold a parameter, as in r_hyd=3.6mm; may be repeated."
    )(command)


@click.command("fit")
@campaign_options
@model_options
@knowledge_options
@click.option(
    "--add", "effects", multiple=True, metavar="EFFECT", help="An effect beside the base model; may be repeated."
)
@click.option(
    "--study-segments", is_flag=True, help="Try 2, 4, 8, 16 and 32 segments too: errors, path of the tip, seconds."
)
@click.option("--profile", multiple=True, metavar="NAME", help="Profile likelihood of a parameter; may be repeated.")
@click.option("--leave-one-out", is_flag=True, help="Fit again without each training run, and score that run.")
@click.option("--name", metavar="MODEL", help="Name of the model; default base, base+EFFECT, ...")
@click.pass_context
def fit_command(
    context: click.Context, campaign: Path, out: Path | None, force: bool, as_json: bool, debug: bool, **choices: Any
) -> None:
    """Fit one model, and score it on held-out runs."""
    add = tuple(effect for item in choices.pop("effects") for effect in item.split(","))
    with opened(campaign, out, force=("fit",) if force else ()) as work:
        model = work.fit(choices.pop("name"), add=add, **choices)
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
