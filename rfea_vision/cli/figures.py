"""Commands whose results go into a paper: figures, reproduce."""

from __future__ import annotations

from pathlib import Path

import click

from rfea_vision.cli.console import print_json
from rfea_vision.cli.options import campaign_options, opened


@click.command("figures")
@campaign_options
@click.option(
    "--style", type=click.Choice(("paper", "screen")), default="paper", show_default=True, help="Size of type."
)
@click.option("--format", "formats", default="pdf,svg,png", show_default=True, help="Any of pdf, svg, png.")
@click.option("--model", metavar="MODEL", help="Whose curves are drawn; default the last of the ladder.")
def figures_command(
    campaign: Path,
    style: str,
    formats: str,
    model: str | None,
    out: Path | None,
    force: bool,
    as_json: bool,
    debug: bool,
) -> None:
    """Every figure of the report as a file, with its data.

    They go to rfea/figures: each in every format, one or two columns of a journal wide, units on the axes, and the numbers drawn
    as CSV. The same results give the same bytes. What is out of date is redone first.
    """
    from rfea_vision.stages.publishing import figures

    with opened(campaign, out, force=("report",) if force else ()) as work:
        work.report()
        files = figures(work, formats=[name.strip() for name in formats.split(",")], style=style, model=model)
    if as_json:
        print_json({"folder": str(files[0].parent), "files": [path.name for path in files]})
        return
    click.echo(f"{files[0].parent}: {len({path.stem for path in files})} figures, {len(files)} files")
