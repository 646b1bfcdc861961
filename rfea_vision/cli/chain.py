"""Commands that string stages together: report, run, batch."""

from __future__ import annotations

from pathlib import Path

import click

from rfea_vision.cli.console import print_json
from rfea_vision.cli.options import campaign_options, opened


@click.command("report")
@campaign_options
def report_command(campaign: Path, out: Path | None, force: bool, as_json: bool, debug: bool) -> None:
    """One page, offline: where the model fails, why, and what adding the effect does."""
    with opened(campaign, out, force=("report",) if force else ()) as work:
        path = work.report()
        status = work.outcome("report", "page")
    if as_json:
        print_json({"file": str(path), "status": status, "bytes": path.stat().st_size})
    else:
        click.echo(str(path))
