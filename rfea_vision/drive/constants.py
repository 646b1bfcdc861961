"""Every number of the drive, SI, with its source; "paper" is section II-B of Momeni Kelageri et al."""

from __future__ import annotations

from dataclasses import dataclass

from rfea_vision.errors import InputError


@dataclass(frozen=True)
class DriveConstants:
    """The drive's numbers. Pressures are gauge.

    Attributes
    ----------
    tank_m3 : water in the tank at the start (paper: 0.6 l)
    pump_flow_m3_s : largest flow of the pump (paper: 3.6 l/min)
    motor_power_W : of the pump's motor (paper: 36 W)
    pump_efficiency : hydraulic over electric power (assumed)
    switch_off_Pa : at which the pressure switch stops the pump (paper: about 600 kPa)
    switch_on_Pa : at which it starts it again (assumed)
    accumulator_m3 : gas volume of the empty accumulator (assumed)
    precharge_Pa : gas pressure of the empty accumulator (assumed)
    polytropic_index : of the gas; between 1 (slow) and 1.4 (fast) (assumed)
    orifice_diameter_m : of both valves (paper: 1 mm)
    discharge_coefficient : of a sharp orifice (0.6 to 0.65; Merritt, Hydraulic Control Systems, 1967, section 3-4)
    critical_reynolds : below which the flow through an orifice is laminar (assumed)
    valve_time_s : from closed to open (assumed)
    density_kg_m3, viscosity_m2_s : of water at 20 C (IAPWS-95)
    bulk_modulus_Pa : of water at 20 C (IAPWS-95)
    line_m3 : water between valves and tube, and in the tube at rest (assumed; the paper's tube holds 4.4 ml)
    hose_compliance_m3_Pa : by how much hose and fittings swell (assumed: a metre of polyurethane hose)
    atmosphere_Pa : standard atmosphere
    """

    tank_m3: float = 0.6e-3
    pump_flow_m3_s: float = 3.6e-3 / 60
    motor_power_W: float = 36.0
    pump_efficiency: float = 0.5
    switch_off_Pa: float = 600e3
    switch_on_Pa: float = 520e3
    accumulator_m3: float = 0.16e-3
    precharge_Pa: float = 300e3
    polytropic_index: float = 1.2
    orifice_diameter_m: float = 1e-3
    discharge_coefficient: float = 0.62
    critical_reynolds: float = 150.0
    valve_time_s: float = 2e-3
    density_kg_m3: float = 998.2
    viscosity_m2_s: float = 1.003e-6
    bulk_modulus_Pa: float = 2.18e9
    line_m3: float = 10e-6
    hose_compliance_m3_Pa: float = 1e-12
    atmosphere_Pa: float = 101325.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise InputError(f"drive: {name} is {value}; it must be positive")
        if not self.precharge_Pa < self.switch_on_Pa < self.switch_off_Pa:
            raise InputError("drive: precharge_Pa, switch_on_Pa and switch_off_Pa must rise in this order")

    @property
    def line_compliance_m3_Pa(self) -> float:
        """Volume that the line takes per pressure: the water's compressibility and the hose's."""
        return self.line_m3 / self.bulk_modulus_Pa + self.hose_compliance_m3_Pa
