"""A mass at the tip that the model does not know of."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import BodyInertia, BodyPlace, Effect, EffectParameter


class Payload(Effect):
    """Point mass at the end of the centre line."""

    id = "payload"
    title = "Mass at the tip"
    reference = "parallel-axis theorem; assumption 1 of the paper"
    shows = "slower ringing, and more sag the further the tube bends"
    mistaken_for = "a wrong density (which is not concentrated at the tip)"
    split_by = "the ringing after a fast step, at a low and at a high pressure"
    kind = "load"
    parameters = {"m": EffectParameter("kg", 0.0, 0.0, 0.1, 1e-3, "mass", display="g")}

    def _across(self) -> sp.Expr:
        """Where it sits across the tube, in outer radii from the hinge line."""
        return sp.Integer(1)

    def inertia(self, place: BodyPlace, inertia: BodyInertia) -> BodyInertia:
        load, at = self.m * place.is_last, self._across() * place.rest_outer_radius
        mass = inertia.mass + load
        along = (inertia.mass * inertia.along + load * place.length) / mass
        across = (inertia.mass * inertia.across + load * at) / mass
        arm = (place.length - inertia.along) ** 2 + (at - inertia.across) ** 2
        return BodyInertia(mass, along, across, inertia.inertia + inertia.mass * load / mass * arm)


class PayloadBesideTheLine(Payload):
    """Point mass at the end of the tube, anywhere across it: a clip on one side, a cap that is heavier there.

    Across the tube it bends by its weight at rest, too: held on the centre line such a mass is found too small, or not at all.
    """

    form = "beside"
    parameters = {
        **Payload.parameters,
        "a": EffectParameter(
            "1",
            None,
            -5.0,
            5.0,
            0.0,
            "place across the tube in outer radii: 0 on the hinge line, 1 on the centre line",
            grid=(0.0,),
        ),
    }

    def _across(self) -> sp.Expr:
        return self.a
