"""One run of the chain: fixed steps along the pressure log, with the derivatives by the parameters.

Time: singly diagonally implicit Runge-Kutta, L-stable and stiffly accurate, full Newton. Sensitivities follow from the
implicit function theorem inside each stage. Legend as in `engine`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import boolean, float64, int64, njit, types

from rfea_vision.dynamics.engine import (
    AL,
    BLOWN_UP,
    BODY_COLUMNS,
    CUBE,
    FORCE_LAW,
    INLINE,
    JOINT_CUBE,
    JOINT_LAW,
    LINE_RHS,
    LINE_STEP,
    MATRIX,
    NOT_CONVERGED,
    OK,
    OM,
    OPTIONS,
    PHI,
    RESIDUAL,
    STEP,
    TAU_P,
    VECTOR,
    factor,
    kinematics,
    solve,
)
from rfea_vision.dynamics.sensitivity import (
    C_PRESSURE,
    CARRY_ROWS,
    LANES,
    ROWS,
    S_OM,
    S_OM_OLD,
    S_PHI,
    S_PHI_OLD,
    Z_ROWS,
    close_step,
    finish,
    finish_states,
    gather,
    line_answer,
    predict,
    predict_states,
    set_constants,
    sweep,
)
from rfea_vision.dynamics.states import joint_factors

LARGEST_JOINT_ANGLE = 3.0  # rad; beyond it the chain has wound up
NEWTON_STEPS = 100
PATIENCE = 6  # full Newton steps before the residual is watched
SMALLEST_PART = 1e-4

# Signatures are spelled out so that laws enter as function pointers and one compiled engine serves them all.
INDEX = int64[::1]
BODIES = (MATRIX, CUBE, float64, VECTOR, MATRIX, VECTOR, MATRIX, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR)
_INTEGRATE = types.Tuple((int64, int64, int64))(
    JOINT_LAW,
    JOINT_CUBE,
    FORCE_LAW,
    MATRIX,
    float64,
    *BODIES,
    MATRIX,
    CUBE,
    CUBE,
    int64,
    int64,
    boolean,
    boolean,
    boolean,
    float64,
    INDEX,
    VECTOR,
    VECTOR,
    MATRIX,
    MATRIX,
    CUBE,
    INDEX,
    VECTOR,
    MATRIX,
    MATRIX,
    CUBE,
    CUBE,
    float64,
)


class Setting(NamedTuple):
    """What lasts for the whole run."""

    law: Any
    force_law: Any
    chain: Any
    base_length: Any
    line: Any
    gravity: Any
    position: Any
    arc: Any
    weights: Any
    par: Any
    con: Any
    length: Any
    states: Any
    D: Any
    with_base: Any
    with_line: Any
    varies: Any
    volume_rate: Any
    tolerance: Any


class Work(NamedTuple):
    """Working space of a stage; `body` has its columns named in `engine`."""

    body: Any
    theta: Any
    rate: Any
    out: Any
    force: Any
    motion: Any
    d: Any
    z: Any
    z_star: Any
    dz: Any
    zc: Any
    Sx: Any
    zp: Any
    inverse: Any
    small: Any


@njit(**INLINE)
def joint_angles(body, theta, rate):
    """Joint angles and rates from absolute ones."""
    for j in range(theta.size):
        theta[j] = body[j + 1, PHI] - body[j, PHI]
        rate[j] = body[j + 1, OM] - body[j, OM]


@njit(**INLINE)
def _felt(setting, body, sensed):
    """Pressure in the tube: what the line loses between sensor and tube goes with flow and its rate."""
    n = body.shape[0] - 2
    resisted = setting.line[0] * (body[n, OM] - body[0, OM]) + setting.line[1] * (body[n, AL] - body[0, AL])
    return sensed - setting.volume_rate * resisted


@njit(**INLINE)
def _line_step(setting, work, s):
    """Newton's step where the felt pressure depends on the motion (rank one); returns the change of pressure."""
    body, n = work.body, work.body.shape[0] - 2
    for i in range(n + 1):
        body[i, LINE_RHS] = body[i + 1, TAU_P] - body[i, TAU_P]
    body[0, LINE_RHS] = setting.line[2] * body[1, TAU_P]
    if setting.D > 3:
        solve(setting, body, 7, LINE_RHS, LINE_STEP, work.d)
    else:
        solve(setting, body, 3, LINE_RHS, LINE_STEP, work.d)
    q = (setting.line[0] * s + setting.line[1]) * setting.volume_rate
    change = -q * (body[n, STEP] - body[0, STEP]) / (1.0 + q * (body[n, LINE_STEP] - body[0, LINE_STEP]))
    for i in range(n + 1):
        body[i, STEP] += change * body[i, LINE_STEP]
    return change


