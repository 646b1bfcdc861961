"""Commands over many campaigns: batch, table."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rfea_vision.cli.console import ConsoleListener, print_json, print_table, say, say_next
from rfea_vision.cli.options import PATH, code_option, named_files, output_options, trust_option, trusted
from rfea_vision.errors import DataError, InputError
from rfea_vision.units import counted, rounded

if TYPE_CHECKING:
    from rfea_vision.distributed.tasks import BatchResult
    from rfea_vision.stages.recipes import Recipe


@click.command("batch")
@click.argument("folders", nargs=-1, required=True, metavar="FOLDER...", type=PATH)
@click.option("--dry-run", is_flag=True, help="Say what would run and what is up to date, and do nothing.")
@click.option(
    "--scheduler", metavar="ADDRESS", help="A Dask scheduler, tcp://host:8786 or tls://host:8786; default this machine."
)
@click.option("--tls-ca", type=PATH, help="Certificate of the authority, for tls:// (PEM).")
@click.option("--tls-cert", type=PATH, help="Certificate of this client, for tls:// (PEM).")
@click.option("--tls-key", type=PATH, help="Key of this client, for tls:// (PEM).")
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True, help="Processes on this machine.")
@click.option(
    "--memory", default="auto", show_default=True, help="Of each process here, such as 2GB; auto: equal shares."
)
@click.option("--recipe", default="default", show_default=True, help="Recipe to run, by name or as a .yaml file.")
@click.option("--out", type=PATH, help="Folder for one folder of results per campaign.")
@click.option(
    "--index",
    type=PATH,
    default="rfea-batch.html",
    show_default=True,
    help="Page that lists all campaigns: experiments down, rungs across.",
)
@click.option("--force", is_flag=True, help="Redo the recipe's steps even if nothing has changed.")
@code_option
@trust_option
@output_options
def batch_command(
    folders: tuple[Path, ...],
    dry_run: bool,
    scheduler: str | None,
    tls_ca: Path | None,
    tls_cert: Path | None,
    tls_key: Path | None,
    workers: int,
    memory: str,
    recipe: str,
    out: Path | None,
    index: Path,
    force: bool,
    as_json: bool,
) -> int:
    """Many campaigns at once.

    Every run is a task of its own, so that one long campaign keeps all processes busy. What is broken does not stop the
    rest. The folders may be campaigns or lone experiments.
    """
    from rfea_vision.distributed import Security, dashboard, dask_client, run_batch
    from rfea_vision.distributed.batch import refuse_shared_results
    from rfea_vision.readers.apart import isolating
    from rfea_vision.stages.recipes import load_recipe, recipe_file

    steps = load_recipe(recipe)  # a broken recipe is said before any worker starts
    refuse_shared_results(folders, out)
    if dry_run:
        return _print_plan(folders, steps, out, force, as_json)
    page = _Index(index)
    security = Security(tls_ca, tls_cert, tls_key)
    own_recipe = recipe_file(recipe)
    files = [*named_files(), *([own_recipe] if own_recipe is not None else [])]
    with (
        isolating(),  # a campaign's results, which the page is made of, may be a stranger's
        ConsoleListener().shown() as listener,
        _memory_said(memory),
        dask_client(scheduler, workers, memory=memory, security=security, folders=folders, files=files) as client,
    ):
        if not index.is_file():
            page.write([])  # one that cannot be written is said now, and not when the first campaign ends
        advance = listener.begin("batch", counted(len(folders), "campaign"))
        listener.note(f"dashboard: {dashboard(client)}")

        def heard(result: BatchResult) -> None:
            page.add(result)
            advance(len(page.rows), len(folders))
            why = [f"{name}: {sentence}" for name, sentence in result.errors.items()]
            listener.note("; ".join([f"{result.folder}: {result.status}", *why]))

        results = run_batch(
            folders, client=client, recipe=recipe, out=out, force=force, trust=trusted(),
            effect_files=named_files(), on_result=heard,
        )  # fmt: skip
    failed = [result for result in results if result.status != "done"]
    page.write([result.folder for result in results])
    if as_json:
        print_json({"ok": not failed, "campaigns": [vars(result) for result in results], "index": str(index)})
    else:
        _print_batch(results)
        click.echo(f"index: {index}")
        say_next("open in a browser:", index, why="every campaign in one table, with links to the reports")
    return DataError.exit_code if failed else 0


@contextlib.contextmanager
def _memory_said(memory: str) -> Iterator[None]:
    from dask.utils import parse_bytes

    if memory != "auto":
        try:
            parse_bytes(memory)
        except ValueError as error:
            raise InputError(f"--memory {memory}: is no amount of memory; write for example 2GB") from error
    yield


class _Index:
    """The page that lists all campaigns, written again as they end."""

    def __init__(self, path: Path) -> None:
        self.path, self.rows = path, {}
        self._took_s, self._written = 0.0, float("-inf")

    def add(self, result: BatchResult) -> None:
        """Add a campaign, and write the page unless that would take a good part of the time."""
        from rfea_vision.report.batch import campaign_row

        why = " ".join(f"{name}: {sentence}" for name, sentence in result.errors.items())
        self.rows[result.folder] = campaign_row(Path(result.out), beside=self.path.resolve().parent, why=why)
        if time.monotonic() - self._written > 20 * self._took_s:
            self.write(list(self.rows))

    def write(self, folders: list[str]) -> None:
        """Write the page with these campaigns in this order."""
        from rfea_vision.files import write_text
        from rfea_vision.report.batch import render_rows

        begun = time.monotonic()
        write_text(self.path, render_rows([self.rows[folder] for folder in folders]))
        self._written = time.monotonic()
        self._took_s = self._written - begun


def _print_plan(folders: tuple[Path, ...], steps: Recipe, out: Path | None, force: bool, as_json: bool) -> int:
    from rfea_vision.distributed.batch import results_of
    from rfea_vision.stages.plan import plan

    found = {}
    for folder in folders:
        target = None if out is None else results_of(folder, out)
        found[str(folder)] = plan(folder, steps, out=target, force=force, trust=trusted())
    broken = [item for items in found.values() for item in items if item.state == "broken"]
    if as_json:
        print_json({"ok": not broken, "plan": {name: [vars(item) for item in items] for name, items in found.items()}})
        return DataError.exit_code if broken else 0
    for name, items in found.items():
        counts = Counter(item.state for item in items)
        to_do = ", ".join(f"{item.stage} {item.subject}".strip() for item in items if item.state == "to do")
        up_to_date = f"{counts['unchanged']} up to date"
        say(f"{name}: {f'to do: {to_do}; ' if to_do else ''}{up_to_date}")
        for item in items:
            if item.state == "broken":
                say(f"{name}: {item.subject or item.stage}: {item.sentence}")
    say_next("rfea batch", *folders, why="does it")
    return DataError.exit_code if broken else 0


def _print_batch(results: list[BatchResult]) -> None:
    rows = []
    for result in results:
        last = result.rungs[-1] if result.rungs else {}
        rows.append([result.folder, result.status, last.get("model"), last.get("said"), _held_out(last)])
    print_table("", ["campaign", "status", "last model", "verdict", "validate"], rows, left=4)
    for result in results:
        for rung in result.rungs:
            if rung.get("tied"):
                say(f"{result.folder}: {rung['added']} cannot be told from {' or '.join(rung['tied'])} by its data")
        for name, sentence in result.errors.items():
            say(f"{result.folder}: {name}: {sentence}")
        if result.report:
            click.echo(f"report: {result.report}")


def _held_out(rung: Mapping[str, Any]) -> str | None:
    """The held-out error of a campaign's last rung with its unit: campaigns of films and of inclinometers stand in one table."""
    for unit in ("mm", "deg"):
        if rung.get(f"validate_{unit}") is not None:
            return f"{rounded(rung[f'validate_{unit}'])} {unit}"
    return None


