"""The plane of motion is not where the board lay."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class PlaneTilt(Effect):
    """Positions measured are (1 + a x + b y) times the true ones (x to the right as the camera sees it)."""

    id = "plane_tilt"
    title = "Tilt of the plane of motion"
    reference = "perspective of a tilted plane, to first order"
    shows = "the scale changes across the picture: the tube seems to grow and shrink as it moves"
    mistaken_for = "elongation, stiffness_profile"
    split_by = "the length of the inextensible side over all postures"
    kind = "measurement"
    parameters = {
        "a": EffectParameter("1/m", 0.0, -2.0, 2.0, 0.05, "change of scale per metre to the right"),
        "b": EffectParameter("1/m", 0.0, -2.0, 2.0, 0.0, "change of scale per metre upwards"),
    }

    def observed_position(self, x: sp.Expr, y: sp.Expr, mirror: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
        scale = 1 + self.a * mirror * x + self.b * y
        return x * scale, y * scale
