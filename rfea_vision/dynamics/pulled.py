"""Steady state of a chain whose tip is pulled by a force: by a string that is then cut, or a weight on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.chain import Chain
from rfea_vision.dynamics.motion import Steady

#: The force is put on in so many parts; Newton steps at each, and the change (rad) at which they have come to rest.
PARTS, STEPS, SETTLED = 4, 40, 1e-10
#: Torque by which the difference for a derivative is taken, as a share of the force times the length.
NUDGE = 1e-5


def lever_torques(chain: Chain, phi: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Torques (n,) on the joints of a force (2,) in N at the end of the centre line, and their derivative (n, n + 1) by phi.

    By virtual work: the force times the derivative of the tip's place by each joint's angle. A clamp that turns (`base_rotation`)
    does not feel it.
    """
    body = phi[1:]
    by_body = chain.length[:, None] * np.stack([-np.cos(body), np.sin(body)], axis=1)
    again = chain.length[:, None] * np.stack([np.sin(body), np.cos(body)], axis=1)
    by_body[-1] += chain.offset * np.array([-np.sin(body[-1]), -np.cos(body[-1])])
    again[-1] += chain.offset * np.array([-np.cos(body[-1]), np.sin(body[-1])])
    torques = np.cumsum((by_body @ force)[::-1])[::-1].copy()
    derivative = np.zeros((chain.bodies, chain.bodies + 1))
    derivative[:, 1:] = np.triu(np.broadcast_to(again @ force, (chain.bodies, chain.bodies)))
    return torques, derivative


def steady_under_force(
    chain: Chain, force: FloatArray, solve: Callable[[FloatArray, FloatArray | None, bool], Steady]
) -> Steady:
    """Steady state with a force (2,) in N at the tip, in the dynamics' frame, and its derivatives by the parameters.

    Parameters
    ----------
    solve : steady state under given joint torques (n,), from given angles (n + 1,) or from the unloaded chain, with or without
        derivatives by the parameters
    """
    length = chain.base_length + chain.length.sum()
    nudge = NUDGE * max(float(np.linalg.norm(force)) * length, 1e-9)
    found = solve(np.zeros(chain.bodies), None, False)
    for share in np.linspace(0.0, 1.0, PARTS + 1)[1:]:
        for _ in range(STEPS):
            if not found.found:
                return found
            torques, slope = lever_torques(chain, found.phi, share * force)
            there = solve(torques, found.phi, False)
            if not there.found:
                return there
            by_torque, _ = _by_torque(there, torques, nudge, solve)
            change = np.linalg.solve(np.eye(found.phi.size) - by_torque @ slope, there.phi - found.phi)
            found = replace(there, phi=found.phi + change)
            if np.max(np.abs(change)) < SETTLED:
                break
        else:
            return replace(found, found=False)
    torques, slope = lever_torques(chain, found.phi, force)
    rest = solve(torques, found.phi, True)
    by_torque, states_by_torque = _by_torque(rest, torques, nudge, solve)
    sensitivity = np.linalg.solve(np.eye(rest.phi.size) - by_torque @ slope, rest.sensitivity)
    states = rest.state_sensitivity + np.einsum("nmj,jp->nmp", states_by_torque, slope @ sensitivity)
    return replace(rest, sensitivity=sensitivity, state_sensitivity=states)


def _by_torque(
    rest: Steady, torques: FloatArray, nudge: float, solve: Callable[[FloatArray, FloatArray | None, bool], Steady]
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of a steady state's angles (n + 1, n) and hidden states (n, m, n) by the torques on the joints."""
    angles, states = [], []
    for one in np.eye(torques.size):
        above, below = (solve(torques + way * nudge * one, rest.phi, False) for way in (1, -1))
        angles.append((above.phi - below.phi) / (2 * nudge))
        states.append((above.states - below.states) / (2 * nudge))
    return np.stack(angles, axis=-1), np.stack(states, axis=-1)
