"""The chain: a planar row of hinged bodies, implicit in time, linear in the number of bodies.

Equations of motion are written body by body (Newton and Euler, eq. GeneralEoM of the paper in absolute angles) and
linearised by a sweep from tip to clamp: the force and torque that a body passes on are an affine function of the
motion of its hinge, so that Newton's step for the whole chain costs O(n) (an articulated-body recursion carried through
the implicit step).

Legend. Index 0 is the clamp (it turns only if it is compliant), 1..n the bodies.
    phi, om, al   absolute angle, rate, acceleration of a body        u = (-sin phi, -cos phi) along it; n = du/dphi
    r, q          centre of mass from the hinge, dr/dphi              P, V, A  position, velocity, acceleration of a hinge
    f, tau        force and torque that body i receives at its hinge
    h             next hinge from the hinge, h = length u; of the clamp, which turns about a point beside it, length u + pivot n
    x             Newton's unknown: change of al (dynamic) or of phi (static); cA, cO, cP: d(al, om, phi)/dx
    d             what a body sees of its inner neighbour: (dA, x of the neighbour, dV, dP), of which the first `D` count
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.misc.special import literally

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
    FORCE_ACROSS,
    FORCE_ALONG,
    FX,
    FY,
    GAMMA,
    INERTIA,
    INLINE,
    KX,
    LENGTH,
    MASS,
    OM,
    PHI,
    RESIDUAL,
    STIFF,
    TAU,
    TORQUE,
    UX,
    UY,
    XFX,
    XFY,
    Z_TORQUE,
    E,
    K,
)


@njit(**INLINE)
def kinematics(system, body, motion):
    """Directions; acceleration less gravity of each centre of mass and of what a body gains; motion where body forces act."""
    chain, gravity, with_force, with_added = system.chain, system.gravity, system.with_force, system.with_added
    n, pivot = chain.shape[0], system.line[3]
    px, py, vx, vy, ax, ay = pivot - chain[0, FORCE_ACROSS], 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n + 1):
        ux, uy = -np.sin(body[i, PHI]), -np.cos(body[i, PHI])
        nx, ny = uy, -ux
        body[i, UX], body[i, UY] = ux, uy
        om, al = body[i, OM], body[i, AL]
        w2 = om * om
        hx, hy, gx, gy = to_hinge(ux, uy, system.base_length, pivot)
        if i > 0:
            hx, hy, gx, gy = to_hinge(ux, uy, chain[i - 1, LENGTH], 0.0)
            along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
            rx, ry = along * ux - across * nx, along * uy - across * ny
            qx, qy = along * nx + across * ux, along * ny + across * uy
            body[i, ACX] = ax + al * qx - w2 * rx - gravity[0]
            body[i, ACY] = ay + al * qy - w2 * ry - gravity[1]
            if with_added:
                along = chain[i - 1, ADDED_ALONG]
                rx, ry = along * ux - across * nx, along * uy - across * ny
                qx, qy = along * nx + across * ux, along * ny + across * uy
                body[i, ADX] = ax + al * qx - w2 * rx - gravity[0]
                body[i, ADY] = ay + al * qy - w2 * ry - gravity[1]
            if with_force:
                along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
                motion[i - 1, 0] = px + along * ux - across * nx
                motion[i - 1, 1] = py + along * uy - across * ny
                motion[i - 1, 2] = vx + om * (along * nx + across * ux)
                motion[i - 1, 3] = vy + om * (along * ny + across * uy)
        ax += al * gx - w2 * hx
        ay += al * gy - w2 * hy
        if with_force:
            px += hx
            py += hy
            vx += om * gx
            vy += om * gy


@njit(**INLINE)
def to_hinge(ux, uy, length, pivot):
    """The next hinge from this one, h, and dh/dphi; of the clamp from the point about which it turns."""
    return length * ux + pivot * uy, length * uy - pivot * ux, length * uy - pivot * ux, -length * ux - pivot * uy


@njit(**INLINE)
def _next_hinge(body, i, length, pivot, D, cA, cO, cP):
    """How the next hinge moves with x of body i, and what everything beyond it answers."""
    literally(D)
    hx, hy, gx, gy = to_hinge(body[i, UX], body[i, UY], length, pivot)
    om, al = body[i, OM], body[i, AL]
    w2 = om * om
    body[i, E] = cA * gx - cP * (al * hx + w2 * gx) - 2 * cO * om * hx
    body[i, E + 1] = cA * gy - cP * (al * hy + w2 * gy) - 2 * cO * om * hy
    body[i, E + 2] = 1.0
    if D > 3:
        body[i, E + 3] = cO * gx - cP * om * hx
        body[i, E + 4] = cO * gy - cP * om * hy
        body[i, E + 5] = cP * gx
        body[i, E + 6] = cP * gy
    for a in range(3):
        total = 0.0
        for b in range(D):
            total += body[i + 1, K + 7 * a + b] * body[i, E + b]
        body[i, KX + a] = total


@njit(**INLINE)
def _force_terms(chain, body, force, i, cO, cP):
    """Body forces in the balance of body i: adds to its residual and force, returns d(moment, fx, fy)/dx."""
    ux, uy = body[i, UX], body[i, UY]
    nx, ny = uy, -ux
    om = body[i, OM]
    along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
    rx, ry = along * ux - across * nx, along * uy - across * ny
    qx, qy = along * nx + across * ux, along * ny + across * uy
    fx, fy = force[i - 1, 0, 0], force[i - 1, 1, 0]
    body[i, RESIDUAL] -= fx * qx + fy * qy
    body[i, FX] -= fx
    body[i, FY] -= fy
    vx, vy = cO * qx - cP * om * rx, cO * qy - cP * om * ry
    dfx = (force[i - 1, 0, 1] * qx + force[i - 1, 0, 2] * qy) * cP + force[i - 1, 0, 3] * vx + force[i - 1, 0, 4] * vy
    dfy = (force[i - 1, 1, 1] * qx + force[i - 1, 1, 2] * qy) * cP + force[i - 1, 1, 3] * vx + force[i - 1, 1, 4] * vy
    for b in range(2):
        body[i, GAMMA + 5 + b] -= force[i - 1, 0, 1 + b] * qx + force[i - 1, 1, 1 + b] * qy
        body[i, GAMMA + 3 + b] -= force[i - 1, 0, 3 + b] * qx + force[i - 1, 1, 3 + b] * qy
    return (fx * rx + fy * ry) * cP - (dfx * qx + dfy * qy), -dfx, -dfy


@njit(**INLINE)
def _added_terms(chain, body, out, i, cA, cO, cP):
    """Mass that body i gains with its joint's angle, likewise; d(moment, fx, fy)/dx, and d(fx, fy) by its joint's angle."""
    ux, uy = body[i, UX], body[i, UY]
    nx, ny = uy, -ux
    om, al = body[i, OM], body[i, AL]
    w2 = om * om
    mass, grow = out[i - 1, ADDED], out[i - 1, ADDED_THETA] * cP
    along, across = chain[i - 1, ADDED_ALONG], chain[i - 1, ACROSS]
    rx, ry = along * ux - across * nx, along * uy - across * ny
    qx, qy = along * nx + across * ux, along * ny + across * uy
    gx = cA * qx - cP * (al * rx + w2 * qx) - 2 * cO * om * rx
    gy = cA * qy - cP * (al * ry + w2 * qy) - 2 * cO * om * ry
    ax, ay = body[i, ADX], body[i, ADY]
    moment = ax * qx + ay * qy
    body[i, RESIDUAL] += mass * moment
    body[i, FX] += mass * ax
    body[i, FY] += mass * ay
    body[i, GAMMA] += mass * qx
    body[i, GAMMA + 1] += mass * qy
    body[i, GAMMA + 2] -= grow * moment
    change = mass * (gx * qx + gy * qy - (ax * rx + ay * ry) * cP) + grow * moment
    return change, mass * gx + grow * ax, mass * gy + grow * ay, grow * ax, grow * ay


@njit(**INLINE)
def factor(system, body, out, force, D, cA, cO, cP):
    """Residual of every body, and the factors of the linearised chain, by one sweep from tip to clamp."""
    literally(D)
    chain, compliance = system.chain, system.line[2]
    n = chain.shape[0]
    for i in range(n, 0, -1):
        length = chain[i - 1, LENGTH]
        _next_hinge(body, i, length, 0.0, D, cA, cO, cP)
        ux, uy = body[i, UX], body[i, UY]
        nx, ny = uy, -ux
        om, al = body[i, OM], body[i, AL]
        w2 = om * om
        fx, fy = body[i + 1, FX], body[i + 1, FY]
        mass = chain[i - 1, MASS]
        along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
        rx, ry = along * ux - across * nx, along * uy - across * ny
        qx, qy = along * nx + across * ux, along * ny + across * uy
        gx = cA * qx - cP * (al * rx + w2 * qx) - 2 * cO * om * rx
        gy = cA * qy - cP * (al * ry + w2 * qy) - 2 * cO * om * ry
        acx, acy = body[i, ACX], body[i, ACY]
        moment = acx * qx + acy * qy
        stiff, torque = body[i, STIFF], out[i - 1, TAU]
        inertia = chain[i - 1, INERTIA]
        # The hidden states' own residual acts through the torques on both sides.
        body[i, RESIDUAL] = (
            inertia * al + mass * moment + length * (nx * fx + ny * fy) + body[i + 1, TORQUE] - torque
        ) + (body[i + 1, Z_TORQUE] - body[i, Z_TORQUE])
        beta = (
            inertia * cA
            + mass * (gx * qx + gy * qy - (acx * rx + acy * ry) * cP)
            + length * (nx * body[i, KX] + ny * body[i, KX + 1] - (ux * fx + uy * fy) * cP)
            + body[i, KX + 2]
            - stiff
        )
        for b in range(D):
            body[i, GAMMA + b] = (
                length * (nx * body[i + 1, K + b] + ny * body[i + 1, K + 7 + b]) + body[i + 1, K + 14 + b]
            )
        body[i, GAMMA + 2] = stiff
        body[i, GAMMA] += mass * qx
        body[i, GAMMA + 1] += mass * qy
        xfx = mass * gx + body[i, KX]
        xfy = mass * gy + body[i, KX + 1]
        body[i, FX] = mass * acx + fx
        body[i, FY] = mass * acy + fy
        if D > 3:
            change, x_force, y_force = _force_terms(chain, body, force, i, cO, cP)
            beta += change
            xfx += x_force
            xfy += y_force
        by_theta_x, by_theta_y = 0.0, 0.0
        if system.with_added:
            change, x_force, y_force, by_theta_x, by_theta_y = _added_terms(chain, body, out, i, cA, cO, cP)
            beta += change
            xfx += x_force
            xfy += y_force
        body[i, TORQUE] = torque
        body[i, XFX], body[i, XFY] = xfx, xfy
        inverse = -1.0 / beta
        body[i, BETA] = beta
        for b in range(D):
            share = body[i, GAMMA + b] * inverse
            body[i, K + b] = body[i + 1, K + b] + xfx * share
            body[i, K + 7 + b] = body[i + 1, K + 7 + b] + xfy * share
            body[i, K + 14 + b] = stiff * share
        share = body[i, GAMMA + 2] * inverse
        body[i, K + 2] = xfx * share
        body[i, K + 9] = xfy * share
        body[i, K + 16] -= stiff
        if system.with_added:
            body[i, K + 2] -= by_theta_x
            body[i, K + 9] -= by_theta_y
            mass += out[i - 1, ADDED]
        body[i, K] += mass
        body[i, K + 8] += mass
        if D > 3:
            for a in range(2):
                for b in range(2):
                    body[i, K + 7 * a + 5 + b] -= force[i - 1, a, 1 + b]
                    body[i, K + 7 * a + 3 + b] -= force[i - 1, a, 3 + b]
    if system.with_base:
        length, pivot = system.base_length, system.line[3]
        _next_hinge(body, 0, length, pivot, D, cA, cO, cP)
        hx, hy, gx, gy = to_hinge(body[0, UX], body[0, UY], length, pivot)
        fx, fy = body[1, FX], body[1, FY]
        moment = body[1, TORQUE] + body[1, Z_TORQUE] + gx * fx + gy * fy
        body[0, RESIDUAL] = body[0, PHI] + compliance * moment
        body[0, BETA] = cP + compliance * (
            body[0, KX + 2] + gx * body[0, KX] + gy * body[0, KX + 1] - (hx * fx + hy * fy) * cP
        )


@njit(**INLINE)
def solve(system, body, D, rhs, x, d):
    """Column x of `body` = -J^-1 (column rhs of `body`), with the factors of `factor`; d (7,) is working space."""
    literally(D)
    chain, compliance = system.chain, system.line[2]
    n = chain.shape[0]
    fx, fy, torque = 0.0, 0.0, 0.0
    for i in range(n, 0, -1):
        length = chain[i - 1, LENGTH]
        total = body[i, rhs] + length * (body[i, UY] * fx - body[i, UX] * fy) + torque
        value = -total / body[i, BETA]
        body[i, x] = value
        fx += body[i, XFX] * value
        fy += body[i, XFY] * value
        torque = body[i, STIFF] * value
    value = 0.0
    if system.with_base:
        _, _, gx, gy = to_hinge(body[0, UX], body[0, UY], system.base_length, system.line[3])
        moment = gx * fx + gy * fy + torque
        value = -(body[0, rhs] + compliance * moment) / body[0, BETA]
    body[0, x] = value
    for b in range(D):
        d[b] = body[0, E + b] * value
    for i in range(1, n + 1):
        total = 0.0
        for b in range(D):
            total += body[i, GAMMA + b] * d[b]
        value = body[i, x] - total / body[i, BETA]
        body[i, x] = value
        for b in range(D):
            d[b] += body[i, E + b] * value
        d[2] = value
