"""From a composed law to source text: exact derivatives by SymPy, common subexpressions shared, printed as Python.

A law gives loops over joints and bodies for Numba, each a module of its own, and a module of NumPy functions for what is
evaluated once a run. Laws that differ in the latter alone have the same loops, word for word.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Mapping, Sequence
from functools import lru_cache
from textwrap import indent
from typing import Any

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from rfea_vision.dynamics import formulas as _formulas
from rfea_vision.dynamics import laws
from rfea_vision.dynamics.formulas import understood
from rfea_vision.dynamics.laws import ComposedLaw
from rfea_vision.errors import InputError

_HEADER = '''"""Generated: do not edit."""
from math import *
import math
import numpy as np
from numba import njit, types, void, float64

VECTOR = float64[::1]
MATRIX = float64[:, ::1]
'''
# What is compiled of the text below follows from this module, too: it is another text where that is another.
_READ = f"from rfea_vision.dynamics.formulas import formulas  # {hashlib.sha256(inspect.getsource(_formulas).encode()).hexdigest()}"

# Column layout of the joint law's output, for m hidden states:
# torque, d/dtheta, d/drate, d/dpressure, added mass, d/dtheta, then per state: d torque/dz; then per state:
# rate, d/dtheta, d/drate, d/dpressure; then the m x m block d rate_a / d z_b.
KINEMATIC = (laws.X, laws.Y, laws.VX, laws.VY)


# Most effects leave the torque of the joints as it is, or all but a part of it: what was derived and written for one law, the next
# takes over. A catalogue has about 50 laws of some 40 derivatives.
_SEEN = lru_cache(maxsize=2000)


_PARTS = lru_cache(maxsize=50_000)


@_PARTS
def _symbols(expression: Any) -> frozenset[Any]:
    return frozenset().union(*map(_symbols, expression.args)) if expression.args else frozenset({expression})


@_PARTS
def _by(expression: Any, symbol: sp.Symbol) -> Any:
    """What SymPy's `diff` returns, of which each part that stands in several places is worked out once: it walks them all."""
    if symbol not in _symbols(expression):
        return sp.Integer(0)
    if isinstance(expression, sp.Add):
        return sp.Add(*(_by(term, symbol) for term in expression.args))
    if isinstance(expression, sp.Mul):
        factors = expression.args
        changes = [_by(factor, symbol) for factor in factors]
        return sp.Add(*(sp.Mul(*factors[:i], change, *factors[i + 1 :]) for i, change in enumerate(changes) if change != 0))
    if isinstance(expression, sp.Piecewise):
        pairs: Any = expression.args
        return sp.Piecewise(*((_by(value, symbol), condition) for value, condition in pairs))
    if isinstance(expression, sp.Pow) and symbol not in _symbols(expression.exp):
        return expression * (_by(expression.base, symbol) * expression.exp / expression.base)
    return sp.diff(expression, symbol)


@_SEEN
def _derivative(expression: sp.Expr, symbol: sp.Symbol) -> Any:
    result = _by(expression, symbol)
    # sign(x) has a derivative at 0 alone; the laws are piecewise smooth and Newton only needs one side.
    return result.replace(sp.DiracDelta, lambda *_: sp.Integer(0)) if result.has(sp.DiracDelta) else result


class _Printer(PythonCodePrinter):
    def _print_sign(self, expression: Any) -> str:
        argument = self._print(expression.args[0])
        return f"(1.0 if ({argument}) > 0 else (-1.0 if ({argument}) < 0 else 0.0))"

    def _print_Heaviside(self, expression: Any) -> str:
        return f"(1.0 if ({self._print(expression.args[0])}) >= 0 else 0.0)"


@_SEEN
def _assignments(targets: tuple[tuple[str, sp.Expr], ...], indent: str) -> str:
    """Assignments with shared subexpressions; what is identically zero is left out and stays as the caller's zeroed array has it."""
    printer = _Printer({"fully_qualified_modules": False})
    shared, reduced = sp.cse([expression for _, expression in targets], symbols=sp.numbered_symbols("_s"), list=True)
    lines = [f"{indent}{symbol} = {printer.doprint(expression)}" for symbol, expression in shared]
    lines += [f"{indent}{name} = {printer.doprint(value)}" for (name, _), value in zip(targets, reduced, strict=True)]
    return "\n".join(lines)


