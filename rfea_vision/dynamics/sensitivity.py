"""Sensitivities of one implicit stage by the implicit function theorem, with the factors that Newton left behind.

Parameters are taken in blocks of `LANES`, so that a body's rows for one block lie at fixed distances from each other
in memory and every inner loop is machine vectors. Legend as in `engine`; a leading S is a derivative by parameters.

    system, work     of one run, as in `system`             free       numbers of the parameters of one block, at most `LANES`
    lanes, carry     of one block, rows as below            out_par    (n, 2 + m, parameters) of torque, added mass, state rates
    z_lanes          of the m hidden states of each joint   width      doubles of a row that are reckoned with
    s, w0, w1        weights of the stage and of the two before it, in s       stage, last   its number; whether it ends the step
"""

from __future__ import annotations

from numba import njit

from rfea_vision.dynamics.engine import to_hinge
from rfea_vision.dynamics.system import (
    ACROSS,
    ACX,
    ACY,
    ADDED,
    ADDED_ALONG,
    ADDED_THETA,
    ADX,
    ADY,
    AL,
    ALONG,
    BETA,
    FIXED,
    FORCE_ACROSS,
    FORCE_ALONG,
    FX,
    FY,
    GAMMA,
    INLINE,
    LENGTH,
    LINE_STEP,
    MASS,
    OM,
    STIFF,
    TAU_PRESSURE,
    TAU_RATE,
    TAU_THETA,
    TORQUE,
    UX,
    UY,
    XFX,
    XFY,
    E,
)

LANES = 8  # doubles in a vector register of AVX-512; narrower ones take two
# Rows of `lanes` (n + 2, ROWS * LANES), per body: at the start of the step; in the stage; earlier stages; the answer;
# explicit changes of the torque, of added mass, of centre of mass and inertia, of residual and force passed on.
S_PHI_OLD, S_OM_OLD, S_PHI, S_OM, S_OM_0, S_OM_1, S_AL_0, S_AL_1 = range(0, 8 * LANES, LANES)
S_AL, S_TORQUE, S_MASS, S_ACX, S_ACY, S_EXTRA, S_FX, S_FY = range(8 * LANES, 16 * LANES, LANES)
S_BODY_MASS, S_ALONG, S_ACROSS, S_INERTIA = range(16 * LANES, 20 * LANES, LANES)
ROWS = 20
# Rows of `carry`, what a sweep hands from body to body; and what is the same for all bodies.
C_AX, C_AY, C_VX, C_VY, C_PX, C_PY, C_FX, C_FY, C_TORQUE = range(0, 9 * LANES, LANES)
C_PRESSURE, C_GX, C_GY, C_COMPLIANCE, C_PIVOT, C_D = range(9 * LANES, 15 * LANES, LANES)
CARRY_ROWS = 14 + 7
# Rows per hidden state and joint of `z_lanes` (n, m * Z_ROWS * LANES).
Z_OLD, Z_STAR, Z_ZETA, Z_G_0, Z_G_1 = range(0, 5 * LANES, LANES)
Z_ROWS = 5


@njit(**INLINE)
def set_constants(system, free, lanes, carry):
    """Put into their lanes the parameter derivatives that last for the whole run: one block per LANES parameters."""
    dchain, dgravity, dline = system.dchain, system.dgravity, system.dline
    for column in range(free.size):
        block, k, p = column // LANES, column % LANES, free[column]
        for j in range(dchain.shape[0]):
            lanes[block, j + 1, S_BODY_MASS + k] = dchain[j, 0, p]
            lanes[block, j + 1, S_ALONG + k] = dchain[j, 1, p]
            lanes[block, j + 1, S_ACROSS + k] = dchain[j, 2, p]
            lanes[block, j + 1, S_INERTIA + k] = dchain[j, 3, p]
        carry[block, C_GX + k] = dgravity[0, p]
        carry[block, C_GY + k] = dgravity[1, p]
        carry[block, C_COMPLIANCE + k] = dline[2, p]
        carry[block, C_PIVOT + k] = dline[3, p]


@njit(**INLINE)
def gather(out_par, free, lanes):
    """Explicit derivatives of torque and added mass by the parameters `free` of one block."""
    for j in range(out_par.shape[0]):
        for k in range(free.size):
            lanes[j + 1, S_TORQUE + k] = out_par[j, 0, free[k]]
            lanes[j + 1, S_MASS + k] = out_par[j, 1, free[k]]


