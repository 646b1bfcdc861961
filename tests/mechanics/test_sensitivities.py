"""Exact sensitivities: against finite differences on every layout, and against an independent symbolic derivation."""

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag

from rfea_vision.dynamics.parameters import scaled
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.base import BASE_PARAMETERS


def _difference(model, par, index, step, excitation, frames):
    """Derivative of the angles by one parameter, from a run to either side."""
    move = step * np.eye(par.size)[index]
    above, below = (model.simulate(par + sign * move, excitation, frames).phi for sign in (1, -1))
    return (above - below) / (2 * step)


@pytest.mark.parametrize("joints", ["middle", "start"])
@pytest.mark.parametrize("n", [1, 4, 16, 64])
def test_base_parameters_against_finite_differences(n, joints, actuator, published, excitation, frames):
    model = Model(Chain.tube(actuator, n, joints), tolerance=1e-13)
    par = scaled(published, 8, n)
    frames = frames[:72]  # rise, hold, fall
    exact = model.simulate(par, excitation, frames, range(7)).sensitivity
    for index, name in enumerate(BASE_PARAMETERS):
        difference = _difference(model, par, index, 2e-6 * abs(par[index]), excitation, frames)
        assert np.abs(exact[..., index] - difference).max() < 1e-5 * np.abs(difference).max(), name


def test_default_tolerance_gives_the_same_sensitivities(actuator, published, excitation, frames):
    """The factors left by Newton are those of its last iteration: good to the tolerance it was given."""
    tight, usual = (
        Model(Chain.tube(actuator, 8), tolerance=tolerance).simulate(published, excitation, frames, range(7))
        for tolerance in (1e-13, 1e-8)
    )
    size = np.abs(tight.sensitivity).max(axis=(0, 1))
    assert np.all(np.abs(tight.sensitivity - usual.sensitivity).max(axis=(0, 1)) < 1e-4 * size)


def test_asking_for_few_gives_the_same_as_asking_for_all(actuator, published, excitation, frames):
    model = Model(Chain.tube(actuator, 8))
    every = model.simulate(published, excitation, frames, range(7)).sensitivity
    some = model.simulate(published, excitation, frames, (6, 2)).sensitivity
    assert np.array_equal(some, every[..., [6, 2]])
    assert model.simulate(published, excitation, frames).sensitivity.shape[2] == 0


def test_more_parameters_than_one_block(actuator, published, excitation, frames):
    """Parameters are taken eight at a time: the ninth and those behind it are no worse."""
    from rfea_vision.effects.catalogue import catalogue

    ids = ("maxwell", "payload", "drag", "base_rotation", "fluid_damping", "stiffness_profile", "pressure_lag")
    model = Model(Chain.tube(actuator, 8), tuple(catalogue()[i]() for i in ids), tolerance=1e-13)
    values = {"maxwell.k1": 0.1, "maxwell.T": 0.3, "payload.m": 1e-3, "drag.c": 5.0, "base_rotation.c": 0.3}
    values |= {"fluid_damping.R": 1e8, "stiffness_profile.a1": 0.05, "pressure_lag.T": 5e-3}
    par = np.append(published, [values.get(name, 0.0) for name in model.names[7:]])
    frames = frames[:60]
    exact = model.simulate(par, excitation, frames, range(par.size)).sensitivity
    for index in range(7, par.size):
        difference = _difference(model, par, index, 1e-5 * max(abs(par[index]), 0.01), excitation, frames)
        assert np.abs(exact[..., index] - difference).max() < 1e-4 * np.abs(difference).max(), model.names[index]


