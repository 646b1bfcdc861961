"""One run of the chain: fixed steps along the pressure log, with the derivatives by the parameters.

Time: singly diagonally implicit Runge-Kutta, L-stable and stiffly accurate, full Newton. Sensitivities follow from the
implicit function theorem inside each stage. Legend as in `engine`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import float64, int64, njit, types

from rfea_vision.dynamics.newton import solve_stage
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
    answer,
    close_step,
    finish,
    finish_states,
    gather,
    line_answer,
    outward,
    predict_states,
    set_constants,
)
from rfea_vision.dynamics.system import (
    AL,
    ALLOCATING,
    CUBE,
    FORCE_LAW,
    INDEX,
    INLINE,
    JOINT_CUBE,
    JOINT_LAW,
    MATRIX,
    NOT_CONVERGED,
    OK,
    OM,
    OPPOSED,
    OPTIONS,
    PHI,
    SYSTEM,
    VECTOR,
    Laws,
    allocate,
    call_joint_law,
    copy_rows,
)


class Course(NamedTuple):
    """What drives a run, and where it is read off.

    pressure (steps, 1 + stages) at the start of each step and at its stage times, and opposed, what all chambers hold beyond
    it; dpressure (steps, 1 + stages, parameters) and drive (steps, 1 + stages, n) torques, or with no rows; free: parameters to
    differentiate by; frames (sorted) by the step that they fall in and the fraction of it
    """

    tableau: Any
    step_s: Any
    pressure: Any
    opposed: Any
    dpressure: Any
    drive: Any
    free: Any
    frame_step: Any
    frame_fraction: Any
    tolerance: Any


class Trace(NamedTuple):
    """Start of a run, written over with its end: phi, om (n + 1), z (n, m), derivatives S_phi (n + 1, p) and S_z (n, m, p).

    Frames: out_phi, out_om (frames, n + 1), out_z (frames, n, m), out_S (frames, n + 1, p).
    """

    phi: Any
    om: Any
    z: Any
    S_phi: Any
    S_z: Any
    out_phi: Any
    out_om: Any
    out_z: Any
    out_S: Any


#: A step may be cut down to 2^-HALVINGS of it.
HALVINGS = 14
#: Beside two for every step of the course; a run that asks for more is not getting anywhere.
MOST_EXTRA_STEPS = 50_000

COURSE = types.NamedTuple((MATRIX, float64, MATRIX, MATRIX, CUBE, CUBE, INDEX, INDEX, VECTOR, float64), Course)
TRACE = types.NamedTuple((VECTOR, VECTOR, MATRIX, MATRIX, CUBE, MATRIX, MATRIX, CUBE, CUBE), Trace)


class Stages(NamedTuple):
    """What the stages of a step leave for the next: accelerations, rates, rates of the hidden states; the step's start."""

    al: Any
    om: Any
    g: Any
    old: Any
    z_old: Any


STAGES = types.NamedTuple((MATRIX, MATRIX, CUBE, MATRIX, MATRIX), Stages)


class Lanes(NamedTuple):
    """Derivatives by the parameters, in blocks; rows as in `sensitivity`."""

    lanes: Any
    carry: Any
    z_lanes: Any
    out_par: Any
    w: Any
    varies: Any


@njit(**INLINE)
def start_stage(work, stages, tableau, stage, h):
    """Known part of a stage in `work`, with the last acceleration as the guess; returns the stage's own weight."""
    s = h * tableau[stage, stage]
    body, old, z_old = work.body, stages.old, stages.z_old
    for i in range(old.shape[0]):
        angle, rate = old[i, 0], old[i, 1]
        for b in range(stage):
            rate += h * tableau[stage, b] * stages.al[b, i]
            angle += h * tableau[stage, b] * stages.om[b, i]
        body[i, OM] = rate + s * body[i, AL]
        body[i, PHI] = angle + s * body[i, OM]
    for j in range(z_old.shape[0]):
        for a in range(z_old.shape[1]):
            value = z_old[j, a]
            for b in range(stage):
                value += h * tableau[stage, b] * stages.g[b, j, a]
            work.z_star[j, a], work.z[j, a] = value, value
    return s


@njit(**INLINE)
def keep_stage(work, stages, stage, m, s):
    """Remember a solved stage for those behind it."""
    body = work.body
    for i in range(stages.old.shape[0]):
        stages.al[stage, i], stages.om[stage, i] = body[i, AL], body[i, OM]
    for j in range(stages.z_old.shape[0]):
        for a in range(m):
            stages.g[stage, j, a] = (work.z[j, a] - work.z_star[j, a]) / s


