"""The water that flows in as the tube bends."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import BEAMS, Effect, EffectParameter, Joint


class VariableMass(Effect):
    """Adds a rho_f (V_j - V_j0) to each body; V_j - V_j0 = pi r_o^3 theta exactly."""

    id = "variable_mass"
    title = "Mass of the water that flows in"
    reference = "discussion of the paper; eq. SegmentVolume, corrected"
    shows = "ringing gets slower as the pressure rises"
    mistaken_for = "payload (the same at every pressure)"
    split_by = "the ringing frequency at a low and at a high pressure"
    kind = "load"
    not_of = BEAMS
    parameters = {
        "a": EffectParameter("1", 0.0, 0.0, 3.0, 1.0, "share of the inflowing water that moves with the body")
    }

    def added_mass(self, joint: Joint) -> sp.Expr:
        return self.a * joint.fluid_density * sp.pi * joint.rest_outer_radius**3 * joint.theta
