"""The clamp gives way."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class BaseRotation(Effect):
    """The clamp turns in proportion to the torque on it."""

    id = "base_rotation"
    title = "A clamp that turns"
    reference = "compliant boundary of a beam"
    shows = "the tube leaves the clamp at an angle that follows the load"
    mistaken_for = "rest_curvature (constant)"
    split_by = "the slope of the centre line at the clamp"
    parameters = {"c": EffectParameter("rad/(N*m)", 0.0, 0.0, 100.0, 1.0, "rotation per torque", display="deg/(N*m)")}

    def base_compliance(self) -> sp.Expr:
        return self.c
