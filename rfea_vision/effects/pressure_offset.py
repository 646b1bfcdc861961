"""The pressure sensor has the wrong zero."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class PressureOffset(Effect):
    """p_tube = p + p0."""

    id = "pressure_offset"
    title = "Zero of the pressure sensor"
    reference = "sensor calibration"
    shows = "an offset at rest that shrinks with nothing but the pressure's own scale"
    mistaken_for = "rest_curvature"
    split_by = "the sensor open to the air"
    kind = "measurement"
    parameters = {"p0": EffectParameter("Pa", 0.0, -1e5, 1e5, 2e3, "true minus logged pressure", display="kPa")}

    def felt_pressure(self, pressure: sp.Symbol) -> sp.Expr:
        return pressure + self.p0