@njit(**INLINE)
def finish(lanes, width, s, stage):
    """Add the stage's own acceleration; keep what later stages need."""
    keep_om, keep_al = (S_OM_0, S_AL_0) if stage == 0 else (S_OM_1, S_AL_1)
    for i in range(lanes.shape[0] - 1):
        for k in range(width):
            x = lanes[i, S_AL + k]
            rate = lanes[i, S_OM + k] + s * x
            lanes[i, S_OM + k] = rate
            lanes[i, S_PHI + k] += s * s * x
            lanes[i, keep_om + k] = rate
            lanes[i, keep_al + k] = x


@njit(**INLINE)
def close_step(lanes, width):
    """The end of a step is the start of the next."""
    for i in range(lanes.shape[0] - 1):
        for k in range(width):
            lanes[i, S_PHI_OLD + k] = lanes[i, S_PHI + k]
            lanes[i, S_OM_OLD + k] = lanes[i, S_OM + k]


@njit(**INLINE)
def predict_states(work, lanes, z_lanes, carry, out_par, m, s, w0, w1, free, width):
    """Known part of the hidden states' derivatives, states eliminated; adds what they do to the torque."""
    out, inverse, base = work.out, work.inverse, FIXED + m
    for j in range(out.shape[0]):
        for a in range(m):
            at = a * Z_ROWS * LANES
            for k in range(width):
                z_lanes[j, at + Z_STAR + k] = (
                    z_lanes[j, at + Z_OLD + k] + w0 * z_lanes[j, at + Z_G_0 + k] + w1 * z_lanes[j, at + Z_G_1 + k]
                )
                z_lanes[j, at + Z_ZETA + k] = 0.0
        for b in range(m):
            row, own = base + 4 * b, b * Z_ROWS * LANES
            by_theta, by_rate, by_p = s * out[j, row + 1], s * out[j, row + 2], s * out[j, row + 3]
            for k in range(free.size):
                known = z_lanes[j, own + Z_STAR + k] + s * out_par[j, 2 + b, free[k]]
                known += by_theta * (lanes[j + 1, S_PHI + k] - lanes[j, S_PHI + k])
                known += by_rate * (lanes[j + 1, S_OM + k] - lanes[j, S_OM + k]) + by_p * carry[C_PRESSURE + k]
                for a in range(m):
                    z_lanes[j, a * Z_ROWS * LANES + Z_ZETA + k] += inverse[j, a, b] * known
        for a in range(m):
            by_z, at = out[j, FIXED + a], a * Z_ROWS * LANES
            for k in range(width):
                lanes[j + 1, S_TORQUE + k] += by_z * z_lanes[j, at + Z_ZETA + k]


@njit(**INLINE)
def finish_states(work, lanes, z_lanes, carry, m, s, stage, last, with_line, width):
    """Derivatives of the hidden states and of their rates; with a line, carry holds what `line_answer` left there."""
    Sx, zp = work.Sx, work.zp
    for j in range(Sx.shape[0]):
        for a in range(m):
            at = a * Z_ROWS * LANES
            by_x, by_p = Sx[j, a], zp[j, a] if with_line else 0.0
            into = at + (Z_G_0 if stage == 0 else Z_G_1)
            for k in range(width):
                value = z_lanes[j, at + Z_ZETA + k] + by_p * carry[C_PRESSURE + k]
                value += by_x * (lanes[j + 1, S_AL + k] - lanes[j, S_AL + k])
                z_lanes[j, into + k] = (value - z_lanes[j, at + Z_STAR + k]) / s
                if last:
                    z_lanes[j, at + Z_OLD + k] = value