def _symbolic_double_joint(actuator, pressure_law):
    """Two bodies from the Lagrangian in SymPy: (slope of the state, its Jacobian by the state, by the parameters)."""
    t = sp.Symbol("t")
    phi = [sp.Function(f"phi{i}")(t) for i in range(2)]
    par = sp.symbols(BASE_PARAMETERS, real=True)
    length, r_o, r_i = (sp.Float(v, 30) for v in (actuator.length / 2, actuator.outer_radius, actuator.inner_radius))
    area = actuator.density * (r_o**2 - r_i**2) + actuator.fluid_density * r_i**2
    mass = area * sp.pi * length
    inertia = mass * (3 * (r_o**2 + r_i**2) + length**2) / 12
    x, y, lagrangian = sp.Integer(0), sp.Integer(0), sp.Integer(0)
    for angle in phi:
        cx, cy = x - length / 2 * sp.sin(angle), y - length / 2 * sp.cos(angle)
        lagrangian += mass * (sp.diff(cx, t) ** 2 + sp.diff(cy, t) ** 2) / 2 + inertia * sp.diff(angle, t) ** 2 / 2
        lagrangian -= mass * sp.Float(9.80665) * cy
        x, y = x - length * sp.sin(angle), y - length * sp.cos(angle)
    q, v, a = sp.symbols("q:2"), sp.symbols("v:2"), sp.symbols("a:2")
    theta, rate = (q[0], q[1] - q[0]), (v[0], v[1] - v[0])
    tau = []
    for joint in range(2):
        radius = sp.sqrt(r_o**2 - (r_o**2 - r_i**2) * length / (length + r_o * theta[joint]))
        stiffness = par[0] + par[1] * (radius - r_i)
        rising, falling = par[2] + par[3] * (radius - r_i), par[4] + par[5] * (radius - r_i)
        damper = sp.Piecewise((rising, rate[joint] >= 0), (falling, True))
        pressure = sp.Symbol("p")
        tau.append(pressure * sp.pi * radius**2 * par[6] - stiffness * theta[joint] - damper * rate[joint])
    generalised = (tau[0] - tau[1], tau[1])
    plain = dict(zip([sp.diff(p, t, 2) for p in phi], a, strict=True))
    plain |= dict(zip([sp.diff(p, t) for p in phi], v, strict=True)) | dict(zip(phi, q, strict=True))
    equations = []
    for angle, force in zip(phi, generalised, strict=True):
        left = sp.diff(sp.diff(lagrangian, sp.diff(angle, t)), t) - sp.diff(lagrangian, angle)
        equations.append(left.subs(plain) - force)
    matrix, rest = sp.linear_eq_to_matrix(equations, a)
    slope = sp.Matrix([*v, *matrix.LUsolve(rest)])
    state = (*q, *v)
    arguments = (state, sp.Symbol("p"), par)
    functions = [
        sp.lambdify(arguments, item, "numpy", cse=True) for item in (slope, slope.jacobian(state), slope.jacobian(par))
    ]

    def extended(time, z, values):
        """State and its 4 x 7 sensitivities, by the variational equations."""
        y, S = z[:4], z[4:].reshape(4, 7)
        f, fy, fp = (function(y, pressure_law(time), values) for function in functions)
        return np.concatenate([np.ravel(f), (np.asarray(fy) @ S + np.asarray(fp)).ravel()])

    def slope_of(time, z, values):
        """Derivative of that by itself, but for what the motion does to the sensitivities' slope: enough for Newton's steps."""
        fy = np.asarray(functions[1](z[:4], pressure_law(time), values), dtype=float)
        return block_diag(fy, np.kron(fy, np.eye(7)))

    return extended, slope_of


@pytest.mark.study
def test_against_a_symbolic_lagrangian_differentiated_exactly(actuator):
    """Two joints: the Lagrangian derived and differentiated by SymPy, its variational equations run by Radau at 1e-8."""
    par = np.array([0.04, -60.0, 1.2e-3, -1.0, 0.8e-3, -2.0, 0.0036])
    knots, values = np.array([0, 0.1, 0.25, 0.35]), np.array([0, 150e3, 150e3, 60e3])

    def pressure(time):
        return np.interp(time, knots, values)

    extended, slope_of = _symbolic_double_joint(actuator, pressure)
    times = np.array([0.05, 0.1, 0.2, 0.25, 0.3, 0.35])
    state = np.zeros(4 + 28)
    seen = []
    # One stretch per kink of the pressure, so that the reference sees smooth right-hand sides.
    for begin, end in pairwise(knots):
        inside = times[(times > begin) & (times <= end)]
        accuracy = {"rtol": 1e-8, "atol": 1e-11, "jac": slope_of}
        run = solve_ivp(extended, (begin, end), state, "Radau", inside, args=(par,), **accuracy)
        assert run.success
        seen.append(run.y.T)
        state = run.y[:, -1]
    reference = np.concatenate(seen)
    expected = reference[:, 4:].reshape(-1, 4, 7)[:, :2]
    size = np.abs(expected).max(axis=(0, 1))
    errors = []
    for step in (2e-4, 1e-4, 5e-5):
        excitation = Excitation(0.0, step, pressure(step * np.arange(round(0.35 / step) + 1)))
        model = Model(Chain.tube(actuator, 2, "start"), order=3, tolerance=1e-13)
        motion = model.simulate(par, excitation, times, range(7))
        assert np.abs(motion.phi[:, 1:] - reference[:, :2]).max() < 1e-5
        errors.append(np.abs(motion.sensitivity[:, 1:] - expected).max(axis=(0, 1)) / size)
    # What is left is the step at which the damper changes sides: it goes with the step, and belongs to b alone.
    assert errors[-1].max() < 1e-4 and errors[-1][[0, 1, 6]].max() < 3e-5, errors
    assert np.median(errors[0] / errors[-1]) > 4
