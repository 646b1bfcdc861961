"""The laws of a fitted model as C: printed from the one SymPy declaration, parameters as numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import sympy as sp
from sympy.printing.c import C99CodePrinter

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics import laws
from rfea_vision.dynamics.generation import KINEMATIC, force_columns, joint_columns, relaxed_columns
from rfea_vision.dynamics.laws import ComposedLaw, compose
from rfea_vision.dynamics.line import scalar
from rfea_vision.dynamics.realtime import NEWTON_ITERATIONS
from rfea_vision.dynamics.simulation import Model
from rfea_vision.errors import InputError

# fmt: off
_WORDS = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float", "for", "goto",
    "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed", "sizeof", "static", "struct", "switch",
    "typedef", "union", "unsigned", "void", "volatile", "while",
))
# fmt: on
STRIDES = 16  # of the pressure, on the way to the static equilibrium

_JOINT_ITEMS = {
    laws.THETA: "theta",
    laws.RATE: "rate",
    laws.PRESSURE: "pressure",
    laws.POSITION: "POSITION[j]",
    laws.ARC: "ARC[j]",
}
_FORCE_ITEMS = {laws.BODY_LENGTH: "length", **{s: f"motion[{index}]" for index, s in enumerate(KINEMATIC)}}


class _Printer(C99CodePrinter):
    def _print_NumberSymbol(self, expression: Any) -> str:  # M_PI is not of C99
        return repr(float(expression))

    def _print_Heaviside(self, expression: Any) -> str:
        return f"(({self._print(expression.args[0])}) >= 0 ? 1.0 : 0.0)"


class _Writer:
    """Prints expressions of one model, with its parameters and constants put in as numbers."""

    def __init__(self, law: ComposedLaw, numbers: Mapping[sp.Symbol, float], names: Mapping[sp.Symbol, str]) -> None:
        self.law, self.numbers, self.names = law, numbers, names
        self.printer = _Printer({"strict": True, "math_macros": {}})

    def function(self, head: str, targets: Sequence[tuple[str, sp.Expr]], items: Mapping[sp.Symbol, str]) -> str:
        """A C function that assigns to the targets; what is identically zero stays as the zeroed array has it."""
        nonzero = [(target, sp.sympify(value)) for target, value in targets if value != 0]
        shared, reduced = sp.cse([value for _, value in nonzero], symbols=sp.numbered_symbols("s_"), list=True)
        used: set[Any] = set().union(*(value.free_symbols for _, value in nonzero)) if nonzero else set()
        lines = [f"const double {s} = {self._source(s, items)};" for s in sorted(used, key=str)]
        lines = [line for line in lines if not re.fullmatch(r"const double (\w+) = \1;", line)]
        lines += [f"const double {symbol} = {self._text(value)};" for symbol, value in shared]
        lines += [f"{target} = {self._text(value)};" for (target, _), value in zip(nonzero, reduced, strict=True)]
        arguments = re.findall(r"(\w+)(?:\)\[\d+\])?(?=[,)]|$)", head.partition("(")[2])
        body = "\n".join(lines)
        lines = [f"(void){name};" for name in arguments if not re.search(rf"\b{name}\b", body)] + lines
        return head + " {\n" + "".join(f"    {line}\n" for line in lines) + "}\n"

    def _source(self, symbol: sp.Symbol, items: Mapping[sp.Symbol, str]) -> str:
        if symbol in items:
            return items[symbol]
        return f"{float(self.numbers[symbol])!r} /* {self.names.get(symbol, symbol)} */"

    def _text(self, value: object) -> str:
        try:
            return str(self.printer.doprint(value))
        except Exception as error:  # SymPy raises several kinds
            raise InputError(
                f"export: the law has no form in C ({error}); write it with elementary functions"
            ) from error


def not_of_the_tube(model: Model) -> list[str]:
    """Effects of the camera or of the clocks, which no code of a tube has."""
    hooks = ("observed_position", "time_shift", "angle_drift")
    return [effect.id for effect in model.effects if any(effect.overrides(hook) for hook in hooks)]


def check_exportable(model: Model) -> None:
    """Refuse what is not of the tube.

    Raises
    ------
    InputError
        The model has effects of the camera or of the clocks.
    """
    if any(effect.overrides("stretch_time_constant") for effect in model.effects):
        raise InputError("export: a length that follows the pressure late is not exported; fit with `stretch` in its place")
    if outside := not_of_the_tube(model):
        raise InputError(
            f"export: '{outside[0]}' belongs to the camera or the clocks, not to the tube; fit a model without it"
        )


def _matrix(values: FloatArray) -> str:
    if values.ndim == 1:
        return "{" + ", ".join(repr(float(v)) for v in values) + "}"
    return "{\n    " + ",\n    ".join(_matrix(row) for row in values) + "}"


def c_files(
    model: Model, par: FloatArray, name: str, step_s: float, about: str = "", iterations: int = NEWTON_ITERATIONS
) -> tuple[str, str]:
    """Header and source of a model with its parameters.

    Parameters
    ----------
    par : (parameters,) in SI, in the order of `model.names`
    name : a C identifier, prefix of everything that the header declares
    about : a line for the head of both files
    iterations : of Newton's method per stage

    Raises
    ------
    InputError
        An effect that cannot be exported, or a name that is no identifier.
    """
    if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII) or name in _WORDS:
        raise InputError(f"export: '{name}' is no identifier in C; use letters, digits and underscores")
    check_exportable(model)
    template = files("rfea_vision.export")
    words = {
        "NAME": name,
        "NAME_UPPER": name.upper(),
        "STRIDES": str(STRIDES),
        "N": str(model.chain.bodies),
        "STATES": str(max(model.law.state_count, 1)),
        "STEP_S": repr(float(step_s)),
        "NEWTON_ITERATIONS": str(iterations),
        "ABOUT": one_line(about),
    }
    header = filled(template.joinpath("runtime.h").read_text(encoding="utf-8"), words)
    runtime = filled(template.joinpath("runtime.c").read_text(encoding="utf-8"), words)
    laws_text = _laws(model, par)
    head = f'/* {words["ABOUT"]} */\n#include "{name}.h"\n\n#include <math.h>\n#include <string.h>\n\n'
    return header, head + _tables(model, par, step_s, laws_text) + "\n" + laws_text + "\n" + runtime


def one_line(about: str) -> str:
    """A text that stays in a comment of C, whatever it holds, and is whole in XML: no control characters, no ``*/``, no splices."""
    return re.sub(r"[\x00-\x1f\x7f-\x9f\\?]", " ", about).replace("*/", "* /").replace("/*", "/ *")


def filled(text: str, words: Mapping[str, str]) -> str:
    """Put words in the place of @THEIR_NAME@."""
    return re.sub(r"@(\w+)@", lambda found: words[found[1]], text)


def _tables(model: Model, par: FloatArray, step_s: float, laws_text: str) -> str:
    """The chain's numbers, as far as they are used."""
    system, chain = model.system(par), model.chain
    lag = max(scalar(model.law.line_time_constant, par, model._constants)[0], 0.0)
    whole = {"N": chain.bodies, "M": system.states, "WITH_FORCE": int(system.with_force)}
    whole |= {"WITH_BASE": int(system.with_base), "WITH_LINE": int(system.with_line)}
    whole |= {"WITH_ADDED": int(system.with_added), "POLYGON": int(chain.polygon)}
    numbers = {"STEP_S": step_s, "LAG_S": lag, "BASE_LENGTH": system.base_length, "OUTER_RADIUS": chain.offset}
    numbers |= {"MIRROR": model.mirror, "VOLUME_RATE": system.volume_rate}
    numbers |= dict(zip(("RESISTANCE", "INERTANCE", "COMPLIANCE", "PIVOT"), system.line, strict=True))
    text = "".join(f"#define {key} {value}\n" for key, value in whole.items())
    text += "".join(f"#define {key} {float(value)!r}\n" for key, value in numbers.items())
    n, count = chain.bodies, system.weights.shape[1]
    text += "\n/* length, mass, centre of mass along and across, inertia, point of the body forces along and across,\n"
    text += " * and along to the mass gained */\n"
    text += f"static const double CHAIN[{n}][8] = {_matrix(system.chain)};\n"
    text += f"static const double GRAVITY[2] = {_matrix(system.gravity)};\n"
    text += f"static const double ARC[{n}] = {_matrix(system.arc)};\n"
    if "POSITION[" in laws_text:
        text += f"static const double POSITION[{n}] = {_matrix(system.position)};\n"
    if "WEIGHT[" in laws_text:
        text += f"static const double WEIGHT[{n}][{count}] = {_matrix(system.weights)};\n"
    return text


