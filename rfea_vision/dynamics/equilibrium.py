"""Steady state of the chain at one pressure, with its derivatives by the parameters. Legend as in `engine`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float64, int64, njit, types

from rfea_vision.dynamics.engine import (
    BETA,
    BLOWN_UP,
    BODY_COLUMNS,
    CUBE,
    FIXED,
    FORCE_LAW,
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
    VECTOR,
    factor,
    kinematics,
    solve,
)
from rfea_vision.dynamics.integration import BODIES, INDEX, LARGEST_JOINT_ANGLE, joint_angles
from rfea_vision.dynamics.sensitivity import (
    C_PRESSURE,
    CARRY_ROWS,
    LANES,
    ROWS,
    S_AL,
    S_TORQUE,
    gather,
    set_constants,
    sweep,
)
from rfea_vision.dynamics.states import relaxed_factors

LARGEST_STEP = 0.3  # rad per Newton step
_EQUILIBRIUM = types.Tuple((int64, float64))(
    JOINT_LAW,
    JOINT_CUBE,
    JOINT_CUBE,
    FORCE_LAW,
    *BODIES,
    float64,
    VECTOR,
    VECTOR,
    int64,
    int64,
    boolean,
    boolean,
    INDEX,
    VECTOR,
    MATRIX,
    MATRIX,
    CUBE,
)


class Clamped(NamedTuple):
    """What factor and solve need of the setting."""

    chain: Any
    base_length: Any
    line: Any
    with_base: Any


@njit(**INLINE)
def _derivatives(
    chain,
    dchain,
    base_length,
    line,
    dline,
    dgravity,
    body,
    out,
    out_par,
    relaxed,
    force,
    dpressure,
    m,
    D,
    with_base,
    Sx,
    free,
    S_phi,
    S_z,
):
    """Implicit function theorem at the steady state: writes S_phi (n + 1, p) and S_z (n, m, p)."""
    n, p = chain.shape[0], free.size
    blocks = (p + LANES - 1) // LANES
    lanes, carry = np.zeros((blocks, n + 2, ROWS * LANES)), np.zeros((blocks, CARRY_ROWS * LANES))
    set_constants(dchain, dgravity, dline[2], free, lanes, carry)
    for block in range(blocks):
        rows, hand = lanes[block], carry[block]
        part = free[block * LANES : (block + 1) * LANES]
        width = lanes.shape[2] // ROWS
        gather(out_par, part, rows, width)
        for k in range(part.size):
            hand[C_PRESSURE + k] = dpressure[part[k]]
            for j in range(n):
                for a in range(m):
                    zeta = relaxed[j, a, 3 + part[k]] + relaxed[j, a, 2] * dpressure[part[k]]
                    S_z[j, a, block * LANES + k] = zeta
                    rows[j + 1, S_TORQUE + k] += out[j, FIXED + a] * zeta
        sweep(
            chain,
            base_length,
            line[2],
            body,
            out,
            force,
            rows,
            hand,
            part,
            D,
            True,
            with_base,
            width,
        )
        for k in range(part.size):
            column = block * LANES + k
            for i in range(n + 1):
                S_phi[i, column] = rows[i, S_AL + k]
            for j in range(n):
                for a in range(m):
                    S_z[j, a, column] += Sx[j, a] * (rows[j + 1, S_AL + k] - rows[j, S_AL + k])


@njit(_EQUILIBRIUM, **OPTIONS)
def equilibrium(
    law,
    law_par,
    relaxed_law,
    force_law,
    chain,
    dchain,
    base_length,
    line,
    dline,
    gravity,
    dgravity,
    position,
    arc,
    weights,
    par,
    con,
    pressure,
    dpressure,
    drive,
    columns,
    m,
    with_force,
    with_base,
    free,
    phi,
    z,
    S_phi,
    S_z,
):
    """Solve for phi (n + 1) in place, from the start that it holds; S_phi (n + 1, p), S_z (n, m, p) follow.

    Returns (status, stability): the smallest pivot of the stiffness along the chain, positive where it is stable.
    """
    n, count = chain.shape[0], par.size
    D = 7 if with_force else 3
    body = np.zeros((n + 2, BODY_COLUMNS))
    motion, force, d = np.zeros((n, 4)), np.zeros((n, 2, 5 + count)), np.zeros(7)
    out, relaxed = np.zeros((n, columns)), np.zeros((n, max(m, 1), 3 + count))
    theta, rate, Sx = np.zeros(n), np.zeros(n), np.zeros((n, max(m, 1)))
    length = chain[:, 0].copy()
    setting = Clamped(chain, base_length, line, with_base)
    status = NOT_CONVERGED
    for i in range(n + 1):
        body[i, PHI] = phi[i]
    for _ in range(60):
        joint_angles(body, theta, rate)
        if m > 0:
            relaxed_law(theta, rate, z, pressure, position, arc, weights, par, con, relaxed)
            for j in range(n):
                for a in range(m):
                    z[j, a] = relaxed[j, a, 0]
        law(theta, rate, z, pressure, position, arc, weights, par, con, out)
        for j in range(n):
            out[j, 0] += drive[j]
        kinematics(chain, base_length, gravity, body, motion, with_force)
        if with_force:
            force_law(motion, length, par, con, force)
        relaxed_factors(out, relaxed, m, z, body, Sx)
        if with_force:
            factor(setting, body, out, force, 7, 0.0, 0.0, 1.0)
            solve(setting, body, 7, RESIDUAL, STEP, d)
        else:
            factor(setting, body, out, force, 3, 0.0, 0.0, 1.0)
            solve(setting, body, 3, RESIDUAL, STEP, d)
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
    joint_angles(body, theta, rate)
    for j in range(n):
        if abs(theta[j]) > LARGEST_JOINT_ANGLE:
            return BLOWN_UP, stability
    if free.size > 0 and status == OK:
        out_par = np.zeros((n, 2 + m, count))
        law_par(theta, rate, z, pressure, position, arc, weights, par, con, out_par)
        _derivatives(
            chain,
            dchain,
            base_length,
            line,
            dline,
            dgravity,
            body,
            out,
            out_par,
            relaxed,
            force,
            dpressure,
            m,
            D,
            with_base,
            Sx,
            free,
            S_phi,
            S_z,
        )
    return status, stability
