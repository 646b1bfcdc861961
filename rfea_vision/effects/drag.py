"""Air (or water) around the tube holds it back."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Body, Effect, EffectParameter


class Drag(Effect):
    """Quadratic drag per length: -c 2 r_o |v| v at the middle of each body."""

    id = "drag"
    title = "Drag of the surroundings"
    reference = "Morison et al. 1950, doi:10.2118/950149-G (drag term)"
    shows = "fast sweeps of the tip are held back, the clamp end is not"
    mistaken_for = "nonlinear_damping (which acts on the rate of the joint)"
    split_by = "a light paddle at the tip"
    kind = "load"
    parameters = {
        "c": EffectParameter("kg/m^3", 0.0, 0.0, 2e4, 5.0, "half the density of the medium times the drag coefficient")
    }
    constants = {"still": ("m/s", 1e-6)}  # keeps the slope at rest finite; a tip moves at some m/s
    dissipates = True

    def body_force(self, body: Body) -> tuple[sp.Expr, sp.Expr]:
        # Keeps the derivative finite at rest, where |v| has a kink.
        speed = sp.sqrt(body.vx**2 + body.vy**2 + self.still**2)
        factor = -self.c * 2 * body.rest_outer_radius * body.rest_length * speed
        return factor * body.vx, factor * body.vy
