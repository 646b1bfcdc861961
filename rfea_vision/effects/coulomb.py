"""Dry friction in each joint."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class Coulomb(Effect):
    """Smoothed Coulomb friction: tau = -tau_c tanh(r / w) with r the rate of the tube's angle."""

    id = "coulomb"
    title = "Dry friction (Coulomb)"
    reference = "Coulomb 1785; Andersson et al. 2007, doi:10.1016/j.triboint.2005.11.014"
    shows = "a jump in the residual torque at every reversal, the same at any speed"
    mistaken_for = "hysteresis (which builds up smoothly over an angle after a reversal)"
    split_by = "small reversals about a held pressure: friction flips at once, hysteresis does not"
    parameters = {
        "tau_c": EffectParameter("N*m", 0.0, 0.0, 0.5, 5e-4, "friction torque", display="mN*m"),
        "w": EffectParameter(
            "rad/s", None, 1e-3, 10.0, 0.05, "rate over which it turns", grid=(0.02, 0.1, 0.5), display="deg/s"
        ),
    }
    dissipates = True

    def joint_torque(self, joint: Joint) -> sp.Expr:
        return -self.tau_c * sp.tanh(joint.tube_rate / self.w)
