"""A law of one's own while it is typed: what is wrong with it, or what it declares.

It is Python that this machine's user has typed or opened, and runs with this user's rights; a campaign cannot name one.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

from rfea_vision.effects.catalogue import load_effect_file
from rfea_vision.errors import InputError


def check(file: Path) -> dict[str, Any]:
    """What the file declares: every effect with its parameters and its law.

    Raises
    ------
    InputError
        What is wrong, in a sentence: syntax, units, a missing absent value, a law without derivative.
    """
    try:
        ast.parse(file.read_text(encoding="utf-8"))
    except SyntaxError as error:
        raise InputError(f"line {error.lineno}: {error.msg}") from error
    from rfea_vision.effects.typeset import typeset

    try:
        effects = load_effect_file(file)
    except InputError as error:
        raise InputError(str(error).removeprefix(f"{file}: ")) from error
    return {
        "effects": [
            {"id": item.id, "title": item.title, "law": typeset(item()), "parameters": _parameters(item)}
            for item in effects
        ]
    }


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
