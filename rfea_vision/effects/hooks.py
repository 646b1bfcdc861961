"""What is known of a hook beside its method: one declaration, read by composition, unit checks, typesetting and tests.

A hook is a method of `Effect` under `hook`. Its arguments are told by their names; `ARGUMENTS` says what each is.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass
from typing import Any, TypeVar

_Method = TypeVar("_Method", bound=Callable[..., Any])

#: Arguments that are plain quantities: unit, and letter of the typeset law. The others (joint, body, place) are in `base`.
ARGUMENTS: dict[str, tuple[str, str]] = {
    "radius": ("m", "r_o"),
    "fraction": ("1", "V_r"),
    "angle": ("rad", r"\theta_0"),
    "stiffness": ("N*m", "k"),
    "damping": ("N*m*s", "b"),
    "torque": ("N*m", r"\tau_\mathrm{hyd}"),
    "pressure": ("Pa", "p"),
    "rest_outer_radius": ("m", "r_o"),
    "x": ("m", "x"),
    "y": ("m", "y"),
    "mirror": ("1", "s"),
    "time": ("s", "t"),
}


@dataclass(frozen=True)
class Hook:
    """One part of the model that an effect may change.

    Attributes
    ----------
    name, arguments : of the method
    units : of each of the values that it returns
    latex : the typeset law, ``{0}``, ``{1}`` standing for the values
    once : whether it is evaluated once a run, as a NumPy function of the arguments in `of`; else at every step
    of : arguments of which the value is a function within a run, in the order of that function's own arguments
    passes_on : whether the present value goes in first and the changed one comes out; else what effects give is added up
    inwards : whether of two effects the last acts first (from the file to the tube)
    """

    name: str
    arguments: tuple[str, ...]
    units: tuple[str, ...]
    latex: str
    once: bool
    of: tuple[str, ...]
    passes_on: bool
    inwards: bool

    def values(self, effect: Any, given: dict[str, Any]) -> tuple[Any, ...]:
        """Return what an effect gives for these arguments, one value for each of `units`."""
        return parts(getattr(effect, self.name)(*(given[name] for name in self.arguments)))


def parts(value: Any) -> tuple[Any, ...]:
    """Return the values of a hook that gives one, a pair, or a record of them."""
    if is_dataclass(value) and not isinstance(value, type):
        return tuple(vars(value).values())
    return tuple(value) if isinstance(value, tuple) else (value,)


def hook(
    *units: str, latex: str, of: tuple[str, ...] | None = None, passes_on: bool = False, inwards: bool = False
) -> Callable[[_Method], _Method]:
    """Declare a method of `Effect` as a hook; see `Hook`. With `of`, even if empty, it is evaluated once a run."""

    def declare(method: _Method) -> _Method:
        arguments = tuple(inspect.signature(method).parameters)[1:]
        declared = Hook(method.__name__, arguments, units, latex, of is not None, of or (), passes_on, inwards)
        method.hook = declared  # type: ignore[attr-defined]
        return method

    return declare


def hooks_of(kind: type) -> dict[str, Hook]:
    """Return every hook that a class declares, by name, in the order of declaration."""
    return {name: item.hook for name, item in vars(kind).items() if hasattr(item, "hook")}


__all__ = ["ARGUMENTS", "Hook", "hook", "hooks_of", "parts"]
