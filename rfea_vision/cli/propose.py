"""The command that writes a law for what no effect explains: propose."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rfea_vision.cli.console import print_json, say, say_next
from rfea_vision.cli.options import code_option, models_like, opened, stage_options


@click.command("propose")
@code_option
@stage_options
@click.argument("model", required=False, shell_complete=models_like)
@click.option(
    "-o",
    "--output",
    "file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Where the law is written; default proposed.py among the model's results.",
)
def propose_command(
    campaign: Path, model: str | None, file: Path | None, out: Path | None, force: bool, as_json: bool
) -> None:
    """A law for what a model leaves, as an effect file.

    Torques on the joints are weighed by what they would do to the motion, cross-validated over the runs, and refitted; by default of
    the model fitted last. A law describes, it does not explain: 'rfea improve CAMPAIGN --effect-file FILE' weighs it against the
    catalogue.
    """
    with opened(campaign, out, "fit", force=force) as work:
        proposal = work.propose(model, file)
    if as_json:
        print_json({**asdict(proposal), "file": str(proposal.file)})
        return
    say(proposal.sentence)
    click.echo(f"law: {proposal.file}")
    say_next("rfea improve", campaign, "--effect-file", proposal.file, why="weighs it against the catalogue")