@njit(**ALLOCATING)
def _start_lanes(system, course, trace):
    """Lanes for the parameters `free`, holding the derivatives of the start."""
    n, m, p = system.chain.shape[0], system.states, course.free.size
    blocks = (p + LANES - 1) // LANES
    lanes, carry = np.zeros((blocks, n + 2, ROWS * LANES)), np.zeros((blocks, CARRY_ROWS * LANES))
    z_lanes = np.zeros((blocks, n, max(m, 1) * Z_ROWS * LANES))
    set_constants(system, course.free, lanes, carry)
    for column in range(p):
        block, k = column // LANES, column % LANES
        for i in range(n + 1):
            lanes[block, i, S_PHI + k] = trace.S_phi[i, column]
        for j in range(n):
            for a in range(m):
                z_lanes[block, j, a * Z_ROWS * LANES + k] = trace.S_z[j, a, column]
    varies = np.any(system.dchain != 0.0) or np.any(system.dgravity != 0.0)
    return Lanes(lanes, carry, z_lanes, np.zeros((n, 2 + m, system.par.size)), np.zeros(2), varies)


@njit(**INLINE)
def _line_pressure(system, work, part, rows, hand):
    """Known part of the felt pressure's derivative where the line resists the flow."""
    body, n = work.body, work.body.shape[0] - 2
    flow, flow_rate = body[n, OM] - body[0, OM], body[n, AL] - body[0, AL]
    for k in range(part.size):
        lost = system.dline[0, part[k]] * flow + system.dline[1, part[k]] * flow_rate
        lost += system.line[0] * (rows[n, S_OM + k] - rows[0, S_OM + k])
        hand[C_PRESSURE + k] -= system.volume_rate * lost


@njit(**INLINE)
def _sensitivity_stage(laws, system, work, derivatives, felt, dpressure, free, s, stage, last):
    """Derivatives of one stage by the parameters of every block, in `lanes` (and of the hidden states, in `z_lanes`)."""
    m, out_par, w = system.states, derivatives.out_par, derivatives.w
    lanes, z_lanes = derivatives.lanes, derivatives.z_lanes
    call_joint_law(laws.joint_parameters, system, work, felt, out_par)
    width = lanes.shape[2] // ROWS
    q = (system.line[0] * s + system.line[1]) * system.volume_rate
    for block in range(lanes.shape[0]):
        rows, hand = lanes[block], derivatives.carry[block]
        part = free[block * LANES : (block + 1) * LANES]
        gather(out_par, part, rows)
        outward(system, work, rows, hand, part, derivatives.varies, width, w[0], w[1], s)
        if dpressure.size > 0:
            for k in range(part.size):
                hand[C_PRESSURE + k] = dpressure[part[k]]
        elif system.with_line:
            for k in range(part.size):
                hand[C_PRESSURE + k] = 0.0
        if system.with_line:
            _line_pressure(system, work, part, rows, hand)
        if m > 0:
            predict_states(work, rows, z_lanes[block], hand, out_par, m, s, w[0], w[1], part, width)
        answer(system, work, rows, hand, width)
        if system.with_line:
            line_answer(work.body, rows, hand, q, width)
        if m > 0:
            finish_states(work, rows, z_lanes[block], hand, m, s, stage, last, system.with_line, width)
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


class Part(NamedTuple):
    """What drives a part of a step: pressure and opposed pressure (stages,), derivatives (stages, parameters), torques (stages, n)."""

    pressure: Any
    opposed: Any
    dpressure: Any
    drive: Any


@njit(**INLINE)
def _drive_part(course, part, step, begin, size):
    """The course over the part of a step that begins at the fraction `begin`; linear between the ends of the step.

    So it is at the sensor. Behind a line with a lag it is not quite, within a step that had to be cut.
    """
    count = course.tableau.shape[0]
    for stage in range(count):
        node, whole = 0.0, stage + 1
        for b in range(stage + 1):
            node += course.tableau[stage, b]
        x = begin + size * node
        row = course.pressure[step]
        part.pressure[stage] = row[whole] if size == 1.0 else row[0] + x * (row[count] - row[0])
        row = course.opposed[step]
        part.opposed[stage] = row[whole] if size == 1.0 else row[0] + x * (row[count] - row[0])
        for k in range(part.dpressure.shape[1]):
            rows = course.dpressure[step]
            part.dpressure[stage, k] = rows[whole, k] if size == 1.0 else rows[0, k] + x * (rows[count, k] - rows[0, k])
        for k in range(part.drive.shape[1]):
            rows = course.drive[step]
            part.drive[stage, k] = rows[whole, k] if size == 1.0 else rows[0, k] + x * (rows[count, k] - rows[0, k])


