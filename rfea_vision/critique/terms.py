"""The terms of a proposed law: their values along a run, and the effect file that says the same in the words that people write."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from rfea_vision.arrays import FloatArray

#: Relaxation times of the memories on offer (s): a log of four apart, from a fast damper's to a slow creep's.
MEMORIES_S = (0.3, 1.2, 5.0)
#: Angles over which a loop of rubbing builds up (rad of the whole tube): the grid of `hysteresis`.
LOOPS_RAD = (0.05, 0.2, 0.8)
#: Rate at which the direction of motion counts as turned (rad/s of the whole tube): that of `coulomb`.
TURNED = 0.05
#: Middles of the places at which a term may act alone.
SPOTS = (0.2, 0.35, 0.5, 0.65, 0.8)
#: Bounds of a fitted coefficient, in times of what it starts from.
ROOM = 10.0


@dataclass(frozen=True)
class Term:
    """One term of the library: its law in the words of an effect file, and its values (grid, n) along each run."""

    law: str
    words: str
    values: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Trajectory:
    """How the model goes through one run, on the grid of its pressure: s (grid,), rad and rad/s (grid, n), Pa (grid,)."""

    time: FloatArray
    theta: FloatArray
    rate: FloatArray
    pressure: FloatArray


def library(trajectories: Sequence[Trajectory]) -> list[Term]:
    """All terms: a quantity, alone and with the place along the tube."""
    each = [_quantities(trajectory) for trajectory in trajectories]
    places = {
        "": ("", np.ones_like),
        " * (1 - s)": (" near the clamp", lambda place: 1 - place),
        " * s": (" near the tip", lambda place: place),
    }
    for at in SPOTS:
        places[f" * exp(-((s - {at}) / 0.1)**2)"] = (f" at {100 * at:.0f} % of the length", partial(_near, at=at))
    terms = []
    for law, (words, _) in each[0].items():
        for factor, (where, shape) in places.items():
            values = []
            for quantities, trajectory in zip(each, trajectories, strict=True):
                n = trajectory.theta.shape[1]
                values.append(quantities[law][1] * shape((np.arange(n) + 0.5) / n))
            terms.append(Term(law + factor, words + where, tuple(values)))
    return terms


def _quantities(trajectory: Trajectory) -> dict[str, tuple[str, FloatArray]]:
    """Law and words of every quantity with its values (grid, n): a, r, p, t, m, z and h stand for what `effect_source` declares."""
    n = trajectory.theta.shape[1]
    a, r = n * trajectory.theta, n * trajectory.rate
    p = np.broadcast_to(trajectory.pressure[:, None] / 1e5, a.shape)
    t = np.broadcast_to((trajectory.time - trajectory.time[0])[:, None], a.shape)
    most = np.maximum.accumulate(np.abs(a), axis=0)
    out: dict[str, tuple[str, FloatArray]] = {
        "1": ("a constant torque", np.ones_like(a)),
        "a": ("the angle", a),
        "a * Abs(a)": ("the angle times its size", a * np.abs(a)),
        "a**3": ("the cube of the angle", a**3),
        "cos(a)": ("the cosine of the angle", np.cos(a)),
        "r": ("the rate", r),
        "r * Abs(r)": ("the rate times its size", r * np.abs(r)),
        "r * a": ("the rate times the angle", r * a),
        f"tanh(r / {TURNED})": ("the direction of motion", np.tanh(r / TURNED)),
        "p": ("the pressure", p),
        "p * a": ("the pressure times the angle", p * a),
        "p**2": ("the square of the pressure", p**2),
        "m": ("the largest bend so far", most),
        "m * a": ("the angle times the largest bend so far", most * a),
        "t": ("the time into the run", t),
        "t * a": ("the angle times the time into the run", t * a),
    }
    for k, period in enumerate(MEMORIES_S):
        z = _relaxed(trajectory.time, a, period)
        out[f"(a - z{k})"] = (f"the angle less its memory of {period:g} s", a - z)
    for k, width in enumerate(LOOPS_RAD):
        out[f"h{k}"] = (f"a loop of rubbing over {width:g} rad", _rubbed(a, width))
    return out


def _relaxed(time: FloatArray, values: FloatArray, period: float) -> FloatArray:
    out = np.empty_like(values)
    out[0] = values[0]
    for k in range(1, time.size):
        decay = np.exp(-(time[k] - time[k - 1]) / period)
        out[k] = decay * out[k - 1] + (1 - decay) * 0.5 * (values[k] + values[k - 1])
    return out


def _rubbed(values: FloatArray, width: float) -> FloatArray:
    """Friction that builds up over a width, from 0 at rest to 1 (Dahl 1968): h' = (r - |r| h) / width, whatever the rate."""
    out = np.zeros_like(values)
    for k in range(1, len(values)):
        step = values[k] - values[k - 1]
        way = np.sign(step)
        out[k] = way + (out[k - 1] - way) * np.exp(-np.abs(step) / width)
    return out


