"""Sensitivities against automatic differentiation: a small code of its own with dual numbers."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from rfea_vision.dynamics.simulation import Chain, Excitation, Model

GAMMA = 1 - math.sqrt(0.5)


class Dual:
    """A number with its gradient: forward-mode automatic differentiation, as small as it can be."""

    def __init__(self, value, gradient=0.0):
        self.v, self.d = float(value), gradient

    @staticmethod
    def of(other):
        return other if isinstance(other, Dual) else Dual(other)

    def __add__(self, other):
        other = Dual.of(other)
        return Dual(self.v + other.v, self.d + other.d)

    def __mul__(self, other):
        other = Dual.of(other)
        return Dual(self.v * other.v, self.d * other.v + self.v * other.d)

    def __truediv__(self, other):
        other = Dual.of(other)
        return Dual(self.v / other.v, (self.d - self.v / other.v * other.d) / other.v)

    def __neg__(self):
        return Dual(-self.v, -self.d)

    def __sub__(self, other):
        return self + (-Dual.of(other))

    def __rtruediv__(self, other):
        return Dual.of(other) / self

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other):
        return Dual.of(other) - self


def sine(x):
    return Dual(math.sin(x.v), math.cos(x.v) * x.d)


def cosine(x):
    return Dual(math.cos(x.v), -math.sin(x.v) * x.d)


def root(x):
    return Dual(math.sqrt(x.v), 0.5 / math.sqrt(x.v) * x.d)


def _tau(par, theta, rate, pressure, actuator, arc):
    r_o, r_i = actuator.outer_radius, actuator.inner_radius
    radius = root(r_o**2 - (r_o**2 - r_i**2) * arc / (arc + r_o * theta))
    softer = radius - r_i
    damper = par[2] + par[3] * softer if rate.v >= 0 else par[4] + par[5] * softer
    return pressure * math.pi * radius * radius * par[6] - (par[0] + par[1] * softer) * theta - damper * rate


def _residual(par, phi, om, al, pressure, actuator):
    """Two bodies with joints at their start, in absolute angles, by the textbook's double pendulum."""
    length = actuator.length / 2
    area = actuator.density * (actuator.outer_radius**2 - actuator.inner_radius**2)
    mass = (area + actuator.fluid_density * actuator.inner_radius**2) * math.pi * length
    own = mass * (3 * (actuator.outer_radius**2 + actuator.inner_radius**2) + length**2) / 12
    first = _tau(par, phi[0], om[0], pressure, actuator, length)
    second = _tau(par, phi[1] - phi[0], om[1] - om[0], pressure, actuator, length)
    gap, couple, g = phi[0] - phi[1], mass * length**2 / 2, 9.80665
    upper = (own + mass * length**2 / 4 + mass * length**2) * al[0] + couple * cosine(gap) * al[1]
    upper += couple * sine(gap) * om[1] * om[1] + 1.5 * mass * g * length * sine(phi[0]) - first + second
    lower = (own + mass * length**2 / 4) * al[1] + couple * cosine(gap) * al[0]
    lower += -couple * sine(gap) * om[0] * om[0] + 0.5 * mass * g * length * sine(phi[1]) - second
    return upper, lower


def _stage(par, phi, om, al, pressure, s, actuator):
    """Newton with a Jacobian by dual numbers, its last steps on numbers that carry the gradient by the parameters."""
    for _ in range(8):
        plain = [Dual(p.v) for p in par]

        def moved(column, plain=plain, al=al):
            x = [Dual(a.v, float(k == column)) for k, a in enumerate(al)]
            rates = [o.v + s * xi for o, xi in zip(om, x, strict=True)]
            angles = [p.v + s * r for p, r in zip(phi, rates, strict=True)]
            return [r.d for r in _residual(plain, angles, rates, x, pressure, actuator)]

        (a, c), (b, d) = moved(0), moved(1)
        rates = [o + s * x for o, x in zip(om, al, strict=True)]
        angles = [p + s * r for p, r in zip(phi, rates, strict=True)]
        upper, lower = _residual(par, angles, rates, al, pressure, actuator)
        determinant = a * d - b * c
        al = [al[0] - (d * upper - b * lower) / determinant, al[1] - (a * lower - c * upper) / determinant]
    rates = [o + s * x for o, x in zip(om, al, strict=True)]
    return [p + s * r for p, r in zip(phi, rates, strict=True)], rates, al


def _run_in_duals(values, pressure, step, theta, actuator):
    """Angles (steps + 1, 2) and their gradients (steps + 1, 2, 7) by the engine's scheme."""
    par = [Dual(value, np.eye(7)[k]) for k, value in enumerate(values)]
    none = np.zeros(7)
    phi = [Dual(angle, none) for angle in np.cumsum(theta)]
    om, al = [Dual(0, none), Dual(0, none)], [Dual(0, none), Dual(0, none)]
    rows = [phi]
    for before, after in pairwise(pressure):
        middle = before + GAMMA * (after - before)
        _, rates, al = _stage(par, phi, om, al, middle, GAMMA * step, actuator)
        rest = (1 - GAMMA) * step
        phi = [p + rest * r for p, r in zip(phi, rates, strict=True)]
        om = [o + rest * a for o, a in zip(om, al, strict=True)]
        phi, om, al = _stage(par, phi, om, al, after, GAMMA * step, actuator)
        rows.append(phi)
    return np.array([[p.v for p in row] for row in rows]), np.array([[p.d for p in row] for row in rows])


PAR = np.array([0.04, -60.0, 1.2e-3, -1.0, 0.8e-3, -2.0, 0.0036])


def test_sensitivities_are_those_of_dual_numbers(actuator):
    """Every digit that rounding leaves, for all seven parameters, through a rise and a fall."""
    step = 1e-3
    pressure = np.interp(np.arange(81) * step, [0, 0.03, 0.05, 0.08], [20e3, 150e3, 150e3, 60e3])
    angles, gradients = _run_in_duals(PAR, pressure, step, [0.1, 0.05], actuator)
    model = Model(Chain.tube(actuator, 2, "start"), order=2, tolerance=1e-14)
    start = (np.array([0.1, 0.05]), np.zeros(2))
    motion = model.simulate(PAR, Excitation(0.0, step, pressure), np.arange(81) * step, range(7), start=start)
    assert motion.ok
    assert np.abs(motion.phi[:, 1:] - angles).max() < 1e-12
    size = np.abs(gradients).max(axis=(0, 1))
    assert np.all(size > 0) and np.ptp(angles[:, 1]) > 0.1
    assert np.all(np.abs(motion.sensitivity[:, 1:] - gradients).max(axis=(0, 1)) < 1e-9 * size)