@njit(**INLINE)
def _linearise(setting, work, sensed, drive, s):
    """Residual and factors at the motion that `work` holds; returns the felt pressure."""
    body, chain = work.body, setting.chain
    joint_angles(body, work.theta, work.rate)
    felt = sensed
    if setting.with_line:
        felt = _felt(setting, body, sensed)
    setting.law(
        work.theta,
        work.rate,
        work.z,
        felt,
        setting.position,
        setting.arc,
        setting.weights,
        setting.par,
        setting.con,
        work.out,
    )
    for j in range(drive.size):
        work.out[j, 0] += drive[j]
    kinematics(chain, setting.base_length, setting.gravity, body, work.motion, setting.D > 3)
    if setting.D > 3:
        setting.force_law(work.motion, setting.length, setting.par, setting.con, work.force)
    joint_factors(work, setting.states, s, s, s * s)
    # D as a literal: the short loops over it unroll.
    if setting.D > 3:
        factor(setting, body, work.out, work.force, 7, 1.0, s, s * s)
    else:
        factor(setting, body, work.out, work.force, 3, 1.0, s, s * s)
    return felt


@njit(**INLINE)
def _newton_step(setting, work, s):
    """Newton's change of every acceleration (column STEP) and hidden state (dz)."""
    body = work.body
    if setting.D > 3:
        solve(setting, body, 7, RESIDUAL, STEP, work.d)
    else:
        solve(setting, body, 3, RESIDUAL, STEP, work.d)
    change = _line_step(setting, work, s) if setting.with_line else 0.0
    for j in range(work.z.shape[0]):
        relative = body[j + 1, STEP] - body[j, STEP]
        for a in range(setting.states):
            work.dz[j, a] = work.Sx[j, a] * relative + work.zc[j, a] + work.zp[j, a] * change


@njit(**INLINE)
def _move(setting, work, s, part):
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
        for a in range(setting.states):
            work.z[j, a] += part * work.dz[j, a]
            total += work.dz[j, a]
    return largest * s * s if np.isfinite(total) else np.nan  # max() passes over what is not a number


@njit(**INLINE)
def solve_stage(setting, work, sensed, drive, s):
    """Newton on one stage, from the guess that `work` holds. Returns (status, iterations, felt pressure).

    Where full Newton does not settle within a few steps (it can jump for ever between the sides of a kink, as dry
    friction has), steps are halved until the residual falls. The factors are those of the last iteration, taken within
    the tolerance of the answer.
    """
    body, n = work.body, work.body.shape[0] - 2
    best, last = np.inf, 1.0
    felt = sensed
    for iteration in range(1, NEWTON_STEPS + 1):
        felt = _linearise(setting, work, sensed, drive, s)
        if iteration > PATIENCE:
            size = 0.0
            for i in range(n + 1):
                size += body[i, RESIDUAL] * body[i, RESIDUAL]
            if size > best and last > SMALLEST_PART:
                last *= 0.5
                _move(setting, work, s, -last)
                continue
            best, last = size, 1.0
        _newton_step(setting, work, s)
        largest = _move(setting, work, s, 1.0)
        if not (largest < 1.0):
            return BLOWN_UP, iteration, felt
        if largest < setting.tolerance:
            for i in range(1, n + 1):
                if abs(body[i, PHI] - body[i - 1, PHI]) > LARGEST_JOINT_ANGLE:
                    return BLOWN_UP, iteration, felt
            return OK, iteration, felt
    return NOT_CONVERGED, NEWTON_STEPS, felt


