"""The camera clock runs at another rate than the log clock."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class ClockDrift(Effect):
    """The true log time of a frame is the recorded one plus d times the time from the middle of the recording."""

    id = "clock_drift"
    title = "Clock drift"
    reference = "synchronisation"
    shows = "an offset that grows from the start of a recording to its end"
    mistaken_for = "time_offset, warm-up"
    split_by = "an LED or trigger at both ends of the recording"
    kind = "measurement"
    parameters = {"d": EffectParameter("1", 0.0, -0.05, 0.05, 1e-3, "relative drift", display="ppm")}

    def time_shift(self, time: sp.Symbol) -> sp.Expr:
        return self.d * time
