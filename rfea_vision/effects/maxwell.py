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


class LogarithmicCreep(Maxwell):
    """Creep that goes on with the logarithm of time: three branches of k_1 / 3 each, with T / 5, T and 5 T."""

    form = "logarithmic"
    reference = "Andrade 1910, doi:10.1098/rspa.1910.0050; a spectrum of Maxwell branches, one per log of five"
    states = {"z": "rad", "z2": "rad", "z3": "rad"}

    def joint_torque(self, joint: Joint) -> sp.Expr:
        lags = 3 * joint.theta - self.z - self.z2 - self.z3
        return -self.k1 * joint.base["k_ref"] * lags / 3

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        return {
            "z": (joint.theta - self.z) / (self.T / 5),
            "z2": (joint.theta - self.z2) / self.T,
            "z3": (joint.theta - self.z3) / (5 * self.T),
        }

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return dict.fromkeys(self.states, joint.theta)