def _near(place: FloatArray, at: float) -> FloatArray:
    return np.exp(-(((place - at) / 0.1) ** 2))


def listed(terms: Sequence[Term]) -> str:
    """Terms in words."""
    return " and ".join(term.words for term in terms)


class _State(NamedTuple):
    """What a law remembers: the unit, the rate and the value at rest, and how the law writes it."""

    name: str
    unit: str
    rate: str
    relaxed: str
    written: str


def _states(text: str) -> list[_State]:
    """The states that laws name."""
    words, found = _words(text), []
    if "m" in words:
        rate = "sp.Piecewise(((sp.Abs(joint.tube_angle) - self.m) / self.follow, sp.Abs(joint.tube_angle) > self.m), (0, True))"
        found.append(_State("m", "rad", rate, "sp.Abs(joint.tube_angle)", "self.m"))
    if "t" in words:
        found.append(_State("t", "s", "sp.Integer(1)", "sp.Integer(0)", "self.t / self.second"))
    for k in [k for k in range(len(MEMORIES_S)) if f"z{k}" in text]:
        rate = f"(joint.tube_angle - self.z{k}) / ({MEMORIES_S[k]} * self.second)"
        found.append(_State(f"z{k}", "rad", rate, "joint.tube_angle", f"self.z{k}"))
    for k in [k for k in range(len(LOOPS_RAD)) if f"h{k}" in words]:
        rate = f"(joint.tube_rate - sp.Abs(joint.tube_rate) * self.h{k}) / {LOOPS_RAD[k]}"
        found.append(_State(f"h{k}", "1", rate, "sp.Integer(0)", f"self.h{k}"))
    return found


def effect_source(effect_id: str, terms: Sequence[Term], coefficients: Sequence[float]) -> str:
    """The law as an effect file, as people write it by hand."""
    laws = [term.law for term in terms]
    text = " ".join(laws)
    states = _states(text)
    names = [f"{state.name} = {state.written}" for state in states]
    for name, meaning in (
        ("a", "joint.tube_angle"), ("r", "joint.tube_rate * self.second"), ("p", "joint.pressure / self.bar"), ("s", "joint.position"),
    ):  # fmt: skip
        if name in _words(text):
            names.append(f"{name} = {meaning}")
    parameters = []
    for k, (term, value) in enumerate(zip(terms, coefficients, strict=True), 1):
        limit = ROOM * max(abs(value), 1e-9)
        parameters.append(
            f'"c{k}": EffectParameter("N*m", 0.0, {-limit:.6g}, {limit:.6g}, {value:.6g}, "{term.words}"),'
        )
    sum_ = " + ".join(f"self.c{k} * {_sympy(law)}" for k, law in enumerate(laws, 1))
    join = "\n        ".join
    hooks, apart = "", ",\n            "
    if states:
        hooks = f"""
    states = {{{", ".join(f'"{state.name}": "{state.unit}"' for state in states)}}}

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        return {{
            {apart.join(f'"{state.name}": {state.rate}' for state in states)},
        }}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {{
            {apart.join(f'"{state.name}": {state.relaxed}' for state in states)},
        }}
"""
    return f'''"""A law for what the model leaves, as `rfea propose` has found it: {listed(terms)}."""

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class Proposed(Effect):
    """Torque per joint: {" + ".join(f"c{k} {law}" for k, law in enumerate(laws, 1))}.

    a is the tube's angle (rad), r its rate (rad/s), p the pressure (bar), s the place from clamp to tip, t the time (s),
    m the largest angle so far, z0.. the angle as it was remembered, h0.. a loop of rubbing (Dahl 1968).
    """

    id = "{effect_id}"
    title = "Proposed: torque that goes with {listed(terms)}"
    reference = "regression of what the model leaves; give the cause a name and a reference"
    parameters = {{
        {join(parameters)}
    }}
    constants = {{"second": ("s", 1.0), "bar": ("Pa", 1e5), "follow": ("s", 0.0002)}}
{hooks}
    def joint_torque(self, joint: Joint) -> sp.Expr:
        {join(names) if names else "pass"}
        return {sum_}
'''


def _words(text: str) -> set[str]:
    return set(re.findall(r"[a-z]\w*", text))


def _sympy(law: str) -> str:
    return re.sub(r"\b(tanh|cos|exp|Abs)\b", r"sp.\1", f"({law})" if "-" in law or "+" in law else law)


__all__ = ["Term", "Trajectory", "effect_source", "library", "listed"]
