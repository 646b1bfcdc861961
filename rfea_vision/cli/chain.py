"""Commands that string stages together: report, run, batch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rfea_vision.cli.console import ConsoleListener, print_json, print_table, say, say_next
from rfea_vision.cli.fit import print_metrics
from rfea_vision.cli.model import print_ladder
from rfea_vision.cli.options import campaign_options, opened, output_options
from rfea_vision.errors import DataError
from rfea_vision.units import rounded


@click.command("report")
@campaign_options
@click.option("--compare", "other", metavar="OTHER", type=click.Path(path_type=Path), help="Side by side with OTHER.")
@click.option("--notebook", is_flag=True, help="Also write a notebook that opens the artefacts.")
def report_command(
    campaign: Path, other: Path | None, notebook: bool, out: Path | None, force: bool, as_json: bool, debug: bool
) -> None:
    """One page, offline: where, why, and the cure.

    Where the model fails, which effect is missing, and what adding it does. What is out of date is redone first.
    '--compare A B' puts campaign A beside campaign B: two tubes, two materials, before and after.
    """
    from rfea_vision.stages import publishing

    forced = ("report",) if force else ()
    with opened(campaign, out, force=forced) as work:
        files = {"file": work.report()}
        status = work.outcome("report", "page")
        if notebook:
            files["notebook"] = publishing.notebook(work)
        if other is not None:
            with opened(other, None, force=forced) as second:
                second.report()
            files["compare"] = publishing.side_by_side(work, second)
    if as_json:
        shown = {key: str(path) for key, path in files.items()}
        print_json({**shown, "status": status, "bytes": files["file"].stat().st_size})
    else:
        for path in files.values():
            click.echo(str(path))
        say_next(f"open {files.get('compare', files['file'])}", "in a browser; it needs no network")


@click.command("run")
@click.argument("recipe")
@campaign_options
def run_command(recipe: str, campaign: Path, out: Path | None, force: bool, as_json: bool, debug: bool) -> None:
    """A recipe over a campaign.

    RECIPE is one of pipelines/ by name (default, paper), or a .yaml file of one's own.
    """
    from rfea_vision.stages.recipes import load_recipe, run_recipe

    steps = load_recipe(recipe)
    with opened(campaign, out, force=tuple(name for name, _ in steps.calls()) if force else ()) as work:
        results = run_recipe(work, steps)
        models = {name: work.model(name) for name in work.model_names()}
    if as_json:
        fits = {name: model.model_dump(mode="json")["metrics"] for name, model in models.items()}
        print_json({"recipe": recipe, "steps": work.outcomes, "models": fits, "report": results.get("report")})
        return
    if "improve" in results:
        print_ladder(results["improve"])
    elif models:
        print_metrics(models)
    if "report" in results:
        click.echo(f"report: {results['report']}")
        say_next(f"open {results['report']}", "in a browser; it needs no network")
    else:
        say_next(f"rfea report {campaign}")


@click.command("batch")
@click.argument("folders", nargs=-1, required=True, metavar="FOLDER...", type=click.Path(path_type=Path))
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, such as tcp://host:8786; default this machine.")
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True, help="Processes on this machine.")
@click.option("--recipe", default="default", show_default=True, help="Recipe to run, by name or as a .yaml file.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for one folder of results per campaign.")
@click.option(
    "--index",
    type=click.Path(path_type=Path),
    default="rfea-batch.html",
    show_default=True,
    help="Page that lists all campaigns: experiments down, rungs across.",
)
@click.option("--force", is_flag=True, help="Redo the recipe's steps even if nothing has changed.")
@output_options
def batch_command(
    folders: tuple[Path, ...],
    scheduler: str | None,
    workers: int,
    recipe: str,
    out: Path | None,
    index: Path,
    force: bool,
    as_json: bool,
    debug: bool,
) -> int:
    """Many campaigns at once.

    One that is broken does not stop the rest. The folders may be campaigns or lone experiments.
    """
    from rfea_vision.distributed import BatchResult, dask_client, run_batch
    from rfea_vision.files import write_text
    from rfea_vision.report import render_index
    from rfea_vision.stages.recipes import load_recipe

    load_recipe(recipe)  # a broken recipe is said before any worker starts
    done: list[BatchResult] = []
    with ConsoleListener().shown() as listener, dask_client(scheduler, workers) as client:
        advance = listener.begin("batch", f"{len(folders)} campaigns")

        def heard(result: BatchResult) -> None:
            done.append(result)
            advance(len(done), len(folders))
            listener.note(f"{result.folder}: {result.status}")

        results = run_batch(folders, client=client, recipe=recipe, out=out, force=force, on_result=heard)
    failed = [result for result in results if result.status != "done"]
    write_text(index, render_index([Path(result.out) for result in results], beside=index.resolve().parent))
    if as_json:
        print_json({"ok": not failed, "campaigns": [vars(result) for result in results], "index": str(index)})
    else:
        _print_batch(results)
        click.echo(f"index: {index}")
        say_next(f"open {index}", "every campaign in one table, with links to the reports")
    return DataError.exit_code if failed else 0


def _print_batch(results: list[Any]) -> None:
    rows = []
    for result in results:
        last = result.rungs[-1] if result.rungs else {}
        rows.append([result.folder, result.status, last.get("model"), last.get("verdict"), _held_out(last)])
    print_table("", ["campaign", "status", "last model", "verdict", "validate"], rows, left=4)
    for result in results:
        for name, sentence in result.errors.items():
            say(f"{result.folder}: {name}: {sentence}")
        if result.report:
            click.echo(f"report: {result.report}")


def _held_out(rung: dict[str, Any]) -> str | None:
    """The held-out error of a campaign's last rung with its unit: campaigns of films and of inclinometers stand in one table."""
    for unit in ("mm", "deg"):
        if rung.get(f"validate_{unit}") is not None:
            return f"{rounded(rung[f'validate_{unit}'])} {unit}"
    return None