@njit(**INLINE)
def outward(system, work, lanes, carry, free, varies, width, w0, w1, s):
    """From clamp to tip: the known part of S_phi and S_om, and what it does to accelerations and body forces.

    w0 and w1 weigh the earlier stages (times the step), s is the stage's own weight.
    """
    chain, body, with_force, with_added = system.chain, work.body, system.with_force, system.with_added
    for row in (C_AX, C_AY, C_VX, C_VY, C_PX, C_PY):
        for k in range(width):
            carry[row + k] = 0.0
    if varies or with_force or with_added:
        for i in range(1, chain.shape[0] + 1):
            for row in (S_EXTRA, S_FX, S_FY):
                for k in range(width):
                    lanes[i, row + k] = 0.0
    for i in range(0 if system.with_base else 1, chain.shape[0] + 1):
        ux, uy = body[i, UX], body[i, UY]
        nx, ny = uy, -ux
        om, al = body[i, OM], body[i, AL]
        w2 = om * om
        hx, hy, gx, gy = to_hinge(ux, uy, system.base_length, system.line[3])
        along, across = 0.0, 0.0
        if i > 0:
            hx, hy, gx, gy = to_hinge(ux, uy, chain[i - 1, LENGTH], 0.0)
            along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
        rx, ry = along * ux - across * nx, along * uy - across * ny
        qx, qy = along * nx + across * ux, along * ny + across * uy
        px, py, ox, oy = -(al * rx + w2 * qx), -(al * ry + w2 * qy), -2 * om * rx, -2 * om * ry
        ex, ey, vx, vy = -(al * hx + w2 * gx), -(al * hy + w2 * gy), -2 * om * hx, -2 * om * hy
        # One pass over memory: every further loop costs more than the arithmetic in it.
        for k in range(width):
            rate = lanes[i, S_OM_OLD + k] + w0 * lanes[i, S_AL_0 + k] + w1 * lanes[i, S_AL_1 + k]
            angle = lanes[i, S_PHI_OLD + k] + w0 * lanes[i, S_OM_0 + k] + w1 * lanes[i, S_OM_1 + k] + s * rate
            lanes[i, S_OM + k], lanes[i, S_PHI + k] = rate, angle
            ax, ay = carry[C_AX + k], carry[C_AY + k]
            lanes[i, S_ACX + k] = ax + px * angle + ox * rate
            lanes[i, S_ACY + k] = ay + py * angle + oy * rate
            carry[C_AX + k] = ax + ex * angle + vx * rate
            carry[C_AY + k] = ay + ey * angle + vy * rate
        if i > 0 and with_added:
            _added_outward(chain, body, work.out, lanes, carry, i, width)
        if i > 0 and (varies or with_force):
            _varying_body(chain, body, lanes, carry, i, width)
        if i > 0 and with_force:
            _forces_outward(chain, body, lanes, carry, work.force, free, i, width)
        if with_force:
            for k in range(width):
                angle, rate = lanes[i, S_PHI + k], lanes[i, S_OM + k]
                carry[C_PX + k] += gx * angle
                carry[C_PY + k] += gy * angle
                carry[C_VX + k] += gx * rate - om * hx * angle
                carry[C_VY + k] += gy * rate - om * hy * angle
        if i == 0:
            for k in range(width):  # the point about which the clamp turns
                d_pivot = carry[C_PIVOT + k]
                carry[C_AX + k] -= d_pivot * (al * ux + w2 * nx)
                carry[C_AY + k] -= d_pivot * (al * uy + w2 * ny)
                carry[C_PX + k] += d_pivot * (1.0 + nx)
                carry[C_PY + k] += d_pivot * ny
                carry[C_VX + k] -= d_pivot * om * ux
                carry[C_VY + k] -= d_pivot * om * uy


@njit(**INLINE)
def _added_outward(chain, body, out, lanes, carry, i, width):
    """Change of what the mass that body i has gained asks for, for the known part of the motion. Before `_varying_body`."""
    ux, uy = body[i, UX], body[i, UY]
    nx, ny = uy, -ux
    om, al = body[i, OM], body[i, AL]
    w2, mass, grow = om * om, out[i - 1, ADDED], out[i - 1, ADDED_THETA]
    along, across = chain[i - 1, ADDED_ALONG], chain[i - 1, ACROSS]
    rx, ry = along * ux - across * nx, along * uy - across * ny
    qx, qy = along * nx + across * ux, along * ny + across * uy
    ax, ay = body[i, ADX], body[i, ADY]
    moment, turned, outside = ax * qx + ay * qy, mass * (ax * rx + ay * ry), ax * ux + ay * uy
    # From the centre of mass, whose acceleration the lanes hold, to where the mass is gained.
    back = along - chain[i - 1, ALONG]
    px, py, ox, oy = -back * (al * ux + w2 * nx), -back * (al * uy + w2 * ny), -2 * back * om * ux, -2 * back * om * uy
    for k in range(width):
        angle, rate, d_across = lanes[i, S_PHI + k], lanes[i, S_OM + k], lanes[i, S_ACROSS + k]
        dax = lanes[i, S_ACX + k] + px * angle + ox * rate + d_across * (al * ux + w2 * nx) - carry[C_GX + k]
        day = lanes[i, S_ACY + k] + py * angle + oy * rate + d_across * (al * uy + w2 * ny) - carry[C_GY + k]
        heavier = lanes[i, S_MASS + k] + grow * (angle - lanes[i - 1, S_PHI + k])
        lanes[i, S_FX + k] += heavier * ax + mass * dax
        lanes[i, S_FY + k] += heavier * ay + mass * day
        lanes[i, S_EXTRA + k] += heavier * moment + mass * (qx * dax + qy * day + d_across * outside) - turned * angle


