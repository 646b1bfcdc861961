"""The pressure does more or less than its log and the tube's geometry say."""

from __future__ import annotations

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter


class PressureGain(Effect):
    """p_tube = g p."""

    id = "pressure_gain"
    title = "Scale of the pressure or of its lever"
    reference = "sensor calibration"
    shows = "the tube moves as if under another pressure: the log has another scale or unit, or the wall takes a share"
    mistaken_for = "r_hyd, exactly, within its bounds; a wrong pressure.unit (a log in psi read as kPa is 6.9 times too low)"
    split_by = "weighing the sensor against a dead-weight tester; no run of this rig can"
    kind = "measurement"
    parameters = {"g": EffectParameter("1", 1.0, 0.1, 10.0, 1.02, "what bends the tube over what is logged")}
    # a chamber's own lever: thin ones beside the middle bend a body a tenth as much as one at its edge
    of_chamber = {"g": EffectParameter("1", 1.0, 0.0, 10.0, 1.02, "lever of the chamber over that of the first one")}
    exactly_tied_to = ("r_hyd",)

    def felt_pressure(self, pressure: sp.Symbol) -> sp.Expr:
        return self.g * pressure
