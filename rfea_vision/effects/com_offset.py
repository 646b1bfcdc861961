"""Where the mass sits across the tube."""

from __future__ import annotations

from rfea_vision.effects.base import BodyInertia, BodyPlace, Effect, EffectParameter


class ComOffset(Effect):
    """Centres of mass moved from the hinge line (a = 0, the paper's) towards the centre line (a = 1)."""

    id = "com_offset"
    title = "Centre of mass on the centre line"
    reference = "geometry of a cylinder hinged on its side"
    shows = "a constant bending moment, present even at rest"
    mistaken_for = "rest_curvature (whose sign stays with the tube when it is mounted the other way round)"
    split_by = "mounting the tube the other way round"
    kind = "load"
    parameters = {"a": EffectParameter("1", 0.0, -2.0, 2.0, 0.5, "offset over the outer radius")}

    def inertia(self, place: BodyPlace, inertia: BodyInertia) -> BodyInertia:
        return BodyInertia(
            inertia.mass, inertia.along, inertia.across + self.a * place.rest_outer_radius, inertia.inertia
        )