@njit(**INLINE)
def _varying_body(chain, body, lanes, carry, i, width):
    """Where mass, centre of mass, inertia or gravity depend on parameters."""
    ux, uy = body[i, UX], body[i, UY]
    nx, ny = uy, -ux
    om, al = body[i, OM], body[i, AL]
    w2, mass = om * om, chain[i - 1, MASS]
    acx, acy = body[i, ACX], body[i, ACY]
    by_along, by_across = acx * nx + acy * ny, acx * ux + acy * uy
    for k in range(width):
        along, across = lanes[i, S_ALONG + k], lanes[i, S_ACROSS + k]
        lanes[i, S_ACX + k] += al * (along * nx + across * ux) - w2 * (along * ux - across * nx) - carry[C_GX + k]
        lanes[i, S_ACY + k] += al * (along * ny + across * uy) - w2 * (along * uy - across * ny) - carry[C_GY + k]
        lanes[i, S_EXTRA + k] += lanes[i, S_INERTIA + k] * al + mass * (along * by_along + across * by_across)


@njit(**INLINE)
def _forces_outward(chain, body, lanes, carry, force, free, i, width):
    """Change of the body force for the known part of the motion, and of its moment."""
    ux, uy = body[i, UX], body[i, UY]
    nx, ny = uy, -ux
    om = body[i, OM]
    along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
    rx, ry = along * ux - across * nx, along * uy - across * ny
    qx, qy = along * nx + across * ux, along * ny + across * uy
    turned = force[i - 1, 0, 0] * rx + force[i - 1, 1, 0] * ry
    for k in range(free.size):
        angle, rate = lanes[i, S_PHI + k], lanes[i, S_OM + k]
        x, y = carry[C_PX + k] + qx * angle, carry[C_PY + k] + qy * angle
        vx = carry[C_VX + k] + qx * rate - om * rx * angle
        vy = carry[C_VY + k] + qy * rate - om * ry * angle
        fx = force[i - 1, 0, 5 + free[k]]
        fx += force[i - 1, 0, 1] * x + force[i - 1, 0, 2] * y + force[i - 1, 0, 3] * vx + force[i - 1, 0, 4] * vy
        fy = force[i - 1, 1, 5 + free[k]]
        fy += force[i - 1, 1, 1] * x + force[i - 1, 1, 2] * y + force[i - 1, 1, 3] * vx + force[i - 1, 1, 4] * vy
        lanes[i, S_FX + k] -= fx
        lanes[i, S_FY + k] -= fy
        lanes[i, S_EXTRA + k] += turned * angle - fx * qx - fy * qy


@njit(**INLINE)
def _inward(chain, body, out, lanes, carry, width):
    """Right-hand side of every body, eliminated on the way from tip to clamp."""
    for row in (C_FX, C_FY, C_TORQUE):
        for k in range(width):
            carry[row + k] = 0.0
    for i in range(chain.shape[0], 0, -1):
        ux, uy = body[i, UX], body[i, UY]
        nx, ny = uy, -ux
        length = chain[i - 1, LENGTH]
        mass = chain[i - 1, MASS]
        along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
        rx, ry = along * ux - across * nx, along * uy - across * ny
        qx, qy = along * nx + across * ux, along * ny + across * uy
        acx, acy = body[i, ACX], body[i, ACY]
        moment = acx * qx + acy * qy
        turned = -mass * (acx * rx + acy * ry) - length * (ux * body[i + 1, FX] + uy * body[i + 1, FY])
        mqx, mqy, lnx, lny = mass * qx, mass * qy, length * nx, length * ny
        by_theta, by_rate, by_p = out[i - 1, TAU_THETA], out[i - 1, TAU_RATE], out[i - 1, TAU_PRESSURE]
        inverse = -1.0 / body[i, BETA]
        xfx, xfy, stiff = body[i, XFX], body[i, XFY], body[i, STIFF]
        for k in range(width):
            angle = lanes[i, S_PHI + k]
            theta = angle - lanes[i - 1, S_PHI + k]
            torque = by_theta * theta + by_rate * (lanes[i, S_OM + k] - lanes[i - 1, S_OM + k])
            torque += by_p * carry[C_PRESSURE + k] + lanes[i, S_TORQUE + k]
            heavier = lanes[i, S_BODY_MASS + k]
            ax, ay = lanes[i, S_ACX + k], lanes[i, S_ACY + k]
            fx, fy = carry[C_FX + k], carry[C_FY + k]
            total = heavier * moment + mqx * ax + mqy * ay + turned * angle + lnx * fx + lny * fy
            x = (total + carry[C_TORQUE + k] - torque + lanes[i, S_EXTRA + k]) * inverse
            lanes[i, S_AL + k] = x
            carry[C_FX + k] = fx + heavier * acx + mass * ax + xfx * x + lanes[i, S_FX + k]
            carry[C_FY + k] = fy + heavier * acy + mass * ay + xfy * x + lanes[i, S_FY + k]
            carry[C_TORQUE + k] = torque + stiff * x


