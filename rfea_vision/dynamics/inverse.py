"""Inverse dynamics: the joint torques that a given motion would need beside those of the law."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.dynamics.engine import (
    ACROSS,
    ACX,
    ACY,
    AL,
    ALONG,
    BODY_COLUMNS,
    FORCE_ACROSS,
    FORCE_ALONG,
    INERTIA,
    LENGTH,
    MASS,
    OM,
    OPTIONS,
    PHI,
    UX,
    UY,
    kinematics,
)
from rfea_vision.dynamics.simulation import Model

FloatArray = NDArray[np.float64]


@njit(**OPTIONS)
def _move(chain, base_length, gravity, body, motion, with_force):
    kinematics(chain, base_length, gravity, body, motion, with_force)


@njit(**OPTIONS)
def _needed(chain, added, force, body, out, with_force):
    n = chain.shape[0]
    fx, fy, needed = 0.0, 0.0, 0.0
    for i in range(n, 0, -1):
        ux, uy = body[i, UX], body[i, UY]
        nx, ny = uy, -ux
        mass = chain[i - 1, MASS] + added[i - 1]
        along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
        qx, qy = along * nx + across * ux, along * ny + across * uy
        needed += chain[i - 1, INERTIA] * body[i, AL] + mass * (body[i, ACX] * qx + body[i, ACY] * qy)
        needed += chain[i - 1, LENGTH] * (nx * fx + ny * fy)
        fx += mass * body[i, ACX]
        fy += mass * body[i, ACY]
        if with_force:
            along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
            qx, qy = along * nx + across * ux, along * ny + across * uy
            needed -= force[i - 1, 0, 0] * qx + force[i - 1, 1, 0] * qy
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
    body, motion = np.zeros((n + 2, BODY_COLUMNS)), np.zeros((n, 4))
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
        body[:-1, PHI], body[:-1, OM], body[:-1, AL] = phi[f], rate[f], acceleration[f]
        _move(chain, model.chain.base_length, gravity, body, motion, law.has_body_force)
        if law.has_body_force:
            law.module.body_force(motion, length, par, model._constants, force)
        _needed(chain, columns[:, 4].copy(), force, body, needed, law.has_body_force)
        out[f] = needed - columns[:, 0]
    return out
