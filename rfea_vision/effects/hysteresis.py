"""Rate-independent hysteresis: friction inside the fibres and the rubber."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class Hysteresis(Effect):
    """Bouc-Wen torque: tau = -tau_h z, z' = (r - (|r| z + r |z|) / 2) / w with r the rate of the tube's angle."""

    id = "hysteresis"
    title = "Rate-independent hysteresis (Bouc-Wen)"
    reference = "Bouc 1967; Wen 1976, doi:10.1061/JMCEA3.0002106"
    shows = "the loop of angle against pressure keeps its area when the motion is slower"
    mistaken_for = "viscous damping or a delay (their loop area goes with the rate)"
    split_by = "the same triangle of pressure at two very different rates"
    parameters = {
        "tau_h": EffectParameter("N*m", 0.0, 0.0, 0.05, 5e-4, "torque of the fully developed loop", display="mN*m"),
        "w": EffectParameter(
            "rad", None, 0.005, 3.0, 0.2, "tube angle over which it builds up", grid=(0.05, 0.2, 0.8), display="deg"
        ),
    }
    states = {"z": "1"}
    dissipates = True

    def joint_torque(self, joint: Joint) -> sp.Expr:
        return -self.tau_h * self.z

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        rate = joint.tube_rate
        return {"z": (rate - (sp.Abs(rate) * self.z + rate * sp.Abs(self.z)) / 2) / self.w}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"z": sp.Integer(0)}


class UnevenHysteresis(Hysteresis):
    """Bouc-Wen whose loop is wider one way than the other: tau = -tau_h (z + d z^2)."""

    form = "asymmetric"
    parameters = {
        **Hysteresis.parameters,
        "d": EffectParameter(
            "1", None, -0.9, 0.9, 0.3, "torque while bending over that while straightening", grid=(0.3, -0.3)
        ),
    }

    def joint_torque(self, joint: Joint) -> sp.Expr:
        return -self.tau_h * (self.z + self.d * self.z**2)


class PlayHysteresis(Hysteresis):
    """A Prandtl-Ishlinskii sum of three elements that yield at w/3, w and 3 w, with equal shares of tau_h.

    Each z' = (r - |r| z |z| / 2 - r z^2 / 2) / w: linear, then at its limit.
    """

    form = "elements"
    reference = "Ishlinskii 1944; Visintin, Differential Models of Hysteresis, 1994, doi:10.1007/978-3-662-11557-2"
    states = {"z": "1", "z2": "1", "z3": "1"}

    def joint_torque(self, joint: Joint) -> sp.Expr:
        return -self.tau_h * (self.z + self.z2 + self.z3) / 3

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        rate = joint.tube_rate

        def element(z: sp.Symbol, factor: sp.Expr) -> sp.Expr:
            return (rate - (sp.Abs(rate) * z * sp.Abs(z) + rate * z**2) / 2) / (factor * self.w)

        third = sp.Rational(1, 3)
        return {
            "z": element(self.z, third),
            "z2": element(self.z2, sp.Integer(1)),
            "z3": element(self.z3, sp.Integer(3)),
        }

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {name: sp.Integer(0) for name in self.states}