@njit(**INLINE)
def _sensitivity_stage(
    setting, work, law_par, out_par, felt, dline, dpressure, free, lanes, carry, z_lanes, w, s, stage, last
):
    """Derivatives of one stage by the parameters of every block, in `lanes` (and of the hidden states, in `z_lanes`)."""
    body, n, m = work.body, work.body.shape[0] - 2, setting.states
    volume = setting.volume_rate
    law_par(
        work.theta,
        work.rate,
        work.z,
        felt,
        setting.position,
        setting.arc,
        setting.weights,
        setting.par,
        setting.con,
        out_par,
    )
    width = lanes.shape[2] // ROWS
    q = (setting.line[0] * s + setting.line[1]) * volume
    for block in range(lanes.shape[0]):
        rows, hand = lanes[block], carry[block]
        part = free[block * LANES : (block + 1) * LANES]
        gather(out_par, part, rows, width)
        predict(rows, width, w[0], w[1], s)
        if dpressure.size > 0:
            for k in range(part.size):
                hand[C_PRESSURE + k] = dpressure[part[k]]
        elif setting.with_line:
            for k in range(part.size):
                hand[C_PRESSURE + k] = 0.0
        if setting.with_line:
            flow, flow_rate = body[n, OM] - body[0, OM], body[n, AL] - body[0, AL]
            for k in range(part.size):
                lost = dline[0, part[k]] * flow + dline[1, part[k]] * flow_rate
                lost += setting.line[0] * (rows[n, S_OM + k] - rows[0, S_OM + k])
                hand[C_PRESSURE + k] -= volume * lost
        if m > 0:
            predict_states(rows, z_lanes[block], hand, work.out, out_par, work.inverse, m, s, w[0], w[1], part, width)
        sweep(
            setting.chain,
            setting.base_length,
            setting.line[2],
            body,
            work.out,
            work.force,
            rows,
            hand,
            part,
            setting.D,
            setting.varies,
            setting.with_base,
            width,
        )
        if setting.with_line:
            line_answer(body, rows, hand, q, width)
        if m > 0:
            finish_states(rows, z_lanes[block], hand, work.Sx, work.zp, m, s, stage, last, setting.with_line, width)
        finish(rows, width, s, stage)


@njit(**INLINE)
def _read_frame(t, h, old, body, lanes, out_phi, out_om, out_S):
    """Cubic Hermite interpolation inside a step at the fraction t: angles, rates and derivatives of one frame."""
    h00, h10 = (1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2 * h
    h01, h11 = t * t * (3 - 2 * t), t * t * (t - 1) * h
    g00, g10, g11 = 6 * t * (t - 1) / h, (1 - t) * (1 - 3 * t), t * (3 * t - 2)
    for i in range(old.shape[0]):
        phi_old, om_old, phi, om = old[i, 0], old[i, 1], body[i, PHI], body[i, OM]
        out_phi[i] = h00 * phi_old + h10 * om_old + h01 * phi + h11 * om
        out_om[i] = g00 * (phi_old - phi) + g10 * om_old + g11 * om
        for column in range(out_S.shape[1]):
            b, k = column // LANES, column % LANES
            before = h00 * lanes[b, i, S_PHI_OLD + k] + h10 * lanes[b, i, S_OM_OLD + k]
            out_S[i, column] = before + h01 * lanes[b, i, S_PHI + k] + h11 * lanes[b, i, S_OM + k]


@njit(**INLINE)
def _start_stage(work, old, states_old, stage_al, stage_om, stage_g, tableau, stage, h):
    """Known part of a stage in `work`, with the last acceleration as the guess."""
    s = h * tableau[stage, stage]
    body = work.body
    for i in range(old.shape[0]):
        angle, rate = old[i, 0], old[i, 1]
        for b in range(stage):
            rate += h * tableau[stage, b] * stage_al[b, i]
            angle += h * tableau[stage, b] * stage_om[b, i]
        body[i, OM] = rate + s * body[i, AL]
        body[i, PHI] = angle + s * body[i, OM]
    for j in range(states_old.shape[0]):
        for a in range(states_old.shape[1]):
            value = states_old[j, a]
            for b in range(stage):
                value += h * tableau[stage, b] * stage_g[b, j, a]
            work.z_star[j, a], work.z[j, a] = value, value


@njit(**INLINE)
def _allocate(n, columns, m, count, D):
    """Working space for one run."""
    m1 = max(m, 1)
    return Work(
        np.zeros((n + 2, BODY_COLUMNS)),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, columns)),
        np.zeros((n, 2, 5 + count)),
        np.zeros((n, 4)),
        np.zeros(7),
        np.zeros((n, m1)),
        np.zeros((n, m1)),
        np.zeros((n, m1)),
        np.zeros((n, m1)),
        np.zeros((n, m1)),
        np.zeros((n, m1)),
        np.zeros((n, m1, m1)),
        np.zeros((m1, m1)),
    )


