"""The tube feels the pressure later than the sensor."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class PressureLag(Effect):
    """First-order line between sensor and tube: T p_tube' = p - p_tube."""

    id = "pressure_lag"
    title = "Lag between sensor and tube"
    reference = "first-order hydraulic line"
    shows = "fast changes arrive late and rounded, slow ones not"
    mistaken_for = "time_offset (a pure shift), fluid_damping"
    split_by = "a fast step and a slow ramp in one run, on a common clock"
    kind = "pressure"
    parameters = {"T": EffectParameter("s", 0.0, 0.0, 20.0, 0.02, "time constant of the line", display="ms")}

    def line_time_constant(self) -> sp.Expr:
        return self.T


class TwiceLaggedPressure(PressureLag):
    """T^2 p_tube'' + 2 T p_tube' = p - p_tube, two equal lags in series: water of some mass, or a volume at each end."""

    form = "second_order"
    states = {"p_tube": "Pa"}
    constants = {"follow": ("s", 0.0002)}  # what is left where T is 0, so that the law has no 0/0

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"p_tube": (joint.pressure - self.p_tube) / (self.T + self.follow)}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"p_tube": joint.pressure}

    def joint_pressure(self, joint: Joint, pressure: sp.Expr) -> sp.Expr:
        return self.p_tube
