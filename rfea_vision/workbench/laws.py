"""A law of one's own while it is typed: what is wrong with it, or what it declares.

It is Python that this machine's user has typed or opened, and runs with this user's rights; a campaign cannot name one.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import platformdirs

from rfea_vision.data import template
from rfea_vision.effects.base import Effect
from rfea_vision.effects.catalogue import load_effect_file
from rfea_vision.effects.permission import name_files
from rfea_vision.errors import InputError


def check(file: Path) -> dict[str, object]:
    """What the file declares: every effect with its parameters and its law.

    Raises
    ------
    InputError
        What is wrong, in a sentence: syntax, units, a missing absent value, a law without derivative.
    """
    try:
        ast.parse(file.read_text(encoding="utf-8"))
    except SyntaxError as error:
        line = f"line {error.lineno}: " if error.lineno else ""  # of a null character there is none
        raise InputError(f"{line}{error.msg}") from error
    except (ValueError, RecursionError, MemoryError) as error:  # a character that no text has, brackets without end
        reason = str(error) or "it is nested too deep"
        raise InputError(f"cannot be read as Python: {reason}; write the law anew") from error
    name_files([file])  # the user has typed it, or opened it by name
    try:
        effects = load_effect_file(file)
    except InputError as error:
        raise InputError(str(error).removeprefix(f"{file}: ")) from error
    return {
        "effects": [
            {"id": item.id, "title": item.title, "law": _law(item()), "parameters": _parameters(item)}
            for item in effects
        ]
    }


def _law(effect: Effect) -> dict[str, str]:
    """The law in words and as MathML."""
    from rfea_vision.effects.typeset import typeset
    from rfea_vision.report.formatting import law

    said = typeset(effect)
    return {"text": said.get("text", ""), "mathml": str(law(said.get("latex", "")))}


def _parameters(effect: Any) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "unit": spec.unit,
            "absent": spec.absent,
            "lower": spec.lower,
            "upper": spec.upper,
            "text": spec.text,
        }
        for name, spec in effect.parameters.items()
    ]


@lru_cache(maxsize=64)
def _ids(file: Path, changed: int) -> frozenset[str]:
    return frozenset(effect.id for effect in load_effect_file(file))


def ids_of(file: Path) -> frozenset[str]:
    """Ids of the effects that a checked file declares; read once as long as it does not change."""
    return _ids(file, file.stat().st_mtime_ns)


def new_law() -> tuple[Path, str]:
    """A file that is not there yet, in the user's own folder, and the template's text for it."""
    file = own_file("my_effect")
    return file, template("effect.py.txt").replace('"my_effect"', f'"{file.stem}"')


def own_file(stem: str) -> Path:
    """A file of this name and a number that is not there yet, in the user's own folder."""
    folder = platformdirs.user_data_path("rfea") / "effects"
    return next(file for n in range(1, 10_000) if not (file := folder / f"{stem}_{n}.py").exists())


def named_file(text: str, campaigns: Sequence[Path]) -> Path:
    """The file that the user names.

    Raises
    ------
    InputError
        If it is no Python file, or lies in a campaign: what came with data is never run.
    """
    file = Path(text).expanduser()
    if file.suffix != ".py" or not file.is_absolute():
        raise InputError(f"{text}: give the whole path of a .py file")
    file = file.resolve()
    if any(file.is_relative_to(folder) for folder in campaigns):
        raise InputError(f"{file}: lies in a campaign; a law is never run from there: read it, and copy it elsewhere")
    return file


def refuse_taken(file: Path) -> None:
    """Raise where there is a file already.

    Raises
    ------
    InputError
        If there is one.
    """
    if file.exists():
        raise InputError(f"{file}: is there already: open it, or give the name of a new file")


def opened(file: Path) -> str:
    """The text of a law.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read ({error})") from error
