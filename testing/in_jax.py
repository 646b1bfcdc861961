"""The same scheme in JAX: SDIRK2 at a fixed step, Newton with the exact Jacobian, dense, jitted, one scan over the log.

Shares no code with the engine but the chain's numbers; a fixed number of Newton iterations per stage, so that `jax.jacfwd`
differentiates the whole run by automatic differentiation.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
GAMMA = 1 - 0.5**0.5


def chain_numbers(columns: np.ndarray, actuator: Any, arc: float, gravity: float) -> dict[str, Any]:
    """Coupling, moments and inertia of a chain from length, mass, centre of mass and inertia of its bodies."""
    length, mass, along, _, inertia = columns[:, :5].T
    n = length.size
    arm = np.tril(np.tile(length, (n, 1)), -1) + np.diag(along)  # d(centre of mass of b)/d(direction of i)
    return {
        "coupling": jnp.asarray(arm.T @ (mass[:, None] * arm)),
        "moment": jnp.asarray(gravity * mass @ arm),
        "inertia": jnp.asarray(inertia),
        "r_o": actuator.outer_radius,
        "r_i": actuator.inner_radius,
        "arc": arc,
    }


def _torque(tube: dict[str, Any], par: Any, theta: Any, rate: Any, pressure: Any) -> Any:
    """The paper's joint law."""
    r_o, r_i, arc = tube["r_o"], tube["r_i"], tube["arc"]
    radius = jnp.sqrt(r_o**2 - (r_o**2 - r_i**2) * arc / (arc + r_o * theta))
    softer = radius - r_i
    damper = jnp.where(rate >= 0, par[2] + par[3] * softer, par[4] + par[5] * softer)
    return pressure * jnp.pi * radius**2 * par[6] - (par[0] + par[1] * softer) * theta - damper * rate


def _newton(tube: dict[str, Any], par: Any, phi: Any, om: Any, al: Any, pressure: Any, s: float) -> Any:
    """Newton's change of the accelerations of one stage."""
    theta, rate = jnp.diff(phi, prepend=0.0), jnp.diff(om, prepend=0.0)
    one = jnp.ones_like(theta)
    law = partial(_torque, tube, par)
    tau, by_theta = jax.jvp(lambda t: law(t, rate, pressure), (theta,), (one,))
    _, by_rate = jax.jvp(lambda r: law(theta, r, pressure), (rate,), (one,))
    gap = phi[:, None] - phi[None, :]
    sine, cosine = tube["coupling"] * jnp.sin(gap), tube["coupling"] * jnp.cos(gap)
    net = tau - jnp.append(tau[1:], 0.0)
    residual = cosine @ al + tube["inertia"] * al + sine @ om**2 + tube["moment"] * jnp.sin(phi) - net
    turn = sine * al - cosine * om**2
    by_phi = turn - jnp.diag(turn.sum(axis=1)) + jnp.diag(tube["moment"] * jnp.cos(phi))
    jacobian = cosine + jnp.diag(tube["inertia"]) + 2 * s * sine * om + s * s * by_phi
    stiff = by_theta * s * s + by_rate * s
    joints = jnp.diag(stiff + jnp.append(stiff[1:], 0.0)) - jnp.diag(stiff[1:], 1) - jnp.diag(stiff[1:], -1)
    return -jnp.linalg.solve(jacobian - joints, residual)


def _stage(tube: dict[str, Any], par: Any, phi: Any, om: Any, al: Any, pressure: Any, s: float, iterations: int) -> Any:
    om, phi = om + s * al, phi + s * (om + s * al)
    for _ in range(iterations):
        x = _newton(tube, par, phi, om, al, pressure, s)
        al, om, phi = al + x, om + s * x, phi + s * s * x
    return phi, om, al


@partial(jax.jit, static_argnames=("step_s", "iterations"))
def run(par: Any, tube: dict[str, Any], phi: Any, pressure: Any, step_s: float, iterations: int) -> Any:
    """Absolute angles (steps + 1, n) from rest at `phi`; pressure (steps + 1,) at the grid, linear in between."""
    s, rest = GAMMA * step_s, (1 - GAMMA) * step_s

    def step(state: Any, ends: Any) -> Any:
        phi, om, al = state
        middle = ends[0] + GAMMA * (ends[1] - ends[0])
        _, om1, al1 = _stage(tube, par, phi, om, al, middle, s, iterations)
        state = _stage(tube, par, phi + rest * om1, om + rest * al1, al1, ends[1], s, iterations)
        return state, state[0]

    start = (phi, jnp.zeros_like(phi), jnp.zeros_like(phi))
    _, phis = jax.lax.scan(step, start, jnp.stack([pressure[:-1], pressure[1:]], axis=1))
    return jnp.concatenate([phi[None], phis])


@partial(jax.jit, static_argnames=("step_s", "iterations"))
def sensitivities(par: Any, tube: dict[str, Any], phi: Any, pressure: Any, step_s: float, iterations: int) -> Any:
    """d(angles)/d(parameters) by forward-mode automatic differentiation: (steps + 1, n, parameters)."""
    return jax.jacfwd(run)(par, tube, phi, pressure, step_s, iterations)
