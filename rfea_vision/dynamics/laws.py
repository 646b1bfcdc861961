"""From effects to one joint law: the paper's torque balance, with every effect's change applied to it, in SymPy.

Source of the base law: eqs. DynInnerRadius, HydraulicTorque, SpringCoefficient and DamperCoefficient of the paper,
parametrised at the rest radius (docs/physics.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import sympy as sp

from rfea_vision.effects.base import (
    BASE_PARAMETERS,
    HOOKS,
    LINE_HOOKS,
    Body,
    BodyInertia,
    BodyPlace,
    Effect,
    EffectParameter,
    Joint,
)
from rfea_vision.effects.hooks import Hook, parts
from rfea_vision.errors import InputError

THETA, RATE = sp.symbols("theta rate", real=True)
PRESSURE = sp.Symbol("pressure", real=True)
POSITION = sp.Symbol("position", nonnegative=True)
COUNT = sp.Symbol("count", positive=True)
ARC = sp.Symbol("arc", positive=True)
OUTER, INNER = sp.symbols("r_o r_i0", positive=True)
FLUID_DENSITY = sp.Symbol("rho_f", positive=True)
TUBE_LENGTH = sp.Symbol("tube_length", positive=True)
LINEAR_DENSITY = sp.Symbol("mu", positive=True)
MIRROR = sp.Symbol("mirror", real=True)
OFFSET, BORE_OFFSET = sp.symbols("offset bore_offset", nonnegative=True)
X, Y, VX, VY = sp.symbols("x y vx vy", real=True)
BODY_LENGTH = sp.Symbol("body_length", positive=True)
IS_LAST = sp.Symbol("is_last", nonnegative=True)
MASS, INERTIA, ALONG = sp.symbols("mass inertia along", positive=True)
ACROSS, GRAVITY, TIME = sp.symbols("across g time", real=True)
#: What the sum of all chambers' pressures is beyond the pressure that bends (Pa): nought of one chamber. It varies within a run.
OPPOSED = sp.Symbol("opposed", real=True)

CONSTANTS: tuple[sp.Symbol, ...] = (
    *(COUNT, OUTER, INNER, FLUID_DENSITY, TUBE_LENGTH, MIRROR, OFFSET, BORE_OFFSET, LINEAR_DENSITY),
    OPPOSED,
)
BASE = {name: sp.Symbol(name, real=True) for name in BASE_PARAMETERS}

#: What hooks are given by the name of the argument, beside the joint and what is composed at it.
GIVEN: dict[str, Any] = {
    "body": Body(X, Y, VX, VY, BODY_LENGTH, OUTER, TUBE_LENGTH, MIRROR),
    "place": BodyPlace(BODY_LENGTH, IS_LAST, OFFSET),
    "inertia": BodyInertia(MASS, ALONG, ACROSS, INERTIA),
    "gravity": (sp.Integer(0), -GRAVITY),
    "pressure": PRESSURE,
    "rest_outer_radius": OFFSET,
    "x": X,
    "y": Y,
    "mirror": MIRROR,
    "time": TIME,
}
ONCE = {name: hook for name, hook in HOOKS.items() if hook.once}


class _Nothing(Effect):
    """Changes nothing: what the hooks are without any effect."""

    id = "nothing"
    parameters: ClassVar[dict[str, EffectParameter]] = {}


#: Springs and dampers are the paper's down to this share of their value at rest, and never fall below half of it: a tube
#: that swings past straight, or bends further than it was ever seen to, is still held and still comes to rest.
LEAST_SHARE = sp.Rational(1, 20)
#: The bore is the paper's as long as the arc keeps this share of the shortening that would close it, and never closes.
OPEN_SHARE = sp.Rational(1, 5)
#: What flows out as a joint bends back is taken off at the joint, and never more than this share of its arc's mass: a chain of
#: links of mass mu h with w taken off at each hinge keeps a positive mass matrix, however it is bent, as long as
#: w < 7/24 mu h (a link that moves as a straight line holds mu h / 6 for either end; the last half link mu h / 8).
MOST_OUTFLOW = sp.Rational(1, 4)


def kept_above(value: sp.Expr, knee: Any, depth: Any) -> sp.Expr:
    """`value` where it is above `knee`; below, on twice differentiable, a curve that never falls by `depth` below the knee."""
    below = knee - value
    return sp.Piecewise((value, value >= knee), (knee - depth + depth**3 / (depth**2 + depth * below + below**2), True))


def _kept_positive(value: sp.Expr, at_rest: sp.Symbol) -> sp.Expr:
    """A coefficient that stays positive wherever the tube goes; `at_rest` is its scale."""
    knee = LEAST_SHARE * sp.Abs(at_rest)
    return kept_above(value, knee, knee / 2)


@dataclass(frozen=True)
class ComposedLaw:
    """The composed expressions and the order of parameters and states."""

    effects: tuple[str, ...]  # in the order of their parameters, states and weights: see `laid_out`
    parameters: tuple[str, ...]  # "k_ref", ..., "maxwell.k1", ...
    symbols: tuple[sp.Symbol, ...]
    states: tuple[sp.Symbol, ...]
    weights: tuple[sp.Symbol, ...]  # one per effect: 1 where it acts, 0 where it does not
    torque: sp.Expr
    state_rates: tuple[sp.Expr, ...]
    relaxed: tuple[sp.Expr, ...]
    added_mass: sp.Expr
    body_force: tuple[sp.Expr, sp.Expr]
    once: dict[str, tuple[sp.Expr, ...]]  # hook evaluated once a run -> its values
    active: frozenset[str]  # those of them that an effect changes
    lines: dict[str, dict[str, tuple[sp.Expr, ...]]]  # chamber with effects of its own -> hook of its line -> values


def _base_joint(effects: Sequence[Effect]) -> Joint:
    joint = Joint(THETA, RATE, PRESSURE, POSITION, COUNT, ARC, OUTER, INNER, FLUID_DENSITY, BASE, opposed=OPPOSED)
    outer: sp.Expr = OUTER
    rubber: sp.Expr = sp.Integer(1)
    for effect in effects:
        outer = effect.outer_radius(joint, outer)
        rubber = effect.rubber_volume(joint, rubber)
    joint.expressions["outer_radius"] = outer
    # Eq. InnerRadius: the rubber of one arc keeps its volume while the centre line grows by r_o theta;
    # a beam keeps its section.
    closed = (OUTER**2 - INNER**2) * rubber / outer**2
    spare = OPEN_SHARE * (1 - closed)
    inner = outer * sp.sqrt(1 - closed / kept_above(1 + BORE_OFFSET * THETA / ARC, closed + spare, spare / 2))
    joint.expressions["inner_radius"] = inner
    stiffness: sp.Expr = BASE["k_ref"] + BASE["k_slope"] * (inner - INNER)
    for effect in effects:
        stiffness = effect.stiffness(joint, stiffness)
    joint.expressions["stiffness"] = _kept_positive(stiffness, BASE["k_ref"])
    rest: sp.Expr = sp.Integer(0)
    for effect in effects:
        rest = effect.rest_angle(joint, rest)
    joint.expressions["rest_angle"] = rest
    ways = []
    for way in ("b_pos", "b_neg"):
        damping: sp.Expr = BASE[f"{way}_ref"] + BASE[f"{way}_slope"] * (inner - INNER)
        for effect in effects:
            damping = effect.damping(joint, damping)
        ways.append(_kept_positive(damping, BASE[f"{way}_ref"]))
    # A tube bends to the side of its bore: one damper bends it further, the other straightens it. A beam has one.
    joint.expressions["damping"] = sp.Piecewise((ways[0], RATE >= 0), (ways[1], BORE_OFFSET > 0), (ways[0], True))
    return joint


def _joint_torque(joint: Joint, effects: Sequence[Effect]) -> sp.Expr:
    hydraulic: sp.Expr = PRESSURE * sp.pi * joint.inner_radius**2 * BASE["r_hyd"]
    added: sp.Expr = sp.Integer(0)
    felt: sp.Expr = PRESSURE
    for effect in effects:
        hydraulic = effect.hydraulic_torque(joint, hydraulic)
        added = added + effect.joint_torque(joint)
        felt = effect.joint_pressure(joint, felt)
    torque = hydraulic - joint.stiffness * (THETA - joint.rest_angle) - joint.damping * RATE + added
    return torque.subs(PRESSURE, felt) if felt != PRESSURE else torque


def laid_out(effects: Sequence[Effect]) -> list[Effect]:
    """Effects in the order of their parameters: those that act at every step of a run first, by name.

    What is compiled for every step is then the same text whatever else a model has, and compiled once.
    """
    stepwise = [effect for effect in effects if effect.acts_at_every_step()]
    return sorted(stepwise, key=lambda effect: effect.id) + [effect for effect in effects if effect not in stepwise]


def compose(effects: Sequence[Effect]) -> ComposedLaw:
    """Apply every effect to the paper's law, by name: the same effects are the same law, in whatever order they were added.

    Raises
    ------
    InputError
        Two effects of the same id, or a hook that returns something else than a SymPy expression.
    """
    ids = [effect.id for effect in effects]
    if len(set(ids)) != len(ids):
        raise InputError(f"effects {ids}: each effect can be added once; remove the repeated one")
    by_name = sorted(effects, key=lambda effect: effect.id)
    joint = _base_joint(by_name)
    torque = _joint_torque(joint, by_name)
    layout = laid_out(effects)
    weights = {effect.id: sp.Symbol(f"weight__{effect.id}", real=True) for effect in layout}
    names, symbols, states = list(BASE_PARAMETERS), list(BASE.values()), list[sp.Symbol]()
    rates, relaxed = list[sp.Expr](), list[sp.Expr]()
    force: tuple[sp.Expr, sp.Expr] = (sp.Integer(0), sp.Integer(0))
    mass: sp.Expr = sp.Integer(0)
    numbers: Any = {}
    for effect in layout:
        names += [f"{effect.id}.{name}" for name in effect.symbol_map()]
        symbols += effect.symbol_map().values()
        numbers.update({getattr(effect, name): sp.Float(value) for name, (_, value) in effect.constants.items()})
        for state, rate, at_rest in _states_of(effect, joint):
            states.append(state)
            rates.append(rate)
            relaxed.append(at_rest)
        fx, fy = effect.body_force(GIVEN["body"])
        force = (force[0] + fx, force[1] + fy)
        mass = mass + effect.added_mass(joint)
    if mass != 0:
        most = MOST_OUTFLOW * LINEAR_DENSITY * ARC
        mass = kept_above(mass, -most / 2, most / 2)
    place_in_joint = _acting_by_weight(layout, weights)

    def final(expression: Any) -> Any:
        return sp.sympify(expression).xreplace(numbers)

    def in_joint(expression: Any) -> Any:
        return final(expression).xreplace(place_in_joint)

    def values(hook: str, among: Sequence[Effect]) -> tuple[sp.Expr, ...]:
        return tuple(final(value) for value in composed(HOOKS[hook], among))

    common = [effect for effect in by_name if not effect.chamber]
    chambers = dict.fromkeys(effect.chamber for effect in effects if effect.chamber)
    return ComposedLaw(
        effects=tuple(effect.id for effect in layout),
        parameters=tuple(names),
        symbols=tuple(symbols),
        states=tuple(states),
        weights=tuple(weights.values()),
        torque=in_joint(torque),
        state_rates=tuple(in_joint(rate) for rate in rates),
        relaxed=tuple(in_joint(value) for value in relaxed),
        added_mass=in_joint(mass),
        body_force=(final(force[0]), final(force[1])),
        once={name: values(name, common) for name in ONCE},
        active=frozenset(name for name in ONCE if any(effect.overrides(name) for effect in common)),
        lines={
            chamber: {
                name: values(name, [effect for effect in by_name if effect.chamber == chamber]) for name in LINE_HOOKS
            }
            for chamber in chambers
        },
    )


def _states_of(effect: Effect, joint: Joint) -> list[tuple[sp.Symbol, sp.Expr, sp.Expr]]:
    """The hidden states of an effect at a joint: symbol, rate, and value at rest."""
    rates, relaxed = effect.state_rates(joint), effect.relaxed_states(joint)
    for state in effect.states:
        if state not in rates or state not in relaxed:
            raise InputError(f"effect {effect.id}: state '{state}' needs an entry in state_rates and relaxed_states")
    return [
        (getattr(effect, state), sp.sympify(rates[state]), sp.sympify(relaxed[state])) for state in effect.states
    ]


def _acting_by_weight(effects: Sequence[Effect], weights: Mapping[str, sp.Symbol]) -> dict[sp.Symbol, sp.Expr]:
    """What stands for each parameter at a joint at which its effect acts by its weight: 0 makes it absent."""
    return {
        symbol: absent + weights[effect.id] * (symbol - absent)
        for effect in effects
        for name, symbol in effect.symbol_map().items()
        if (absent := effect.parameters[name].absent) is not None
    }


def composed(hook: Hook, effects: Sequence[Effect]) -> tuple[sp.Expr, ...]:
    """The values of a hook that is evaluated once a run, with what every effect does to it."""
    width = len(hook.units)
    present = hook.values(_Nothing(), GIVEN)
    for effect in reversed(effects) if hook.inwards else effects:
        if not hook.passes_on:
            present = tuple(old + new for old, new in zip(present, hook.values(effect, GIVEN), strict=True))
        elif hook.arguments[:width] == hook.of:  # the values themselves are the arguments
            present = hook.values(effect, {**GIVEN, **dict(zip(hook.of, present, strict=True))})
        else:  # a pair, or a record of values
            record = hook.of[0]
            whole = present if isinstance(GIVEN[record], tuple) else type(GIVEN[record])(*present)
            present = hook.values(effect, {**GIVEN, record: whole})
    return present


def own_symbols(hook: Hook) -> tuple[sp.Symbol, ...]:
    """Symbols that a hook evaluated once a run is a function of."""
    free = [part.free_symbols for name in hook.of for part in parts(GIVEN[name])]
    return tuple(symbol for symbols in free for symbol in symbols if symbol not in CONSTANTS)
