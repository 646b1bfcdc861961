"""Checks of an effect before anything runs: symbols, units, derivatives, finite values. One clear sentence each."""

from __future__ import annotations

from difflib import get_close_matches
from math import isclose
from typing import Any

import sympy as sp

from rfea_vision.effects.base import BASE_PARAMETERS, BASE_UNITS, HOOKS, Body, BodyInertia, BodyPlace, Effect, Joint
from rfea_vision.effects.hooks import ARGUMENTS
from rfea_vision.errors import InputError
from rfea_vision.units import dimension_of, si_factor

Dimension = Any  # pint's UnitsContainer


class DimensionError(Exception):
    """Two terms that cannot be added, or a function of something that has a unit."""


def _dimension_of(unit: str) -> Dimension:
    return dimension_of("" if unit == "1" else unit)


_NONE = _dimension_of("1")


def dimension(expression: Any, known: dict[Any, Dimension]) -> Dimension:
    """Dimension of a SymPy expression; raises DimensionError where units do not fit."""
    if expression.is_number:
        return _NONE
    if expression.is_Symbol:
        return known[expression]
    if expression.is_Add:
        terms = [(term, dimension(term, known)) for term in expression.args]
        first = terms[0]
        for term, unit in terms[1:]:
            if unit != first[1]:
                raise DimensionError(f"{first[0]} [{_name(first[1])}] and {term} [{_name(unit)}] are added")
        return first[1]
    if expression.is_Mul:
        product = _NONE
        for factor in expression.args:
            product = product * dimension(factor, known)
        return product
    if expression.is_Pow:
        base, exponent = expression.args
        inner = dimension(base, known)
        if dimension(exponent, known) != _NONE:
            raise DimensionError(f"the exponent {exponent} has a unit")
        if inner != _NONE and not exponent.is_number:
            raise DimensionError(f"{base} [{_name(inner)}] is raised to {exponent}")
        return inner ** float(exponent) if exponent.is_number else inner
    if isinstance(expression, sp.Piecewise):
        pieces: Any = expression.args
        for _, condition in pieces:
            for relation in condition.atoms(sp.core.relational.Relational):
                _same([side for side in relation.args if side != 0], known)
        return _same([branch for branch, _ in pieces if branch != 0], known)
    if isinstance(expression, (sp.Max, sp.Min)):
        return _same([a for a in expression.args if a != 0], known)
    if isinstance(expression, sp.Abs):
        return dimension(expression.args[0], known)
    if isinstance(expression, (sp.sign, sp.Heaviside)):
        dimension(expression.args[0], known)
        return _NONE
    for argument in expression.args:
        unit = dimension(argument, known)
        if unit != _NONE:
            raise DimensionError(f"{expression.func.__name__} is taken of {argument} [{_name(unit)}]")
    return _NONE


def _same(parts: list[Any], known: dict[Any, Dimension]) -> Dimension:
    units = [dimension(part, known) for part in parts] or [_NONE]
    if any(unit != units[0] for unit in units):
        raise DimensionError(f"the branches {parts} have different units")
    return units[0]


def _name(unit: Dimension) -> str:
    return "no unit" if unit == _NONE else str(unit).replace("[", "").replace("]", "")


def _check(effect: Effect, hook: str, expression: Any, unit: str, known: dict[Any, Dimension]) -> None:
    try:
        expression = sp.sympify(expression)
    except (sp.SympifyError, TypeError) as error:
        raise InputError(f"effect {effect.id}: {hook} returns {expression!r}, not a SymPy expression") from error
    unknown = sorted(str(s) for s in expression.free_symbols if s not in known)
    if unknown:
        raise InputError(
            f"effect {effect.id}: {hook} uses {', '.join(unknown)}, which is neither one of its parameters or states nor "
            "something that the hook offers"
        )
    if expression == 0:
        return
    try:
        found = dimension(expression, known)
    except DimensionError as error:
        words = str(error).replace(f"{effect.id}__", "")
        raise InputError(f"effect {effect.id}: units in {hook} do not fit: {words}") from error
    if found != _dimension_of(unit):
        raise InputError(f"effect {effect.id}: {hook} has the unit [{_name(found)}], expected {unit}")
    for symbol in expression.free_symbols:
        slope = sp.diff(expression, symbol)
        if slope.has(sp.Derivative, sp.Subs, sp.zoo, sp.nan):
            raise InputError(
                f"effect {effect.id}: {hook} cannot be differentiated with respect to {symbol}; write it with "
                "differentiable functions (tanh, sqrt, Abs, Piecewise, ...)"
            )


def _symbols(effect: Effect) -> dict[Any, Dimension]:
    known = {effect.symbol_map()[name]: _dimension_of(spec.unit) for name, spec in effect.parameters.items()}
    known.update({getattr(effect, name): _dimension_of(unit) for name, (unit, _) in effect.constants.items()})
    return known


