"""Identities of the tube's geometry, as printed and corrected."""

import numpy as np
import pytest

from rfea_vision.dynamics.inverse import joint_torques
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.tube import body_inertia, body_mass, inner_radius
from testing.geometry import (
    AS_PRINTED,
    flow_needed,
    fluid_volume,
    fluid_volume_rate,
    hydraulic_torque,
    potential_energy,
)

ARC = 0.155 / 8


@pytest.fixture(params=[-0.2, 0.0, 0.3, 1.0])
def theta(request):
    return request.param


def test_closed_form_solves_the_differential_equation_of_the_inner_radius(actuator, theta):
    """Eq. DynInnerRadius integrates to eq. InnerRadius: 2 r_i dr_i/ds (L + s) = r_o^2 - r_i^2."""
    step = 1e-6
    slope = (inner_radius(actuator, theta + step, ARC) - inner_radius(actuator, theta - step, ARC)) / (2 * step)
    radius = inner_radius(actuator, theta, ARC)
    printed = (actuator.outer_radius**2 - radius**2) / (2 * (ARC + actuator.outer_radius * theta) * radius)
    assert slope == pytest.approx(printed * actuator.outer_radius, rel=1e-7)
    r_o, r_i0 = actuator.outer_radius, actuator.inner_radius
    as_printed = np.sqrt((r_o * theta + ARC) * (r_o**3 * theta + ARC * r_i0**2)) / (r_o * theta + ARC)
    assert radius == pytest.approx(as_printed, rel=1e-13)


def test_volume_grows_by_pi_outer_radius_cubed_per_radian(actuator, theta):
    constant = np.pi * actuator.outer_radius**3
    change = fluid_volume(actuator, theta, ARC) - fluid_volume(actuator, 0.0, ARC)
    assert change == pytest.approx(constant * theta, rel=1e-11, abs=1e-20)
    assert fluid_volume_rate(actuator, theta, 2.0, ARC) == pytest.approx(2 * constant, rel=1e-12)


def test_printed_segment_volume_leaves_out_the_volume_at_rest(actuator, theta):
    """What is missing is the rest volume's share, 2 pi r_i L_0 dr_i/dt, and nothing else."""
    rate = 1.3
    full = fluid_volume_rate(actuator, theta, rate, ARC)
    printed = fluid_volume_rate(actuator, theta, rate, ARC, as_printed=True)
    radius = inner_radius(actuator, theta, ARC)
    stretched = ARC + actuator.outer_radius * theta
    growth = (actuator.outer_radius**2 - radius**2) / (2 * stretched * radius) * actuator.outer_radius * rate
    assert full - printed == pytest.approx(2 * np.pi * radius * ARC * growth, rel=1e-10)
    assert abs(full - printed) > 0.1 * abs(full)


@pytest.mark.parametrize("bodies", [2, 8, 64])
def test_variant_with_the_angle_alpha_is_the_outer_radius(actuator, bodies, theta):
    """Eqs. HydTorqueAlpha and AlphaR: R cos(alpha) = r_o for any body length, so nothing is gained by it."""
    length = actuator.length / bodies
    variant = hydraulic_torque(actuator, 200e3, theta / bodies, length)
    assert variant == pytest.approx(
        hydraulic_torque(actuator, 200e3, theta / bodies, length, actuator.outer_radius), rel=1e-13
    )
    assert variant == pytest.approx(200e3 * np.pi * inner_radius(actuator, theta / bodies, length) ** 2 * 0.004)


def test_printed_tube_is_the_tube_by_its_diameters(actuator):
    assert (AS_PRINTED.outer_radius, AS_PRINTED.inner_radius) == (0.008, 0.006)
    assert (AS_PRINTED.outer_radius / 2, AS_PRINTED.inner_radius / 2) == (actuator.outer_radius, actuator.inner_radius)


def test_weight_of_the_chain_is_the_slope_of_its_energy(actuator):
    """m g y restores: its slope over each joint is the torque that holds the chain. The printed form's is not."""
    rng, n = np.random.default_rng(3), 5
    theta, model = rng.uniform(-0.3, 0.5, n), Model(Chain.tube(actuator, n, "start"))
    phi, still = np.concatenate([[0.0], np.cumsum(theta)])[None], np.zeros((1, n + 1))
    needed = joint_torques(model, np.zeros(7), phi, still, still, np.zeros((1, n, 1)), np.zeros(1))[0]

    def slope(**options):
        steps = 1e-6 * np.eye(n)
        ends = [[potential_energy(actuator, theta + s * d, 0.0, **options) for s in (1, -1)] for d in steps]
        return np.array([(up - down) / 2e-6 for up, down in ends])

    assert slope() == pytest.approx(needed, rel=1e-6)
    assert np.abs(slope(as_printed=True) - needed).max() > 0.1 * np.abs(needed).max()
    spring = potential_energy(actuator, theta, 0.2, gravity=0.0)
    assert spring == pytest.approx(0.1 * theta @ theta, rel=1e-14)


def test_flow_needed_for_a_pressure_trace(actuator, published):
    """Volume and its rate per segment and in total, along a run: the rate is the slope of the volume."""
    time = np.arange(0, 0.6, 1e-3)
    excitation = Excitation(0.0, 1e-3, np.interp(time, [0, 0.1, 0.4, 0.6], [20e3, 20e3, 200e3, 150e3]))
    motion = Model(Chain.tube(actuator, 8)).simulate(published, excitation, time[:-1])
    rates = np.diff(motion.rate, axis=1)
    volume, flow = fluid_volume(actuator, motion.theta, ARC), fluid_volume_rate(actuator, motion.theta, rates, ARC)
    total = flow_needed(actuator, rates)
    assert volume.shape == flow.shape == (599, 8) and total.shape == (599,)
    assert total == pytest.approx(flow.sum(axis=1), rel=1e-10, abs=1e-18)
    taken = np.sum((total[1:] + total[:-1]) / 2) * 1e-3
    assert volume[-1].sum() - volume[0].sum() == pytest.approx(taken, rel=1e-4)
    assert taken > 1e-7  # a tenth of a millilitre and more


def test_flow_needed_is_the_volume_rate_of_every_segment(actuator):
    rng = np.random.default_rng(0)
    theta, rates = rng.uniform(0, 0.5, (5, 8)), rng.normal(size=(5, 8))
    by_segment = fluid_volume_rate(actuator, theta, rates, ARC).sum(axis=1)
    assert np.allclose(flow_needed(actuator, rates), by_segment, rtol=1e-12)


def test_mass_and_inertia_are_those_of_a_hollow_cylinder_full_of_water(actuator):
    """Mass of two cylinders; eq. CylinderIx in its two limits, a thin rod and a thin disc."""
    mass = body_mass(actuator, ARC)
    rubber = actuator.density * np.pi * (actuator.outer_radius**2 - actuator.inner_radius**2) * ARC
    water = actuator.fluid_density * np.pi * actuator.inner_radius**2 * ARC
    assert mass == pytest.approx(rubber + water, rel=1e-14)
    long = body_inertia(actuator, 1.0)
    assert long == pytest.approx(body_mass(actuator, 1.0) / 12, rel=1e-4)  # a thin rod
    assert body_inertia(actuator, 1e-9) == pytest.approx(
        body_mass(actuator, 1e-9) * (actuator.outer_radius**2 + actuator.inner_radius**2) / 4, rel=1e-6
    )