@njit(_INTEGRATE, **OPTIONS)
def integrate(
    law,
    law_par,
    force_law,
    tableau,
    h,
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
    with_line,
    volume_rate,
    free,
    phi,
    om,
    z,
    S_phi,
    S_z,
    frame_step,
    frame_fraction,
    out_phi,
    out_om,
    out_z,
    out_S,
    tolerance,
):
    """March along the log from phi, om (n + 1) and z (n, m), whose derivatives are S_phi (n + 1, p), 0 and S_z (n, m, p).

    pressure (steps, stages) at the stage times; dpressure (steps, stages, parameters) or with no rows; drive
    (steps, stages, n) or with no rows. Frames (sorted) are read off by cubic Hermite interpolation inside each step:
    out_phi, out_om (frames, n + 1), out_S (frames, n + 1, p). Returns (status, steps done, Newton iterations).
    """
    n, p, stages = chain.shape[0], free.size, tableau.shape[0]
    steps = pressure.shape[0]
    D = 7 if with_force else 3
    varies = np.any(dchain != 0.0) or np.any(dgravity != 0.0)
    work = _allocate(n, columns, m, par.size, D)
    setting = Setting(
        law,
        force_law,
        chain,
        base_length,
        line,
        gravity,
        position,
        arc,
        weights,
        par,
        con,
        chain[:, 0].copy(),
        m,
        D,
        with_base,
        with_line,
        varies,
        volume_rate,
        tolerance,
    )
    body = work.body
    stage_al, stage_om = np.zeros((stages, n + 1)), np.zeros((stages, n + 1))
    stage_g, z_old, old = np.zeros((stages, n, max(m, 1))), z.copy(), np.zeros((n + 1, 2))
    blocks = (p + LANES - 1) // LANES
    lanes, carry = np.zeros((blocks, n + 2, ROWS * LANES)), np.zeros((blocks, CARRY_ROWS * LANES))
    z_lanes = np.zeros((blocks, n, max(m, 1) * Z_ROWS * LANES))
    out_par, w = np.zeros((n, 2 + m, par.size)), np.zeros(2)
    set_constants(dchain, dgravity, dline[2], free, lanes, carry)
    for column in range(p):
        block, k = column // LANES, column % LANES
        for i in range(n + 1):
            lanes[block, i, S_PHI + k] = S_phi[i, column]
        for j in range(n):
            for a in range(m):
                z_lanes[block, j, a * Z_ROWS * LANES + k] = S_z[j, a, column]
    no_drive, no_pressure = np.zeros(0), np.zeros(0)
    for i in range(n + 1):
        body[i, PHI], body[i, OM] = phi[i], om[i]
    frame, iterations = 0, 0
    for step in range(steps):
        for i in range(n + 1):
            old[i, 0], old[i, 1] = body[i, PHI], body[i, OM]
        for block in range(blocks):
            close_step(lanes[block], lanes.shape[2] // ROWS)
        for stage in range(stages):
            s = h * tableau[stage, stage]
            _start_stage(work, old, z_old, stage_al, stage_om, stage_g, tableau, stage, h)
            torques = drive[step, stage] if drive.shape[0] > 0 else no_drive
            status, count, felt = solve_stage(setting, work, pressure[step, stage], torques, s)
            iterations += count
            if status != OK:
                return status, step, iterations
            if p > 0:
                for b in range(2):
                    w[b] = h * tableau[stage, b] if b < stage else 0.0
                by_par = dpressure[step, stage] if dpressure.shape[0] > 0 else no_pressure
                _sensitivity_stage(
                    setting,
                    work,
                    law_par,
                    out_par,
                    felt,
                    dline,
                    by_par,
                    free,
                    lanes,
                    carry,
                    z_lanes,
                    w,
                    s,
                    stage,
                    stage == stages - 1,
                )
            for i in range(n + 1):
                stage_al[stage, i], stage_om[stage, i] = body[i, AL], body[i, OM]
            for j in range(n):
                for a in range(m):
                    stage_g[stage, j, a] = (work.z[j, a] - work.z_star[j, a]) / s
        if m > 0:
            z_old[:, :] = work.z
        while frame < frame_step.size and frame_step[frame] <= step:
            _read_frame(frame_fraction[frame], h, old, body, lanes, out_phi[frame], out_om[frame], out_S[frame])
            if m > 0:
                out_z[frame] = work.z
            frame += 1
    for i in range(n + 1):
        phi[i], om[i] = body[i, PHI], body[i, OM]
    z[:, :] = z_old
    return OK, steps, iterations
