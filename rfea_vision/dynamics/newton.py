"""Newton's method on one implicit stage of the chain. Legend as in `engine`.

Arguments.
    laws, system, work   of one run of n bodies, as in `system`              s       the stage's own weight, in s
    sensed, felt         pressure at the sensor and in the tube, Pa          drive   outer torques (n,) in N m, or (0,)
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rfea_vision.dynamics.engine import factor, kinematics, solve
from rfea_vision.dynamics.states import joint_factors
from rfea_vision.dynamics.system import (
    AL,
    BLOWN_UP,
    INLINE,
    LINE_RHS,
    LINE_STEP,
    NOT_CONVERGED,
    OK,
    OM,
    PHI,
    RESIDUAL,
    STEP,
    TAU_P,
    call_joint_law,
    joint_angles,
)

NEWTON_STEPS = 1000  # so that no step goes on for ever
PATIENCE = 6  # full Newton steps before the residual is watched
SMALLEST_PART = 1e-7  # a kink that turns within 1e-3 rad/s is that narrow


@njit(**INLINE)
def _felt(system, body, sensed):
    """Pressure in the tube: what the line loses between sensor and tube goes with flow and its rate."""
    n = body.shape[0] - 2
    resisted = system.line[0] * (body[n, OM] - body[0, OM]) + system.line[1] * (body[n, AL] - body[0, AL])
    return sensed - system.volume_rate * resisted


@njit(**INLINE)
def _line_step(system, work, s):
    """Newton's step where the felt pressure depends on the motion (rank one); returns the change of pressure."""
    body, n = work.body, work.body.shape[0] - 2
    for i in range(n + 1):
        body[i, LINE_RHS] = body[i + 1, TAU_P] - body[i, TAU_P]
    body[0, LINE_RHS] = system.line[2] * body[1, TAU_P]
    if system.with_force:
        solve(system, body, 7, LINE_RHS, LINE_STEP, work.d)
    else:
        solve(system, body, 3, LINE_RHS, LINE_STEP, work.d)
    q = (system.line[0] * s + system.line[1]) * system.volume_rate
    change = -q * (body[n, STEP] - body[0, STEP]) / (1.0 + q * (body[n, LINE_STEP] - body[0, LINE_STEP]))
    for i in range(n + 1):
        body[i, STEP] += change * body[i, LINE_STEP]
    return change


@njit(**INLINE)
def linearise(laws, system, work, sensed, drive, s):
    """Residual and factors at the motion that `work` holds; returns the felt pressure."""
    body = work.body
    joint_angles(body, work.theta, work.rate)
    felt = sensed
    if system.with_line:
        felt = _felt(system, body, sensed)
    call_joint_law(laws.joint, system, work, felt, work.out)
    for j in range(drive.size):
        work.out[j, 0] += drive[j]
    kinematics(system, body, work.motion)
    if system.with_force:
        laws.force(work.motion, system.length, system.par, system.con, work.force)
    joint_factors(work, system.states, s, s, s * s)
    # The number of columns as a literal: the short loops over it unroll.
    if system.with_force:
        factor(system, body, work.out, work.force, 7, 1.0, s, s * s)
    else:
        factor(system, body, work.out, work.force, 3, 1.0, s, s * s)
    return felt


@njit(**INLINE)
def newton_step(system, work, s):
    """Newton's change of every acceleration (column STEP) and hidden state (dz)."""
    body = work.body
    if system.with_force:
        solve(system, body, 7, RESIDUAL, STEP, work.d)
    else:
        solve(system, body, 3, RESIDUAL, STEP, work.d)
    change = _line_step(system, work, s) if system.with_line else 0.0
    for j in range(work.z.shape[0]):
        relative = body[j + 1, STEP] - body[j, STEP]
        for a in range(system.states):
            work.dz[j, a] = work.Sx[j, a] * relative + work.zc[j, a] + work.zp[j, a] * change


@njit(**INLINE)
def move(system, work, s, part):
    """Take `part` of the step; returns the largest change of an angle, not a number if any is not."""
    body, largest, total = work.body, 0.0, 0.0
    for i in range(body.shape[0] - 1):
        x = part * body[i, STEP]
        body[i, AL] += x
        body[i, OM] += s * x
        body[i, PHI] += s * s * x
        largest = max(largest, abs(x))
        total += x
    for j in range(work.z.shape[0]):
        for a in range(system.states):
            work.z[j, a] += part * work.dz[j, a]
            total += work.dz[j, a]
    return largest * s * s if np.isfinite(total) else np.nan  # max() passes over what is not a number


@njit(**INLINE)
def solve_stage(laws, system, work, sensed, drive, s, tolerance):
    """Newton on one stage, from the guess that `work` holds. Returns (status, iterations, felt pressure).

    Where full Newton does not settle within a few (it can jump for ever between the sides of a kink, as dry
    friction has), steps are halved until the residual falls. The factors are those of the last iteration, taken within
    the tolerance of the answer.
    """
    body, n = work.body, work.body.shape[0] - 2
    best, last = np.inf, 1.0
    felt = sensed
    for iteration in range(1, NEWTON_STEPS + 1):
        felt = linearise(laws, system, work, sensed, drive, s)
        if iteration > PATIENCE:
            size = 0.0
            for i in range(n + 1):
                size += body[i, RESIDUAL] * body[i, RESIDUAL]
            if size > best and last > SMALLEST_PART:
                last *= 0.5
                move(system, work, s, -last)
                continue
            best, last = size, 1.0
        newton_step(system, work, s)
        largest = move(system, work, s, 1.0)
        if not (largest < 1.0):
            return BLOWN_UP, iteration, felt
        if largest < tolerance:
            return OK, iteration, felt
    return NOT_CONVERGED, NEWTON_STEPS, felt
