"""The drive: water is kept, the switch switches, pressure stays between tank and supply, and rest is rest."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfea_vision.drive import Drive, DriveConstants, orifice_flow
from rfea_vision.errors import InputError

CONSTANTS = DriveConstants()


def _run(drive, seconds, supply, drain, flow=lambda t: 0.0, step=1e-3):
    """Pressure in the line, in the supply, and whether the pump ran, after every step."""
    rows = []
    for k in range(round(seconds / step)):
        now = (k + 0.5) * step
        pressure = drive.step(step, supply=supply(now), drain=drain(now), tube_flow_m3_s=flow(now))
        rows.append((pressure, drive.supply_Pa(), drive.state.pump_runs))
    return np.array(rows)


def closed(_):
    return 0.0


def opened(_):
    return 1.0


def test_paper_numbers_are_the_papers():
    assert CONSTANTS.tank_m3 == pytest.approx(0.6e-3)
    assert CONSTANTS.pump_flow_m3_s * 60e3 == pytest.approx(3.6)  # l/min
    assert CONSTANTS.motor_power_W == 36 and CONSTANTS.switch_off_Pa == 600e3
    assert CONSTANTS.orifice_diameter_m == 1e-3


def test_orifice_formula():
    """C_d A sqrt(2 dp / rho) where the flow is turbulent, odd in the pressure drop, linear near zero, none when closed."""
    area = np.pi * (1e-3) ** 2 / 4
    expected = 0.62 * area * np.sqrt(2 * 300e3 / 998.2)
    assert orifice_flow(300e3, 1.0, CONSTANTS) == pytest.approx(expected, rel=1e-6)
    assert orifice_flow(-300e3, 1.0, CONSTANTS) == -orifice_flow(300e3, 1.0, CONSTANTS)
    assert orifice_flow(300e3, 0.5, CONSTANTS) == pytest.approx(expected / 2, rel=1e-6)
    assert orifice_flow(300e3, 0.0, CONSTANTS) == 0
    assert orifice_flow(0.02, 1.0, CONSTANTS) == pytest.approx(2 * orifice_flow(0.01, 1.0, CONSTANTS), rel=1e-4)


def test_water_is_kept():
    """Through pulses of both valves, a moving tube and a running pump: not a drop is lost."""
    drive = Drive()
    first = drive.water_m3()
    rows = _run(
        drive,
        6.0,
        lambda t: float(t % 0.2 < 0.06),
        lambda t: float(0.1 < t % 0.2 < 0.16),
        lambda t: 3e-6 * np.sin(9 * t),
    )
    assert rows[:, 2].any() and np.ptp(rows[:, 0]) > 50e3  # the pump ran, and the pressure moved
    assert drive.water_m3() == pytest.approx(first, abs=1e-15)


def test_switch_has_hysteresis():
    """With both valves open the supply sinks to the lower threshold, and is filled to the upper one: never beyond."""
    rows = _run(Drive(), 15.0, opened, opened)
    supply, runs = rows[:, 1], rows[:, 2].astype(bool)
    starts = np.flatnonzero(runs[1:] & ~runs[:-1])
    stops = np.flatnonzero(~runs[1:] & runs[:-1])
    assert starts.size >= 2 and stops.size >= 2
    assert supply[starts] == pytest.approx(CONSTANTS.switch_on_Pa, rel=5e-3)
    assert supply[stops] == pytest.approx(CONSTANTS.switch_off_Pa, rel=5e-3)
    assert supply.max() < 1.005 * CONSTANTS.switch_off_Pa


@pytest.mark.parametrize("seed", [0, 1])
def test_pressure_stays_between_tank_and_supply(seed):
    rng = np.random.default_rng(seed)
    told = rng.integers(0, 2, (2, 300))
    rows = _run(Drive(), 3.0, lambda t: float(told[0, int(t / 0.01)]), lambda t: float(told[1, int(t / 0.01)]))
    assert rows[:, 0].min() >= 0 and np.all(rows[:, 0] <= rows[:, 1] + 1e-6)


def test_rest_is_rest():
    drive = Drive(pressure_Pa=120e3)
    rows = _run(drive, 1.0, closed, closed)
    assert rows[:, 0] == pytest.approx(120e3, abs=1e-3) and not rows[:, 2].any()


def test_filling_of_a_stiff_line_is_the_differential_equation():
    """Valve opening, orifice and compliance against SciPy's Radau at 1e-9, with a large accumulator."""
    c = DriveConstants(accumulator_m3=1.0, tank_m3=2.0)
    drive = Drive(c)
    supply = drive.supply_Pa()

    def slope(t, p):
        return [orifice_flow(supply - float(p[0]), min(t / c.valve_time_s, 1.0), c) / c.line_compliance_m3_Pa]

    times = np.arange(1, 61) * 1e-3
    exact = solve_ivp(slope, (0, 0.06), [0.0], "Radau", times, rtol=1e-9, atol=1e-3, max_step=1e-3).y[0]
    rows = _run(drive, 0.06, opened, closed)
    # Backward Euler of 0.25 ms; the valve opens by whole parts.
    assert np.abs(rows[:, 0] - exact).max() < 0.02 * supply
    fine = Drive(c)
    for _ in range(8):
        finer = _run(fine, 0.0025, opened, closed, step=2.5e-5)[-1, 0]
    assert abs(finer - exact[19]) < 2e-3 * supply


def test_compliance_is_of_water_and_hose():
    """A closed line takes a flow as dp = dV / (V / K + C_hose)."""
    drive = Drive(pressure_Pa=50e3)
    _run(drive, 0.1, closed, closed, lambda t: -1e-6)
    stiff = CONSTANTS.line_m3 / CONSTANTS.bulk_modulus_Pa + CONSTANTS.hose_compliance_m3_Pa
    assert drive.state.pressure_Pa - 50e3 == pytest.approx(1e-7 / stiff, rel=1e-6)


def test_gas_law_of_the_accumulator():
    """p V^n is the same, full or half empty."""
    drive = Drive()
    c = CONSTANTS

    def invariant():
        gas = c.accumulator_m3 - drive.state.accumulator_m3
        return (drive.supply_Pa() + c.atmosphere_Pa) * gas**c.polytropic_index

    first, before = invariant(), drive.supply_Pa()
    _run(drive, 1.0, opened, opened)
    assert drive.supply_Pa() < before - 10e3
    assert invariant() == pytest.approx(first, rel=1e-12)
    assert first == pytest.approx((c.precharge_Pa + c.atmosphere_Pa) * c.accumulator_m3**c.polytropic_index, rel=1e-12)


def test_constants_that_cannot_be_are_refused():
    with pytest.raises(InputError, match=r"orifice_diameter_m is -0\.001"):
        DriveConstants(orifice_diameter_m=-1e-3)
    with pytest.raises(InputError, match="must rise in this order"):
        DriveConstants(switch_on_Pa=700e3)
