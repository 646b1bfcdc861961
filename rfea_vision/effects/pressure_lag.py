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


class ValvedPressure(PressureLag):
    """T p_tube' = p - p_tube while the tube fills, and T_drain in place of T while it drains: another valve, or vent, either way."""

    form = "valve"
    shows = "the tube follows rising and falling pressure alike slowly, or one more slowly than the other"
    states = {"p_tube": "Pa"}
    parameters = {
        "T": EffectParameter("s", 0.0, 0.0, 20.0, 0.02, "time constant while it fills", display="ms", grid=(0.02, 0.2)),
        "T_drain": EffectParameter("s", 0.0, 0.0, 20.0, 0.02, "time constant while it drains", display="ms", grid=(0.02, 0.2)),
    }
    #: Pressures so near to each other neither fill nor drain it; and what is left where T is 0, so that the law has no 0/0.
    constants = {"width": ("Pa", 100.0), "follow": ("s", 0.0002)}

    def line_time_constant(self) -> sp.Expr:
        return sp.Integer(0)

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        above = joint.pressure - self.p_tube
        fills = (1 + sp.tanh(above / self.width)) / 2
        return {"p_tube": above / (self.T_drain + (self.T - self.T_drain) * fills + self.follow)}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {"p_tube": joint.pressure}

    def joint_pressure(self, joint: Joint, pressure: sp.Expr) -> sp.Expr:
        return self.p_tube
