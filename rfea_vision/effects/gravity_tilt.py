"""The rig does not stand upright."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Body, Effect, EffectParameter


class GravityTilt(Effect):
    """Gravity turned in the plane of motion; positive turns it towards the side to which the tube bends."""

    id = "gravity_tilt"
    title = "Gravity tilted in the plane"
    reference = "rotation of the gravity vector"
    shows = "a sideways lean at rest that grows softer as the tube stiffens or bends"
    mistaken_for = "rest_curvature (which scales with stiffness, not with mass), camera_roll (which moves every point by one angle)"
    imitated_by = "a steady pull to the side (a wind, a hose, a cable)"
    split_by = "a plumb line in the picture, or the same run with a payload"
    kind = "load"
    parameters = {"angle": EffectParameter("rad", 0.0, -0.5, 0.5, 0.03, "tilt", display="deg")}

    def gravity(self, gravity: tuple[sp.Expr, sp.Expr], body: Body) -> tuple[sp.Expr, sp.Expr]:
        gx, gy = gravity
        s, c = sp.sin(self.angle), sp.cos(self.angle)
        return c * gx + s * gy, c * gy - s * gx
