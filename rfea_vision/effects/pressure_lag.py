"""The tube feels the pressure later than the sensor."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class PressureLag(Effect):
    """First-order line between sensor and tube: T p_tube' = p - p_tube."""

    id = "pressure_lag"
    title = "Lag between sensor and tube"
    reference = "first-order hydraulic line"
    shows = "fast changes arrive late and rounded, slow ones not"
    mistaken_for = "time_offset (a pure shift), fluid_damping"
    split_by = "a fast step and a slow ramp in one run, on a common clock"
    kind = "pressure"
    parameters = {"T": EffectParameter("s", 0.0, 0.0, 2.0, 0.02, "time constant of the line", display="ms")}

    def line_time_constant(self) -> sp.Expr:
        return self.T