def _declaration(effect: Effect) -> None:
    for name, spec in effect.parameters.items():
        try:
            _dimension_of(spec.unit)
        except Exception as error:
            raise InputError(f"effect {effect.id}: parameter {name} has the unknown unit '{spec.unit}'") from error
        if spec.unit != "1" and not isclose(factor := si_factor(spec.unit), 1.0):
            raise InputError(
                f"effect {effect.id}: parameter {name} has the unit '{spec.unit}', and laws reckon in SI: give it and its numbers in "
                f"the SI unit, of which that is {factor:g}, and display='{spec.unit}' beside them"
            )
        if not spec.lower < spec.upper or not spec.lower <= spec.start <= spec.upper:
            raise InputError(f"effect {effect.id}: parameter {name} needs lower <= start <= upper and lower < upper")
        if spec.absent is not None and not spec.lower <= spec.absent <= spec.upper:
            raise InputError(f"effect {effect.id}: parameter {name} is absent at {spec.absent}, outside its bounds")
    if not effect.amplitudes():
        raise InputError(
            f"effect {effect.id}: no parameter has a value at which the effect is absent; give one `absent`"
        )
    for state, unit in effect.states.items():
        try:
            _dimension_of(unit)
        except Exception as error:
            raise InputError(f"effect {effect.id}: state {state} has the unknown unit '{unit}'") from error


def validate(effect: Effect) -> None:
    """Check one effect.

    Raises
    ------
    InputError
        What is wrong, naming the effect, the hook and the remedy.
    """
    _declaration(effect)
    _changes_something(effect)
    own = _symbols(effect)
    given, offered = _arguments()
    states = {getattr(effect, name): _dimension_of(unit) for name, unit in effect.states.items()}
    for name, hook in HOOKS.items():
        known = {**own, **(states if hook.arguments[:1] == ("joint",) else {})}
        for argument in hook.arguments:
            known |= offered[argument]
        for index, (value, unit) in enumerate(zip(hook.values(effect, given), hook.units, strict=True)):
            _check(effect, name if len(hook.units) == 1 else f"{name} [{index}]", value, unit, known)
    _check_states(effect, given["joint"], {**own, **states, **offered["joint"]})


def _changes_something(effect: Effect) -> None:
    """Refuse an effect that overrides no hook, as one with a misspelt hook: it would be fitted for nothing."""
    if effect.states or any(type(effect).overrides(name) for name in HOOKS):
        return
    methods = [name for name, value in vars(type(effect)).items() if callable(value) and not name.startswith("_")]
    near = ((name, get_close_matches(name, HOOKS, n=1)) for name in methods)
    slip = next((f"'{name}' is none, did you mean '{close[0]}'?" for name, close in near if close), "")
    remedy = slip or "the hooks are " + ", ".join(HOOKS)
    raise InputError(f"effect {effect.id}: changes nothing, as it has no hook; {remedy}")


def _arguments() -> tuple[dict[str, Any], dict[str, dict[Any, Dimension]]]:
    """What is handed to hooks by the name of the argument, and the symbols in it with their dimensions."""

    def named(**units: str) -> dict[Any, Dimension]:
        return {sp.Symbol(name, real=True): _dimension_of(unit) for name, unit in units.items()}

    base = named(**{name: BASE_UNITS[name] for name in BASE_PARAMETERS})
    joint = named(
        theta="rad", rate="rad/s", pressure="Pa", position="1", count="1", rest_length="m", r_o="m", r_i0="m",
        rho_f="kg/m^3",
    )  # fmt: skip
    composed = named(outer_radius="m", inner_radius="m", rest_angle="rad", stiffness="N*m", damping="N*m*s")
    opposed = named(opposed="Pa")
    body = named(x="m", y="m", vx="m/s", vy="m/s", length="m", r_o="m", tube_length="m", mirror="1")
    place = named(length="m", is_last="1", r_o="m")
    inertia = named(mass="kg", along="m", across="m", inertia="kg*m^2")
    plain = {name: named(**{name: unit}) for name, (unit, _) in ARGUMENTS.items()}
    g = named(g="m/s^2")
    given: dict[str, Any] = {name: next(iter(symbols)) for name, symbols in plain.items()}
    given |= {
        "joint": Joint(
            *joint,
            base={str(s): s for s in base},
            expressions={str(s): s for s in composed},
            opposed=next(iter(opposed)),
        ),
        "body": Body(*body),
        "place": BodyPlace(*place),
        "inertia": BodyInertia(*inertia),
        "gravity": (sp.Integer(0), -next(iter(g))),
    }
    offered = {**plain, "joint": {**base, **joint, **composed, **opposed}, "body": body, "place": place}
    return given, {**offered, "inertia": inertia, "gravity": g}


def _check_states(effect: Effect, joint: Joint, known: dict[Any, Dimension]) -> None:
    rates, relaxed = effect.state_rates(joint), effect.relaxed_states(joint)
    for name, unit in effect.states.items():
        if name not in rates or name not in relaxed:
            raise InputError(f"effect {effect.id}: state '{name}' needs an entry in state_rates and in relaxed_states")
        _check(effect, f"state_rates['{name}']", rates[name], f"({unit})/s" if unit != "1" else "1/s", known)
        _check(effect, f"relaxed_states['{name}']", relaxed[name], unit, known)
    extra = sorted((set(rates) | set(relaxed)) - set(effect.states))
    if extra:
        raise InputError(
            f"effect {effect.id}: '{extra[0]}' has a rate but is not among its states; declare it in `states`"
        )
