"""The rubber is not incompressible."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import BEAMS, Effect, EffectParameter, Joint


class Compressibility(Effect):
    """Volume of rubber times (1 - c p): assumption 3 of the paper given up (c is one over the bulk modulus)."""

    id = "compressibility"
    title = "Compressible rubber"
    reference = "assumption 3 of the paper (bulk modulus about 2 GPa)"
    shows = "a slightly wider bore under pressure"
    mistaken_for = "pressure_gain, radial_expansion, pressure_stiffening (a wider bore has another spring)"
    split_by = "the volume that flows in against the angle"
    not_of = BEAMS
    parameters = {"c": EffectParameter("1/Pa", 0.0, 0.0, 1e-6, 5e-10, "one over the bulk modulus", display="1/GPa")}

    def rubber_volume(self, joint: Joint, fraction: sp.Expr) -> sp.Expr:
        return fraction * (1 - self.c * joint.pressure)
