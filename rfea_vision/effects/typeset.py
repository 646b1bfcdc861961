"""The law of an effect as LaTeX, built from its declaration."""

from __future__ import annotations

import re
from typing import Any

import sympy as sp

from rfea_vision.effects.base import BASE_PARAMETERS, HOOKS, Body, BodyInertia, BodyPlace, Effect, Joint
from rfea_vision.effects.hooks import ARGUMENTS


class _TypesetJoint(Joint):
    """A joint whose composed quantities print as single letters."""

    @property
    def tube_angle(self) -> sp.Expr:
        return sp.Symbol(r"\Theta", real=True)

    @property
    def tube_rate(self) -> sp.Expr:
        return sp.Symbol(r"\dot\Theta", real=True)

    @property
    def total_pressure(self) -> sp.Expr:
        return sp.Symbol(r"p_\Sigma", real=True)


def _joint() -> Joint:
    base = {
        name: sp.Symbol({"k_ref": r"k_\mathrm{ref}", "r_hyd": r"r_\mathrm{hyd}"}.get(name, name))
        for name in BASE_PARAMETERS
    }
    names = (r"\theta", r"\dot\theta", "p", r"\sigma", "n", "L_0", "r_o", "r_{i0}", r"\rho_f")
    symbols: list[Any] = [sp.Symbol(name, real=True) for name in names]
    joint = _TypesetJoint(*symbols, base=base)
    joint.expressions.update(
        outer_radius=sp.Symbol("r_o"), inner_radius=sp.Symbol("r_i"), rest_angle=sp.Symbol(r"\theta_0"),
        stiffness=sp.Symbol("k"), damping=sp.Symbol("b"),
    )
    return joint


def _letters(effect: Effect) -> Any:
    out = {}
    for name in (*effect.parameters, *effect.states, *effect.constants):
        letter = re.sub(r"([A-Za-z])(\d+)$", r"\1_{\2}", name)
        if letter.isalpha() and len(letter) > 2:
            letter = rf"\mathrm{{{letter}}}"
        out[getattr(effect, name)] = sp.Symbol(
            {"angle": r"\alpha", "tau_h": r"\tau_h", "tau_c": r"\tau_c"}.get(name, letter)
        )
    return out


def law_lines(effect: Effect) -> list[str]:
    """Equations of the effect, one LaTeX string each."""
    joint, letters = _joint(), _letters(effect)

    def latex(expression: object) -> str:
        return sp.latex(sp.sympify(expression).subs(letters))

    def one(letter: str) -> Any:
        return sp.Symbol(letter, real=True)

    given: dict[str, Any] = {name: one(letter) for name, (_, letter) in ARGUMENTS.items()}
    given |= {
        "joint": joint,
        "angle": sp.Integer(0),
        "body": Body(*(one(letter) for letter in ("x", "y", r"\dot{x}", r"\dot{y}", r"\Delta L", "r_o", "L", "s"))),
        "place": BodyPlace(one("l"), sp.Integer(1), one("r_o")),  # type: ignore[arg-type]
        "inertia": BodyInertia(one("m_b"), one("c"), sp.Integer(0), one("I")),
        "gravity": (sp.Integer(0), -one("g")),
    }
    lines = [
        hook.latex.format(*(latex(value) for value in hook.values(effect, given)))
        for name, hook in HOOKS.items()
        if effect.overrides(name)
    ]
    rates = effect.state_rates(joint).items()
    return lines + [rf"\dot{{{sp.latex(letters[getattr(effect, state)])}}} = {latex(rate)}" for state, rate in rates]


def typeset(effect: Effect) -> dict[str, str]:
    """Title, law, reference and words of an effect, for the artefacts."""
    return {
        "title": effect.title,
        "latex": effect.law() or r" \\ ".join(law_lines(effect)),
        "reference": effect.reference,
        "text": (type(effect).__doc__ or "").strip(),
        "shows": effect.shows,
        "mistaken_for": effect.mistaken_for,
        "imitated_by": effect.imitated_by,
        "split_by": effect.split_by,
    }
