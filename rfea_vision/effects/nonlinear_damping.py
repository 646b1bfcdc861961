"""Damping that grows with the rate of bending."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class NonlinearDamping(Effect):
    """b_j (1 + c |r|) with r the rate of the tube's angle."""

    id = "nonlinear_damping"
    title = "Damping that grows with speed"
    reference = "quadratic damping, e.g. Nayfeh and Mook, Nonlinear Oscillations, 1979"
    shows = "fast motion is held back more than slow motion predicts"
    mistaken_for = "drag (which acts on the speed of the body, not of the joint)"
    split_by = "the same fast step at rest and near full bending"
    parameters = {"c": EffectParameter("s/rad", 0.0, -0.2, 10.0, 0.05, "growth per rate of the tube's angle")}

    def damping(self, joint: Joint, damping: sp.Expr) -> sp.Expr:
        return damping * (1 + self.c * sp.Abs(joint.tube_rate))


class RootDamping(NonlinearDamping):
    """b_j (1 + c sqrt(|r|)), rounded below 0.01 rad/s."""

    form = "root"
    parameters = {"c": EffectParameter("s**0.5/rad**0.5", 0.0, -0.3, 10.0, 0.05, "growth per root of the rate")}
    constants = {"rounded": ("rad/s", 0.01)}  # keeps the slope at rest finite; a tube swings at some rad/s

    def damping(self, joint: Joint, damping: sp.Expr) -> sp.Expr:
        return damping * (1 + self.c * (joint.tube_rate**2 + self.rounded**2) ** sp.Rational(1, 4))


class SquareDamping(NonlinearDamping):
    """b_j (1 + c r^2)."""

    form = "square"
    parameters = {"c": EffectParameter("s**2/rad**2", 0.0, -0.02, 10.0, 0.01, "growth per squared rate")}

    def damping(self, joint: Joint, damping: sp.Expr) -> sp.Expr:
        return damping * (1 + self.c * joint.tube_rate**2)
