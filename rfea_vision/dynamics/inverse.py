"""Inverse dynamics: the joint torques that a given motion would need beside those of the law."""

from __future__ import annotations

import numpy as np
from numba import njit, void

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.engine import kinematics
from rfea_vision.dynamics.simulation import Model
from rfea_vision.dynamics.system import (
    ACROSS,
    ACX,
    ACY,
    ADDED,
    ADDED_ALONG,
    ADX,
    ADY,
    AL,
    ALONG,
    CUBE,
    FORCE_ACROSS,
    FORCE_ALONG,
    FORCE_LAW,
    INERTIA,
    JOINT_LAW,
    LENGTH,
    MASS,
    MATRIX,
    OM,
    OPPOSED,
    OPTIONS,
    PHI,
    SYSTEM,
    TAU,
    UX,
    UY,
    VECTOR,
    allocate,
    call_joint_law,
    copy_rows,
    joint_angles,
)


@njit(void(JOINT_LAW, FORCE_LAW, SYSTEM, MATRIX, MATRIX, MATRIX, CUBE, VECTOR, VECTOR, MATRIX), **OPTIONS)
def _joint_torques(joint_law, force_law, system, phi, rate, acceleration, states, felt, opposed, needed):
    """Write what every frame's motion needs beside the law's torque into `needed` (frames, n)."""
    n, work, chain = system.chain.shape[0], allocate(system), system.chain
    body, force = work.body, work.force
    for frame in range(felt.size):
        for i in range(n + 1):
            body[i, PHI], body[i, OM], body[i, AL] = phi[frame, i], rate[frame, i], acceleration[frame, i]
        if system.states > 0:
            copy_rows(states[frame], work.z)
        joint_angles(body, work.theta, work.rate)
        system.con[OPPOSED] = opposed[frame]
        call_joint_law(joint_law, system, work, felt[frame], work.out)
        kinematics(system, body, work.motion)
        if system.with_force:
            force_law(work.motion, system.length, system.par, system.con, force)
        fx, fy, torque = 0.0, 0.0, 0.0
        for i in range(n, 0, -1):
            ux, uy = body[i, UX], body[i, UY]
            nx, ny = uy, -ux
            mass = chain[i - 1, MASS]
            along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
            qx, qy = along * nx + across * ux, along * ny + across * uy
            torque += chain[i - 1, INERTIA] * body[i, AL] + mass * (body[i, ACX] * qx + body[i, ACY] * qy)
            torque += chain[i - 1, LENGTH] * (nx * fx + ny * fy)
            fx += mass * body[i, ACX]
            fy += mass * body[i, ACY]
            if system.with_added:
                mass, along = work.out[i - 1, ADDED], chain[i - 1, ADDED_ALONG]
                qx, qy = along * nx + across * ux, along * ny + across * uy
                torque += mass * (body[i, ADX] * qx + body[i, ADY] * qy)
                fx += mass * body[i, ADX]
                fy += mass * body[i, ADY]
            if system.with_force:
                along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
                qx, qy = along * nx + across * ux, along * ny + across * uy
                torque -= force[i - 1, 0, 0] * qx + force[i - 1, 1, 0] * qy
                fx -= force[i - 1, 0, 0]
                fy -= force[i - 1, 1, 0]
            needed[frame, i - 1] = torque - work.out[i - 1, TAU]


def joint_torques(
    model: Model,
    par: FloatArray,
    phi: FloatArray,
    rate: FloatArray,
    acceleration: FloatArray,
    states: FloatArray,
    pressure: FloatArray,
    opposed: FloatArray | None = None,
) -> FloatArray:
    """Torque at each joint (frames, n) in N m that the motion needs beside the law's own.

    phi, rate, acceleration : (frames, n + 1) absolute angles with the clamp first; states (frames, n, m); pressure (frames,) in Pa
    opposed : (frames,) in Pa, of several chambers what the sum of all pressures is beyond it; see `Excitation.opposed`
    """
    par = np.asarray(par, dtype=float)
    felt = np.empty(pressure.shape)
    felt[:] = model.law.felt_pressure(par, model._constants, pressure)[0][0]
    needed = np.empty((phi.shape[0], model.chain.bodies))
    angles, rates, accelerations, hidden = (
        np.ascontiguousarray(values, dtype=float) for values in (phi, rate, acceleration, states)
    )
    system = model.system(par)
    laws = model.law.loops
    beyond = np.zeros(felt.size) if opposed is None else np.ascontiguousarray(opposed, dtype=float)
    _joint_torques(laws.joint_law, laws.body_force, system, angles, rates, accelerations, hidden, felt, beyond, needed)
    return needed
