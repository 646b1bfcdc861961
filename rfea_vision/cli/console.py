"""What is said where: results on stdout, progress on stderr, as a bar where that is a terminal."""

from __future__ import annotations

import json
import shlex
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

import click
from click.core import ParameterSource
from rich.console import Console, ConsoleDimensions
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from rfea_vision.progress import Listener, Outcome
from rfea_vision.progress import Progress as ProgressCall
from rfea_vision.units import counted, finite, rounded

if TYPE_CHECKING:
    from pathlib import Path

    from rfea_vision.stages.runner import Runner

_WIDE = 160  # columns of a table that goes to a file or another program
_CARRIED = ("out", "trust", "untrusted")  # parameters that say where to look, and at what
_OF_A_LOOK = ("dry_run", "as_json", "debug")  # those that the same command, typed again to do the work, leaves out
LAWS = "--effect-file"  # without it what was fitted with laws of one's own is refused; the key of files that a command only names
AGAIN = "rfea_vision.again"  # whether a result is to be printed again though nothing changed; the key is there where one may ask
_SINCE = "rfea_vision.since"  # what the last line of a command that had nothing to do begins with
_MOST_NAMED = 6  # unchanged stages that are listed by name


class WholeHelpGroup(click.Group):
    """Commands whose help says in full what each is for: click cuts it off at the width of a narrow terminal."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one line, or as many as it takes, of each command."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, item.get_short_help_str(limit=200)) for name, item in commands if item])


def print_error(message: str, exit_code: int, *, as_json: bool, quiet: bool = False) -> None:
    """Print one sentence on stderr, and with --json the same as JSON on stdout."""
    if not quiet:
        click.echo(_between_words(f"rfea: {message}", sys.stderr), err=True)
    if as_json:
        click.echo(json.dumps({"status": "error", "exit_code": exit_code, "error": message}))


def print_json(value: object) -> None:
    """Print one JSON document on stdout; NaN is not JSON and becomes null."""
    click.echo(json.dumps(finite(value), indent=1, default=str))


def say(text: str, *, indent: str = "") -> None:
    """Print a sentence on stdout; on a terminal it is broken between words, elsewhere it stays one line."""
    click.echo(_between_words(text, sys.stdout, indent))


def _between_words(text: str, stream: TextIO, indent: str = "") -> str:
    if not stream.isatty():
        return indent + text
    return textwrap.fill(
        text,
        shutil.get_terminal_size().columns,
        initial_indent=indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def drawn_previews(out: Path) -> list[Path]:
    """The previews among the results that show the tracks as they are now."""
    drawn = [(path, path.with_name("track.nc")) for path in sorted(out.glob("*/preview.mp4"))]
    return [path for path, track in drawn if track.is_file() and path.stat().st_mtime >= track.stat().st_mtime]


def say_next(command: str, *words: object, why: str = "") -> None:
    """Print the last line of a command: what to type next, `words` quoted as a shell wants them, and what for.

    What says where the results are, and what may be read, goes along where the next command takes it.
    """
    context = click.get_current_context(silent=True)
    since = context.meta.pop(_SINCE, "") if context else ""
    line = [command, *(shlex.quote(str(word)) for word in words), *_carried(command)]
    say(f"{since}next: {' '.join(line)}" + (f"   ({why})" if why and not since else ""))


def up_to_date(work: Runner) -> bool:
    """Whether a command had nothing to do and printed this result before: `say_next` then says so, in the one line."""
    context, since = click.get_current_context(), work.unchanged_since()
    asked = " ".join([str(context.info_name), *(f"{item['stage']}/{item['subject']}" for item in work.outcomes)])
    if not work.cache.told(asked, since) or since is None or context.meta.get(AGAIN):
        return False
    context.meta[_SINCE] = f"nothing changed since {since:%Y-%m-%d %H:%M}: up to date ('--again' shows it); "
    return True


def _carried(command: str) -> list[str]:
    """Options of the command that runs, as they were typed, without which `command` would look elsewhere or be refused."""
    context = click.get_current_context(silent=True)
    if context is None or not command.startswith("rfea "):
        return []
    typed = [
        option for option in context.command.params
        if isinstance(option, click.Option) and LAWS not in option.opts
        and context.get_parameter_source(str(option.name)) is ParameterSource.COMMANDLINE
    ]  # fmt: skip
    laws = [option for option in context.command.params if LAWS in option.opts]
    files = [file for option in laws for file in context.params.get(str(option.name)) or context.meta.get(LAWS, ())]
    root = context.find_root()
    following = (
        root.command.get_command(root, command.split()[1])
        if (typed or files) and isinstance(root.command, click.Group)
        else None
    )
    options = [option for option in getattr(following, "params", ()) if isinstance(option, click.Option)]
    alike = {(option.name, option.help) for option in options}
    taken = files if any(LAWS in option.opts for option in options) else []
    words = [word for file in taken for word in (LAWS, shlex.quote(str(file)))]
    again = following is context.command  # with nothing but what made this one a look, or print otherwise, left out
    for option in typed:
        if option.name not in _OF_A_LOOK if again else option.name in _CARRIED and (option.name, option.help) in alike:
            words += [option.opts[0], *([] if option.is_flag else [shlex.quote(str(context.params[str(option.name)]))])]
    return words


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], *, left: int = 1) -> None:
    """Print a table on stdout; the first `left` columns are text, the others numbers.

    Where the terminal is too narrow for it, every row becomes a few lines of its own: no word is broken.
    """
    cells = [[shown(cell) for cell in row] for row in rows]
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else _WIDE
    whole = [index == 0 or index >= left for index in range(len(columns))]  # columns that are not broken
    needed = [
        max((len(part) for cell in column for part in ([cell] if kept else cell.split())), default=0)
        for kept, column in zip(whole, zip(*cells, strict=True), strict=False)
    ]
    least = sum(max(len(name), width) for name, width in zip(columns, needed, strict=False)) + 2 * (len(columns) - 1)
    if least > width:
        return _print_lines(title, columns, cells)
    table = Table(title=title or None, title_justify="left", header_style="bold", box=None, pad_edge=False)
    for index, name in enumerate(columns):
        table.add_column(name, justify="left" if index < left else "right", no_wrap=whole[index])
    for row in cells:
        table.add_row(*row)
    return Console(file=sys.stdout, width=width, highlight=False, markup=False).print(table)


def print_columns(
    title: str, columns: Mapping[str, Callable[[Any], object]], items: Sequence[object], *, always: Sequence[str] = (), left: int = 1
) -> None:
    """Print a table of one row per item, the cells as `columns` make them; one without any cell is left out, but for `always`."""
    cells = {name: [cell(item) for item in items] for name, cell in columns.items()}
    kept = {name: column for name, column in cells.items() if name in always or any(cell is not None for cell in column)}
    print_table(title, list(kept), list(zip(*kept.values(), strict=True)), left=left)


def _print_lines(title: str, columns: Sequence[str], cells: Sequence[Sequence[str]]) -> None:
    """Print a table as one paragraph per row."""
    if title:
        say(title)
    for first, *others in cells:
        click.echo(first)
        told = (f"{name} {cell}" for name, cell in zip(columns[1:], others, strict=True) if cell != "-")
        say(", ".join(told), indent="  ")


def shown(value: object) -> str:
    """Return a cell of a table: a number to the digits that count, nothing as a dash."""
    if value is None or value == "":
        return "-"
    return rounded(value) if isinstance(value, float) else str(value)


def _before(number: int) -> str:
    return f"{'is' if number == 1 else 'are'} {counted(number, 'result')}"


class _Count(MofNCompleteColumn):
    """How many of how many, once that is known: until then a turning wheel says enough."""

    def render(self, task: Task) -> Text:
        return Text() if task.total is None else super().render(task)


class ConsoleListener(Listener):
    """Draws a bar per running stage on a terminal; elsewhere one line when a stage ends, and one for all that were unchanged."""

    def __init__(self, *, told: bool = False) -> None:
        """`told`: whether the command itself says that all was unchanged."""
        self.told = told
        self.console = Console(stderr=True, highlight=False, markup=False)
        if self.console.is_dumb_terminal:  # rich takes such a one for 80 columns wide, whatever it is
            self.console.size = ConsoleDimensions(*shutil.get_terminal_size())
        self.bars: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._unchanged: list[str] = []
        self._worked = False

    @contextmanager
    def shown(self) -> Iterator[ConsoleListener]:
        """Keep the bars up while the block runs."""
        if not self.console.is_terminal:
            yield self
        else:
            columns = (
                SpinnerColumn(),
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                _Count(),
                TimeElapsedColumn(),
            )
            with Progress(*columns, console=self.console, transient=True) as self.bars:
                yield self
            self.bars = None
        self._say_unchanged()

    def begin(self, stage: str, subject: str) -> ProgressCall:
        """Start a bar."""
        self._worked = True
        bars = self.bars
        if bars is None:
            return lambda done, total: None
        task = bars.add_task(f"{stage} {subject}", total=None)
        self._tasks[f"{stage}/{subject}"] = task

        def advance(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total or None)

        return advance

    def end(self, stage: str, subject: str, outcome: Outcome, sentence: str) -> None:
        """Take the bar away and say how the stage ended; an error is printed once, at the end of the command."""
        task = self._tasks.pop(f"{stage}/{subject}", None)
        if self.bars is not None and task is not None:
            self.bars.remove_task(task)
        if outcome == "unchanged":
            self._unchanged.append(f"{stage} {subject}")
        elif outcome == "done":
            self._print(f"{stage} {subject}: done" + (f": {sentence}" if sentence else ""))

    def note(self, sentence: str) -> None:
        """Say something in between."""
        self._print(f"  {sentence}")

    def _say_unchanged(self) -> None:
        """One line for everything that was as it should be."""
        if not self._unchanged:
            return
        *before, last = self._unchanged
        if self._worked:
            named = self._unchanged[:_MOST_NAMED]
            more = len(self._unchanged) - len(named)
            self._print(f"{', '.join(named)}{f' and {more} more' if more else ''}: unchanged")
        elif not self.told:
            self._print(f"{last}: unchanged{f', as {_before(len(before))} before it' if before else ''}")
        self._unchanged = []

    def _print(self, text: str) -> None:
        # a terminal's lines are broken between words; what goes to a file stays one line
        self.console.print(text, soft_wrap=not self.console.is_terminal)
