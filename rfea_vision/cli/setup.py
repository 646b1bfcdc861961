"""Commands before any data: init, check, schema, doctor, board."""

from __future__ import annotations

from pathlib import Path

import click

from rfea_vision.cli.console import print_json
from rfea_vision.cli.options import output_options
from rfea_vision.errors import InputError


@click.command("check")
@click.argument("campaign", type=click.Path(path_type=Path))
@output_options
def check_command(campaign: Path, as_json: bool, debug: bool) -> int:
    """What is wrong with a campaign, all at once; nothing is written."""
    from rfea_vision.campaign.check import check_campaign

    checked = check_campaign(campaign)
    errors = [item for item in checked.problems if item.severity == "error"]
    if as_json:
        print_json(
            {
                "campaign": str(campaign),
                "ok": not errors,
                "experiments": checked.experiments,
                "problems": [item.as_dict() for item in checked.problems],
            }
        )
    else:
        for item in checked.problems:
            click.echo(f"{item.severity}: {item}")
        warnings = len(checked.problems) - len(errors)
        found = ", ".join(f"{name} ({role})" for name, role in checked.experiments.items()) or "none"
        click.echo(f"experiments: {found}")
        click.echo(f"{len(errors)} errors, {warnings} warnings" if checked.problems else "nothing is wrong")
    return InputError.exit_code if errors else 0
