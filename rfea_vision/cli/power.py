"""The command that says what a campaign could show: power."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rfea_vision.cli.console import print_json, print_table, say, say_next
from rfea_vision.cli.options import ask, models_like, opened, stage_options
from rfea_vision.options import CritiqueOptions


@click.command("power")
@stage_options
@click.argument("model", required=False, shell_complete=models_like)
@ask("power", options=CritiqueOptions)
def power_command(
    campaign: Path,
    model: str | None,
    out: Path | None,
    force: bool,
    as_json: bool,
    options: CritiqueOptions,
) -> None:
    """Which effects these recordings could reveal, and how strong they must be.

    With this excitation, camera and noise, around a model (by default the one fitted last, or the base model).
    'rfea simulate OUT --like CAMPAIGN --hidden ...' makes a twin to try it on.
    """
    from rfea_vision.critique import power_study

    with opened(campaign, out, "fit", force=force) as work:
        names = work.model_names()
        fit = work.model(model or names[-1]) if model or names else work.fit()
        recordings = work.recordings()
    rows = power_study(fit, recordings, effect_files=options.effect_files)
    if as_json:
        print_json({"model": fit.name, "noise_floor_mm": fit.noise_floor_mm, "effects": [asdict(row) for row in rows]})
        return
    seen = sorted((row for row in rows if row.amplitude is not None), key=lambda row: row.effect)
    table = [[row.effect, row.parameter, f"{row.amplitude:.3g}", row.unit, _at(row.grid)] for row in seen]
    print_table("revealed from this strength on", ["effect", "parameter", "least", "unit", "at"], table, left=2)
    hidden = sorted({row.effect for row in rows} - {row.effect for row in seen})
    if hidden:
        say(f"not to be seen in these recordings at any strength that physics allows: {', '.join(hidden)}")
    say_next("rfea simulate OUT --hidden EFFECT.PARAMETER=VALUE --like", campaign, why="a twin to try one of them on")


def _at(grid: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in grid.items())
