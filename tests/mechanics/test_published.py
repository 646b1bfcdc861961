"""The paper's tables, its errata, and what the steady state says of them (docs/physics.md)."""

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.parameters import PER_DEGREE, PUBLISHED, as_paper
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from testing.geometry import hinge_line_tip
from testing.steady import bending_angle, holding_pressure, limit_point, steady_curve


def _tip_mm(name, pressure):
    table = PUBLISHED[name]
    actuator = Actuator()
    model = Model(Chain.tube(actuator, table.segments, "start"))
    rest = model.steady(table.vector(), pressure)
    assert rest.found
    return hinge_line_tip(np.diff(rest.phi), actuator.length / table.segments) * 1e3


def test_printed_radii_are_diameters():
    """With 8 and 6 mm as radii every coefficient at rest is negative; with 4 and 3 mm they are what springs can be."""
    wrong, right = PUBLISHED["8-DoF"].vector(0.006), PUBLISHED["8-DoF"].vector(0.003)
    assert wrong[0] / PER_DEGREE == pytest.approx(-0.0394, abs=1e-4)
    assert wrong[2] / PER_DEGREE == pytest.approx(-2.7e-4, rel=0.02)
    assert wrong[4] / PER_DEGREE == pytest.approx(-5.5e-4, rel=0.01)
    assert right[0] / PER_DEGREE == pytest.approx(0.00295, abs=1e-5)
    assert right[2] / PER_DEGREE == pytest.approx(3.13e-5, rel=0.01)
    assert right[4] / PER_DEGREE == pytest.approx(1.92e-5, rel=0.01)
    assert PUBLISHED["2-DoF"].vector(0.003)[4] / PER_DEGREE == pytest.approx(-5.4e-8, rel=0.01)  # the falling damper


def test_table_survives_the_change_of_parametrisation():
    table = PUBLISHED["8-DoF"]
    back = as_paper(table.vector())
    for name in ("k_0", "m_k", "b_0pos", "m_bpos", "b_0neg", "m_bneg", "r_hyd"):
        assert back[name] == pytest.approx(getattr(table, name), rel=1e-9)


def test_tables_agree_in_y_and_differ_in_x_at_270_kPa():
    """Just what the paper's path plots show: identified on tip y, so y agrees and x does not."""
    two, eight = _tip_mm("2-DoF", 270e3), _tip_mm("8-DoF", 270e3)
    assert two == pytest.approx([-115.8, -90.6], abs=0.1)
    assert eight == pytest.approx([-106.5, -88.9], abs=0.1)
    assert abs(two[1] - eight[1]) < 2 < 9 < abs(two[0] - eight[0])


def test_validation_at_220_kPa():
    """The paper validates at 220 kPa: the two tables still agree in y within its figures' accuracy, x again does not."""
    two, eight = _tip_mm("2-DoF", 220e3), _tip_mm("8-DoF", 220e3)
    assert two == pytest.approx([-100.1, -111.5], abs=0.1)
    assert eight == pytest.approx([-89.9, -114.5], abs=0.1)


def test_steady_state_satisfies_the_torque_equilibrium(actuator, published):
    pressures = np.array([-10e3, 0.0, 50e3, 270e3, 380e3])
    angle = bending_angle(published, 8, pressures, actuator)
    assert np.all(np.diff(angle) > 0) and angle[1] == 0
    assert holding_pressure(published, 8, angle, actuator) == pytest.approx(pressures, abs=1e-3)


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("joints", ["middle", "start"])
def test_chain_without_gravity_bends_as_the_closed_form(name, joints, actuator):
    """Every joint bends alike without gravity: the chain and eq. BendingAngleSS with k_ss = k_j / n are one."""
    table = PUBLISHED[name]
    model = Model(Chain.tube(actuator, table.segments, joints), gravity=0.0)
    curve = steady_curve(model, table.vector(), [50e3, 150e3, 250e3])
    assert curve.found.all() and curve.limit_Pa is None and (curve.stability > 0).all()
    expected = bending_angle(table.vector(), table.segments, curve.pressure_Pa, actuator)
    assert curve.angle_rad == pytest.approx(expected, rel=1e-10)


def test_table_ends_at_a_limit_point_and_says_so(actuator, published):
    limit = limit_point(published, 8, actuator)
    assert limit is not None
    assert limit.pressure_Pa == pytest.approx(382.0e3, abs=100)
    assert np.rad2deg(limit.angle_rad) == pytest.approx(229.8, abs=0.2)
    below, above = bending_angle(published, 8, [limit.pressure_Pa - 1, limit.pressure_Pa + 1], actuator)
    assert below == pytest.approx(limit.angle_rad, abs=0.02) and np.isnan(above)
    # Past the limit the balance exists but is unstable: less pressure holds a larger angle.
    assert holding_pressure(published, 8, limit.angle_rad + 0.2, actuator) < limit.pressure_Pa
    for gravity in (0.0, 9.80665):
        curve = steady_curve(Model(Chain.tube(actuator, 8, "start"), gravity=gravity), published, [300e3, 400e3])
        assert list(curve.found) == [True, False]
        assert curve.limit_Pa == pytest.approx(382e3, rel=2e-3) and np.isnan(curve.tip_m[1]).all()


def test_constant_spring_has_no_limit(actuator, published):
    constant = published.copy()
    constant[1] = 0.0
    assert limit_point(constant, 8, actuator, np.pi) is None
    # Beyond the largest angle asked for there is no answer either.
    assert np.isnan(bending_angle(constant, 8, 5e6, actuator, np.pi))


def test_spring_that_is_negative_at_rest_has_no_steady_state(actuator, published):
    negative = published.copy()
    negative[0] = -0.01
    limit = limit_point(negative, 8, actuator)
    assert limit is not None and limit.pressure_Pa == 0.0
    assert np.isnan(bending_angle(negative, 8, 10e3, actuator))


def test_above_the_limit_point_a_run_starts_where_the_tube_falls_to(actuator, published):
    time = np.arange(0, 0.1, 1e-3)
    model = Model(Chain.tube(actuator, 8))
    assert not model.steady(published, 400e3).found
    excitation = Excitation.from_log(time, np.full(time.size, 400e3), 0, 0.09)
    motion = model.simulate(published, excitation, np.array([0.0, 0.05]))
    assert motion.ok and motion.phi[0, -1] > 4 * np.pi and np.abs(motion.phi[1] - motion.phi[0]).max() < 1e-3


def test_kinematics_closed_form():
    """Eq. KinematicsClosedForm, term by term."""
    theta = np.array([0.2, -0.1, 0.4])
    x = -0.05 * (np.sin(0.2) + np.sin(0.1) + np.sin(0.5))
    y = -0.05 * (np.cos(0.2) + np.cos(0.1) + np.cos(0.5))
    assert hinge_line_tip(theta, 0.05) == pytest.approx([x, y], rel=1e-14)


@pytest.mark.parametrize("joints", ["middle", "start"])
def test_centre_line_hangs_one_radius_outside_the_hinge_line(joints, actuator, published):
    model = Model(Chain.tube(actuator, 8, joints))
    curve = steady_curve(model, published, [0.0, 200e3])
    assert curve.tip_m[0] == pytest.approx([0.0, -actuator.length], abs=1e-12)
    phi = curve.phi[1]
    if joints == "start":
        hinge = hinge_line_tip(np.diff(phi), actuator.length / 8)
        outward = np.array([np.cos(phi[-1]), -np.sin(phi[-1])])
        expected = hinge - [actuator.outer_radius, 0] + actuator.outer_radius * outward
        assert curve.tip_m[1] == pytest.approx(expected, abs=1e-12)
