"""The command that opens the workbench."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
import threading
import webbrowser
from pathlib import Path

import click

from rfea_vision.cli.console import print_json
from rfea_vision.cli.options import PATH, output_options
from rfea_vision.errors import InputError


@click.command("open")
@click.argument("folder", metavar="CAMPAIGN|FOLDER", type=PATH)
@click.option("--out", type=PATH, help="Where results go; default CAMPAIGN/rfea.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port on this machine; default a free one.")
@click.option("--no-browser", is_flag=True, help="Print the address and leave opening it to you.")
@output_options
def open_command(folder: Path, out: Path | None, port: int, no_browser: bool, as_json: bool) -> None:
    """The workbench: a local page.

    To set a campaign up by pointing, play its model, add an effect and watch the error fall. It works on the same folder
    as the commands, and shows them. Only this machine reaches it. Ctrl-C ends it.
    """
    if not all(importlib.util.find_spec(name) for name in ("starlette", "uvicorn")):
        raise InputError("rfea open: the extra 'workbench' is not installed; pip install 'rfea-vision[workbench]'")
    from rfea_vision.workbench.serve import serve

    def ready(address: str) -> None:
        if as_json:
            print_json({"address": address})
        else:
            click.echo(address)
        click.echo("The address carries a secret: give it to nobody. Ctrl-C ends the workbench.", err=True)
        if not no_browser:
            webbrowser.open(address)

    try:
        with contextlib.suppress(KeyboardInterrupt):  # the way to end it
            serve(folder, out=out, port=port, ready=ready)
    except OSError as error:
        raise InputError(f"--port {port}: cannot be used ({error.strerror}); choose another") from error
    _leave()


def _leave() -> None:
    """End at once though a thread still compiles a law or reads a campaign: what it would write is written whole or not at all."""
    if any(not thread.daemon and thread is not threading.main_thread() for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