def _unpack(law: ComposedLaw, expressions: Sequence[sp.Expr], indent: str, per_item: dict[sp.Symbol, str]) -> str:
    used: set[Any] = set().union(*(expression.free_symbols for expression in expressions)) if expressions else set()
    sources: dict[sp.Symbol, str] = dict(per_item)
    sources.update({symbol: f"par[{index}]" for index, symbol in enumerate(law.symbols)})
    sources.update({symbol: f"con[{index}]" for index, symbol in enumerate(laws.CONSTANTS)})
    unknown = sorted(str(symbol) for symbol in used if symbol not in sources)
    if unknown:
        raise InputError(
            f"effect law uses {', '.join(unknown)}, which is neither a parameter, a state nor a symbol of the hook"
        )
    return "\n".join(f"{indent}{symbol} = {sources[symbol]}" for symbol in sorted(used, key=str))


def _function(
    name: str,
    arguments: str,
    signature: str,
    targets: list[tuple[str, sp.Expr]],
    law: ComposedLaw,
    per_item: dict[sp.Symbol, str],
    count: str,
) -> str:
    expressions = [expression for _, expression in targets]
    for expression in expressions:
        if expression.has(sp.Derivative, sp.Subs, sp.zoo, sp.nan):
            raise InputError("effect law: a derivative could not be formed; write it with differentiable functions")
    lines = _unpack(law, expressions, "", per_item)
    lines += "\n" + _assignments(tuple(target for target in targets if target[1] != 0), "")
    head = _HEADER
    if lines.strip() and understood(lines):
        head += f"{_READ}\nrun = formulas({_quoted(lines)}, {arguments!r})\n"
        lines = f"run(({arguments}), j)"
    return (
        f"{head}\n@njit(void({signature}), nogil=True, cache=True, error_model='numpy', _nrt=False)\n"
        f"def {name}({arguments}):\n    for j in range({count}):\n{indent(lines.strip() or 'pass', 8 * ' ')}\n"
    )


def _quoted(lines: str) -> str:
    return f'"""\n{lines.strip()}\n"""'


def _joint_items(law: ComposedLaw) -> dict[sp.Symbol, str]:
    items: dict[sp.Symbol, str] = {
        laws.THETA: "thetas[j]",
        laws.RATE: "rates[j]",
        laws.PRESSURE: "felt",
        laws.POSITION: "positions[j]",
        laws.ARC: "arcs[j]",
    }
    items.update({state: f"z[j, {index}]" for index, state in enumerate(law.states)})
    items.update({weight: f"weights[j, {index}]" for index, weight in enumerate(law.weights)})
    return items


def joint_columns(law: ComposedLaw) -> list[sp.Expr]:
    """Columns of the joint law's output, in the order stated above."""
    columns = [law.torque, *(_derivative(law.torque, symbol) for symbol in (laws.THETA, laws.RATE, laws.PRESSURE))]
    columns += [law.added_mass, _derivative(law.added_mass, laws.THETA)]
    columns += [_derivative(law.torque, state) for state in law.states]
    for rate in law.state_rates:
        columns += [rate, *(_derivative(rate, symbol) for symbol in (laws.THETA, laws.RATE, laws.PRESSURE))]
    return columns + [_derivative(rate, state) for rate in law.state_rates for state in law.states]


def relaxed_columns(law: ComposedLaw) -> list[list[sp.Expr]]:
    """Per hidden state: its relaxed value, and that by the angle and by the pressure."""
    return [[v, _derivative(v, laws.THETA), _derivative(v, laws.PRESSURE)] for v in law.relaxed]


def force_columns(law: ComposedLaw) -> list[list[sp.Expr]]:
    """Per component of the body force: its value, and that by position and velocity."""
    return [[part, *(_derivative(part, symbol) for symbol in KINEMATIC)] for part in law.body_force]


