"""Inverse dynamics: the joint torques that a given motion would need beside those of the law."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.dynamics.engine import _OPTIONS, _kinematics
from rfea_vision.dynamics.simulation import Model

FloatArray = NDArray[np.float64]


@njit(**_OPTIONS)
def _bias(chain, base_length, gravity, added, force, phi, om, al, out, motion, u, ac, with_force):
    n = chain.shape[0]
    _kinematics(chain, base_length, phi, om, al, u, ac, motion, gravity, with_force)
    fx, fy, needed = 0.0, 0.0, 0.0
    for i in range(n, 0, -1):
        ux, uy = u[i, 0], u[i, 1]
        nx, ny = uy, -ux
        mass = chain[i - 1, 1] + added[i - 1]
        along, across = chain[i - 1, 2], chain[i - 1, 3]
        qx, qy = along * nx + across * ux, along * ny + across * uy
        needed += (
            chain[i - 1, 4] * al[i] + mass * (ac[i, 0] * qx + ac[i, 1] * qy) + chain[i - 1, 0] * (nx * fx + ny * fy)
        )
        fx += mass * ac[i, 0]
        fy += mass * ac[i, 1]
        if with_force:
            along, across = chain[i - 1, 5], chain[i - 1, 6]
            sx, sy = along * nx + across * ux, along * ny + across * uy
            needed -= force[i - 1, 0, 0] * sx + force[i - 1, 1, 0] * sy
            fx -= force[i - 1, 0, 0]
            fy -= force[i - 1, 1, 0]
        out[i - 1] = needed


def joint_torques(
    model: Model,
    par: FloatArray,
    phi: FloatArray,
    rate: FloatArray,
    acceleration: FloatArray,
    states: FloatArray,
    pressure: FloatArray,
) -> FloatArray:
    """Torque at each joint (frames, n) in N m that the motion needs beside the law's own.

    phi, rate, acceleration : (frames, n + 1) absolute angles with the clamp first; states (frames, n, m); pressure (frames,) in Pa
    """
    frames, n = phi.shape[0], model.chain.bodies
    chain, _ = model._bodies(par)
    _, _, gravity, _ = model._environment(par)
    law = model.law
    felt = np.broadcast_to(
        np.asarray(law.felt_pressure(par, model._constants, pressure)[0][0], dtype=float), pressure.shape
    )
    columns, length = np.zeros((n, law.columns)), chain[:, 0].copy()
    force = np.zeros((n, 2, 5 + par.size))
    u, ac, motion = np.zeros((n + 1, 2)), np.zeros((n + 1, 2)), np.zeros((n, 4))
    out, needed = np.empty((frames, n)), np.zeros(n)
    for f in range(frames):
        theta, theta_rate = np.diff(phi[f]), np.diff(rate[f])
        law.module.joint_law(
            theta,
            theta_rate,
            np.ascontiguousarray(states[f]),
            float(felt[f]),
            model.chain.position,
            model.chain.arc,
            model._weights,
            par,
            model._constants,
            columns,
        )
        args = (np.ascontiguousarray(phi[f]), np.ascontiguousarray(rate[f]), np.ascontiguousarray(acceleration[f]))
        if law.has_body_force:
            _kinematics(chain, model.chain.base_length, *args, u, ac, motion, gravity, True)
            law.module.body_force(motion, length, par, model._constants, force)
        _bias(
            chain,
            model.chain.base_length,
            gravity,
            columns[:, 4].copy(),
            force,
            *args,
            needed,
            motion,
            u,
            ac,
            law.has_body_force,
        )
        out[f] = needed - columns[:, 0]
    return out
