"""How an option is asked for. An option is one annotated field of a closed dataclass; all that people meet follows from it.

`Asked` says which commands, and steps of a recipe by the same name, take the option; the field's description is its help.
In files and on the command line quantities carry their unit; in Python they are plain numbers in SI.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import AliasChoices, BeforeValidator, ConfigDict, JsonValue, TypeAdapter, ValidationError, ValidationInfo
from pydantic.fields import FieldInfo

from rfea_vision.effects.permission import name_files, refuse_unnamed
from rfea_vision.errors import InputError
from rfea_vision.units import parse_quantity

CLOSED = ConfigDict(extra="forbid")
_WRITTEN, _NAMED, _STORED = {"written": True}, {"written": True, "named": True}, {"stored": True}

_Options = TypeVar("_Options")


@dataclass(frozen=True)
class Asked:
    """Who takes an option, and how it is written.

    Attributes
    ----------
    by : commands, and steps of a recipe
    metavar : what stands for its value in the help
    flag : its name on the command line, where that is not the key of the recipe
    write : from a value and the options it belongs to, what people write behind the flag, once for each time it is repeated
    """

    by: tuple[str, ...] = ()
    metavar: str | None = None
    flag: str = ""
    write: Callable[[Any, Any], list[str]] = lambda value, options: (
        [str(item) for item in value] if isinstance(value, tuple) else [str(value)]
    )


@dataclass(frozen=True)
class Option:
    """One field as people ask for it: `key` in a recipe, `flag` on the command line."""

    name: str
    key: str
    asked: Asked
    info: FieldInfo

    @property
    def flag(self) -> str:
        """Its name on the command line."""
        return self.asked.flag or f"--{self.key.replace('_', '-')}"

    @property
    def default(self) -> Any:
        """What holds where it is not given."""
        return self.info.get_default(call_default_factory=True)

    @property
    def is_switch(self) -> bool:
        """Whether it is either there or not, without a value."""
        return self.info.annotation is bool


@cache
def options_of(kind: type) -> tuple[Option, ...]:
    """Return every option that a class declares."""
    found = []
    for name, info in kind.__pydantic_fields__.items():  # type: ignore[attr-defined]
        asked = next((item for item in info.metadata if isinstance(item, Asked)), Asked())
        alias = info.validation_alias
        found.append(Option(name, str(alias.choices[0]) if isinstance(alias, AliasChoices) else name, asked, info))
    return tuple(found)


def declares(kind: type, name: str) -> bool:
    """Whether a class has an option of this name, or of this key."""
    return any(name in (option.name, option.key) for option in options_of(kind))


def asked_by(command: str, *kinds: type) -> Iterator[Option]:
    """Yield the options of these classes that a command takes, those that classes share once."""
    taken = {option.key: option for kind in kinds for option in options_of(kind) if command in option.asked.by}
    yield from taken.values()


def read(kind: type[_Options], written: Mapping[str, object], command: str, *, named: bool = False) -> _Options:
    """Return options from what people wrote, by key; `named` on the command line, and not in a file.

    Raises
    ------
    ValidationError
        If a value is not what the option takes.
    """
    known = {option.key for option in asked_by(command, kind)}
    return _adapter(kind).validate_python(
        {key: written[key] for key in written if key in known}, context=_NAMED if named else _WRITTEN
    )


def read_flags(kind: type[_Options], values: Mapping[str, object], command: str) -> _Options:
    """Return options from a command line; `values` by key.

    Raises
    ------
    InputError
        Naming the flag.
    """
    try:
        return read(kind, values, command, named=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        flag = {option.key: option.flag for option in options_of(kind)}.get(str(first["loc"][0]), "")
        raise InputError(f"{flag} {first.get('input')}: {explain(first, kind)}") from error


def from_keywords(kind: type[_Options], keywords: Mapping[str, Any]) -> _Options:
    """Return options from keywords in Python.

    Raises
    ------
    InputError
        If a keyword is no option, or its value is not what the option takes.
    """
    try:
        return kind(**keywords)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"{first['loc'][0]}: {explain(first, kind)}") from error


def explain(found: Any, *kinds: type) -> str:
    """Say one finding of pydantic about an option of these classes in plain words."""
    cause = found.get("ctx", {}).get("error")
    if found["type"] in ("int_parsing", "int_from_float", "int_type"):
        asked = (option.asked.metavar for kind in kinds for option in options_of(kind) if option.key == str(found["loc"][0]))
        words = (next(asked, None) or "").strip("[]").split("|")[1:]  # of [INTEGER|auto] the words beside the number
        return "is no whole number" + "".join(f", nor {word}" for word in words)
    if found["type"] in ("greater_than_equal", "less_than_equal"):
        limit = found["ctx"].get("ge", found["ctx"].get("le"))
        return f"must be {limit:g} or {'more' if found['type'] == 'greater_than_equal' else 'less'}"
    return str(cause) if found["type"] == "value_error" else found["msg"][0].lower() + found["msg"][1:]


def as_record(options: object) -> dict[str, JsonValue]:
    """Return the options that differ from their defaults as JSON values, from which `from_record` makes them again.

    What is not asked for leaves no trace, so that a result stays fresh when an option is added to the tool.
    """
    return _adapter(type(options)).dump_python(options, mode="json", exclude_defaults=True)


def from_record(kind: type[_Options], record: object) -> _Options | None:
    """Return the options of a record; None where it does not hold such options (another version wrote it)."""
    try:
        return _adapter(kind).validate_python(record, context=_STORED)
    except ValidationError:
        return None


def written(command: str, *options: object) -> str:
    """Return the options that differ from their defaults as one writes them on the command line."""
    parts: list[str] = []
    owners = {option.key: item for item in options for option in asked_by(command, type(item))}
    for option in asked_by(command, *(type(item) for item in options)):
        owner = owners[option.key]
        if option.is_switch:
            parts += [option.flag] if getattr(owner, option.name) else []
        elif (texts := _texts(option, owner)) != _texts(option, type(owner)()):
            parts += [f"{option.flag} {shlex.quote(text)}" for text in texts]
    return " ".join(parts)


def _texts(option: Option, owner: object) -> list[str]:
    value = getattr(owner, option.name)
    return [] if value is None else option.asked.write(value, owner)


def quantity(unit: str, example: str) -> BeforeValidator:
    """Take text such as ``5min`` for a number in `unit`; numbers are in it already, but not where people wrote them."""

    def parse(value: object, info: ValidationInfo) -> object:
        bare = isinstance(value, int | float) and not (info.context or {}).get("written")
        return value if value is None or bare else parse_quantity(value, unit, example=example)

    return BeforeValidator(parse, json_schema_input_type=str)


def written_by_people(info: ValidationInfo) -> bool:
    """Whether a value comes from a file or a command line, and not from Python."""
    return bool((info.context or {}).get("written"))


def effect_file_paths(flag: str, remedy: str) -> BeforeValidator:
    """Take paths for absolute ones; each must be there, and be named by a person: a recipe or a record cannot; else InputError."""

    def resolve(value: object, info: ValidationInfo) -> object:
        if not isinstance(value, list | tuple):
            return value
        files = tuple(Path(str(item)).expanduser().resolve() for item in value)
        context = info.context or {"named": True}
        if context.get("named"):
            name_files(files)
        for file in files:
            if not file.is_file():
                raise InputError(f"{flag} {file}: not found; {remedy.format(name=file.name)}")
            refuse_unnamed(file)
        return files

    return BeforeValidator(resolve)


@cache
def _adapter(kind: type[_Options]) -> TypeAdapter[_Options]:
    return TypeAdapter(kind)


def json_schema(command: str, *kinds: type) -> dict[str, Any]:
    """Return the JSON Schema of a step of a recipe with these options."""
    properties: dict[str, Any] = {}
    for kind in kinds:
        known = _adapter(kind).json_schema()["properties"]
        properties |= {option.key: known[option.key] for option in asked_by(command, kind)}
    return {"type": ["object", "null"], "properties": properties, "additionalProperties": False}
