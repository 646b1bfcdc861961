"""Commands that string stages together: report, run."""

from __future__ import annotations

from pathlib import Path

import click

from rfea_vision.cli.console import print_json, say_next, up_to_date
from rfea_vision.cli.fit import print_metrics
from rfea_vision.cli.model import print_ladder
from rfea_vision.cli.options import PATH, campaign_options, code_option, opened, refuse_beside
from rfea_vision.errors import InputError


@click.command("report")
@code_option
@campaign_options
@click.argument("more", nargs=-1, metavar="[CAMPAIGN]...", type=PATH)
@click.option("--group", is_flag=True, help="Many tubes on one page: parameters over the design, effects by tube.")
@click.option("--compare", "other", metavar="OTHER", type=PATH, help="Side by side with OTHER.")
@click.option("--notebook", is_flag=True, help="Also write a notebook that opens the artefacts.")
def report_command(
    campaign: Path,
    more: tuple[Path, ...],
    group: bool,
    other: Path | None,
    notebook: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """One page, offline: where, why, and the cure.

    Where the model fails, which effect is missing, and what adding it does. What is out of date is redone first.
    '--group A B C' puts many tubes on one page, rfea-group.html: their parameters over the design variables of campaign.yaml
    (design: {turns: 12, load: 30 g}), and the effects named as a matrix.
    '--compare A B' puts campaign A beside campaign B: two tubes, two materials, before and after. B may be an earlier
    folder of results of the same campaign, such as a copy of A/rfea.
    """
    from rfea_vision.stages import publishing

    if more and not group:
        raise click.UsageError(f"Got unexpected '{more[0]}': several campaigns go on one page with --group.")
    if group:
        refuse_beside("--group", ("other", "notebook"), "it writes the page of all tubes")
        _report_group((campaign, *more), out or Path("rfea-group.html"), force, as_json)
        return
    if other is not None and not other.is_dir():
        raise InputError(f"--compare {other}: no such folder; give a campaign, or an earlier folder of its results")
    second = None
    if other is not None and not publishing.is_results(other):
        # one after the other: two that wait for each other never end
        with opened(other, None, "report", force=force) as second:
            second.report()
    with opened(campaign, out, "report", force=force) as work:
        files = {"file": work.report()}
        status = work.outcome("report", "page")
        if notebook:
            files["notebook"] = publishing.notebook(work)
        if second is not None:
            files["compare"] = publishing.side_by_side(work, second)
        elif other is not None:
            files["compare"] = publishing.beside_results(work, other)
    if as_json:
        shown = {key: str(path) for key, path in files.items()}
        print_json({**shown, "status": status, "bytes": files["file"].stat().st_size})
    else:
        if len(files) > 1 or not up_to_date(work):
            click.echo("\n".join(map(str, files.values())))
        say_next("open in a browser:", files.get("compare", files["file"]), why="it needs no network")


def _report_group(campaigns: tuple[Path, ...], page: Path, force: bool, as_json: bool) -> None:
    """Bring every campaign up to date, then write the page of all."""
    from rfea_vision.stages import publishing

    page = page if page.suffix == ".html" else page / "rfea-group.html"
    works = []
    for path in {path.resolve(): path for path in campaigns}.values():  # each once
        with opened(path, None, "report", force=force) as work:
            publishing.bring_up_to_date(work)
        works.append(work)
    files = publishing.group(works, page)
    if as_json:
        print_json(
            {"file": str(page), "campaigns": [str(path) for path in campaigns], "figures": [str(p) for p in files[1:]]}
        )
    else:
        say_next("open in a browser:", page, why="it needs no network")


@click.command("run")
@click.argument("recipe")
@code_option
@campaign_options
def run_command(recipe: str, campaign: Path, out: Path | None, force: bool, as_json: bool) -> None:
    """A recipe over a campaign.

    RECIPE is one of pipelines/ by name (default, paper), or a .yaml file of one's own.
    """
    from rfea_vision.stages.recipes import load_recipe, run_recipe

    steps = load_recipe(recipe)
    with opened(campaign, out, *(name for name, _ in steps.calls()), force=force) as work:
        results = run_recipe(work, steps)
        models = {name: work.model(name) for name in work.model_names()}
    if as_json:
        fits = {name: model.model_dump(mode="json")["metrics"] for name, model in models.items()}
        print_json({"recipe": recipe, "steps": work.outcomes, "models": fits, "report": results.get("report")})
        return
    fresh = not up_to_date(work)
    if fresh and "improve" in results:
        print_ladder(results["improve"])
    elif fresh and models:
        print_metrics(models)
    if "report" in results:
        if fresh:
            click.echo(f"report: {results['report']}")
        say_next("open in a browser:", results["report"], why="it needs no network")
    else:
        say_next("rfea report", campaign)
