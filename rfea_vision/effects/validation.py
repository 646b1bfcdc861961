"""Checks of an effect before anything runs: symbols, units, derivatives, finite values. One clear sentence each."""

from __future__ import annotations

from typing import Any

import pint
import sympy as sp

from rfea_vision.effects.base import BASE_PARAMETERS, BASE_UNITS, Body, BodyInertia, BodyPlace, Effect, Joint
from rfea_vision.errors import InputError

_registry = pint.UnitRegistry()
Dimension = Any  # pint's UnitsContainer


class DimensionError(Exception):
    """Two terms that cannot be added, or a function of something that has a unit."""


def _dimension_of(unit: str) -> Dimension:
    return _registry.Unit("" if unit == "1" else unit).dimensionality


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
    own = _symbols(effect)
    base = {name: sp.Symbol(name, real=True) for name in BASE_PARAMETERS}
    s = {name: sp.Symbol(name, real=True) for name in ("theta", "rate", "pressure", "position")}
    c = {name: sp.Symbol(name, positive=True) for name in ("count", "rest_length", "r_o", "r_i0", "rho_f")}
    composed = {
        name: sp.Symbol(name, positive=True) for name in ("outer_radius", "inner_radius", "stiffness", "damping")
    }
    joint = Joint(
        s["theta"], s["rate"], s["pressure"], s["position"], c["count"], c["rest_length"], c["r_o"], c["r_i0"], c["rho_f"],
        base, dict(composed),
    )  # fmt: skip
    units = {
        **{base[name]: BASE_UNITS[name] for name in BASE_PARAMETERS},
        s["theta"]: "rad", s["rate"]: "rad/s", s["pressure"]: "Pa", s["position"]: "1", c["count"]: "1",
        c["rest_length"]: "m", c["r_o"]: "m", c["r_i0"]: "m", c["rho_f"]: "kg/m^3",
        composed["outer_radius"]: "m", composed["inner_radius"]: "m", composed["stiffness"]: "N*m", composed["damping"]: "N*m*s",
    }  # fmt: skip
    states = {getattr(effect, name): _dimension_of(unit) for name, unit in effect.states.items()}
    known = {**own, **states, **{symbol: _dimension_of(unit) for symbol, unit in units.items()}}
    torque, one, angle = (
        sp.Symbol("torque", real=True),
        sp.Symbol("fraction", positive=True),
        sp.Symbol("rest", real=True),
    )
    known.update({torque: _dimension_of("N*m"), one: _NONE, angle: _NONE})
    for hook, argument, unit in (
        ("outer_radius", composed["outer_radius"], "m"),
        ("rubber_volume", one, "1"),
        ("rest_angle", angle, "rad"),
        ("stiffness", composed["stiffness"], "N*m"),
        ("damping", composed["damping"], "N*m*s"),
        ("hydraulic_torque", torque, "N*m"),
    ):
        _check(effect, hook, getattr(effect, hook)(joint, argument), unit, known)
    _check(effect, "joint_torque", effect.joint_torque(joint), "N*m", known)
    _check(effect, "added_mass", effect.added_mass(joint), "kg", known)
    _check_states(effect, joint, known)
    _check_bodies(effect, own)
    pressure = sp.Symbol("pressure", real=True)
    _check(effect, "felt_pressure", effect.felt_pressure(pressure), "Pa", {**own, pressure: _dimension_of("Pa")})
    for hook, unit in (
        ("line_time_constant", "s"),
        ("flow_resistance", "Pa*s/m^3"),
        ("flow_inertance", "Pa*s^2/m^3"),
        ("base_compliance", "1/(N*m)"),
    ):
        _check(effect, hook, getattr(effect, hook)(), unit, own)


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


def _check_bodies(effect: Effect, own: dict[Any, Dimension]) -> None:
    names = {"x": "m", "y": "m", "vx": "m/s", "vy": "m/s", "length": "m", "r_o": "m", "tube_length": "m", "mirror": "1"}
    symbols = {name: sp.Symbol(name, real=True) for name in names}
    known = {**own, **{symbols[name]: _dimension_of(unit) for name, unit in names.items()}}
    body = Body(*(symbols[name] for name in names))
    g = sp.Symbol("g", positive=True)
    for axis, force in zip("xy", effect.body_force(body), strict=True):
        _check(effect, f"body_force ({axis})", force, "N", known)
    for axis, component in zip("xy", effect.gravity((sp.Integer(0), -g), body), strict=True):
        _check(effect, f"gravity ({axis})", component, "m/s^2", {**known, g: _dimension_of("m/s^2")})
    seen = effect.observed_position(symbols["x"], symbols["y"], symbols["mirror"])
    for axis, value in zip("xy", seen, strict=True):
        _check(effect, f"observed_position ({axis})", value, "m", known)
    time = sp.Symbol("t", real=True)
    _check(effect, "time_shift", effect.time_shift(time), "s", {**own, time: _dimension_of("s")})
    last = sp.Symbol("is_last", nonnegative=True)
    parts = {"mass": "kg", "along": "m", "across": "m", "inertia": "kg*m^2"}
    inertia = {name: sp.Symbol(name, positive=True) for name in parts}
    known.update({inertia[name]: _dimension_of(unit) for name, unit in parts.items()})
    known[last] = _NONE
    changed = effect.inertia(BodyPlace(symbols["length"], last, symbols["r_o"]), BodyInertia(**inertia))
    for name, unit in parts.items():
        _check(effect, f"inertia ({name})", getattr(changed, name), unit, known)
