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