def _laws(model: Model, par: FloatArray) -> str:
    """The four functions that the runtime calls."""
    law = compose(model.effects)
    numbers = dict(zip(law.symbols, par, strict=True)) | dict(zip(laws.CONSTANTS, model._constants, strict=True))
    writer = _Writer(law, numbers, dict(zip(law.symbols, law.parameters, strict=True)))
    joint = dict(_JOINT_ITEMS)
    joint |= {state: f"z[{index}]" for index, state in enumerate(law.states)}
    joint |= {weight: f"WEIGHT[j][{index}]" for index, weight in enumerate(law.weights)}
    targets = [(f"out[{index}]", column) for index, column in enumerate(joint_columns(law))]
    arguments = "int j, double theta, double rate, const double *z, double pressure, double *out"
    text = writer.function(f"static void joint_law({arguments})", targets, joint)
    if law.states:
        targets = [
            (f"out[{row}][{column}]", item)
            for row, items in enumerate(relaxed_columns(law))
            for column, item in enumerate(items[:2])
        ]
        arguments = "int j, double theta, const double *z, double pressure, double (*out)[2]"
        text += writer.function(f"static void relaxed_states({arguments})", targets, joint)
    if model.law.has_body_force:
        targets = [
            (f"out[{row}][{column}]", item)
            for row, items in enumerate(force_columns(law))
            for column, item in enumerate(items)
        ]
        head = "static void body_force(double length, const double *motion, double (*out)[5])"
        text += writer.function(head, targets, _FORCE_ITEMS)
    for hook in ("felt_pressure", "line_shift", "stretch"):
        head = f"static void {hook}(double pressure, double *out)"
        text += writer.function(head, [("*out", law.once[hook][0])], {laws.PRESSURE: "pressure"})
    return text
