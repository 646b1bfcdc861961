"""The fibres give and the tube widens."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class RadialExpansion(Effect):
    """r_o (1 + c p): assumption 2 of the paper given up."""

    id = "radial_expansion"
    title = "The tube widens under pressure"
    reference = "assumption 2 of the paper"
    shows = "the width in the picture grows with the pressure"
    mistaken_for = "a softer spring"
    split_by = "the measured width"
    parameters = {"c": EffectParameter("1/Pa", 0.0, 0.0, 1e-6, 1e-9, "relative growth per pressure", display="1/MPa")}

    def outer_radius(self, joint: Joint, radius: sp.Expr) -> sp.Expr:
        return radius * (1 + self.c * joint.pressure)
