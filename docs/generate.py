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
        "130 interrupted, with everything finished so far kept.",
        "",
    ]
    for path, command in _walk("rfea", rfea):
        context = click.Context(command, info_name=path, max_content_width=WIDTH, terminal_width=WIDTH)
        parts += [f"## {path}", "", "```", command.get_help(context), "```", ""]
    return "\n".join(parts)


def _walk(path: str, command: click.Command) -> Iterator[tuple[str, click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=path)
        for name in command.list_commands(context):
            child = command.get_command(context, name)
            assert child is not None
            yield from _walk(f"{path} {name}", child)


if __name__ == "__main__":
    (HERE / "commands.md").write_text(commands_page(), encoding="utf-8")
    sys.stdout.write(f"{HERE / 'commands.md'}\n")
