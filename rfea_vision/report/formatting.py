"""Numbers, units and laws as people read them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from latex2mathml.converter import convert
from markupsafe import Markup, escape

from rfea_vision import units
from rfea_vision.artefacts.lenses import LENSES
from rfea_vision.units import rounded

MINUS = "\N{MINUS SIGN}"


def as_added(parameters: Mapping[str, Any], effects: Sequence[str]) -> dict[str, Any]:
    """Rows of the base model, then those of effects in the order in which these were added: a rung only appends to the one before."""
    order = {re.sub(":[^@]*", "", effect): place for place, effect in enumerate(effects, start=1)}
    return dict(sorted(parameters.items(), key=lambda item: order.get(item[0].partition(".")[0], 0)))


def number(value: float | None, digits: int = 3) -> str:
    """`value` as `rounded` has it, with the signs of print; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    mantissa, _, exponent = rounded(value, digits).partition("e")
    return (f"{mantissa}·10{_raised(int(exponent))}" if exponent else mantissa).replace("-", MINUS)


def _raised(power: int) -> str:
    return str(power).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))


def with_unit(value: float | None, unit: str, digits: int = 3) -> str:
    """``0.31 mm``; no unit after a missing number or a pure ratio."""
    text = number(value, digits)
    return text if value is None or not unit_text(unit) else f"{text}\N{NO-BREAK SPACE}{unit_text(unit)}"


def with_error(value: float | None, error: float | None, unit: str, digits: int = 3) -> str:
    """``0.0011 ± 0.0002 N m``: the error to the last place that counts, the unit once."""
    if value is None or not error or not math.isfinite(error):
        return with_unit(value, unit, digits)
    return f"{number(value, digits)} ± {with_unit(error, unit, 2)}"


def to_error(value: float | None, error: float | None) -> str:
    """`value` alone, to the second digit of its standard error, with the signs of print; a dash where there is none."""
    return number(None) if value is None else units.to_error(value, error).replace("-", MINUS)


def inner_title(title: str) -> str:
    """A title inside a sentence, without what follows its colon."""
    head = title.split(":")[0].strip()
    return head if head[:2].isupper() and head[1:2] != " " else head[:1].lower() + head[1:]


def lens_words(model: str | None) -> str:
    """A lens model as people call it."""
    return LENSES[model].title if model in LENSES else f"lens model {model}" if model else "lens model of OpenCV"


def unit_text(unit: str) -> str:
    """A unit as printed: ``N·m/rad^2`` becomes ``N m/rad²``; that of a pure ratio is none."""
    if unit in ("1", "dimensionless"):
        return ""
    plain = unit.replace("**", "^").replace("*", " ").replace("·", " ")
    return re.sub(r"\^(-?\d+)", lambda power: _raised(int(power[1])), plain)


def law(latex: str) -> Markup:
    r"""Equations, separated by ``\\\\``, as MathML, which browsers set without any library; LaTeX where that fails."""
    source = latex.strip().strip("$")
    lines = [source] if "\\begin" in source else source.split("\\\\")
    try:
        return Markup("").join(Markup(convert(line.strip(), display="block")) for line in lines if line.strip())
    except Exception:  # the converter raises many kinds; the page must not fall with it
        return Markup("<code>{}</code>").format(latex)


def listing(words: Iterable[str], last: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    items = [str(word) for word in words]
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"


def inline_code(text: str) -> Markup:
    """Text in which `backticks` mark a command."""
    parts = str(escape(text)).split("`")
    return Markup("".join(part if i % 2 == 0 else f"<code>{part}</code>" for i, part in enumerate(parts)))
