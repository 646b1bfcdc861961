"""What a person knows of parameters beforehand, as they write it: ``r_hyd=3.6mm``, ``payload.m=2g±0.1g``, ``k_ref=0.1..0.3 N*m/rad``.

Base parameters are per joint of the chain that is fitted, as in `model.json`. ``modulus`` stands for the Young's modulus of
the wall and may have a prior.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BeforeValidator, ValidationInfo

from rfea_vision.errors import InputError
from rfea_vision.options.asking import written_by_people
from rfea_vision.units import parse_quantity

if TYPE_CHECKING:
    from rfea_vision.artefacts import Actuator

MODULUS = "modulus"


def units_of(effect_files: Sequence[Path]) -> dict[str, str]:
    """Unit of every parameter that a model may have."""
    from rfea_vision.effects.base import BASE_UNITS
    from rfea_vision.effects.catalogue import catalogue, load_effect_file, parameters_of

    own = {effect.id: effect for file in effect_files for effect in load_effect_file(file)}
    found = parameters_of({**catalogue(), **own}.values())
    return {**BASE_UNITS, **{name: spec.unit for name, spec in found.items()}}


def known_values(read: Callable[[Sequence[str], Mapping[str, str]], Mapping[str, object]]) -> BeforeValidator:
    """Take what people write, ``r_hyd=3.6mm`` or ``{r_hyd: 3.6 mm}``, for values in SI; a mapping in Python is in SI already."""

    def parse(value: object, info: ValidationInfo) -> object:
        if isinstance(value, Mapping):
            if not value or not written_by_people(info):
                return value
            value = [f"{name}={text}" for name, text in value.items()]
        if not isinstance(value, list | tuple):
            return value
        return read([str(item) for item in value], units_of(info.data.get("effect_files", ()))) if value else {}

    return BeforeValidator(parse, json_schema_input_type=dict[str, str] | list[str])


def read_conditions(given: Mapping[str, object]) -> dict[str, float]:
    """Values in SI of what is known of a run: ``{payload: 10 g}``, or ``{base_rotation.c: 0.2 rad/(N*m)}``.

    An effect with one amplitude is named without it.

    Raises
    ------
    InputError
        If it is no parameter of an effect, or its unit is wrong.
    """
    from rfea_vision.effects.catalogue import catalogue

    effects, units, found = catalogue(), units_of(()), {}
    for name, value in given.items():
        effect = effects.get(name)
        full = f"{name}.{effect.amplitudes()[0]}" if effect is not None and len(effect.amplitudes()) == 1 else name
        if "." not in full or full not in units:
            near = difflib.get_close_matches(name, [*effects, *units], n=1)
            hint = f"; did you mean '{near[0]}'?" if near else "; 'rfea effects' lists them"
            raise InputError(f"'{name}' is no parameter of an effect{hint}")
        try:
            found[full] = _number(f"{value:g}" if isinstance(value, float) else str(value), units[full])
        except ValueError as error:
            raise InputError(f"{name}: {error}") from error
    return found


def write_values(values: Mapping[str, Any], options: Any, between: str = "") -> list[str]:
    """Write parameters in SI with their unit, as they are read: a pair with `between` (``±`` or ``..``) in the middle."""
    if not values:
        return []  # the units of all effects take a second to load
    units = {**units_of(options.effect_files), MODULUS: "Pa"}
    out = []
    for name, value in values.items():
        unit = _unit(name, units).replace(" ", "*").removesuffix("1")
        numbers = value if isinstance(value, tuple) else (value,)
        out.append(f"{name}={between.join(f'{number:.9g}{unit}' for number in numbers)}")
    return out


def read_values(option: str, items: Sequence[str], units: Mapping[str, str]) -> dict[str, float]:
    """Read ``r_hyd=3.6mm``, written behind `option`."""
    return {name: _value(option, item, text, _unit(name, units)) for item, name, text in _split(option, items, units)}


def read_priors(items: Sequence[str], units: Mapping[str, str]) -> dict[str, tuple[float, float]]:
    """Read ``payload.m=2g±0.1g``; ``+-`` and ``+/-`` do as well.

    Raises
    ------
    InputError
        If one has no standard error above zero, or a value or its unit cannot be read.
    """
    out = {}
    known = {**units, MODULUS: "Pa"}
    for item, name, text in _split("--prior", items, known):
        parts = re.split(r"±|\+/-|\+-", text)
        if len(parts) != 2:
            raise InputError(f"--prior {item}: write value and standard error, as in payload.m=2g±0.1g")
        mean, sd = (_value("--prior", item, part, _unit(name, known)) for part in parts)
        if sd <= 0:
            raise InputError(f"--prior {item}: the standard error must be positive; to hold a value use --fix")
        out[name] = (mean, sd)
    return out


def read_bounds(items: Sequence[str], units: Mapping[str, str]) -> dict[str, tuple[float, float]]:
    """Read ``r_hyd=3mm..4mm``.

    Raises
    ------
    InputError
        If the first value of one is not below the second, or a value or its unit cannot be read.
    """
    out = {}
    for item, name, text in _split("--bound", items, units):
        parts = text.split("..")
        if len(parts) != 2:
            raise InputError(f"--bound {item}: write lowest and highest value, as in r_hyd=3mm..4mm")
        low, high = (_value("--bound", item, part, _unit(name, units)) for part in parts)
        if not low < high:
            raise InputError(f"--bound {item}: the first value must be below the second")
        out[name] = (low, high)
    return out


def refuse_impossible_lever(fixed: Mapping[str, float], actuator: Actuator) -> None:
    """Refuse a lever of the pressure (m) that is held beyond the tube: no part of the bore is farther from its side than a diameter.

    Raises
    ------
    InputError
        If it is longer than the tube is wide.
    """
    lever_m, most_m = fixed.get("r_hyd", 0.0), 2 * actuator.outer_radius
    if actuator.kind == "tube" and lever_m > most_m:
        raise InputError(
            f"--fix r_hyd={1e3 * lever_m:g}mm: is longer than the tube is wide (actuator.outer_radius: {1e3 * most_m / 2:g} mm); "
            "check the unit"
        )


def _unit(name: str, units: Mapping[str, str]) -> str:
    """Unit of a parameter, of one chamber's too (``pressure_lag@right.T``); empty for a name that there is not."""
    return units.get(re.sub(r"@[^.]*", "", name), "")


