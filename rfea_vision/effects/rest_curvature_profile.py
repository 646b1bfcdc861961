"""The rest curvature varies along the tube."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class RestCurvatureProfile(Effect):
    """Rest angle (a1 P1 + a2 P2) / n beside the uniform one, with Legendre polynomials of 2 sigma - 1."""

    id = "rest_curvature_profile"
    title = "Unevenly bent at rest"
    reference = "residual strain of casting; transport over a spool"
    shows = "with one rest angle for the whole tube, the resting midline still has another shape"
    mistaken_for = "plane_tilt (which changes with the posture)"
    split_by = "a picture of the tube lying on a table, without load"
    parameters = {
        "a1": EffectParameter("rad", 0.0, -3.0, 3.0, 0.05, "linear variation, clamp to tip", display="deg"),
        "a2": EffectParameter("rad", 0.0, -3.0, 3.0, 0.0, "ends against middle", display="deg"),
    }

    def rest_angle(self, joint: Joint, angle: sp.Expr) -> sp.Expr:
        t = 2 * joint.position - 1
        return angle + (self.a1 * t + self.a2 * (3 * t**2 - 1) / 2) / joint.count
