"""The plant hides no effect of its own, and its effects do what their names say."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.errors import DataError
from rfea_vision.twin import HIDDEN, OUTSIDE, BaseParameters, TwinOptions
from rfea_vision.twin.draw import build_plant, camera_times, draw_runs, highest_pressure, move, posture_at
from rfea_vision.twin.options import with_partners
from rfea_vision.twin.plant import Plant
from rfea_vision.twin.shape import hinge_arcs, line_at

TIP = np.array([1.0])


def tip_mm(
    hidden: dict[str, float] | None = None, joints: int = 32, step_s: float = 0.001, duration_s: float = 1.0
) -> np.ndarray:
    return _tip_mm(tuple((hidden or {}).items()), joints, step_s, duration_s)


@cache
def _tip_mm(hidden: tuple[tuple[str, float], ...], joints: int, step_s: float, duration_s: float) -> np.ndarray:
    options = TwinOptions(hidden=dict(hidden), seed=3, joints=joints, step_s=step_s, duration_s=duration_s)
    plant, _ = build_plant(options)
    run = draw_runs(options, highest_pressure(plant, options))[0]
    motion = move(plant, run, step_s)
    return posture_at(plant, motion, run.offset_s + camera_times(options)).line(TIP)[0][:, 0]


def apart_mm(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.max(np.hypot(*(a - b).T)))


def test_32_and_128_joints_agree_within_a_fiftieth_of_a_millimetre() -> None:
    coarse, fine = tip_mm(joints=32), tip_mm(joints=128)
    assert np.ptp(coarse[:, 0]) > 50  # it did move
    assert apart_mm(coarse, fine) < 0.02


@pytest.mark.parametrize("hidden", [{}, {"coulomb.tau_c": 3e-4}, {"maxwell.k1": 0.05}, {"hysteresis.tau_h": 3e-4}])
def test_step_and_half_step_agree_within_a_fiftieth_of_a_millimetre(hidden: dict[str, float]) -> None:
    assert apart_mm(tip_mm(hidden), tip_mm(hidden, step_s=0.0005)) < 0.02


def test_order_of_the_integrator_is_two() -> None:
    exact, coarse, fine = (tip_mm({"pressure_lag.T": 0.05}, 16, step) for step in (0.0005, 0.004, 0.002))
    coarse, fine = apart_mm(coarse, exact), apart_mm(fine, exact)
    assert 1.6 < math.log2(coarse / fine) < 2.6


def test_published_table_reaches_its_published_place() -> None:
    """Table EstimatedParam, eight joints at the starts of their bodies, 270 kPa; hinge line from x = 0."""
    plant = Plant(Actuator(), BaseParameters(), {}, joints=8, layout="start")
    theta = plant.equilibrium(270e3)
    phi = np.cumsum(theta)
    length = 0.155 / 8  # eq. KinematicsClosedForm
    tip = -1e3 * length * np.array([np.sin(phi).sum(), np.cos(phi).sum()])
    assert tip == pytest.approx([-106.5, -88.9], abs=0.1)
    angles, lengths = hinge_arcs(theta[None], 0.155, "start")
    centre = 1e3 * line_at(angles, lengths, TIP, np.array([0.004]))[0][0, 0]
    outward = np.array([np.cos(phi[-1]), -np.sin(phi[-1])])
    assert centre == pytest.approx(tip + [-4, 0] + 4 * outward, abs=1e-6)


def test_joints_at_the_start_of_each_body_are_another_tube() -> None:
    start = Plant(Actuator(), BaseParameters(), {}, joints=8, layout="start")
    middle = Plant(Actuator(), BaseParameters(), {}, joints=48)
    tips = [
        line_at(*hinge_arcs(plant.equilibrium(2e5)[None], 0.155, plant.layout), TIP, np.array([0.004]))[0][0, 0]
        for plant in (start, middle)
    ]
    assert np.hypot(*(tips[0] - tips[1])) > 0.9e-3


def test_static_equilibrium_balances_moments() -> None:
    """The torque of joint j is the moment of the weight hanging below it."""
    actuator = Actuator()
    plant = Plant(actuator, BaseParameters(), {}, joints=40)
    theta = plant.equilibrium(1.5e5)
    torque = plant.law.torque(theta, np.zeros(40), plant.law.relaxed(theta), 1.5e5, 0.0)
    fraction = (np.arange(4000) + 0.5) / 4000
    arcs = hinge_arcs(theta[None], actuator.length)
    hinge = line_at(*arcs, fraction, np.array([actuator.outer_radius]), offset=-1.0)[0][0]
    weight = plant.chain.line_density * actuator.length / 4000 * 9.80665
    for joint in (0, 13, 30):
        start = (joint + 0.5) / 40
        below = fraction > start
        at = line_at(*arcs, np.array([start]), np.array([actuator.outer_radius]), offset=-1.0)[0][0, 0]
        moment = -weight * np.sum(hinge[below, 0] - at[0])  # pulls back towards straight
        assert torque[joint] == pytest.approx(moment, rel=0.01)


def test_energy_is_kept_when_nothing_dissipates() -> None:
    """A nearly undamped tube swings on: kinetic and potential energy together fall only by what the damper takes."""
    base = BaseParameters(b_pos_ref=1e-9, b_pos_slope=0, b_neg_ref=1e-9, b_neg_slope=0, k_slope=0)
    plant = Plant(Actuator(), base, {}, joints=12)
    motion = plant.run(lambda time: np.full_like(time, 5e4), 0.0, 0.01, 0.0005)
    assert np.max(np.abs(motion.rate)) < 1e-6  # an equilibrium stays
    motion = plant.run(lambda time: 5e4 * (time > 0.005), 0.0, 0.6, 0.0002)
    swing = motion.theta.sum(axis=1)
    early, late = np.ptp(swing[:1500]), np.ptp(swing[1500:])
    assert late == pytest.approx(early, rel=0.1)


STRENGTHS: dict[str, dict[str, float]] = {
    "virtual_work": {"virtual_work.a": 0.1},
    "variable_mass": {"variable_mass.a": 1.0},
    "payload": {"payload.m": 1e-3},
    "com_offset": {"com_offset.a": 1.0},
    "gravity_tilt": {"gravity_tilt.angle": 0.05},
    "rest_curvature": {"rest_curvature.angle": 0.05},
    "rest_curvature_profile": {"rest_curvature_profile.a1": 0.05, "rest_curvature_profile.a2": 0.05},
    "nonlinear_stiffness": {"nonlinear_stiffness.c": 0.03},
    "pressure_stiffening": {"pressure_stiffening.c": 3e-7},
    "stiffness_profile": {"stiffness_profile.a1": 0.1, "stiffness_profile.a2": 0.1, "stiffness_profile.a3": 0.1},
    "damping_profile": {"damping_profile.a1": 0.2, "damping_profile.a2": 0.2},
    "nonlinear_damping": {"nonlinear_damping.c": 0.02},
    "maxwell": {"maxwell.k1": 0.05},
    "hysteresis": {"hysteresis.tau_h": 3e-4},
    "coulomb": {"coulomb.tau_c": 3e-4},
    "mullins": {"mullins.c": 0.05},
    "radial_expansion": {"radial_expansion.c": 5e-9},
    "compressibility": {"compressibility.c": 1e-8},
    "fluid_inertia": {"fluid_inertia.I": 1e8},
    "fluid_damping": {"fluid_damping.R": 3e9},
    "drag": {"drag.c": 5.0},
    "contact": {"contact.k": 50.0, "contact.d": 0.05},
    "base_rotation": {"base_rotation.c": 1.0},
    "pressure_lag": {"pressure_lag.T": 0.02},
    "pressure_gain": {"pressure_gain.g": 1.03},
    "pressure_offset": {"pressure_offset.p0": 3e3},
    "fan": {"fan.F": 0.05},
    "warm_up": {"warm_up.c": 0.05},
    "shaking": {"shaking.a": 0.3},
    "heavy_section": {"heavy_section.m": 1e-3},
    "kink": {"kink.c": 0.3},
}
MEASURED = {"time_offset", "clock_drift", "camera_scale", "camera_roll", "plane_tilt"}  # effects on the measurement: test_campaign.py


def quick_tip_mm(hidden: dict[str, float]) -> np.ndarray:
    return tip_mm(hidden, joints=8, step_s=0.004, duration_s=0.5)


@pytest.fixture(scope="module")
def without() -> np.ndarray:
    return quick_tip_mm({})


@pytest.mark.parametrize("effect", sorted({key.split(".")[0] for key in HIDDEN} - MEASURED))
def test_every_effect_moves_the_tip_and_vanishes_at_its_absent_value(effect: str, without: np.ndarray) -> None:
    absent = {key: HIDDEN[key].absent for key in STRENGTHS[effect]}
    assert apart_mm(quick_tip_mm(with_partners(absent)), without) < 1e-6
    assert apart_mm(quick_tip_mm(STRENGTHS[effect]), without) > 0.1


def test_at_least_three_effects_are_in_no_catalogue() -> None:
    assert len(OUTSIDE) >= 3
    assert all(any(key.startswith(f"{effect}.") for key in HIDDEN) for effect in OUTSIDE)


def test_beyond_the_limit_point_there_is_no_equilibrium() -> None:
    plant = Plant(Actuator(), BaseParameters(), {}, joints=32)
    with pytest.raises(DataError, match="pressure_max_kPa"):
        plant.equilibrium(450e3)
