"""The camera clock is off against the log clock."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class TimeOffset(Effect):
    """The true log time of a frame is the recorded one plus dt."""

    id = "time_offset"
    title = "Clock offset"
    reference = "synchronisation"
    shows = "a residual in proportion to the speed, of one sign up and the other down"
    mistaken_for = "pressure_lag (which rounds fast changes too), viscous damping"
    split_by = "an LED or trigger that both clocks see"
    kind = "measurement"
    parameters = {"dt": EffectParameter("s", 0.0, -2.0, 2.0, 0.005, "offset", display="ms")}

    def time_shift(self, time: sp.Symbol) -> sp.Expr:
        return self.dt
