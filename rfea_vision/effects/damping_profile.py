"""The damper coefficient varies along the tube."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class DampingProfile(Effect):
    """b_j (1 + a1 P1 + a2 P2) with Legendre polynomials of 2 sigma - 1, sigma from clamp to tip."""

    id = "damping_profile"
    title = "Damping that varies along the tube"
    reference = "discussion of the paper: coefficients are not identical along the tube"
    shows = "parts of the tube lag behind others while moving, and none at rest"
    mistaken_for = "stiffness_profile (which shows at rest too)"
    split_by = "fast and slow runs to the same pressure"
    parameters = {
        "a1": EffectParameter("1", 0.0, -0.9, 0.9, 0.1, "linear variation, clamp to tip"),
        "a2": EffectParameter("1", 0.0, -0.9, 0.9, 0.0, "ends against middle"),
    }

    def damping(self, joint: Joint, damping: sp.Expr) -> sp.Expr:
        t = 2 * joint.position - 1
        return damping * (1 + self.a1 * t + self.a2 * (3 * t**2 - 1) / 2)


class SteppedDamping(DampingProfile):
    """b_j (1 + a tanh((sigma - at) / 0.02)): more on one side of a place than on the other."""

    form = "stepped"
    parameters = {
        "a": EffectParameter("1", 0.0, -0.9, 0.9, 0.1, "half the step"),
        "at": EffectParameter("1", None, 0.05, 0.95, 0.5, "place, from clamp to tip", grid=(0.25, 0.5, 0.75)),
    }

    def damping(self, joint: Joint, damping: sp.Expr) -> sp.Expr:
        return damping * (1 + self.a * sp.tanh(50 * (joint.position - self.at)))
