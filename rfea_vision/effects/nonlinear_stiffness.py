"""A spring that is not linear in the angle."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class NonlinearStiffness(Effect):
    """k_j (1 + c Theta^2) with Theta = n theta, the angle that the whole tube would have at this curvature."""

    id = "nonlinear_stiffness"
    title = "Stiffness that grows with the angle"
    reference = "cubic spring (Duffing 1918)"
    shows = "the curve of angle against pressure bends away from the model at high pressure"
    mistaken_for = "pressure_stiffening: the same curve against pressure"
    split_by = "the same pressures with a payload"
    parameters = {"c": EffectParameter("1/rad^2", 0.0, -0.15, 2.0, 0.01, "relative growth per squared angle")}

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 + self.c * joint.tube_angle**2)


class AbsoluteStiffness(NonlinearStiffness):
    """k_j (1 + c |Theta|)."""

    form = "absolute"
    parameters = {"c": EffectParameter("1/rad", 0.0, -0.3, 2.0, 0.02, "relative growth per angle")}

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 + self.c * sp.Abs(joint.tube_angle))


class RadiusStiffness(NonlinearStiffness):
    """k_j (1 + c (r_i^2 / r_i0^2 - 1)^2): quadratic in the section's opening, beyond the base model's slope over r_i."""

    form = "radius"
    parameters = {"c": EffectParameter("1", 0.0, -50.0, 500.0, 2.0, "growth per squared opening of the bore")}

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 + self.c * ((joint.inner_radius / joint.rest_inner_radius) ** 2 - 1) ** 2)
