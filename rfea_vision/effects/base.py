"""What an effect is: the parts of the model that it changes, its law in SymPy, and the words that go with it.

An effect is one file with one subclass of `Effect`. It overrides the hooks it needs; every hook receives the present
expression and returns the new one. Effects stack by name, in whatever order they are asked for. Derivatives, compiled code and the
typeset law come from that single declaration. Every amplitude has a value at which the effect is absent, so that the
model without it is truly nested in the model with it.

Symbols (SI units; for one joint j, clamp to tip):

=============  ==================================================================================================
theta, rate    joint angle (rad) and its rate (rad/s)
tube_angle     n theta: the angle that the whole tube would have at this curvature (independent of n)
tube_rate      n rate
pressure       pressure that the joint feels (Pa, gauge); of several chambers what bends, their sum with their signs
total_pressure sum of the pressures in all chambers (Pa, gauge); of one chamber the same
position       material coordinate of the joint, 0 at the clamp, 1 at the tip
=============  ==================================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import ClassVar

import sympy as sp

from rfea_vision.effects.hooks import hook, hooks_of

BASE_PARAMETERS: tuple[str, ...] = ("k_ref", "k_slope", "b_pos_ref", "b_pos_slope", "b_neg_ref", "b_neg_slope", "r_hyd")
BASE_UNITS: dict[str, str] = {
    "k_ref": "N*m/rad",
    "k_slope": "N/rad",
    "b_pos_ref": "N*m*s/rad",
    "b_pos_slope": "N*s/rad",
    "b_neg_ref": "N*m*s/rad",
    "b_neg_slope": "N*s/rad",
    "r_hyd": "m",
}


#: Kinds of bodies without a bore, about which some laws are.
BEAMS = ("rod", "rectangle", "custom")


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect, in SI units.

    Attributes
    ----------
    unit : SI unit as pint reads it
    absent : value at which the effect is not there; None for a parameter that vanishes with the amplitude
        (a time constant, a loop width, the place of a wall)
    lower, upper : what physics allows
    start : where a refit starts; for a parameter without `absent` the first of `grid` is used in its place
    grid : values to screen when the parameter vanishes with the amplitude (Davies' problem)
    display : unit in which people read it
    """

    unit: str
    absent: float | None
    lower: float
    upper: float
    start: float
    text: str
    grid: tuple[float, ...] = ()
    display: str | None = None


@dataclass(frozen=True)
class Joint:
    """Symbols and expressions that the joint hooks may use."""

    theta: sp.Symbol
    rate: sp.Symbol
    pressure: sp.Symbol
    position: sp.Symbol
    count: sp.Symbol
    rest_length: sp.Symbol
    rest_outer_radius: sp.Symbol
    rest_inner_radius: sp.Symbol
    fluid_density: sp.Symbol
    base: dict[str, sp.Symbol]
    expressions: dict[str, sp.Expr] = field(default_factory=dict)
    opposed: sp.Expr = sp.S.Zero

    @property
    def total_pressure(self) -> sp.Expr:
        """Sum of the pressures in all chambers, whatever their signs; of one chamber its pressure."""
        return self.pressure + self.opposed

    @property
    def tube_angle(self) -> sp.Expr:
        """Angle (rad) that the whole tube would have at this curvature."""
        return self.count * self.theta

    @property
    def tube_rate(self) -> sp.Expr:
        """Its rate (rad/s)."""
        return self.count * self.rate

    @property
    def outer_radius(self) -> sp.Expr:
        """Outer radius (m) under pressure."""
        return self.expressions["outer_radius"]

    @property
    def inner_radius(self) -> sp.Expr:
        """Inner radius (m) under pressure."""
        return self.expressions["inner_radius"]

    @property
    def rest_angle(self) -> sp.Expr:
        """Angle at which the spring is at rest (rad); known where damping and torques are asked for."""
        return self.expressions["rest_angle"]

    @property
    def stiffness(self) -> sp.Expr:
        """Spring coefficient (N m/rad) that the stiffness hooks left; known where torques are asked for."""
        return self.expressions["stiffness"]

    @property
    def damping(self) -> sp.Expr:
        """Damper coefficient (N m s/rad) that the damping hooks left; known where torques are asked for."""
        return self.expressions["damping"]


