"""Pressure lost in the line as water flows."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class FluidDamping(Effect):
    """p_tube = p - R dV/dt, laminar loss between sensor and tube; V = pi r_o^3 times the bending angle."""

    id = "fluid_damping"
    title = "Pressure lost to flow in the line"
    reference = "Hagen 1839, Poiseuille 1840"
    shows = "fast motion is slowed, equally up and down"
    mistaken_for = "nonlinear_damping, pressure_lag"
    split_by = "a second pressure sensor at the tube, or a shorter line"
    kind = "pressure"
    parameters = {"R": EffectParameter("Pa*s/m^3", 0.0, 0.0, 1e12, 1e9, "resistance of the line")}
    dissipates = True

    def flow_resistance(self) -> sp.Expr:
        return self.R
