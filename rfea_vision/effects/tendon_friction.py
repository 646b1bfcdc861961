"""A tendon rubs on what guides it along the body: its tension falls from guide to guide on the way out, and rises on the way back."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class TendonFriction(Effect):
    """The capstan equation to first order: tau = -mu sigma |Theta| |tau_drive| z, sigma from clamp to tip, z as of Bouc and Wen.

    Theta is the tube's angle, so that sigma |Theta| is what the tendon has turned by where it acts; it is the same for an even bend.
    The loop grows with the tension and with the bend, which that of `hysteresis` does not.
    """

    id = "tendon_friction"
    title = "Friction of the tendon along its guides"
    reference = "the capstan equation (Euler 1769, Eytelwein 1808); its onset by Bouc 1967 and Wen 1976, doi:10.1061/JMCEA3.0002106"
    shows = "less bend on the way out than on the way back at the same tension, most near the tip, and as much when it moves slower"
    mistaken_for = "pressure_stiffening, nonlinear_stiffness (a friction that is met on the way out alone), hysteresis, viscous damping"
    split_by = "the same triangle of tension at two very different rates, up and down"
    needs_tendon = True
    parameters = {
        "mu": EffectParameter("1", 0.0, 0.0, 2.0, 0.1, "coefficient of friction: share of the tension lost per rad of turn"),
        "w": EffectParameter(
            "rad", None, 0.002, 1.0, 0.05, "tube angle over which it builds up", grid=(0.02, 0.1, 0.4), display="deg"
        ),
    }
    states = {"z": "1"}
    dissipates = True

    def joint_torque(self, joint: Joint) -> sp.Expr:
        drive = sp.Abs(joint.pressure) * sp.pi * joint.inner_radius**2 * joint.base["r_hyd"]
        return -self.mu * joint.position * sp.Abs(joint.tube_angle) * drive * self.z

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        rate = joint.tube_rate
        return {"z": (rate - (sp.Abs(rate) * self.z + rate * sp.Abs(self.z)) / 2) / self.w}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"z": sp.Integer(0)}