@njit(**INLINE)
def _step(laws, system, course, work, stages, derivatives, part, h):
    """Every stage of one step of length h, with its derivatives. Returns (status, Newton iterations)."""
    tableau, free = course.tableau, course.free
    count, iterations, w = tableau.shape[0], 0, derivatives.w
    for stage in range(count):
        s = start_stage(work, stages, tableau, stage, h)
        system.con[OPPOSED] = part.opposed[stage]
        status, used, felt = solve_stage(
            laws, system, work, part.pressure[stage], part.drive[stage], s, course.tolerance
        )
        iterations += used
        if status != OK:
            return status, iterations
        if free.size > 0:
            for b in range(2):
                w[b] = h * tableau[stage, b] if b < stage else 0.0
            last = stage == count - 1
            _sensitivity_stage(laws, system, work, derivatives, felt, part.dpressure[stage], free, s, stage, last)
        keep_stage(work, stages, stage, system.states, s)
    if system.states > 0:
        for j in range(work.z.shape[0]):
            for a in range(system.states):
                stages.z_old[j, a] = work.z[j, a]
    return OK, iterations


@njit(**INLINE)
def _begin_step(body, stages, lanes):
    """The end of a step is the start of the next."""
    for i in range(stages.old.shape[0]):
        stages.old[i, 0], stages.old[i, 1], stages.old[i, 2] = body[i, PHI], body[i, OM], body[i, AL]
    for block in range(lanes.shape[0]):
        close_step(lanes[block], lanes.shape[2] // ROWS)


@njit(**INLINE)
def _step_back(body, stages):
    """Undo a step that failed; derivatives and hidden states begin from what `close_step` and `z_old` keep."""
    for i in range(stages.old.shape[0]):
        body[i, PHI], body[i, OM], body[i, AL] = stages.old[i, 0], stages.old[i, 1], stages.old[i, 2]


@njit(types.Tuple((int64, int64, int64, int64))(JOINT_LAW, JOINT_CUBE, FORCE_LAW, SYSTEM, COURSE, TRACE), **OPTIONS)
def integrate(joint_law, joint_parameters, force_law, system, course, trace):
    """March along the course from the start that `trace` holds, at rest as far as its derivatives go.

    A step that fails is halved, and halved again, down to 2^-`HALVINGS` of it; behind the trouble steps grow again.
    Frames are read off by cubic Hermite interpolation inside each step.
    Returns (status, whole steps done, steps taken in all, Newton iterations).
    """
    n, m, count = system.chain.shape[0], system.states, course.tableau.shape[0]
    laws, work = Laws(joint_law, joint_parameters, force_law), allocate(system)
    body = work.body
    stages = Stages(
        np.zeros((count, n + 1)),
        np.zeros((count, n + 1)),
        np.zeros((count, n, max(m, 1))),
        np.zeros((n + 1, 3)),
        trace.z.copy(),
    )
    derivatives = _start_lanes(system, course, trace)
    part = Part(
        np.zeros(count),
        np.zeros(count),
        np.zeros((count, course.dpressure.shape[2] if course.dpressure.shape[0] > 0 else 0)),
        np.zeros((count, course.drive.shape[2] if course.drive.shape[0] > 0 else 0)),
    )
    for i in range(n + 1):
        body[i, PHI], body[i, OM] = trace.phi[i], trace.om[i]
    frame, iterations, taken, steps = 0, 0, 0, course.pressure.shape[0]
    most = 2 * steps + MOST_EXTRA_STEPS
    whole = 1 << HALVINGS
    for step in range(steps):
        place, size = 0, whole
        while place < whole:
            _begin_step(body, stages, derivatives.lanes)
            status = NOT_CONVERGED
            while True:
                h = course.step_s * (size / whole)
                _drive_part(course, part, step, place / whole, size / whole)
                status, used = _step(laws, system, course, work, stages, derivatives, part, h)
                iterations += used
                taken += 1
                if status == OK or size == 1 or taken > most:
                    break
                _step_back(body, stages)
                size //= 2
            if status != OK:
                return status, step, taken, iterations
            end = (place + size) / whole
            while frame < course.frame_step.size and (
                course.frame_step[frame] < step
                or (course.frame_step[frame] == step and course.frame_fraction[frame] <= end)
            ):
                t = (course.frame_fraction[frame] - place / whole) * (whole / size)
                _read_frame(
                    t,
                    h,
                    stages.old,
                    body,
                    derivatives.lanes,
                    trace.out_phi[frame],
                    trace.out_om[frame],
                    trace.out_S[frame],
                )
                if m > 0:
                    copy_rows(work.z, trace.out_z[frame])
                frame += 1
            place += size
            if place % (2 * size) == 0 and size < whole:
                size *= 2
    for i in range(n + 1):
        trace.phi[i], trace.om[i] = body[i, PHI], body[i, OM]
    copy_rows(stages.z_old, trace.z)
    return OK, steps, taken, iterations
