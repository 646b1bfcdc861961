"""Softening by the largest bend so far."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class Mullins(Effect):
    """k_j (1 - c (1 - exp(-z / s))), z the largest tube angle so far, to either side (followed within 0.2 ms)."""

    id = "mullins"
    title = "Softening after the first bend (Mullins)"
    reference = "Mullins 1969, doi:10.5254/1.3539210"
    shows = "the first rise differs from all later ones to the same pressure"
    mistaken_for = "creep (which comes again with every step)"
    split_by = "the same cycle twice without a pause"
    parameters = {
        "c": EffectParameter("1", 0.0, 0.0, 0.8, 0.05, "largest loss of stiffness"),
        "s": EffectParameter(
            "rad", None, 0.05, 10.0, 1.0, "tube angle over which it is lost", grid=(0.3, 1.5), display="deg"
        ),
    }
    states = {"z": "rad"}
    constants = {"follow": ("s", 0.0002)}  # a fifth of a step of the integrator: as good as at once

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 - self.c * (1 - sp.exp(-self.z / self.s)))

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        gap = sp.Abs(joint.tube_angle) - self.z
        return {"z": sp.Piecewise((gap / self.follow, gap > 0), (0, True))}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"z": sp.Abs(joint.tube_angle)}


class CappedMullins(Mullins):
    """k_j (1 - c min(z / s, 1)): the loss grows in proportion to the largest bend, up to s."""

    form = "linear"

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 - self.c * sp.Piecewise((self.z / self.s, self.z < self.s), (1, True)))


class SlowMullins(Mullins):
    """k_j (1 - c (1 - (1 + z / s)^(-1/2))): a power law, which never ends."""

    form = "power"

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 - self.c * (1 - (1 + self.z / self.s) ** sp.Rational(-1, 2)))
