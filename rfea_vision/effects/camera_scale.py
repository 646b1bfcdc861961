"""The picture has the wrong scale."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class CameraScale(Effect):
    """Positions measured are (1 + s) times the true ones."""

    id = "camera_scale"
    title = "Scale of the picture"
    reference = "camera calibration"
    shows = "every point too far from the clamp in the same proportion, at rest too"
    mistaken_for = "a longer tube, elongation"
    split_by = "the length of the tube at rest, measured with a ruler"
    kind = "measurement"
    parameters = {"s": EffectParameter("1", 0.0, -0.2, 0.2, 0.005, "relative error of the scale")}

    def observed_position(self, x: sp.Expr, y: sp.Expr, mirror: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
        return x * (1 + self.s), y * (1 + self.s)
