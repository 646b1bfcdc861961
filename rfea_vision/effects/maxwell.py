"""Visco-elastic memory: a spring in series with a damper beside each joint spring."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class Maxwell(Effect):
    """One Maxwell branch: tau = -k_1 k_ref (theta - z), z' = (theta - z) / T."""

    id = "maxwell"
    title = "Visco-elastic relaxation (Maxwell branch)"
    reference = "Maxwell 1867, doi:10.1098/rstl.1867.0004; Ferry, Viscoelastic Properties of Polymers, 1980"
    shows = "after a step the tube creeps on for seconds while the pressure holds"
    mistaken_for = "a leak or warm-up (then the pressure drifts too, or the time of day matters)"
    split_by = "a step held for several time constants, at two pressures, repeated after a rest"
    parameters = {
        "k1": EffectParameter("1", 0.0, 0.0, 3.0, 0.1, "stiffness of the branch over k_ref"),
        "T": EffectParameter("s", None, 0.02, 100.0, 0.5, "relaxation time", grid=(0.08, 0.3, 1.0, 4.0)),
    }
    states = {"z": "rad"}
    dissipates = True

    def joint_torque(self, joint: Joint) -> sp.Expr:
        return -self.k1 * joint.base["k_ref"] * (joint.theta - self.z)

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"z": (joint.theta - self.z) / self.T}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"z": joint.theta}
