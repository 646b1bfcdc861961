"""The law of an effect as LaTeX, built from its declaration."""

from __future__ import annotations

import re
from typing import Any

import sympy as sp

from rfea_vision.effects.base import BASE_PARAMETERS, Body, BodyInertia, BodyPlace, Effect, Joint


class _TypesetJoint(Joint):
    """A joint whose composed quantities print as single letters."""

    @property
    def tube_angle(self) -> sp.Expr:
        return sp.Symbol(r"\Theta", real=True)

    @property
    def tube_rate(self) -> sp.Expr:
        return sp.Symbol(r"\dot\Theta", real=True)


def _joint() -> Joint:
    base = {
        name: sp.Symbol({"k_ref": r"k_\mathrm{ref}", "r_hyd": r"r_\mathrm{hyd}"}.get(name, name))
        for name in BASE_PARAMETERS
    }
    names = (r"\theta", r"\dot\theta", "p", r"\sigma", "n", "L_0", "r_o", "r_{i0}", r"\rho_f")
    symbols: list[Any] = [sp.Symbol(name, real=True) for name in names]
    joint = _TypesetJoint(*symbols, base=base)
    joint.expressions.update(
        outer_radius=sp.Symbol("r_o"), inner_radius=sp.Symbol("r_i"), stiffness=sp.Symbol("k"), damping=sp.Symbol("b")
    )
    return joint


def _letters(effect: Effect) -> Any:
    out = {}
    for name in (*effect.parameters, *effect.states, *effect.constants):
        letter = re.sub(r"([A-Za-z])(\d+)$", r"\1_{\2}", name)
        out[getattr(effect, name)] = sp.Symbol(
            {"angle": r"\alpha", "tau_h": r"\tau_h", "tau_c": r"\tau_c"}.get(name, letter)
        )
    return out


def law_lines(effect: Effect) -> list[str]:
    """Equations of the effect, one LaTeX string each."""
    joint, letters = _joint(), _letters(effect)

    def latex(expression: object) -> str:
        return sp.latex(sp.sympify(expression).subs(letters))

    one = sp.Symbol
    lines = []
    for hook, symbol, left in (
        ("outer_radius", one("r_o"), "r_o(p)"),
        ("rubber_volume", one("V_r"), "V_r(p)"),
        ("rest_angle", sp.Integer(0), r"\theta_0"),
        ("stiffness", one("k"), r"k'"),
        ("damping", one("b"), r"b'"),
        ("hydraulic_torque", one(r"\tau_\mathrm{hyd}"), r"\tau_\mathrm{hyd}'"),
    ):
        if effect.overrides(hook):
            lines.append(f"{left} = {latex(getattr(effect, hook)(joint, symbol))}")
    if effect.overrides("joint_torque"):
        lines.append(rf"\tau = {latex(effect.joint_torque(joint))}")
    for state, rate in effect.state_rates(joint).items():
        lines.append(rf"\dot{{{sp.latex(letters[getattr(effect, state)])}}} = {latex(rate)}")
    body = Body(*(one(s, real=True) for s in ("x", "y", r"\dot{x}", r"\dot{y}", r"\Delta L", "r_o", "L", "s")))
    if effect.overrides("added_mass"):
        lines.append(rf"\Delta m = {latex(effect.added_mass(joint))}")
    if effect.overrides("inertia"):
        last: Any = sp.Integer(1)
        place = BodyPlace(one("l"), last, one("r_o"))
        changed = effect.inertia(place, BodyInertia(one("m_b"), one("c"), sp.Integer(0), one("I")))
        lines.append(rf"m_b' = {latex(changed.mass)},\quad d' = {latex(changed.across)}")
    if effect.overrides("gravity"):
        gx, gy = effect.gravity((sp.Integer(0), -one("g")), body)
        lines.append(rf"\mathbf{{g}}' = \left({latex(gx)},\ {latex(gy)}\right)")
    if effect.overrides("body_force"):
        fx, fy = effect.body_force(body)
        lines.append(rf"\mathbf{{F}} = \left({latex(fx)},\ {latex(fy)}\right)")
    if effect.overrides("base_compliance"):
        lines.append(rf"\varphi_0 = -{latex(effect.base_compliance())}\, \tau_0")
    if effect.overrides("felt_pressure"):
        lines.append(rf"p' = {latex(effect.felt_pressure(one('p')))}")
    if effect.overrides("line_time_constant"):
        lines.append(rf"{latex(effect.line_time_constant())}\, \dot{{p}}' = p - p'")
    if effect.overrides("flow_resistance"):
        lines.append(rf"p' = p - {latex(effect.flow_resistance())}\, \dot{{V}}")
    if effect.overrides("flow_inertance"):
        lines.append(rf"p' = p - {latex(effect.flow_inertance())}\, \ddot{{V}}")
    if effect.overrides("observed_position"):
        x, y = effect.observed_position(one("x"), one("y"), one("s"))
        lines.append(rf"x' = {latex(x)},\quad y' = {latex(y)}")
    if effect.overrides("time_shift"):
        lines.append(rf"t' = t + {latex(effect.time_shift(one('t')))}")
    return lines


def typeset(effect: Effect) -> dict[str, str]:
    """Title, law, reference and words of an effect, for the artefacts."""
    return {
        "title": effect.title,
        "latex": effect.law() or r" \\ ".join(law_lines(effect)),
        "reference": effect.reference,
        "text": (type(effect).__doc__ or "").strip(),
        "shows": effect.shows,
        "mistaken_for": effect.mistaken_for,
        "split_by": effect.split_by,
    }