def generate(law: ComposedLaw) -> dict[str, str]:
    """Source text of each loop that is compiled of a composed law, by the names in `compilation.Loops`."""
    targets = [(f"out[j, {index}]", column) for index, column in enumerate(joint_columns(law))]
    joint_arguments = "thetas, rates, z, felt, positions, arcs, weights, par, con, out"
    joint_signature = "VECTOR, VECTOR, MATRIX, float64, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, MATRIX"
    joints = (law, _joint_items(law), "thetas.size")
    texts = {"joint_law": _function("joint_law", joint_arguments, joint_signature, targets, *joints)}

    rows = [law.torque, law.added_mass, *law.state_rates]
    parameter_targets = [
        (f"out[j, {row}, {column}]", _derivative(expression, symbol))
        for row, expression in enumerate(rows)
        for column, symbol in enumerate(law.symbols)
    ]
    cube = joint_signature.rsplit(", ", 1)[0] + ", float64[:, :, ::1]"
    texts["joint_law_parameters"] = _function("joint_law_parameters", joint_arguments, cube, parameter_targets, *joints)

    relaxed_targets: list[tuple[str, sp.Expr]] = []
    for index, (value, columns) in enumerate(zip(law.relaxed, relaxed_columns(law), strict=True)):
        columns = [*columns, *(_derivative(value, symbol) for symbol in law.symbols)]
        relaxed_targets += [(f"out[j, {index}, {column}]", item) for column, item in enumerate(columns)]
    texts["relaxed_states"] = _function("relaxed_states", joint_arguments, cube, relaxed_targets, *joints)

    force_targets: list[tuple[str, sp.Expr]] = []
    for row, (component, columns) in enumerate(zip(law.body_force, force_columns(law), strict=True)):
        columns = [*columns, *(_derivative(component, symbol) for symbol in law.symbols)]
        force_targets += [(f"out[j, {row}, {column}]", item) for column, item in enumerate(columns)]
    items = {symbol: f"motion[j, {index}]" for index, symbol in enumerate(KINEMATIC)}
    items[laws.BODY_LENGTH] = "length[j]"
    texts["body_force"] = _function(
        "body_force",
        "motion, length, par, con, out",
        "MATRIX, VECTOR, VECTOR, VECTOR, float64[:, :, ::1]",
        force_targets,
        law,
        items,
        "length.size",
    )
    return texts


def _numpy_function(name: str, law: ComposedLaw, expressions: Sequence[sp.Expr], own: Sequence[sp.Symbol]) -> str:
    """(par, con, *own) -> list of [value, d/d own..., d/d par...] per expression, each broadcast like `own`."""
    rows = [[value, *(_derivative(value, symbol) for symbol in (*own, *law.symbols))] for value in expressions]
    function = sp.lambdify([list(law.symbols), list(laws.CONSTANTS), *own], rows, modules="numpy", cse=True)
    return inspect.getsource(function).replace("_lambdifygenerated", name, 1)


def generate_numpy(law: ComposedLaw, loops: Mapping[str, str]) -> str:
    """Source text of the NumPy functions, and of what there is to know of the law without deriving it again.

    loops : the module in which each compiled loop stands
    """
    facts = {
        "effects": law.effects,
        "parameters": law.parameters,
        "state_count": len(law.states),
        "has_body_force": law.body_force != (0, 0),
        "has_added_mass": law.added_mass != 0,
        "active": law.active,
        "chambers": tuple(law.lines),
    }
    text = '"""Generated: do not edit."""\nfrom numpy import *\n\nFACTS = ' + repr(facts) + "\n"
    text += f"LOOPS = {dict(loops)!r}\n"
    written = [(name, name, values) for name, values in law.once.items()]
    for index, line in enumerate(law.lines.values()):
        written += [(f"{name}_{index}", name, values) for name, values in line.items()]
    functions = (
        _numpy_function(name, law, values, laws.own_symbols(laws.ONCE[hook])) for name, hook, values in written
    )
    return text + "".join("\n\n" + function for function in functions)
