"""What is said where: results on stdout, progress on stderr, as a bar where that is a terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from rfea_vision.progress import Listener, Outcome
from rfea_vision.progress import Progress as ProgressCall

_MARKS = {"done": "done", "unchanged": "unchanged", "failed": "failed"}


def print_error(message: str, exit_code: int, *, as_json: bool, quiet: bool = False) -> None:
    """Print one line on stderr, and with --json the same as JSON on stdout."""
    if not quiet:
        click.echo(f"rfea: {message}", err=True)
    if as_json:
        click.echo(json.dumps({"status": "error", "exit_code": exit_code, "error": message}))


def print_json(value: Any) -> None:
    """Print one JSON document on stdout; NaN is not JSON and becomes null."""
    click.echo(json.dumps(_finite(value), indent=1, default=str))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    return value


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], *, left: int = 1) -> None:
    """Print a table on stdout; the first `left` columns are text, the others numbers."""
    table = Table(title=title or None, title_justify="left", header_style="bold", box=None, pad_edge=False)
    for index, name in enumerate(columns):
        table.add_column(name, justify="left" if index < left else "right", overflow="fold")
    for row in rows:
        table.add_row(*(shown(cell) for cell in row))
    width = None if sys.stdout.isatty() else 160
    Console(file=sys.stdout, width=width, highlight=False, markup=False).print(table)


def shown(value: Any) -> str:
    """Return a cell of a table: numbers to three digits after the point, nothing as a dash."""
    if value is None or value == "":
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


class ConsoleListener(Listener):
    """Draws a bar per running stage on a terminal; elsewhere one line when a stage ends."""

    def __init__(self) -> None:
        self.console = Console(stderr=True, highlight=False, markup=False)
        self.bars: Progress | None = None
        self._tasks: dict[str, TaskID] = {}

    @contextmanager
    def shown(self) -> Iterator[ConsoleListener]:
        """Keep the bars up while the block runs."""
        if not self.console.is_terminal:
            yield self
            return
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=self.console, transient=True) as self.bars:
            yield self
        self.bars = None

    def begin(self, stage: str, subject: str) -> ProgressCall:
        """Start a bar."""
        bars = self.bars
        if bars is None:
            return lambda done, total: None
        task = bars.add_task(f"{stage} {subject}", total=None)
        self._tasks[f"{stage}/{subject}"] = task

        def advance(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total or None)

        return advance

    def end(self, stage: str, subject: str, outcome: Outcome, sentence: str) -> None:
        """Take the bar away and say how the stage ended."""
        task = self._tasks.pop(f"{stage}/{subject}", None)
        if self.bars is not None and task is not None:
            self.bars.remove_task(task)
        if outcome != "failed":  # an error is printed once, at the end
            said = f": {sentence}" if sentence else ""
            self.console.print(f"{stage} {subject}: {_MARKS[outcome]}{said}", soft_wrap=True)

    def note(self, sentence: str) -> None:
        """Say something in between."""
        self.console.print(f"  {sentence}", soft_wrap=True)
