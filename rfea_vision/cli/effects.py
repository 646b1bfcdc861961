"""The catalogue of effects: list, show, new."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rfea_vision.cli.console import WholeHelpGroup, print_json, print_table, say, say_next
from rfea_vision.cli.options import PATH, ask, effects_like, output_options
from rfea_vision.data import template
from rfea_vision.errors import InputError
from rfea_vision.options import CritiqueOptions

if TYPE_CHECKING:
    from rfea_vision.effects.base import Effect


@click.group("effects", cls=WholeHelpGroup, invoke_without_command=True)
@ask("effects", options=CritiqueOptions)
@output_options
@click.pass_context
def effects_command(context: click.Context, options: CritiqueOptions, as_json: bool) -> None:
    """The catalogue of effects.

    'show ID' tells of one, 'new FILE' writes a template of one's own.
    """
    if context.invoked_subcommand is not None:
        return
    effects = _known(options.effect_files)
    if as_json:
        print_json([_facts(effect) for effect in effects.values()])
        return
    rows = [[effect.id, effect.kind, effect.title, ", ".join(effect.parameters)] for effect in effects.values()]
    print_table("", ["effect", "kind", "what", "parameters"], rows, left=4)
    say_next("rfea effects show ID", why="one of them, with its law")


@effects_command.command("show")
@click.argument("effect_id", metavar="ID", shell_complete=effects_like)
@ask("effects", options=CritiqueOptions)
@output_options
def show_command(effect_id: str, options: CritiqueOptions, as_json: bool) -> None:
    """One effect: its law, its parameters, what it is mistaken for and what tells them apart."""
    effects = _known(options.effect_files)
    if effect_id not in effects:
        from rfea_vision.effects.catalogue import meant

        if effect_id.endswith(".py"):
            raise InputError(f"effects: '{effect_id}' is a file; write 'rfea effects show ID --effect-file {effect_id}'")
        raise InputError(f"effects: '{effect_id}' is unknown; {meant(effect_id, effects)}")
    facts = {**_facts(effects[effect_id]), "latex": _typeset(effects[effect_id])}
    if as_json:
        print_json(facts)
        return
    say(f"{facts['id']}: {facts['title']}")
    for line in [*facts["law"].splitlines(), ""]:
        say(line)
    for key in ("shows", "mistaken_for", "imitated_by", "split_by", "reference"):
        if facts[key]:
            say(f"{key.replace('_', ' ')}: {facts[key]}")
    columns = ("unit", "absent", "lower", "upper", "text")
    rows = [[name, *(_cell(item[key]) for key in columns)] for name, item in facts["parameters"].items()]
    print_table("", ["parameter", "unit", "absent at", "from", "to", "what"], rows, left=6)
    say_next(f"rfea fit CAMPAIGN --add {effect_id}")


def _cell(value: object) -> str:
    return "-" if value is None else f"{value:g}" if isinstance(value, float | int) else str(value)


@effects_command.command("new")
@click.argument("file", type=PATH)
@output_options
def new_command(file: Path, as_json: bool) -> None:
    """A template of one's own effect, to edit and to pass on with --effect-file."""
    from rfea_vision.files import write_text

    if file.exists():
        raise InputError(f"{file}: is there already and is left as it is; choose another name")
    if file.suffix != ".py":
        raise InputError(f"{file}: an effect is a Python file; call it {file.with_suffix('.py')}")
    text = template("effect.py.txt")
    name = "".join(part.capitalize() for part in file.stem.replace("-", "_").split("_"))
    if file.stem.replace("-", "_").isidentifier():
        text = text.replace("MyEffect", name).replace('"my_effect"', f'"{file.stem.replace("-", "_")}"')
    write_text(file, text)
    if as_json:
        print_json({"file": str(file)})
    else:
        click.echo(f"{file}: written; edit the law in it")
        say_next("rfea diagnose CAMPAIGN --effect-file", file)


def _typeset(effect: type[Effect]) -> str:
    from rfea_vision.effects.typeset import typeset

    return typeset(effect())["latex"]


def _known(effect_files: tuple[Path, ...]) -> dict[str, type[Effect]]:
    from rfea_vision.effects.catalogue import catalogue, load_effect_file

    own = {effect.id: effect for file in effect_files for effect in load_effect_file(file)}
    return {**catalogue(), **own}


def _facts(effect: type[Effect]) -> dict[str, object]:
    parameters = {
        name: {"unit": item.unit, "absent": item.absent, "lower": item.lower, "upper": item.upper, "text": item.text}
        for name, item in effect.parameters.items()
    }
    return {
        "id": effect.id,
        "title": effect.title,
        "kind": effect.kind,
        "law": " ".join((effect.__doc__ or "").split()),
        "shows": effect.shows,
        "mistaken_for": effect.mistaken_for,
        "imitated_by": effect.imitated_by,
        "split_by": effect.split_by,
        "reference": effect.reference,
        "parameters": parameters,
    }
