"""Other rigs than the paper's: how gravity stands, sections that are no tube, and runs that begin held by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.inverse import joint_torques
from rfea_vision.dynamics.laws import PRESSURE, compose
from rfea_vision.dynamics.parameters import PUBLISHED
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.catalogue import catalogue, find_effects
from rfea_vision.errors import InputError
from rfea_vision.fitting.camera_view import seen_by_camera

BEAM = Actuator(outer_radius=0.015, inner_radius=0.0075, length=0.1, density=1070.0, kind="rectangle", width=0.03)
MODULUS = 0.26e6


def _beam(n, mounting=np.pi / 2, effects=()):
    stiffness = MODULUS * BEAM.bending_moment_of_area * n / BEAM.length
    par = np.array([stiffness, 0.0, 0.002 * stiffness, 0.0, 0.002 * stiffness, 0.0, 0.015])
    return Model(Chain.tube(BEAM, n), effects, mounting=mounting), par


def test_a_horizontal_beam_sags_as_a_cantilever():
    """w L^4 / (8 E I), for a sag small enough to be linear; a chain of n joints comes near with 1 / n^2."""
    light = 0.02
    model, par = _beam(64)
    model = model.rigged(model.gravity * light, model.mounting)
    rest = model.steady(par, 0.0)
    assert rest.found
    tip = -np.sum(model.chain.length * np.sin(rest.phi[1:]))
    weight = BEAM.linear_density * model.gravity
    assert tip == pytest.approx(-weight * BEAM.length**4 / (8 * MODULUS * BEAM.bending_moment_of_area), rel=2e-3)


def test_a_beam_that_is_let_go_swings_at_the_frequency_of_a_cantilever():
    model, par = _beam(16, mounting=0.0)
    model = model.rigged(0.0, 0.0)
    excitation = Excitation(0.0, 1e-3, np.zeros(2001))
    frames = np.arange(0, 1.9, 1e-3)
    share = 1 - model.chain.position
    motion = model.simulate(par, excitation, frames, held=0.02 * share / share.sum())
    assert motion.ok and motion.phi[0, -1] == pytest.approx(0.02)
    signal = motion.phi[:, -1]
    crossings = frames[1:][np.diff(np.sign(signal)) < 0]
    measured = 1 / np.mean(np.diff(crossings))
    # Euler and Bernoulli, less what rotatory inertia takes of so thick a beam (Rayleigh): about one part in forty.
    slender = (
        1.8751**2 / (2 * np.pi) * np.sqrt(MODULUS * BEAM.bending_moment_of_area / BEAM.linear_density) / BEAM.length**2
    )
    assert 0.95 * slender < measured < slender


@pytest.mark.parametrize("degrees", [-90.0, 30.0, 180.0])
def test_mounting_turns_gravity_as_gravity_tilt_does(degrees):
    """The rig's angle and the effect's add up: the effect is measured from how the rig stands."""
    model, par = _beam(8, mounting=np.deg2rad(degrees))
    tilted, _ = _beam(8, mounting=0.0, effects=(catalogue()["gravity_tilt"](),))
    seen = model.system(par).gravity
    assert seen == pytest.approx(tilted.system(np.append(par, np.deg2rad(degrees))).gravity, abs=1e-12)
    assert np.linalg.norm(seen) == pytest.approx(9.80665)


def test_hidden_states_of_a_held_tube_are_relaxed():
    model, par = _beam(4, effects=(catalogue()["maxwell"](),))
    held = np.array([0.02, 0.01, 0.0, -0.01])
    motion = model.simulate(
        np.append(par, [0.5, 1.0]), Excitation(0.0, 1e-3, np.zeros(11)), np.array([1e-3]), held=held
    )
    assert motion.ok and motion.states[0, :, 0] == pytest.approx(held, rel=1e-2, abs=1e-4)


def test_the_derivative_of_a_held_start_whose_hidden_states_hang_on_the_pressure():
    """Behind a line of second order a joint feels a pressure of its own: at first that of the log and the sensor's zero."""
    model, par = _beam(3, effects=tuple(find_effects(["pressure_lag:second_order", "pressure_offset"])))
    model = replace(model, tolerance=1e-13)
    par = np.append(par, [0.05, 3e3])
    excitation, frames = Excitation(0.0, 1e-3, np.full(101, 1e4)), np.linspace(0.01, 0.1, 5)
    held = {"held": np.full(3, 0.05)}
    exact = model.simulate(par, excitation, frames, [8], **held).sensitivity[..., 0]
    step = 0.3 * np.eye(par.size)[8]
    above, below = (model.simulate(par + way * step, excitation, frames, **held).phi for way in (1, -1))
    assert np.abs(exact - (above - below) / 0.6).max() < 1e-4 * np.abs(exact).max()


