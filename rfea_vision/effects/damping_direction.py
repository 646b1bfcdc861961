"""A body without a bore is damped more on its way out than on its way back, or less."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class DampingDirection(Effect):
    """b_j (1 + a s), s the sign of the rate times tanh of the joint's angle from rest over `width`.

    Out, away from where the spring is at rest, s is 1, and back it is -1, to whichever side. Where a joint swings through
    its rest the one passes into the other over `width` of the tube's angle, so that the torque does not jump.
    """

    id = "damping_direction"
    title = "Damping that differs on the way out and back"
    reference = "two dampers by the direction of the motion, as in the paper's eq. DamperCoefficient"
    shows = "the body comes back slower than it went out, or faster, and alike on both sides"
    mistaken_for = "nonlinear_damping, maxwell, pressure_lag (of a valve that drains more slowly than it fills)"
    split_by = "steps up and down of the same size and speed, to both sides"
    not_of = ("tube",)  # which has two dampers from the start
    parameters = {"a": EffectParameter("1", 0.0, -0.95, 0.95, 0.1, "out: 1 + a times the damping; back: 1 - a times")}
    #: Three degrees: far below a bend that tells out from back, and wide enough that the spring outweighs the passage.
    constants = {"width": ("rad", 0.05)}

    def damping(self, joint: Joint, damping: sp.Expr) -> sp.Expr:
        from_rest = joint.count * (joint.theta - joint.rest_angle)
        return damping * (1 + self.a * sp.sign(joint.rate) * sp.tanh(from_rest / self.width))
