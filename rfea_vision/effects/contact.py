"""A wall in the way."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Body, Effect, EffectParameter


class Contact(Effect):
    """One-sided spring at the vertical plane x = -d on the side to which the tube bends; k is shared along the tube."""

    id = "contact"
    title = "Contact with a wall"
    reference = "penalty contact; assumption 1 of the paper"
    shows = "the tube stops following at one place, whatever the angle there"
    mistaken_for = "nonlinear_stiffness (which acts at an angle, not at a place)"
    split_by = "the same pressures with the wall moved"
    kind = "load"
    parameters = {
        "k": EffectParameter("N/m", 0.0, 0.0, 5000.0, 50.0, "stiffness of the wall against the whole tube"),
        "d": EffectParameter(
            "m",
            None,
            0.005,
            0.3,
            0.05,
            "distance of the wall from the clamp's centre line",
            grid=(0.04, 0.07, 0.1),
            display="mm",
        ),
    }

    def body_force(self, body: Body) -> tuple[sp.Expr, sp.Expr]:
        depth = -self.d - body.x
        push = self.k * body.rest_length / body.tube_length * depth
        return sp.Piecewise((push, depth > 0), (0, True)), sp.Integer(0)