@pytest.mark.parametrize("ids", [("payload", "com_offset"), ("pressure_gain", "pressure_offset")])
def test_effects_are_one_model_in_whatever_order_they_are_asked_for(ids):
    """The load hangs at the tip, wherever the tube's own mass sits: moving that moves no load."""
    known = {"payload.m": 0.02, "com_offset.a": 1.0, "pressure_gain.g": 1.5, "pressure_offset.p0": 2e4}
    bends = []
    for order in (ids, ids[::-1]):
        model = Model(Chain.tube(Actuator(), 3), tuple(find_effects(order)))
        par = np.append(PUBLISHED["8-DoF"].vector(), [known[name] for name in model.names[7:]])
        bends.append(model.steady(par, 5e4).phi)
    np.testing.assert_allclose(*bends, rtol=1e-12)


def test_behind_a_line_of_second_order_everything_in_a_joint_feels_its_pressure():
    """The spring that stiffens and the bore that widens, too, and not the torque alone."""
    law = compose(
        find_effects(["pressure_lag:second_order", "pressure_stiffening", "radial_expansion", "virtual_work"])
    )
    assert law.torque.has(law.states[0]) and not law.torque.has(PRESSURE)


def test_a_beam_keeps_its_section():
    model, par = _beam(4)
    bent = par.copy()
    bent[[1, 3, 5]] = 1.0
    start = (np.full(4, 0.2), np.zeros(4))
    excitation = Excitation(0.0, 1e-3, np.zeros(101))
    runs = [model.simulate(values, excitation, np.array([0.1]), start=start).phi for values in (par, bent)]
    assert np.array_equal(*runs)


def test_mass_as_weighed_stands_for_the_densities():
    weighed = Actuator(mass_per_length=0.0332 / 0.07, length=0.07)
    assert Chain.tube(weighed, 8).mass.sum() == pytest.approx(0.0332 * 15 / 16)  # half a body is held in the clamp
    with pytest.raises(InputError, match="mass_per_length is missing"):
        Actuator(kind="custom")


def test_what_flows_out_leaves_a_mass_that_can_be_moved():
    """A light, thick rod that is bent back, where pi r_o^3 theta of fluid is more than it weighs: its mass matrix stays positive."""
    rod = Actuator(outer_radius=0.009, length=0.12, mass_per_length=0.0108 / 0.12, kind="rod")
    model = Model(Chain.tube(rod, 8), (catalogue()["variable_mass"](),))
    par = np.array([0.01, 0.0, 1e-4, 0.0, 1e-4, 0.0, 0.015, 3.0])
    phi = np.tile(np.concatenate([[0.0], np.cumsum(np.full(8, -0.4))]), (9, 1))
    accelerations = np.zeros((9, 9))
    for joint in range(8):
        accelerations[joint + 1, joint + 1 :] = 1.0
    torques = joint_torques(model, par, phi, np.zeros((9, 9)), accelerations, np.zeros((9, 8, 0)), np.zeros(9))
    mass = torques[1:] - torques[0]
    assert mass == pytest.approx(mass.T, rel=1e-9, abs=1e-18)
    assert np.linalg.eigvalsh(mass)[0] > 0


ROD = Actuator(kind="rod", outer_radius=0.0125, inner_radius=0.0044, length=0.07, mass_per_length=0.47)
ROD_AT_REST = np.array([0.2, 0.0, 6e-3, 0.0, 0.0, 0.0, 0.0125])


def _swung(angle, *, rod=ROD, damper=6e-3, other=0.0, direction=None, pressure=0.0):
    """A rod without weight that is let go bent by `angle`, to whichever side, at a pressure."""
    model = Model(Chain.tube(rod, 4), find_effects([] if direction is None else ["damping_direction"]), gravity=0.0)
    par = np.append(ROD_AT_REST, [] if direction is None else [direction])
    par[2], par[4] = damper, other
    excitation = Excitation(0.0, 1e-3, np.full(801, pressure))
    motion = model.simulate(par, excitation, np.arange(0.0, 0.8, 1e-3), held=np.full(4, angle / 4))
    assert motion.ok
    return motion


