"""Options that many commands share, and how a command opens its campaign."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click

from rfea_vision.cli.console import ConsoleListener
from rfea_vision.units import parse_quantity

_Command = TypeVar("_Command", bound=Callable[..., Any])
_TRUST = "rfea_vision.trust"


class Quantity(click.ParamType):
    """A number with its unit, such as 5min or 1.2s; stored in the unit given."""

    name = "quantity"

    def __init__(self, unit: str, example: str) -> None:
        self.unit, self.example = unit, example

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        if isinstance(value, float):
            return value
        try:
            return parse_quantity(value, self.unit, example=self.example)
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return "QUANTITY"


class Segments(click.ParamType):
    """A number of bodies from 1 to 256, or ``auto``."""

    name = "segments"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        if value == "auto":
            return value
        return click.IntRange(1, 256).convert(value, param, ctx)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return "[INTEGER|auto]"


def output_options(command: _Command) -> _Command:
    """Add --json and --debug, which every command has."""
    command = click.option("--debug", is_flag=True, help="Show the traceback of an error.")(command)
    return click.option(
        "--json", "as_json", is_flag=True, help="Print the result as JSON on stdout and nothing else there."
    )(command)


def trust_option(command: _Command) -> _Command:
    """Add --trust; `trusted` tells whether it was given, so that no command has to hand it on."""
    return click.option(
        "--trust",
        is_flag=True,
        expose_value=False,
        callback=lambda ctx, param, value: ctx.meta.__setitem__(_TRUST, value),
        help="Let the campaign read outside of its folder, and from database servers.",
    )(command)


def trusted() -> bool:
    """Whether the command that runs was given --trust."""
    return bool(click.get_current_context().meta.get(_TRUST))


def campaign_options(command: _Command) -> _Command:
    """Add the argument CAMPAIGN and the options of every command that works on one."""
    command = trust_option(output_options(command))
    command = click.option("--force", is_flag=True, help="Redo the stage even if nothing has changed.")(command)
    command = click.option("--out", type=click.Path(path_type=Path), help="Where results go; default CAMPAIGN/rfea.")(
        command
    )
    return click.argument("campaign", type=click.Path(path_type=Path))(command)


def effect_file_option(command: _Command) -> _Command:
    """Add --effect-file."""
    return click.option(
        "--effect-file",
        "effect_files",
        type=click.Path(path_type=Path),
        multiple=True,
        metavar="FILE.py",
        help="An effect of one's own, as 'rfea effects new' writes it; may be repeated.",
    )(command)


def enough_option(command: _Command) -> _Command:
    """Add --enough: how much of the misfit an effect must explain to be named."""
    return click.option(
        "--enough",
        type=Quantity("1", "97%"),
        metavar="SHARE",
        help="Share of the misfit (squared error above the noise) that must be explained to earn a name; default 97%.",
    )(command)


def model_options(command: _Command) -> _Command:
    """Add the choices of the model that fit and improve share."""
    command = click.option("--seed", type=int, default=0, show_default=True, help="Seed of everything random.")(command)
    command = effect_file_option(command)
    command = click.option(
        "--observe",
        type=click.Choice(["tip_y", "tip", "midline", "angle"]),
        help="What of the recordings is fitted; default the richest that all of them offer.",
    )(command)
    command = click.option(
        "--joints",
        type=click.Choice(["middle", "start"]),
        default="middle",
        show_default=True,
        help="Joints in the middle of their arc, or at the start of the body as in the paper.",
    )(command)
    return click.option(
        "--segments",
        type=Segments(),
        default=16,
        show_default=True,
        help="Number of bodies; auto: as few as bring the error near the noise floor.",
    )(command)


@contextmanager
def opened(campaign: Path, out: Path | None, *, force: tuple[str, ...] = ()) -> Iterator[Any]:
    """Open a campaign with bars on stderr while the block runs."""
    from rfea_vision.campaign import load_campaign
    from rfea_vision.stages import Workspace

    with ConsoleListener().shown() as listener:
        work = Workspace(load_campaign(campaign, out, trust=trusted()), listener=listener, force=force)
        try:
            yield work
        finally:
            work.cache.save_hashes()
