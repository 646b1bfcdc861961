"""Steady state of the chain at one pressure, with its derivatives by the parameters. Legend as in `engine`."""

from __future__ import annotations

import numpy as np
from numba import float64, int64, njit, types

from rfea_vision.dynamics.engine import factor, kinematics, solve
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
    FORCE_ACROSS,
    FORCE_LAW,
    FX,
    FY,
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
    TAU_THETA,
    TORQUE,
    UX,
    UY,
    VECTOR,
    K,
    allocate,
    call_joint_law,
    copy_rows,
    joint_angles,
)

LARGEST_STEP = 0.3  # rad per Newton step
#: Of a fall: how the resistance changes from step to step, the steps it may take, and the share of the first at which it ends.
EASED, STIFFENED, FALLING_STEPS, LET_GO = 0.5, 4.0, 100_000, 1e-12
#: It is at rest, too, where no joint moves by more than this (rad) though the chain itself withstands more than the liquid does: what
#: is left of the torques may be rounding, which no smaller resistance foretells.
AT_REST = 1e-6
#: Change of the angles, in rad or as a share, at which Newton steps have come to rest.
SETTLED = 1e-12
#: A step of a fall is taken back where what is left is this many times what a law without bends would leave.
UNLIKE_STRAIGHT = 2.0


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
def _pull(system, body, pull):
    """A force (2,) in N at the end of the centre line, as what a body behind the last one would hand on to it."""
    n = body.shape[0] - 2
    ux, uy, across = body[n, UX], body[n, UY], system.chain[n - 1, FORCE_ACROSS]
    body[n + 1, FX], body[n + 1, FY] = -pull[0], -pull[1]
    body[n + 1, TORQUE] = -across * (ux * pull[0] + uy * pull[1])
    body[n + 1, K + 16] = -across * (uy * pull[0] - ux * pull[1])  # its change with the last body's angle


@njit(**INLINE)
def _newton_step(joint_law, relaxed_law, force_law, system, work, relaxed, pressure, drive, pull, resistance):
    """Newton's change of every angle (column STEP), with the hidden states relaxed; `resistance` (N m/rad) to it in every joint."""
    body, z = work.body, work.z
    joint_angles(body, work.theta, work.rate)
    if system.states > 0:
        call_joint_law(relaxed_law, system, work, pressure, relaxed)
        for j in range(z.shape[0]):
            for a in range(system.states):
                z[j, a] = relaxed[j, a, 0]
    call_joint_law(joint_law, system, work, pressure, work.out)
    for j in range(work.out.shape[0]):
        work.out[j, TAU_THETA] -= resistance
    for j in range(drive.size):
        work.out[j, 0] += drive[j]
    kinematics(system, body, work.motion)
    _pull(system, body, pull)
    if system.with_force:
        force_law(work.motion, system.length, system.par, system.con, work.force)
    relaxed_factors(work, relaxed, system.states)
    if system.with_force:
        factor(system, body, work.out, work.force, 7, 0.0, 0.0, 1.0)
        solve(system, body, 7, RESIDUAL, STEP, work.d)
    else:
        factor(system, body, work.out, work.force, 3, 0.0, 0.0, 1.0)
        solve(system, body, 3, RESIDUAL, STEP, work.d)


@njit(**INLINE)
def _largest_change(body):
    """Largest change of a joint's angle in column STEP; not a number if any is not."""
    largest, total = abs(body[0, STEP]), body[0, STEP]
    for i in range(1, body.shape[0] - 1):
        largest = max(largest, abs(body[i, STEP] - body[i - 1, STEP]))
        total += body[i, STEP]
    return largest if np.isfinite(total) else np.nan  # max() passes over what is not a number


@njit(**INLINE)
def _smallest_pivot(body):
    """Smallest pivot of the stiffness along the chain: positive where it is stable."""
    smallest = np.inf
    for i in range(1, body.shape[0] - 1):
        smallest = min(smallest, body[i, BETA])
    return smallest


