"""An independent model of the tube for the proofs: dense, in absolute angles, from the Lagrangian; shares no engine code."""

import numpy as np


class DenseTube:
    """Joints at the start of n equal bodies; parameters as in the paper, at the rest radius. All by the textbook."""

    def __init__(self, actuator, n, gravity=9.80665):
        self.n, self.gravity = n, gravity
        self.r_o, self.r_i, self.length = actuator.outer_radius, actuator.inner_radius, actuator.length / n
        area = actuator.density * (self.r_o**2 - self.r_i**2) + actuator.fluid_density * self.r_i**2
        self.mass = area * np.pi * self.length
        self.inertia = self.mass * (3 * (self.r_o**2 + self.r_i**2) + self.length**2) / 12
        arm = np.zeros((n, n))  # arm[b, i]: d(centre of mass of b) / d(direction of i)
        for b in range(n):
            arm[b, :b], arm[b, b] = self.length, self.length / 2
        self.arm = arm
        self.coupling = self.mass * arm.T @ arm
        self.moment = self.mass * arm.sum(axis=0)

    def energy(self, phi, rate, par, pressure=0.0):
        """Kinetic, spring (constant stiffness), gravity; less the work of a constant pressure is left to the caller."""
        difference = phi[:, None] - phi[None, :]
        kinetic = 0.5 * rate @ ((self.coupling * np.cos(difference)) @ rate) + 0.5 * self.inertia * rate @ rate
        theta = np.diff(phi, prepend=0.0)
        return kinetic + 0.5 * par[0] * theta @ theta - self.gravity * self.moment @ np.cos(phi)

    def torques(self, theta, rate, pressure, par):
        radius = np.sqrt(self.r_o**2 - (self.r_o**2 - self.r_i**2) * self.length / (self.length + self.r_o * theta))
        softer = radius - self.r_i
        rising = par[2] + par[3] * softer
        falling = par[4] + par[5] * softer
        damper = np.where(np.real(rate) >= 0, rising, falling)
        return pressure * np.pi * radius**2 * par[6] - (par[0] + par[1] * softer) * theta - damper * rate

    def acceleration(self, phi, rate, pressure, par):
        difference = phi[:, None] - phi[None, :]
        mass = self.coupling * np.cos(difference) + self.inertia * np.eye(self.n)
        bias = (self.coupling * np.sin(difference)) @ rate**2 + self.gravity * self.moment * np.sin(phi)
        first = np.zeros_like(phi[:1])
        tau = self.torques(np.diff(phi, prepend=first), np.diff(rate, prepend=first), pressure, par)
        generalised = tau - np.append(tau[1:], first)
        return np.linalg.solve(mass, generalised - bias)

    def run(self, par, pressure, times, phi=None, rate=None, **options):
        """Reference motion (times, n) by SciPy's Radau at tight tolerance, broken at the kinks given in `breaks`."""
        from scipy.integrate import solve_ivp

        n = self.n
        state = np.concatenate([np.zeros(n) if phi is None else phi, np.zeros(n) if rate is None else rate])

        def slope(t, y):
            return np.concatenate([y[n:], self.acceleration(y[:n], y[n:], pressure(t), par)])

        solution = solve_ivp(slope, (0.0, times[-1]), state, "Radau", t_eval=times, rtol=1e-11, atol=1e-13, **options)
        assert solution.success
        return solution.y[:n].T
