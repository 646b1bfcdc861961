"""Pump, pressure switch, accumulator, two on/off valves and tank, between a valve command and the pressure in the tube.

Volumes are of water; what leaves one place arrives at another, to rounding. The pressure in the line is stiff against
flow: each step solves it implicitly. The flow into the tube is that of its last step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import copysign, pi, sqrt
from typing import Any

from scipy.optimize import brentq

from rfea_vision.drive.constants import DriveConstants

LONGEST_STEP_S = 2.5e-4  # longest step of the explicit integration of volumes and valves


def orifice_flow(drop_Pa: float, opening: float, constants: DriveConstants) -> float:
    """Flow (m^3/s) through a valve's orifice, opened by a share from 0 to 1: C_d A sqrt(2 dp / rho).

    Near zero it is linear in the pressure drop, below the one at which the critical Reynolds number is reached.
    """
    area = opening * pi * constants.orifice_diameter_m**2 / 4
    slow = constants.critical_reynolds * constants.viscosity_m2_s
    slow /= constants.discharge_coefficient * constants.orifice_diameter_m
    critical = constants.density_kg_m3 / 2 * slow**2
    return (
        constants.discharge_coefficient
        * area
        * sqrt(2 / constants.density_kg_m3)
        * drop_Pa
        / (drop_Pa**2 + critical**2) ** 0.25
    )


@dataclass(frozen=True)
class Hydraulics:
    """State of the drive: line pressure (Pa), water in accumulator and tank, and gone into the tube since the start (m^3)."""

    pressure_Pa: float
    accumulator_m3: float
    tank_m3: float
    tube_m3: float
    supply_opening: float
    drain_opening: float
    pump_runs: bool


class Drive:
    """The drive, stepped by whoever holds the clock.

    It starts with the accumulator full, the pump off, both valves closed and the tube at `pressure_Pa`.
    """

    def __init__(self, constants: DriveConstants | None = None, *, pressure_Pa: float = 0.0) -> None:
        self.constants = constants or DriveConstants()
        full = self._water_at(self.constants.switch_off_Pa)
        self.state = Hydraulics(pressure_Pa, full, self.constants.tank_m3 - full, 0.0, 0.0, 0.0, False)

    def _water_at(self, supply_Pa: float) -> float:
        """Water in the accumulator at a pressure, by the gas law p V^n = constant."""
        c = self.constants
        squeezed = ((c.precharge_Pa + c.atmosphere_Pa) / (supply_Pa + c.atmosphere_Pa)) ** (1 / c.polytropic_index)
        return c.accumulator_m3 * (1 - squeezed)

    def supply_Pa(self) -> float:
        """Pressure of the accumulator and the supply line (Pa, gauge); none when it is empty."""
        c = self.constants
        gas = c.accumulator_m3 - self.state.accumulator_m3
        if self.state.accumulator_m3 <= 0:
            return 0.0
        return (c.precharge_Pa + c.atmosphere_Pa) * (c.accumulator_m3 / gas) ** c.polytropic_index - c.atmosphere_Pa

    def water_m3(self) -> float:
        """All the water there is, in tank, accumulator, line and tube (as far as it came in since the start)."""
        state = self.state
        line = self.constants.line_compliance_m3_Pa * state.pressure_Pa
        return state.tank_m3 + state.accumulator_m3 + line + state.tube_m3

    def step(self, duration_s: float, *, supply: float, drain: float, tube_flow_m3_s: float) -> float:
        """Let time pass with the valves commanded open (1) or closed (0); returns the pressure at the end (Pa).

        tube_flow_m3_s : into the tube, by its own motion
        """
        count = max(1, int(-(-duration_s // LONGEST_STEP_S)))
        for _ in range(count):
            self._part(duration_s / count, supply, drain, tube_flow_m3_s)
        return self.state.pressure_Pa

    def _part(self, h: float, supply: float, drain: float, tube_flow: float) -> None:
        c, state = self.constants, self.state
        from_Pa, before = self.supply_Pa(), state.pressure_Pa
        runs = from_Pa < c.switch_on_Pa or (state.pump_runs and from_Pa < c.switch_off_Pa)
        pump = min(c.pump_flow_m3_s, c.pump_efficiency * c.motor_power_W / max(from_Pa, 1.0)) if runs else 0.0
        pump = min(pump, max(state.tank_m3, 0.0) / h)
        opened = _toward(state.supply_opening, supply, h / c.valve_time_s)
        drained = _toward(state.drain_opening, drain, h / c.valve_time_s)
        capacity = c.line_compliance_m3_Pa / h

        def surplus(pressure: float) -> float:
            inflow = orifice_flow(from_Pa - pressure, opened, c)
            return capacity * (pressure - before) - inflow + orifice_flow(pressure, drained, c) + tube_flow

        # Rising in the pressure, with its zero between the pressures all round and what the tube's flow makes of them.
        reach = abs(tube_flow) / capacity + 1.0
        low, high = min(before, 0.0, from_Pa) - reach, max(before, 0.0, from_Pa) + reach
        root: Any = brentq(surplus, low, high, xtol=1e-6)
        pressure = float(root)
        outflow = orifice_flow(pressure, drained, c)
        inflow = capacity * (pressure - before) + outflow + tube_flow  # as the balance has it, to the last digit
        self.state = replace(
            state,
            pressure_Pa=pressure,
            accumulator_m3=state.accumulator_m3 + h * (pump - inflow),
            tank_m3=state.tank_m3 + h * (outflow - pump),
            tube_m3=state.tube_m3 + h * tube_flow,
            supply_opening=opened,
            drain_opening=drained,
            pump_runs=runs,
        )


def _toward(now: float, wanted: float, most: float) -> float:
    return wanted if abs(wanted - now) <= most else now + copysign(most, wanted - now)
