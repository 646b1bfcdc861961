"""The camera was not level, or the clamp not plumb."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class CameraRoll(Effect):
    """Positions measured are turned about the clamp; positive turns the tip to the side to which the tube bends.

    The angle of bend, which is that between both ends of the tube, is as it was.
    """

    id = "camera_roll"
    title = "Roll of the camera"
    reference = "rotation of the picture in its plane"
    shows = "every point off across the line from the clamp to it, in proportion to its distance, by one angle, at rest too"
    mistaken_for = "rest_curvature, rest_curvature_profile, gravity_tilt: a tube that does not hang straight"
    split_by = "a plumb line in the picture (camera.vertical: {plumb: ...}), or camera.vertical: rest where the tube hangs straight"
    kind = "measurement"
    parameters = {"angle": EffectParameter("rad", 0.0, -0.2, 0.2, 0.005, "turn of the picture", display="deg")}

    def observed_position(self, x: sp.Expr, y: sp.Expr, mirror: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
        s, c = sp.sin(self.angle), sp.cos(self.angle)
        return c * x + s * y, c * y - s * x  # the tube bends to negative x
