"""A spring that stiffens with pressure."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class PressureStiffening(Effect):
    """k_j (1 + c p), p the sum of the pressures in all chambers: those on both sides stretch the wall, whichever way they bend."""

    id = "pressure_stiffening"
    title = "Stiffness that grows with pressure"
    reference = "geometric stiffness of an inflated beam, Fichter 1966, NASA TN D-3393"
    shows = "the curve of angle against pressure flattens, and ringing is faster under pressure"
    mistaken_for = "nonlinear_stiffness: the same curve against pressure; a bore that does not widen as the tube bends is the same law"
    split_by = "the same pressures with a payload"
    parameters = {"c": EffectParameter("1/Pa", 0.0, -2e-6, 2e-5, 3e-7, "relative growth per pressure", display="1/MPa")}

    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:
        return stiffness * (1 + self.c * joint.total_pressure)
