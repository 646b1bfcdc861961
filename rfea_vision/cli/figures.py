"""Commands whose results go into a paper: figures, reproduce."""

from __future__ import annotations

from pathlib import Path

import click

from rfea_vision.cli.console import ConsoleListener, print_json, say, say_next
from rfea_vision.cli.options import PATH, code_option, opened, output_options, stage_options
from rfea_vision.errors import InputError


@click.command("figures")
@code_option
@stage_options
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
) -> None:
    """Every figure of the report as a file, with its data.

    They go to rfea/figures: each in every format, one or two columns of a journal wide, units on the axes, and the numbers drawn
    as CSV. The same results give the same bytes. What is out of date is redone first.
    """
    from rfea_vision.artefacts import Ladder
    from rfea_vision.figures.saving import refuse_unknown_formats
    from rfea_vision.stages.publishing import figures

    wanted = [name.strip() for name in formats.split(",")]
    refuse_unknown_formats(wanted)
    with opened(campaign, out, "report", force=force) as work:
        work.report()
        files = figures(work, formats=wanted, style=style, model=model)
        ladder = work.out / "ladder.json"
        drawn = model or (Ladder.load(ladder).rungs[-1].model if ladder.is_file() else None)
    if as_json:
        print_json({"folder": str(files[0].parent), "files": [path.name for path in files]})
        return
    say(f"{files[0].parent}: {len({path.stem for path in files})} figures, {len(files)} files")
    named = (drawn,) if drawn else ()
    say_next("rfea export --crate", campaign, *named, "OUT", why="the fit behind them, with its files and hashes")


@click.command("reproduce")
@click.argument("campaign", required=False, type=PATH)
@click.option("--out", type=PATH, help="Where results go; default CAMPAIGN/rfea.")
@click.option(
    "--twin", type=PATH, default="rfea-paper", show_default=True,
    help="Without CAMPAIGN: where the twin of the paper's tube goes, or is already.",
)  # fmt: skip
@click.option("--force", is_flag=True, help="Fit again even if nothing has changed.")
@output_options
def reproduce_command(campaign: Path | None, out: Path | None, twin: Path, force: bool, as_json: bool) -> None:
    """The paper: its Table I and figures 4 to 10.

    Two and eight bodies, published parameters beside those found with their intervals, as one page and as files; on your campaign, or
    on a twin of the paper's tube. The same data give the same bytes.
    """
    from rfea_vision.stages.reproducing import reproduce

    if campaign is None:
        campaign = twin
        if not (twin / "campaign.yaml").is_file():
            _write_twin(twin)
    with opened(campaign, out, "fit", force=force) as work:
        files = reproduce(work)
    if as_json:
        print_json({"page": str(files[0]), "files": [str(path) for path in files[1:]]})
        return
    say(f"{files[0]}: Table I and {len({path.stem for path in files[2:]})} drawings, each as a file beside it")
    say_next("rfea improve", campaign, why="what the paper's model lacks here")


def _write_twin(folder: Path) -> None:
    try:
        from rfea_vision.twin import paper_campaign, simulate
    except ImportError as error:
        raise InputError(f"reproduce: needs the module '{error.name}'; pip install 'rfea-vision[twin]'") from error
    with ConsoleListener().shown() as listener:
        simulate(folder, paper_campaign(), listener.begin("simulate", folder.name))