@click.command("table")
@click.argument("folders", nargs=-1, required=True, metavar="FOLDER...", type=PATH)
@click.option(
    "--format", "kind", type=click.Choice(["parquet", "csv"]), help="Of the file; default as its name ends, or parquet."
)
@click.option("-o", "--output", type=PATH, help="File to write; default rfea-table.parquet or .csv.")
@output_options
def table_command(folders: tuple[Path, ...], kind: str | None, output: Path | None, as_json: bool) -> int:
    """Results of many campaigns as one table.

    One row per campaign and model: parameters with their intervals, verdicts, errors in mm and deg, and versions. The
    folders are campaigns, or folders of results ('rfea/').
    """
    from rfea_vision.stages.table import campaign_rows, write_table

    rows: list[dict[str, Any]] = []
    empty: dict[str, str] = {}
    for folder in folders:
        try:
            rows += campaign_rows(folder)
        except InputError as error:
            empty[str(folder)] = str(error)
    if not rows:
        raise InputError(f"{next(iter(empty.values()), 'no campaign')}; nothing to write")
    kind = kind or ("csv" if output is not None and output.suffix.lower() == ".csv" else "parquet")
    path = output or Path(f"rfea-table.{kind}")
    columns = write_table(path, rows, kind)
    if as_json:
        print_json({"file": str(path), "rows": len(rows), "columns": columns, "without_results": empty})
    else:
        for sentence in empty.values():
            click.echo(f"left out: {sentence}", err=True)
        click.echo(f"{path}: {counted(len(rows), 'row')}, {counted(len(columns), 'column')}")
        shown = [folder for folder in folders if str(folder) not in empty]
        say_next("rfea report --group", *shown, why="the same tubes on one page")
    return DataError.exit_code if empty else 0