@njit(**INLINE)
def _clamp(system, body, lanes, carry, D, width):
    """The clamp's own turn, and what the first body sees of it."""
    if not system.with_base:
        for k in range(D * LANES):
            carry[C_D + k] = 0.0
        return
    ux, uy, compliance = body[0, UX], body[0, UY], system.line[2]
    hx, hy, gx, gy = to_hinge(ux, uy, system.base_length, system.line[3])
    fx, fy = body[1, FX], body[1, FY]
    moment, turned, axial = body[1, TORQUE] + gx * fx + gy * fy, hx * fx + hy * fy, ux * fx + uy * fy
    for k in range(width):
        angle = lanes[0, S_PHI + k]
        total = carry[C_TORQUE + k] + gx * carry[C_FX + k] + gy * carry[C_FY + k] - turned * angle
        total -= carry[C_PIVOT + k] * axial
        lanes[0, S_AL + k] = -(angle + carry[C_COMPLIANCE + k] * moment + compliance * total) / body[0, BETA]
    for b in range(D):
        for k in range(width):
            carry[C_D + b * LANES + k] = body[0, E + b] * lanes[0, S_AL + k]


@njit(**INLINE)
def _from_clamp(body, lanes, carry, D, width):
    """The motion that follows, from clamp to tip."""
    for i in range(1, lanes.shape[0] - 1):
        inverse = -1.0 / body[i, BETA]
        g0, g1, g2 = body[i, GAMMA] * inverse, body[i, GAMMA + 1] * inverse, body[i, GAMMA + 2] * inverse
        e0, e1 = body[i, E], body[i, E + 1]
        if D > 3:
            for b in range(3, D):
                g = body[i, GAMMA + b] * inverse
                for k in range(width):
                    lanes[i, S_AL + k] += g * carry[C_D + b * LANES + k]
        for k in range(width):
            dx, dy = carry[C_D + k], carry[C_D + LANES + k]
            x = lanes[i, S_AL + k] + g0 * dx + g1 * dy + g2 * carry[C_D + 2 * LANES + k]
            lanes[i, S_AL + k] = x
            carry[C_D + k] = dx + e0 * x
            carry[C_D + LANES + k] = dy + e1 * x
            carry[C_D + 2 * LANES + k] = x
        if D > 3:
            for b in range(3, D):
                e = body[i, E + b]
                for k in range(width):
                    carry[C_D + b * LANES + k] += e * lanes[i, S_AL + k]


@njit(**INLINE)
def answer(system, work, lanes, carry, width):
    """Row S_AL of one block: derivative of Newton's unknown by each parameter, after `outward`."""
    body, D = work.body, 7 if system.with_force else 3
    _inward(system.chain, body, work.out, lanes, carry, width)
    _clamp(system, body, lanes, carry, D, width)
    _from_clamp(body, lanes, carry, D, width)


@njit(**INLINE)
def line_answer(body, lanes, carry, q, width):
    """The felt pressure depends on the tube's acceleration (flow inertance): a rank-one correction of the answer."""
    n = lanes.shape[0] - 2
    denominator = 1.0 + q * (body[n, LINE_STEP] - body[0, LINE_STEP])
    for k in range(width):
        change = -q * (lanes[n, S_AL + k] - lanes[0, S_AL + k]) / denominator
        carry[C_PRESSURE + k] = change
        for i in range(n + 1):
            lanes[i, S_AL + k] += change * body[i, LINE_STEP]
