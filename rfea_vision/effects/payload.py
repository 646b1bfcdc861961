"""A mass at the tip that the model does not know of."""

from __future__ import annotations

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

    def inertia(self, place: BodyPlace, inertia: BodyInertia) -> BodyInertia:
        load = self.m * place.is_last
        mass = inertia.mass + load
        along = (inertia.mass * inertia.along + load * place.length) / mass
        across = (inertia.mass * inertia.across + load * place.rest_outer_radius) / mass
        arm = (place.length - inertia.along) ** 2 + (place.rest_outer_radius - inertia.across) ** 2
        return BodyInertia(mass, along, across, inertia.inertia + inertia.mass * load / mass * arm)