@njit(**ALLOCATING)
def _fall(joint_law, relaxed_law, force_law, system, work, relaxed, pressure, drive, pull, resistance):
    """Let the chain go downhill until it comes to rest (pseudo-transient continuation: Kelley and Keyes 1998,
    doi:10.1137/S0036142996304796), as through a liquid whose resistance eases off. Returns the steps that were taken.
    """
    body, count, end = work.body, work.body.shape[0] - 1, LET_GO * resistance
    step, expected = np.zeros(count), np.inf
    for taken in range(FALLING_STEPS):
        _newton_step(joint_law, relaxed_law, force_law, system, work, relaxed, pressure, drive, pull, resistance)
        largest, left = _largest_change(body), 0.0
        for i in range(1, count):
            left += body[i, RESIDUAL] ** 2
        back = left > UNLIKE_STRAIGHT**2 * expected  # the law bends within the step
        if back or not (largest < LARGEST_STEP) or _smallest_pivot(body) <= 0:
            if resistance > 1e300:
                return taken
            resistance *= STIFFENED
            if back:
                for i in range(count):
                    body[i, PHI] -= step[i]
                expected = np.inf
            continue
        expected = 0.0
        for i in range(count):
            step[i] = body[i, STEP]
            body[i, PHI] += step[i]
        for i in range(1, count):
            after = step[i + 1] - step[i] if i + 1 < count else 0.0
            expected += (resistance * (step[i] - step[i - 1] - after)) ** 2
        if resistance < end or (largest < AT_REST and 2 * resistance < _smallest_pivot(body)):
            return taken
        resistance *= EASED
    return FALLING_STEPS


@njit(
    types.Tuple((int64, float64, int64))(
        *(JOINT_LAW, JOINT_CUBE, JOINT_CUBE, FORCE_LAW, SYSTEM),
        *(float64, VECTOR, VECTOR, VECTOR, INDEX, float64, VECTOR, MATRIX, MATRIX, CUBE),
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
    pull,
    free,
    fall,
    phi,
    z,
    S_phi,
    S_z,
):
    """Solve for phi (n + 1) in place, from the start that it holds; S_phi (n + 1, p), S_z (n, m, p) follow.

    pressure in Pa, with its derivative (parameters,); drive (n,) torques on the joints; pull (2,) force at the tip
    With a positive `fall` (N m/rad, about a joint's stiffness) the chain is let go at the start and comes to rest first.
    Returns (status, stability, steps of the fall); stability is the smallest pivot of the stiffness along the chain, positive where
    it is stable.
    """
    n, m, count = system.chain.shape[0], system.states, system.par.size
    work, relaxed = allocate(system), np.zeros((n, max(m, 1), 3 + count))
    body, status = work.body, NOT_CONVERGED
    for i in range(n + 1):
        body[i, PHI] = phi[i]
    fallen = 0
    if fall > 0:
        fallen = _fall(joint_law, relaxed_law, force_law, system, work, relaxed, pressure, drive, pull, fall)
    for _ in range(60):
        _newton_step(joint_law, relaxed_law, force_law, system, work, relaxed, pressure, drive, pull, 0.0)
        largest = _largest_change(body)
        if not np.isfinite(largest):
            return BLOWN_UP, 0.0, fallen
        part = min(1.0, LARGEST_STEP / largest) if largest > 0 else 1.0
        for i in range(n + 1):
            body[i, PHI] += part * body[i, STEP]
        if largest < SETTLED * max(1.0, abs(body[n, PHI])):
            status = OK
            break
    stability = _smallest_pivot(body)
    for i in range(n + 1):
        phi[i] = body[i, PHI]
    copy_rows(work.z, z)
    if free.size > 0 and status == OK:
        joint_angles(body, work.theta, work.rate)
        out_par = np.zeros((n, 2 + m, count))
        call_joint_law(joint_parameters, system, work, pressure, out_par)
        _derivatives(system, work, out_par, relaxed, dpressure, free, S_phi, S_z)
    return status, stability, fallen
