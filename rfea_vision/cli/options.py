"""Options that many commands share, and how a command opens its campaign."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, get_args, get_origin

import click
from click.core import ParameterSource

from rfea_vision.cli.console import AGAIN, LAWS, ConsoleListener
from rfea_vision.options.asking import Option, asked_by, read_flags
from rfea_vision.units import parse_quantity

if TYPE_CHECKING:
    from rfea_vision.stages import Workspace

Command = TypeVar("Command", bound=Callable[..., Any])
PATH = click.Path(path_type=Path)
_TRUST = "rfea_vision.trust"


class Quantity(click.ParamType):
    """A number with its unit, such as 5min or 1.2s; stored in the unit given."""

    name = "quantity"

    def __init__(self, unit: str, example: str) -> None:
        self.unit, self.example = unit, example

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number in the unit of the option; click's BadParameter where a text is no such quantity."""
        if isinstance(value, float):
            return value
        try:
            return parse_quantity(value, self.unit, example=self.example)
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return what stands for the value in the help."""
        return "QUANTITY"


def output_options(command: Command) -> Command:
    """Add --json and --debug, which every command has."""
    # whoever runs the command looks for it among the arguments
    debug = click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
    return click.option(
        "--json", "as_json", is_flag=True, help="Print the result as JSON on stdout and nothing else there."
    )(debug(command))


def trust_option(command: Command) -> Command:
    """Add --trust and --untrusted; `trusted` tells whether the first was given, so that no command has to hand it on."""

    def apart(ctx: click.Context, param: click.Parameter, value: bool) -> None:
        from rfea_vision.readers.apart import isolating

        ctx.with_resource(isolating(value))

    command = click.option(
        "--untrusted",
        is_flag=True,
        expose_value=False,
        callback=apart,
        help="Read films, tables and results in a process of its own, with bounded memory and time.",
    )(command)
    return click.option(
        "--trust",
        is_flag=True,
        expose_value=False,
        callback=lambda ctx, param, value: ctx.meta.__setitem__(_TRUST, value),
        help="Let the campaign read outside of its folder, and from database servers.",
    )(command)


def code_option(command: Command) -> Command:
    """Add --effect-file to a command that may have to fit again what was fitted with effects of one's own."""

    def name(ctx: click.Context, param: click.Parameter, value: tuple[Path, ...]) -> None:
        from rfea_vision.effects.permission import name_files

        name_files(value)
        ctx.meta[LAWS] = value

    return click.option(
        LAWS,
        type=PATH,
        multiple=True,
        expose_value=False,
        callback=name,
        metavar="FILE.py",
        help="An effect file that models here were fitted with: its code runs only if it is named.",
    )(command)


def typed() -> dict[str, str]:
    """The options that stand on the command line which runs: parameter -> flag."""
    context = click.get_current_context()
    return {
        option.name: max(option.opts, key=len)
        for option in context.command.params
        if isinstance(option, click.Option) and option.name is not None
        and context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE
    }  # fmt: skip


def refuse_beside(flag: str, odd: Iterable[str], why: str) -> None:
    """Raise where one of the parameters `odd` was typed, which has no effect beside `flag`."""
    given = typed()
    for name in odd:
        if name in given:
            raise click.UsageError(f"{given[name]} has no effect with {flag}: {why}; leave it out.")


def named_files() -> tuple[Path, ...]:
    """The effect files that the command which runs was given through `code_option`."""
    return tuple(click.get_current_context().meta.get(LAWS) or ())


def trusted() -> bool:
    """Whether the command that runs was given --trust."""
    return bool(click.get_current_context().meta.get(_TRUST))


def campaign_options(command: Command) -> Command:
    """Add the argument CAMPAIGN and the options of every command whose result is that of its stages."""
    again = click.option(
        "--again",
        is_flag=True,
        expose_value=False,
        callback=lambda ctx, param, value: ctx.meta.__setitem__(AGAIN, value),
        help="Print the result again though nothing has changed.",
    )
    return stage_options(again(command))


