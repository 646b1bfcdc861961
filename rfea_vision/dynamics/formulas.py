"""Lines of formulas, handed to the compiler as they are: where every number is a float there are no types to be inferred.

Numba takes more than a second over the hundred lines of a law, nine tenths of it to find out what each number is, and to write each
sum as a call of a function. Here, lines are read by Python's own parser and written down in the compiler's language, operation by
operation as Numba would: the results are the same bits.
"""

from __future__ import annotations

import ast
import math
import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

FLOAT, TRUTH, PLACE = ir.DoubleType(), ir.IntType(1), ir.IntType(64)
_OPERATIONS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
#: Beyond it, a whole power is worked out by the library, as in Numba.
_MOST_MULTIPLIED = 0x10000
_KNOWN = (
    *(ast.Module, ast.Assign, ast.Name, ast.Load, ast.Store, ast.Constant, ast.Subscript, ast.Tuple),
    *(ast.BinOp, ast.Pow, *_OPERATIONS, ast.UnaryOp, ast.USub, ast.Not, ast.BoolOp, ast.And, ast.Or),
    *(ast.Compare, *_COMPARED, ast.IfExp, ast.Call),
)


def understood(text: str) -> bool:
    """Whether lines of formulas hold nothing but what can be written down here; the rest is left to Numba."""
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return False
    for node in ast.walk(tree):
        if not isinstance(node, _KNOWN) or (isinstance(node, ast.Constant) and not isinstance(node.value, int | float)):
            return False
        if isinstance(node, ast.Call) and (not isinstance(node.func, ast.Name) or _called(node.func.id) is None):
            return False
    return True


def _called(name: str) -> Any:
    return abs if name == "abs" else getattr(math, name, None)


def formulas(text: str, names: str) -> Any:
    """Return a function of compiled code that runs lines of formulas: (tuple of arguments, row) -> None.

    text : assignments to names and to elements of arrays; `j` is the row
    names : of the arguments, with commas between them: floats and arrays of floats, row by row
    """
    lines = ast.parse(text).body
    arguments = names.replace(",", " ").split()

    @intrinsic
    def run(typing_context, packed, row):
        def generate(context, builder, signature, values):
            given = dict(
                zip(arguments, zip(packed.types, cgutils.unpack_tuple(builder, values[0]), strict=True), strict=True)
            )
            writer = _Writer(context, builder, given, values[1])
            for line in lines:
                writer.assign(line)
            return context.get_dummy_value()

        return types.void(packed, types.int64), generate

    return run


class _Writer:
    """Writes one line after the other; `known` are the numbers that have a name."""

    def __init__(self, context: Any, builder: Any, given: dict[str, tuple[Any, Any]], row: Any) -> None:
        self.context, self.builder, self.row = context, builder, row
        self.arrays = {name: item for name, item in given.items() if isinstance(item[0], types.Array)}
        self.known = {name: value for name, (kind, value) in given.items() if not isinstance(kind, types.Array)}
        self.known |= {name: ir.Constant(FLOAT, getattr(math, name)) for name in ("pi", "e", "inf", "nan")}

    def assign(self, line: Any) -> None:
        (target,) = line.targets
        value = self.write(line.value)
        if isinstance(target, ast.Name):
            self.known[target.id] = value
        else:
            self.builder.store(self.number(value), self.element(target))

    def element(self, node: Any) -> Any:
        indices: list[Any]
        kind, value = self.arrays[node.value.id]
        array = self.context.make_array(kind)(self.context, self.builder, value)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        places = [self.row if isinstance(i, ast.Name) else ir.Constant(PLACE, i.value) for i in indices]
        return cgutils.get_item_pointer(self.context, self.builder, kind, array, places, wraparound=False)

    def number(self, value: Any) -> Any:
        return self.builder.uitofp(value, FLOAT) if value.type == TRUTH else value

    def truth(self, value: Any) -> Any:
        return value if value.type == TRUTH else self.builder.fcmp_unordered("!=", value, ir.Constant(FLOAT, 0.0))

    def write(self, node: Any) -> Any:
        return getattr(self, f"_{type(node).__name__.lower()}")(node)

    def _name(self, node: ast.Name) -> Any:
        return self.known[node.id]

    def _constant(self, node: ast.Constant) -> Any:
        if isinstance(node.value, bool):
            return ir.Constant(TRUTH, node.value)
        return ir.Constant(FLOAT, float(node.value))  # type: ignore[arg-type]

    def _subscript(self, node: ast.Subscript) -> Any:
        return self.builder.load(self.element(node))

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        if isinstance(node.op, ast.Not):
            return self.builder.not_(self.truth(self.write(node.operand)))
        return self.builder.fneg(self.number(self.write(node.operand)))

    def _boolop(self, node: ast.BoolOp) -> Any:
        join = self.builder.and_ if isinstance(node.op, ast.And) else self.builder.or_
        result, *rest = (self.truth(self.write(value)) for value in node.values)
        for value in rest:
            result = join(result, value)
        return result

    def _compare(self, node: ast.Compare) -> Any:
        values = [self.number(self.write(value)) for value in (node.left, *node.comparators)]
        result = ir.Constant(TRUTH, True)
        for kind, left, right in zip(node.ops, values, values[1:], strict=False):
            compare = self.builder.fcmp_unordered if isinstance(kind, ast.NotEq) else self.builder.fcmp_ordered
            result = self.builder.and_(result, compare(_COMPARED[type(kind)], left, right))
        return result

    def _ifexp(self, node: ast.IfExp) -> Any:
        ends = []
        with self.builder.if_else(self.truth(self.write(node.test))) as branches:
            for branch, part in zip(branches, (node.body, node.orelse), strict=True):
                with branch:
                    ends.append((self.write(part), self.builder.block))
        if {value.type for value, _ in ends} == {TRUTH}:
            joined = self.builder.phi(TRUTH)
        else:
            joined = self.builder.phi(FLOAT)
        for value, block in ends:
            if value.type != joined.type:
                with self.builder.goto_block(block):
                    value = self.number(value)
            joined.add_incoming(value, block)
        return joined

    def _binop(self, node: ast.BinOp) -> Any:
        left = self.number(self.write(node.left))
        if isinstance(node.op, ast.Pow):
            power = _whole(node.right)
            return (
                self._call_of(operator.pow, left, self.number(self.write(node.right)))
                if power is None
                else self._power(left, power)
            )
        return getattr(self.builder, _OPERATIONS[type(node.op)])(left, self.number(self.write(node.right)))

    def _power(self, value: Any, power: int) -> Any:
        one = ir.Constant(FLOAT, 1.0)
        result, left = one, abs(power)
        while left:
            if left & 1:
                result = self.builder.fmul(result, value)
            left >>= 1
            value = self.builder.fmul(value, value)
        return self.builder.fdiv(one, result) if power < 0 else result

    def _call(self, node: Any) -> Any:
        return self._call_of(_called(node.func.id), *(self.number(self.write(value)) for value in node.args))

    def _call_of(self, function: Any, *values: Any) -> Any:
        typing = self.context.typing_context
        kind = typing.resolve_value_type(function)
        signature = kind.get_call_type(typing, (types.float64,) * len(values), {})
        result = self.context.get_function(kind, signature)(self.builder, values)
        return self.context.cast(self.builder, result, signature.return_type, types.float64)


def _whole(node: ast.expr) -> int | None:
    sign = 1
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node, sign = node.operand, -1
    if isinstance(node, ast.Constant) and type(node.value) is int and node.value <= _MOST_MULTIPLIED:
        return sign * node.value
    return None
