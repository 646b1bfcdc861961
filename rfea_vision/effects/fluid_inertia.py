"""Pressure lost to speed up the water in the line."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class FluidInertia(Effect):
    """p_tube = p - I d2V/dt2, the inertance of the water between sensor and tube."""

    id = "fluid_inertia"
    title = "Inertia of the water in the line"
    reference = "inertance rho l / A of a line; Wylie and Streeter, Fluid Transients, 1978"
    shows = "slower ringing of the whole tube, the same at every pressure"
    mistaken_for = "variable_mass, payload"
    split_by = "a shorter or wider line"
    kind = "pressure"
    parameters = {"I": EffectParameter("Pa*s^2/m^3", 0.0, 0.0, 1e11, 1e8, "inertance of the line")}

    def flow_inertance(self) -> sp.Expr:
        return self.I