def _split(option: str, items: Sequence[str], units: Mapping[str, str]) -> list[tuple[str, str, str]]:
    found: dict[str, tuple[str, str, str]] = {}
    for item in items:
        name, separator, text = (part.strip() for part in item.partition("="))
        if not separator or not text:
            raise InputError(f"{option} {item}: write parameter=value with its unit, as in r_hyd=3.6mm")
        if not _unit(name, units):
            base = [one for one in units if "." not in one]
            close = difflib.get_close_matches(name, units if "." in name else base, n=1)
            of_base = f"the base model's are {', '.join(base)}; 'rfea effects show EFFECT' lists those of an effect"
            hint = f"did you mean {close[0]}?" if close else of_base
            raise InputError(f"{option} {item}: there is no parameter '{name}'; {hint}")
        if name in found:
            raise InputError(f"{option} {item}: given twice; keep one")
        found[name] = (item, name, text)
    return list(found.values())


def _value(option: str, item: str, text: str, unit: str) -> float:
    try:
        return _number(text, unit)
    except ValueError as error:
        raise InputError(f"{option} {item}: {error}") from error


def _number(text: str, unit: str) -> float:
    """A value in SI, written with its unit; a pure number stands alone, or in %."""
    if unit not in ("1", "") or "%" in text:
        return parse_quantity(text.strip(), unit, example={"m": "3.6 mm", "kg": "10 g"}.get(unit, f"1 {unit}"))
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"'{text}' is no finite number; write for example 0.98")
    return number
