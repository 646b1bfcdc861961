"""The tube is not straight when nothing acts on it."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class RestCurvature(Effect):
    """Uniform rest angle of the springs, given as the angle of the whole tube."""

    id = "rest_curvature"
    title = "Bent at rest"
    reference = "residual strain of casting"
    shows = "an offset in the angle that stays at every pressure"
    mistaken_for = "gravity_tilt (which scales with mass, not with stiffness)"
    split_by = "mounting the tube the other way round, or a payload"
    parameters = {"angle": EffectParameter("rad", 0.0, -2.0, 2.0, 0.05, "angle of the whole tube", display="deg")}

    def rest_angle(self, joint: Joint, angle: sp.Expr) -> sp.Expr:
        return angle + self.angle / joint.count