def stage_options(command: Command) -> Command:
    """Add the argument CAMPAIGN and the options of every command that runs stages on one."""
    force = click.option("--force", is_flag=True, help="Redo the stage even if nothing has changed.")
    return campaign_argument(force(command))


def campaign_argument(command: Command) -> Command:
    """Add the argument CAMPAIGN and the options of every command that works on one."""
    command = trust_option(output_options(command))
    command = click.option("--out", type=PATH, help="Where results go; default CAMPAIGN/rfea.")(command)
    return click.argument("campaign", type=PATH)(command)


def effects_like(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Return the effects that begin so, for a shell that completes."""
    from rfea_vision.effects.catalogue import catalogue

    return [effect for effect in sorted(catalogue()) if effect.startswith(incomplete)]


def models_like(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Return the models of the campaign on the line that begin so, for a shell that completes."""
    campaign, out = ctx.params.get("campaign"), ctx.params.get("out")
    place = out or (None if campaign is None else Path(campaign) / "rfea")
    there = [] if place is None else Path(place).glob("models/*/model.json")
    return [name for name in sorted(file.parent.name for file in there) if name.startswith(incomplete)]


def ask(name: str, **kinds: type) -> Callable[[Callable[..., object]], Callable[..., object]]:
    """Add every option of these classes that the command `name` takes, and pass one object of each on under its keyword."""

    def decorate(command: Callable[..., object]) -> Callable[..., object]:
        asked = tuple(asked_by(name, *kinds.values()))

        @functools.wraps(command)
        def called(*args: object, **params: object) -> object:
            values = {option.key: params.pop(option.name) for option in asked}
            given = {key: value for key, value in values.items() if value not in (None, ())}
            options = {key: read_flags(kind, given, name) for key, kind in kinds.items()}
            return command(*args, **params, **options)

        for option in reversed(asked):
            called = _click_option(option)(called)
        return called

    return decorate


def _click_option(option: Option) -> Callable[[Command], Command]:
    """One option of the command line; what is written is read by the class that declares it."""
    default, metavar = option.default, option.asked.metavar
    choices = next((get_args(item) for item in _members(option.info.annotation) if get_origin(item) is Literal), ())
    plain = default if isinstance(default, str | int) and default != "" else None
    if option.is_switch:
        return click.option(option.flag, option.name, is_flag=True, help=option.info.description)
    return click.option(
        option.flag,
        option.name,
        type=click.Choice(choices) if choices else int if option.info.annotation is int and metavar is None else str,
        multiple=not isinstance(default, str | int | float | None),
        default=plain,
        show_default=plain is not None,
        metavar=metavar,
        help=option.info.description,
        shell_complete=effects_like if metavar == "EFFECT" else None,
    )


def _members(annotation: object) -> tuple[object, ...]:
    """The members of a union, or the annotation itself."""
    return get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)


@contextmanager
def opened(
    campaign: Path, out: Path | None, *stages: str, force: bool = False, only: Sequence[str] = ()
) -> Iterator[Workspace]:
    """Open a campaign with bars on stderr while the block runs; with `force` these stages are redone; `only` as in `load_campaign`."""
    from rfea_vision.campaign import load_campaign
    from rfea_vision.stages import Workspace
    from rfea_vision.stages.locks import locked

    context = click.get_current_context(silent=True)
    told = context is not None and context.meta.get(AGAIN) is False and not context.params.get("as_json")
    with ConsoleListener(told=told).shown() as listener:
        work = Workspace(
            load_campaign(campaign, out, trust=trusted(), only=only), listener=listener, force=stages if force else ()
        )
        with locked(work.cache.lock, say=listener.note):
            try:
                yield work
            finally:
                with contextlib.suppress(OSError):  # remembered hashes save time and nothing else
                    work.cache.save_hashes()
