"""The command fit, and how a fitted model is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rfea_vision.cli.console import print_columns, print_json, print_table, say, say_next, up_to_date
from rfea_vision.cli.options import ask, campaign_options, opened
from rfea_vision.errors import InputError
from rfea_vision.options import FitOptions
from rfea_vision.units import rounded

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
) -> None:
    """Fit one model, and score it on held-out runs."""
    parts = {effect.partition(":")[0].partition("@")[0] for effect in options.effects}
    for name in (*options.fixed, *options.start, *options.priors, *options.bounds, *options.profile):
        effect = name.partition(".")[0].partition("@")[0]
        if "." in name and effect not in parts:
            raise InputError(f"{name}: is no parameter of this model, which is fitted without {effect}; add it: --add {effect}")
    with opened(campaign, out, "fit", force=force) as work:
        model = work.fit(options)
    if as_json:
        print_json(model.model_dump(mode="json"))
    else:
        if model.status == "refused" or not up_to_date(work):
            print_model(model, study=options.study_segments or options.auto_segments)
            click.echo(str(work.out / "models" / model.name / "model.json"))
        if model.meets_no_run:
            say_next("rfea check", campaign, why="it meets no run: see what may be declared wrong")
        else:
            say_next("rfea compare", campaign, model.name, why="where it fails; 'rfea diagnose' says why")
    if model.status == "refused":
        context.exit(1)


def print_model(model: ModelFit, *, study: bool) -> None:
    """Print the parameters of a fit, its errors, and the studies that were asked for: `study` is that of the segments."""
    table = [
        [
            name,
            f"{item.value:.6g}",
            "-" if item.stderr is None else rounded(item.stderr, 2),
            item.unit,
            "fixed" if item.fixed else item.note,
        ]
        for name, item in model.told.items()
    ]
    print_table(f"{model.name}: {model.status}", ["parameter", "value", "std. error", "unit", "note"], table)
    if model.message:
        say(model.message)
    for warning in model.warnings:
        say(f"warning: {warning}")
    print_metrics({model.name: model})
    if study:
        print_study(model)
    for found in model.profiles.values():
        say(found["sentence"])
    if model.leave_one_out:
        say(f"leaving runs out: {model.leave_one_out.get('sentence', '')}")


def print_study(model: ModelFit) -> None:
    """Print errors over the number of segments, with the seconds where they were just measured."""
    if not model.segments_study:
        return
    known = {key for row in model.segments_study for key, value in row.items() if value is not None}
    role = "validate" if any(key.startswith("validate") for key in known) else "train"
    columns: dict[str, Callable[[Any], object]] = {"segments": lambda row: row["segments"]}
    for name in ("tip mm", "tip x mm", "tip y mm", "angle deg"):
        what, unit = name.rsplit(" ", 1)
        key = f"{role}_{'_'.join(what.split())}_rmse_{unit}"
        columns[name] = lambda row, key=key: row.get(key)
    columns["seconds"] = lambda row: model.timings.get(str(row["segments"]))
    title = f"root mean square errors over the number of segments ({role})"
    print_columns(title, columns, model.segments_study, always=("segments", "seconds"))


def print_metrics(models: dict[str, ModelFit]) -> None:
    """Print the errors of models by role, beside the noise floor; what these tracks cannot give has no column."""
    scores = [(name, model, role, metrics) for name, model in models.items() for role, metrics in model.metrics.items()]
    columns: dict[str, Callable[[Any], object]] = {
        "model": lambda score: score[0],
        "role": lambda score: score[2],
        "tip mm": lambda score: score[3].tip_rmse_mm,
        "tip y mm": lambda score: score[3].tip_y_rmse_mm,
        "midline mm": lambda score: score[3].midline_rmse_mm,
        "angle deg": lambda score: score[3].angle_rmse_deg,
        "noise floor mm": lambda score: score[1].noise_floor_mm or None,
        "noise floor deg": lambda score: score[1].noise_floor_deg or None,
    }
    print_columns("root mean square errors", columns, scores, always=("model", "role"), left=2)
