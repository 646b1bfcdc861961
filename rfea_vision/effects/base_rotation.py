"""The clamp gives way."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class BaseRotation(Effect):
    """The clamp turns in proportion to the torque on it, about a point level with its end, `pivot` radii outside the hinge line."""

    id = "base_rotation"
    title = "A clamp that turns"
    reference = "compliant boundary of a beam"
    shows = "the tube leaves the clamp at an angle that follows the load"
    mistaken_for = "rest_curvature (constant)"
    split_by = "the slope of the centre line at the clamp"
    parameters = {
        "c": EffectParameter("rad/(N*m)", 0.0, 0.0, 100.0, 1.0, "rotation per torque", display="deg/(N*m)"),
        "pivot": EffectParameter(
            "1",
            None,
            -5.0,
            7.0,
            1.0,
            "where it turns, in outer radii from the hinge line; 1: the centre line",
            grid=(1.0,),
        ),
    }

    def base_compliance(self) -> sp.Expr:
        return self.c

    def base_pivot(self, rest_outer_radius: sp.Symbol) -> sp.Expr:
        return self.pivot * rest_outer_radius
