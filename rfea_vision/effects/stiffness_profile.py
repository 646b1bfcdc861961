"""The spring coefficient varies along the tube."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class StiffnessProfile(Effect):
    """k_j (1 + a1 P1 + a2 P2 + a3 P3) with Legendre polynomials of 2 sigma - 1, sigma from clamp to tip."""

    id = "stiffness_profile"
    title = "Stiffness that varies along the tube"
    reference = "discussion of the paper: the elongation is not uniform"
    shows = "some parts of the tube bend more than others at every pressure"
    mistaken_for = "camera error (fixed in the picture, not on the tube), a rig.gravity that is not as the tube hangs"
    split_by = "the same run with the camera moved, or the length of the inextensible side over all postures"
    parameters = {
        "a1": EffectParameter("1", 0.0, -0.6, 0.6, 0.05, "linear variation, clamp to tip"),
        "a2": EffectParameter("1", 0.0, -0.6, 0.6, 0.0, "ends against middle"),
        "a3": EffectParameter("1", 0.0, -0.6, 0.6, 0.0, "third order"),
    }

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        t = 2 * joint.position - 1
        shape = self.a1 * t + self.a2 * (3 * t**2 - 1) / 2 + self.a3 * (5 * t**3 - 3 * t) / 2
        return stiffness * (1 + shape)


class SoftSpot(StiffnessProfile):
    """k_j (1 - a exp(-((sigma - at) / width)^2)): one soft (or stiff) place."""

    form = "spot"
    parameters = {
        "a": EffectParameter("1", 0.0, -2.0, 0.95, 0.1, "loss of stiffness in the middle of the spot"),
        "at": EffectParameter("1", None, 0.0, 1.0, 0.5, "place, from clamp to tip", grid=(0.2, 0.5, 0.8)),
        "width": EffectParameter("1", None, 0.02, 0.5, 0.1, "half width", grid=(0.1,)),
    }

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 - self.a * sp.exp(-(((joint.position - self.at) / self.width) ** 2)))


class SteppedStiffness(StiffnessProfile):
    """k_j (1 + a tanh((sigma - at) / 0.02)): stiffer on one side of a place than on the other."""

    form = "stepped"
    parameters = {
        "a": EffectParameter("1", 0.0, -0.9, 0.9, 0.05, "half the step"),
        "at": EffectParameter("1", None, 0.05, 0.95, 0.5, "place, from clamp to tip", grid=(0.25, 0.5, 0.75)),
    }

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 + self.a * sp.tanh(50 * (joint.position - self.at)))