@dataclass(frozen=True)
class Body:
    """Symbols that the body hooks may use: position (m) and velocity (m/s) of the body's middle on the centre line.

    In the dynamics a tube bends towards -x; the recording of one that bends right is mirrored on the way in.
    `mirror` is +1 or -1 accordingly, for what belongs to the camera or the room and not to the tube.
    """

    x: sp.Symbol
    y: sp.Symbol
    vx: sp.Symbol
    vy: sp.Symbol
    rest_length: sp.Symbol
    rest_outer_radius: sp.Symbol
    tube_length: sp.Symbol
    mirror: sp.Symbol


@dataclass(frozen=True)
class BodyInertia:
    """Mass (kg), centre of mass along the hinge line and across it towards the outside (m), inertia about it (kg m^2)."""

    mass: sp.Expr
    along: sp.Expr
    across: sp.Expr
    inertia: sp.Expr


@dataclass(frozen=True)
class BodyPlace:
    """Where a body sits: its rest length, whether it is the last one (1 or 0), and how far the centre line lies outside."""

    length: sp.Symbol
    is_last: sp.Symbol
    rest_outer_radius: sp.Symbol


class Effect:
    """Base of every effect. Subclasses set the class attributes and override the hooks they need."""

    id: ClassVar[str]
    form: ClassVar[str] = ""  # of a subclass that states the same physics by another formula: asked for as id:form
    title: ClassVar[str]
    reference: ClassVar[str]
    shows: ClassVar[str] = ""
    mistaken_for: ClassVar[str] = ""
    imitated_by: ClassVar[str] = ""  # a cause outside of the catalogue, as common, that moves the tube in the same way
    split_by: ClassVar[str] = ""
    kind: ClassVar[str] = "tube"  # tube | load | pressure | measurement
    parameters: ClassVar[dict[str, EffectParameter]]
    states: ClassVar[dict[str, str]] = {}  # name to unit
    constants: ClassVar[dict[str, tuple[str, float]]] = {}  # name to unit and value: numbers that have a unit
    dissipates: ClassVar[bool] = False
    source_text: ClassVar[str | None] = None  # of a user's file
    exactly_tied_to: ClassVar[tuple[str, ...]] = ()
    #: Kinds of sections in which the critique does not look for it.
    not_of: ClassVar[tuple[str, ...]] = ()
    needs_tendon: ClassVar[bool] = False  # whether the critique looks for it only where a tendon pulls
    goes_with: ClassVar[tuple[str, ...]] = ()  # effects without which this one is no candidate
    # of an effect of the line that acts on one of several chambers alone; asked for as id@chamber
    chamber: ClassVar[str] = ""
    # parameters that then mean something else, and have other bounds
    of_chamber: ClassVar[dict[str, EffectParameter]] = {}

    def __init__(self) -> None:
        own = "".join(c if c.isalnum() else f"_{ord(c):x}_" for c in self.id) if self.chamber else self.id
        self._symbols = {
            name: sp.Symbol(f"{own}__{name}", real=True) for name in (*self.parameters, *self.states, *self.constants)
        }

    def scaled(self, times: Mapping[str, float]) -> Effect:
        """The same effect whose parameters of these units have bounds and starts so many times as large."""
        other = copy(self)
        vars(other)["parameters"] = {
            name: replace(spec, lower=spec.lower * by, upper=spec.upper * by, start=spec.start * by)
            for name, spec in self.parameters.items()
            for by in (times.get(spec.unit, 1.0),)
        }
        return other

    def __getattr__(self, name: str) -> sp.Symbol:
        symbols = self.__dict__.get("_symbols", {})
        if name in symbols:
            return symbols[name]
        raise AttributeError(f"effect {type(self).__name__} has no parameter, state or hook '{name}'")

    # joint law ---------------------------------------------------------------------------------------------------
    @hook("m", latex="r_o(p) = {0}", passes_on=True)
    def outer_radius(self, joint: Joint, radius: sp.Expr) -> sp.Expr:
        """Outer radius (m)."""
        return radius

    @hook("1", latex="V_r(p) = {0}", passes_on=True)
    def rubber_volume(self, joint: Joint, fraction: sp.Expr) -> sp.Expr:
        """Volume of rubber over its volume at rest (incompressible: 1)."""
        return fraction

    @hook("rad", latex=r"\theta_0 = {0}", passes_on=True)
    def rest_angle(self, joint: Joint, angle: sp.Expr) -> sp.Expr:
        """Angle at which the spring is at rest (rad)."""
        return angle

    @hook("N*m", latex="k' = {0}", passes_on=True)
    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        """Spring coefficient (N m/rad)."""
        return stiffness

    @hook("N*m*s", latex="b' = {0}", passes_on=True)
    def damping(self, joint: Joint, damping: sp.Expr) -> sp.Expr:
        """Damper coefficient (N m s/rad)."""
        return damping

    @hook("N*m", latex=r"\tau_\mathrm{{hyd}}' = {0}", passes_on=True)
    def hydraulic_torque(self, joint: Joint, torque: sp.Expr) -> sp.Expr:
        """Torque of the pressure (N m)."""
        return torque

    @hook("Pa", latex="p_j = {0}", passes_on=True)
    def joint_pressure(self, joint: Joint, pressure: sp.Expr) -> sp.Expr:
        """Pressure (Pa) that everything in a joint feels."""
        return pressure

    @hook("N*m", latex=r"\tau = {0}")
    def joint_torque(self, joint: Joint) -> sp.Expr:
        """Torque added to the joint (N m), positive in the direction of bending."""
        return sp.Integer(0)

    # hidden states, one set per joint ----------------------------------------------------------------------------
    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        """Time derivative of every hidden state."""
        return {}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        """Value of every hidden state when the joint has rested at theta for ever."""
        return {}

    # bodies ------------------------------------------------------------------------------------------------------
    @hook("kg", "m", "m", "kg*m^2", latex=r"m_b' = {0},\quad d' = {2}", of=("inertia", "place"), passes_on=True)
    def inertia(self, place: BodyPlace, inertia: BodyInertia) -> BodyInertia:
        """Mass, centre of mass and inertia of a body."""
        return inertia

    @hook("kg", latex=r"\Delta m = {0}")
    def added_mass(self, joint: Joint) -> sp.Expr:
        """Mass (kg) that a body gains as its joint bends."""
        return sp.Integer(0)

    @hook("m/s^2", "m/s^2", latex=r"\mathbf{{g}}' = \left({0},\ {1}\right)", of=("gravity",), passes_on=True)
    def gravity(self, gravity: tuple[sp.Expr, sp.Expr], body: Body) -> tuple[sp.Expr, sp.Expr]:
        """Acceleration of gravity (m/s^2) in the rig frame."""
        return gravity

    @hook("N", "N", latex=r"\mathbf{{F}} = \left({0},\ {1}\right)")
    def body_force(self, body: Body) -> tuple[sp.Expr, sp.Expr]:
        """Force (N) on the middle of a body's centre line."""
        return sp.Integer(0), sp.Integer(0)

    @hook("1/(N*m)", latex=r"\varphi_0 = -{0}\, \tau_0", of=())
    def base_compliance(self) -> sp.Expr:
        """Rotation of the clamp per torque on it (rad/(N m))."""
        return sp.Integer(0)

    @hook("m", latex="d_0 = {0}", of=())
    def base_pivot(self, rest_outer_radius: sp.Symbol) -> sp.Expr:
        """How far outside of the hinge line lies the point about which the clamp turns (m); level with its end."""
        return sp.Integer(0)

    # between the sensor and the tube -----------------------------------------------------------------------------
    @hook("Pa", latex="p' = {0}", of=("pressure",), passes_on=True, inwards=True)
    def felt_pressure(self, pressure: sp.Symbol) -> sp.Expr:
        """Pressure in the tube (Pa) for a sensor reading (Pa)."""
        return pressure

    @hook("s", latex=r"{0}\, \dot{{p}}' = p - p'", of=())
    def line_time_constant(self) -> sp.Expr:
        """First-order lag between sensor and tube (s)."""
        return sp.Integer(0)

    @hook("Pa*s/m^3", latex=r"p' = p - {0}\, \dot{{V}}", of=())
    def flow_resistance(self) -> sp.Expr:
        """Pressure lost per flow into the tube (Pa s/m^3)."""
        return sp.Integer(0)

    @hook("Pa*s^2/m^3", latex=r"p' = p - {0}\, \ddot{{V}}", of=())
    def flow_inertance(self) -> sp.Expr:
        """Pressure lost per change of that flow (Pa s^2/m^3)."""
        return sp.Integer(0)

    @hook("m", latex=r"\Delta d = {0}", of=("pressure",))
    def line_shift(self, pressure: sp.Symbol, rest_outer_radius: sp.Symbol) -> sp.Expr:
        """How far the centre line moves away from the inextensible side (m) at a pressure in the tube (Pa)."""
        return sp.Integer(0)

    @hook("1", latex=r"\mathbf{{x}} = (1 + {0})\, \mathbf{{x}}_0", of=("pressure",))
    def stretch(self, pressure: sp.Symbol) -> sp.Expr:
        """Share by which lengths from the clamp grow at a pressure in the tube (Pa); of several chambers at their sum."""
        return sp.Integer(0)

    @hook("s", latex=r"{0}\, \dot{{p}}' = p - p'", of=())
    def stretch_time_constant(self) -> sp.Expr:
        """First-order lag (s) by which the stretch follows the pressure."""
        return sp.Integer(0)

    # between the tube and the file -------------------------------------------------------------------------------
    @hook("m", "m", latex=r"x' = {0},\quad y' = {1}", of=("x", "y"), passes_on=True)
    def observed_position(self, x: sp.Expr, y: sp.Expr, mirror: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
        """Position (m) that the camera reports for a true position, both in the dynamics' frame."""
        return x, y

    @hook("s", latex="t' = t + {0}", of=("time",))
    def time_shift(self, time: sp.Symbol) -> sp.Expr:
        """What must be added to the recording's time (s; zero in the middle of the recording) to get the log's."""
        return sp.Integer(0)

    @hook("rad", latex=r"\vartheta' = \vartheta + {0}", of=("time",))
    def angle_drift(self, time: sp.Symbol) -> sp.Expr:
        """What an angle sensor shows beside the angle (rad) at the recording's time (s; zero in its middle)."""
        return sp.Integer(0)

    def law(self) -> str:
        """LaTeX of the law, for the report; built from the hooks unless a subclass knows better."""
        return ""

    # ----------------------------------------------------------------------------------------------------------------
    @classmethod
    def amplitudes(cls) -> tuple[str, ...]:
        """Parameters whose absence removes the effect."""
        return tuple(name for name, parameter in cls.parameters.items() if parameter.absent is not None)

    @classmethod
    def overrides(cls, hook: str) -> bool:
        """Whether this effect changes `hook`."""
        return getattr(cls, hook) is not getattr(Effect, hook)

    @classmethod
    def acts_at_every_step(cls) -> bool:
        """Whether it changes what is evaluated at every step of a run, and not once a run."""
        return bool(cls.states) or any(cls.overrides(name) for name, item in HOOKS.items() if not item.once)

    def symbol_map(self) -> dict[str, sp.Symbol]:
        """Parameter name to symbol."""
        return {name: self._symbols[name] for name in self.parameters}


#: Every hook by name; a new one is a method above, and the place of the engine that reads it.
HOOKS = hooks_of(Effect)
#: Hooks that each of several chambers may have of its own.
LINE_HOOKS = ("felt_pressure", "line_time_constant")
#: Hooks of the tube as a whole: an effect that has one of them has no joint.
OF_THE_TUBE = ("body_force", *(name for name, hook in HOOKS.items() if hook.once))

__all__ = [
    "BASE_PARAMETERS",
    "BASE_UNITS",
    "BEAMS",
    "HOOKS",
    "LINE_HOOKS",
    "OF_THE_TUBE",
    "Body",
    "BodyInertia",
    "BodyPlace",
    "Effect",
    "EffectParameter",
    "Joint",
]
