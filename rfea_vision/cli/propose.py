"""The command that writes a law for what no effect explains: propose."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rfea_vision.cli.console import print_json, say, say_next
from rfea_vision.cli.options import campaign_options, opened
from rfea_vision.errors import InputError


@click.command("propose")
@campaign_options
@click.argument("model", required=False)
@click.option(
    "-o",
    "--output",
    "file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Where the law is written; default proposed.py among the model's results.",
)
def propose_command(
    campaign: Path, model: str | None, file: Path | None, out: Path | None, force: bool, as_json: bool, debug: bool
) -> None:
    """A law for what a model leaves, as an effect file.

    Read from the residual torque, cross-validated over the runs, refitted; by default of the model fitted last. It describes, it
    does not explain: 'rfea improve CAMPAIGN --effect-file FILE' weighs it against the catalogue.
    """
    from rfea_vision.critique import propose

    if file is not None and file.suffix != ".py":
        raise InputError(f"--output {file}: an effect is a Python file; call it {file.with_suffix('.py')}")
    with opened(campaign, out, force=("fit",) if force else ()) as work:
        names = work.model_names()
        fit = work.model(model or names[-1]) if model or names else work.fit()
        recordings = {name: stored.value for name, stored in work.recordings("train", "validate").items()}
        target = file or work.out / "models" / fit.name / "proposed.py"
    proposal = propose(fit, recordings, target, effect_id=target.stem.replace("-", "_"))
    if as_json:
        print_json({**asdict(proposal), "file": str(proposal.file)})
        return
    say(proposal.sentence)
    click.echo(f"law: {target}")
    say_next(f"rfea improve {campaign} --effect-file {target}", "weighs it against the catalogue")
