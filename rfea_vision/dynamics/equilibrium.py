"""Steady state of the chain at one pressure, with its derivatives by the parameters. Legend as in `engine`."""

from __future__ import annotations

import numpy as np
from numba import float64, int64, njit, types

from rfea_vision.dynamics.engine import factor, kinematics, solve
from rfea_vision.dynamics.newton import wound_up
from rfea_vision.dynamics.sensitivity import (
    C_PRESSURE,
    CARRY_ROWS,
    LANES,
    ROWS,
    S_AL,
    S_TORQUE,
    answer,
    gather,
    outward,
    set_constants,
)
from rfea_vision.dynamics.states import relaxed_factors
from rfea_vision.dynamics.system import (
    ALLOCATING,
    BETA,
    BLOWN_UP,
    CUBE,
    FIXED,
    FORCE_LAW,
    INDEX,
    INLINE,
    JOINT_CUBE,
    JOINT_LAW,
    MATRIX,
    NOT_CONVERGED,
    OK,
    OPTIONS,
    PHI,
    RESIDUAL,
    STEP,
    SYSTEM,
    VECTOR,
    allocate,
    call_joint_law,
    joint_angles,
)

LARGEST_STEP = 0.3  # rad per Newton step


@njit(**ALLOCATING)
def _derivatives(system, work, out_par, relaxed, dpressure, free, S_phi, S_z):
    """Implicit function theorem at the steady state: writes S_phi (n + 1, p) and S_z (n, m, p)."""
    n, m, p = system.chain.shape[0], system.states, free.size
    blocks = (p + LANES - 1) // LANES
    lanes, carry = np.zeros((blocks, n + 2, ROWS * LANES)), np.zeros((blocks, CARRY_ROWS * LANES))
    set_constants(system, free, lanes, carry)
    for block in range(blocks):
        rows, hand = lanes[block], carry[block]
        part = free[block * LANES : (block + 1) * LANES]
        width = lanes.shape[2] // ROWS
        gather(out_par, part, rows)
        for k in range(part.size):
            hand[C_PRESSURE + k] = dpressure[part[k]]
            for j in range(n):
                for a in range(m):
                    zeta = relaxed[j, a, 3 + part[k]] + relaxed[j, a, 2] * dpressure[part[k]]
                    S_z[j, a, block * LANES + k] = zeta
                    rows[j + 1, S_TORQUE + k] += work.out[j, FIXED + a] * zeta
        outward(system, work, rows, hand, part, True, width, 0.0, 0.0, 0.0)
        answer(system, work, rows, hand, width)
        for k in range(part.size):
            column = block * LANES + k
            for i in range(n + 1):
                S_phi[i, column] = rows[i, S_AL + k]
            for j in range(n):
                for a in range(m):
                    S_z[j, a, column] += work.Sx[j, a] * (rows[j + 1, S_AL + k] - rows[j, S_AL + k])


@njit(**INLINE)
def _newton_step(joint_law, relaxed_law, force_law, system, work, relaxed, pressure, drive):
    """Newton's change of every angle (column STEP), with the hidden states relaxed."""
    body, z = work.body, work.z
    joint_angles(body, work.theta, work.rate)
    if system.states > 0:
        call_joint_law(relaxed_law, system, work, pressure, relaxed)
        for j in range(z.shape[0]):
            for a in range(system.states):
                z[j, a] = relaxed[j, a, 0]
    call_joint_law(joint_law, system, work, pressure, work.out)
    for j in range(drive.size):
        work.out[j, 0] += drive[j]
    kinematics(system, body, work.motion)
    if system.with_force:
        force_law(work.motion, system.length, system.par, system.con, work.force)
    relaxed_factors(work, relaxed, system.states)
    if system.with_force:
        factor(system, body, work.out, work.force, 7, 0.0, 0.0, 1.0)
        solve(system, body, 7, RESIDUAL, STEP, work.d)
    else:
        factor(system, body, work.out, work.force, 3, 0.0, 0.0, 1.0)
        solve(system, body, 3, RESIDUAL, STEP, work.d)


@njit(
    types.Tuple((int64, float64))(
        *(JOINT_LAW, JOINT_CUBE, JOINT_CUBE, FORCE_LAW, SYSTEM),
        *(float64, VECTOR, VECTOR, INDEX, VECTOR, MATRIX, MATRIX, CUBE),
    ),
    **OPTIONS,
)
def equilibrium(
    joint_law,
    joint_parameters,
    relaxed_law,
    force_law,
    system,
    pressure,
    dpressure,
    drive,
    free,
    phi,
    z,
    S_phi,
    S_z,
):
    """Solve for phi (n + 1) in place, from the start that it holds; S_phi (n + 1, p), S_z (n, m, p) follow.

    Returns (status, stability): the smallest pivot of the stiffness along the chain, positive where it is stable.
    """
    n, m, count = system.chain.shape[0], system.states, system.par.size
    work, relaxed = allocate(system), np.zeros((n, max(m, 1), 3 + count))
    body, status = work.body, NOT_CONVERGED
    for i in range(n + 1):
        body[i, PHI] = phi[i]
    for _ in range(60):
        _newton_step(joint_law, relaxed_law, force_law, system, work, relaxed, pressure, drive)
        largest, total = abs(body[0, STEP]), body[0, STEP]
        for i in range(1, n + 1):
            largest = max(largest, abs(body[i, STEP] - body[i - 1, STEP]))
            total += body[i, STEP]
        if not np.isfinite(total):  # max() passes over what is not a number
            return BLOWN_UP, 0.0
        part = min(1.0, LARGEST_STEP / largest) if largest > 0 else 1.0
        for i in range(n + 1):
            body[i, PHI] += part * body[i, STEP]
        if largest < 1e-12:
            status = OK
            break
    stability = np.inf
    for i in range(1, n + 1):
        stability = min(stability, body[i, BETA])
    for i in range(n + 1):
        phi[i] = body[i, PHI]
    z[:, :] = work.z
    if wound_up(body):
        return BLOWN_UP, stability
    if free.size > 0 and status == OK:
        joint_angles(body, work.theta, work.rate)
        out_par = np.zeros((n, 2 + m, count))
        call_joint_law(joint_parameters, system, work, pressure, out_par)
        _derivatives(system, work, out_par, relaxed, dpressure, free, S_phi, S_z)
    return status, stability
