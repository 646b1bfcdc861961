"""The root command, what it does with errors, and its exit codes."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import FrameType

import click

from rfea_vision import __version__
from rfea_vision.cli.console import WholeHelpGroup, print_error
from rfea_vision.errors import RfeaError
from rfea_vision.files import storage_error

INTERRUPTED = 130  # 128 + SIGINT, as shells count
_KEPT = "interrupted; what was finished is kept, what was begun is not"
_interrupted: list[int] = []  # signals that have come

_COMMANDS = {
    "setup": ("init", "check", "schema", "doctor", "board"),
    "measure": ("calibrate", "track", "sync"),
    "fit": ("fit",),
    "model": ("compare", "diagnose", "improve"),
    "power": ("power",),
    "propose": ("propose",),
    "effects": ("effects",),
    "chain": ("report", "run"),
    "batch": ("batch", "table"),
    "workbench": ("open",),
    "figures": ("figures", "reproduce"),
    "export": ("export",),
    "twin": ("simulate", "demo"),
}
_HOME_OF = {command: module for module, commands in _COMMANDS.items() for command in commands}
COMMANDS = tuple(_HOME_OF)
#: Modules that the package itself does not bring, and the extra that does.
_EXTRAS = {
    "distributed": "batch", "dask": "batch", "sqlalchemy": "database", "mujoco": "twin", "matplotlib": "figures", "pynwb": "nwb",
    "ndx_pose": "nwb",
}  # fmt: skip


class _LazyGroup(WholeHelpGroup):
    """Loads the file of a command when it is asked for, so that ``rfea --help`` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_HOME_OF)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _HOME_OF:
            return None
        module = import_module(f"rfea_vision.cli.{_HOME_OF[cmd_name]}")
        return getattr(module, f"{cmd_name}_command")

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            import difflib

            close = difflib.get_close_matches(args[0], list(_HOME_OF), n=1)
            hint = f" Did you mean '{close[0]}'?" if close else ""
            raise click.UsageError(f"There is no command '{args[0]}'.{hint}", ctx) from error


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="rfea")
def rfea() -> None:
    """See how a soft hydraulic actuator really moves, fit the RSDA model, and learn which effect the model lacks.

    A campaign is a folder with a campaign.yaml and one folder per experiment; 'rfea init DIR' writes one to fill in.
    Every command runs the stages that it needs and that are out of date. 'rfea improve CAMPAIGN' does it all.
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit code.

    0 done; 1 the data do not allow it; 2 wrong usage or a broken input file; 130 interrupted.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):  # a terminal that cannot show a letter of a name shows its number
        with contextlib.suppress(AttributeError):
            stream.reconfigure(errors="backslashreplace")  # pyright: ignore[reportAttributeAccessIssue]
    with contextlib.suppress(ValueError):  # only the main thread may set it
        signal.signal(signal.SIGTERM, _interrupt)
        # a shell may have had the first ignored, and nohup the second: Windows knows no terminal that hangs up
        for number in {signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)}:
            if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
                signal.signal(number, _interrupt)
    sys.exit(run(arguments))


def run(arguments: list[str]) -> int:
    """Run the command line and return its exit code."""
    as_json, debug = "--json" in arguments, "--debug" in arguments

    def failed(message: str, exit_code: int, *, traced: bool = True) -> int:
        if debug and traced:
            traceback.print_exc()
        print_error(message, exit_code, as_json=as_json)
        return exit_code

    try:
        result = rfea.main(arguments, prog_name="rfea", standalone_mode=False)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except RfeaError as error:
        return failed(str(error), error.exit_code)
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get((error.name or "").split(".")[0])
        remedy = f"'rfea-vision[{extra}]'" if extra else str(error.name)
        return failed(f"this needs the module '{error.name}'; pip install {remedy}", 2)
    except click.ClickException as error:
        error = _with_advice(error, arguments)
        error.show()
        if as_json:
            print_error(error.format_message(), error.exit_code, as_json=True, quiet=True)
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        return failed(_KEPT, INTERRUPTED, traced=False)
    except BrokenPipeError:
        # the reader of our output has gone, as in 'rfea effects | head'
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if _interrupted:
            return failed(_KEPT, INTERRUPTED, traced=False)
        if (stored := storage_error(error, _elsewhere(arguments)) if isinstance(error, OSError) else None) is not None:
            return failed(str(stored), stored.exit_code)
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return failed(f"a fault in rfea-vision ({reason[:300]}); the same command with --debug shows where", 1)


def _elsewhere(arguments: list[str]) -> str:
    """How the command of this line is told to write to another place: by its options, or else by the place that it was given."""
    command = next((rfea.get_command(click.Context(rfea), name) for name in arguments if name in COMMANDS), rfea)
    taken = {name for item in (command.params if command else ()) for name in item.opts}
    ways = [f"{name} {kind}" for name, kind in (("--out", "DIR"), ("--output", "FILE")) if name in taken]
    return f"keep the results elsewhere with {' or '.join(ways)}" if ways else "choose another folder"


def _with_advice(error: click.ClickException, arguments: list[str]) -> click.ClickException:
    """A wrong use of the command line with what was probably meant."""
    if "unexpected extra argument" in error.message:
        advice = ""
        if any(item.startswith("--") for item in arguments):
            advice = "An option takes one value: repeat it for more, as in --add maxwell --add coulomb."
        elif sum(Path(item).is_dir() for item in arguments) > 1:
            advice = "One campaign at a time; 'rfea batch' runs many, 'rfea report --group' and '--compare' show them together."
        return click.UsageError(f"{error.message}. {advice}", getattr(error, "ctx", None)) if advice else error
    return _with_its_place(error, error.ctx) if isinstance(error, click.NoSuchOption) and error.ctx is not None else error


def _with_its_place(error: click.NoSuchOption, context: click.Context) -> click.UsageError:
    """Where a wrong option belongs: it is an argument of this command, or an option of others."""
    arguments = [part.human_readable_name for part in context.command.params if isinstance(part, click.Argument)]
    name = error.option_name.lstrip("-").upper()
    if name in (argument.strip("[].") for argument in arguments):
        place = f"Give {name} by its place, without a name: {context.command_path} {' '.join(arguments)}"
        return click.UsageError(f"{error.message} {place}", context)
    commands = [(name, rfea.get_command(context, name)) for name in COMMANDS]
    homes = [
        name
        for name, command in commands
        if command and error.option_name in (o for p in command.params for o in p.opts)
    ]
    if error.possibilities or not 0 < len(homes) < 4:  # what many commands have, none of them is looked for by
        return error
    others = " and ".join(f"'rfea {name}'" for name in homes)
    return click.UsageError(f"{error.message} It is an option of {others}.", context)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Let a polite kill end like Ctrl-C: unfinished files are removed on the way out.

    What calls back from C, as the compiler does, swallows the interrupt and fails in another way: that is no fault of ours.
    """
    _interrupted.append(number)
    raise KeyboardInterrupt
