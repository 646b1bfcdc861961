"""The fibres give and the tube widens."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import BEAMS, Effect, EffectParameter, Joint


class RadialExpansion(Effect):
    """r_o (1 + c p): assumption 2 of the paper given up.

    The centre line that a camera sees moves by the share `axis` of that away from the inextensible side: 1 where this side
    stays where it is, 0 where the tube's axis does.
    """

    id = "radial_expansion"
    title = "The tube widens under pressure"
    reference = "assumption 2 of the paper"
    shows = "the width in the picture grows with the pressure"
    mistaken_for = "compressibility, pressure_stiffening (under pressure their bore or spring changes alike), a softer spring"
    split_by = "the measured width"
    not_of = BEAMS
    parameters = {
        "c": EffectParameter("1/Pa", 0.0, 0.0, 1e-6, 1e-9, "relative growth per pressure", display="1/MPa"),
        "axis": EffectParameter(
            "1", None, -1.0, 2.0, 1.0, "share of it by which the centre line moves", grid=(1.0, 0.0)
        ),
    }

    def outer_radius(self, joint: Joint, radius: sp.Expr) -> sp.Expr:
        return radius * (1 + self.c * joint.pressure)

    def line_shift(self, pressure: sp.Symbol, rest_outer_radius: sp.Symbol) -> sp.Expr:
        return self.axis * self.c * pressure * rest_outer_radius