@pytest.mark.parametrize("direction", [None, 0.8])
def test_the_dampers_of_a_body_without_a_bore_know_no_side(direction):
    """Let go on the left it is the mirror of one let go on the right, and what stands for a second damper moves nothing."""
    left, right = (_swung(way * 0.6, other=0.03, direction=direction) for way in (1.0, -1.0))
    np.testing.assert_allclose(left.phi, -right.phi, atol=1e-9)
    np.testing.assert_array_equal(left.phi, _swung(0.6, direction=direction).phi)


def test_a_body_may_be_damped_more_on_its_way_out_than_back():
    """With 1.8 times the damper out and 0.2 times back it takes so many times as long; it weighs next to nothing."""

    def half_way_s(motion):
        share = (motion.phi[:, -1] - motion.phi[0, -1]) / (motion.phi[-1, -1] - motion.phi[0, -1])
        return np.interp(0.5, share, np.arange(share.size) * 1e-3)

    light = replace(ROD, mass_per_length=1e-3)
    back, out = ({"rod": light, "angle": 0.6}, {"rod": light, "angle": 0.0, "pressure": -1.5e5})
    for way, times in ((back, 0.2), (out, 1.8)):
        assert half_way_s(_swung(**way, direction=0.8)) == pytest.approx(times * half_way_s(_swung(**way)), rel=0.1)


def test_swinging_through_rest_with_uneven_dampers_costs_the_integrator_next_to_nothing():
    even, uneven = (_swung(0.6, damper=3e-4, direction=direction) for direction in (0.0, 0.8))
    assert even.phi[:, -1].min() < -0.1 and uneven.phi[:, -1].min() < -0.1
    assert uneven.steps == even.steps and uneven.newton_iterations < 1.2 * even.newton_iterations


def test_a_spring_stiffens_with_the_pressures_on_both_sides():
    """Two chambers at one pressure do not bend a rod and do stiffen it: what a third bends is less."""
    model = Model(Chain.tube(ROD, 4), find_effects(["pressure_stiffening"]), gravity=0.0)
    par, step = np.append(ROD_AT_REST, 5e-6), np.linspace(0.0, 4e4, 1500)
    frames = np.array([2.9])

    def bend(both):
        left, right = step + both, np.full(step.size, both)
        chambers = {"left": (1.0, left), "right": (-1.0, right)}
        motion = model.simulate(par, Excitation(0.0, 2e-3, left - right, chambers=chambers), frames)
        assert motion.ok
        return motion.phi[0, -1]

    assert bend(1e5) == pytest.approx(bend(0.0) * (1 + 5e-6 * 4e4) / (1 + 5e-6 * (4e4 + 2e5)), rel=2e-3)
    alone = model.simulate(par, Excitation(0.0, 2e-3, step), frames).phi[0, -1]
    assert bend(0.0) == alone


FLAT = Actuator(kind="rectangle", width=0.022, outer_radius=0.006, inner_radius=0.0067, length=0.07, mass_per_length=0.2)
FINGER = replace(FLAT, keeps="side")


def test_a_finger_with_a_layer_that_does_not_stretch_bends_about_it_and_keeps_its_chamber():
    """Its middle grows by half its thickness times the bend, as a tube's does; the pressure's lever and the damper are a beam's."""
    model = Model(Chain.tube(FINGER, 8), (), gravity=0.0)
    par = np.array([0.2, 0.0, 6e-3, 0.0, 0.0, 0.0, 0.006])
    bends = [model.steady(par, p).phi[-1] for p in (1e4, 3e4)]
    assert bends[1] == pytest.approx(3 * bends[0]) and bends[1] == pytest.approx(8 * 3e4 * np.pi * 0.0067**2 * 0.006 / 0.2)
    motion = model.simulate(par, Excitation(0.0, 1e-3, np.full(801, 3e4)), np.array([0.7]))
    line = seen_by_camera(model, par, motion, np.linspace(0, 1, 400), [], np.array([3e4]))[0][0]
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert length == pytest.approx(FINGER.length + 0.006 * motion.phi[0, -1], rel=1e-4)
    assert FINGER.bending_moment_of_area == pytest.approx(4 * FLAT.bending_moment_of_area)


def test_the_damper_of_such_a_finger_knows_no_side():
    """What stands for a second damper, of a tube that straightens, moves nothing."""
    there, other = (_swung(0.6, rod=FINGER, other=other) for other in (0.0, 0.03))
    np.testing.assert_array_equal(there.phi, other.phi)
