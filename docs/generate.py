"""Write docs/commands.md from the commands' own help: `make docs`.

`tests/test_docs.py` fails when what is committed differs from what this writes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import click

from rfea_vision.cli.root import rfea

HERE = Path(__file__).resolve().parent
WIDTH = 100


def commands_page() -> str:
    """Return docs/commands.md."""
    parts = [
        "# Commands",
        "",
        "Generated from `--help` by `make docs`. Every command runs the stages that it needs and that are out of date.",
        "Exit codes: 0 done; 1 the data do not allow it (with what to do); 2 wrong usage or a broken input file;",
        "130 interrupted: what was finished is kept, what was begun is not.",
        "",
    ]
    for context in _walk(click.Context(rfea, info_name="rfea", terminal_width=WIDTH, **rfea.context_settings)):
        parts += [f"## {context.command_path}", "", "```", context.command.get_help(context), "```", ""]
    return "\n".join(parts)


def _walk(context: click.Context) -> Iterator[click.Context]:
    """Go through a command and those below it, as contexts, so that settings are inherited."""
    yield context
    if isinstance(context.command, click.Group):
        for name in context.command.list_commands(context):
            child = context.command.get_command(context, name)
            assert child is not None
            yield from _walk(click.Context(child, info_name=name, parent=context, **child.context_settings))


if __name__ == "__main__":
    (HERE / "commands.md").write_text(commands_page(), encoding="utf-8")
    sys.stdout.write(f"{HERE / 'commands.md'}\n")
