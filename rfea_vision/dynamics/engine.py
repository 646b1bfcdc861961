"""The chain: a planar row of hinged bodies, implicit in time, linear in the number of bodies.

Equations of motion are written body by body (Newton and Euler, eq. GeneralEoM of the paper in absolute angles) and
linearised by a sweep from tip to clamp: the force and torque that a body passes on are an affine function of the
motion of its hinge, so that Newton's step for the whole chain costs O(n) (an articulated-body recursion carried through
the implicit step).

Legend. Index 0 is the clamp (it turns only if it is compliant), 1..n the bodies.
    phi, om, al   absolute angle, rate, acceleration of a body        u = (-sin phi, -cos phi) along it; n = du/dphi
    r, q          centre of mass from the hinge, dr/dphi              P, V, A  position, velocity, acceleration of a hinge
    f, tau        force and torque that body i receives at its hinge
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
    ADDED_THETA,
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
    """Directions, and acceleration of each centre of mass less gravity; motion of the points where body forces act."""
    chain, gravity, with_force = system.chain, system.gravity, system.with_force
    n = chain.shape[0]
    px, py, vx, vy, ax, ay = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n + 1):
        ux, uy = -np.sin(body[i, PHI]), -np.cos(body[i, PHI])
        nx, ny = uy, -ux
        body[i, UX], body[i, UY] = ux, uy
        om, al = body[i, OM], body[i, AL]
        w2 = om * om
        length = system.base_length
        if i > 0:
            length = chain[i - 1, LENGTH]
            along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
            rx, ry = along * ux - across * nx, along * uy - across * ny
            qx, qy = along * nx + across * ux, along * ny + across * uy
            body[i, ACX] = ax + al * qx - w2 * rx - gravity[0]
            body[i, ACY] = ay + al * qy - w2 * ry - gravity[1]
            if with_force:
                along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
                motion[i - 1, 0] = px + along * ux - across * nx
                motion[i - 1, 1] = py + along * uy - across * ny
                motion[i - 1, 2] = vx + om * (along * nx + across * ux)
                motion[i - 1, 3] = vy + om * (along * ny + across * uy)
        ax += length * (al * nx - w2 * ux)
        ay += length * (al * ny - w2 * uy)
        if with_force:
            px += length * ux
            py += length * uy
            vx += length * om * nx
            vy += length * om * ny


@njit(**INLINE)
def _next_hinge(body, i, length, D, cA, cO, cP):
    """How the next hinge moves with x of body i, and what everything beyond it answers."""
    literally(D)
    ux, uy = body[i, UX], body[i, UY]
    nx, ny = uy, -ux
    om, al = body[i, OM], body[i, AL]
    w2 = om * om
    body[i, E] = length * (cA * nx - cP * (al * ux + w2 * nx) - 2 * cO * om * ux)
    body[i, E + 1] = length * (cA * ny - cP * (al * uy + w2 * ny) - 2 * cO * om * uy)
    body[i, E + 2] = 1.0
    if D > 3:
        body[i, E + 3] = length * (cO * nx - cP * om * ux)
        body[i, E + 4] = length * (cO * ny - cP * om * uy)
        body[i, E + 5] = length * cP * nx
        body[i, E + 6] = length * cP * ny
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
def factor(system, body, out, force, D, cA, cO, cP):
    """Residual of every body, and the factors of the linearised chain, by one sweep from tip to clamp."""
    literally(D)
    chain, base_length, compliance = system.chain, system.base_length, system.line[2]
    n = chain.shape[0]
    for i in range(n, 0, -1):
        length = chain[i - 1, LENGTH]
        _next_hinge(body, i, length, D, cA, cO, cP)
        ux, uy = body[i, UX], body[i, UY]
        nx, ny = uy, -ux
        om, al = body[i, OM], body[i, AL]
        w2 = om * om
        fx, fy = body[i + 1, FX], body[i + 1, FY]
        mass = chain[i - 1, MASS] + out[i - 1, ADDED]
        along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
        rx, ry = along * ux - across * nx, along * uy - across * ny
        qx, qy = along * nx + across * ux, along * ny + across * uy
        gx = cA * qx - cP * (al * rx + w2 * qx) - 2 * cO * om * rx
        gy = cA * qy - cP * (al * ry + w2 * qy) - 2 * cO * om * ry
        acx, acy = body[i, ACX], body[i, ACY]
        moment = acx * qx + acy * qy
        stiff, torque = body[i, STIFF], out[i - 1, TAU]
        grow = out[i - 1, ADDED_THETA] * cP
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
            + grow * moment
        )
        for b in range(D):
            body[i, GAMMA + b] = (
                length * (nx * body[i + 1, K + b] + ny * body[i + 1, K + 7 + b]) + body[i + 1, K + 14 + b]
            )
        body[i, GAMMA + 2] = stiff - grow * moment
        body[i, GAMMA] += mass * qx
        body[i, GAMMA + 1] += mass * qy
        xfx = mass * gx + grow * acx + body[i, KX]
        xfy = mass * gy + grow * acy + body[i, KX + 1]
        body[i, FX] = mass * acx + fx
        body[i, FY] = mass * acy + fy
        if D > 3:
            change, x_force, y_force = _force_terms(chain, body, force, i, cO, cP)
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
        body[i, K + 2] = xfx * share - grow * acx
        body[i, K + 9] = xfy * share - grow * acy
        body[i, K + 16] -= stiff
        body[i, K] += mass
        body[i, K + 8] += mass
        if D > 3:
            for a in range(2):
                for b in range(2):
                    body[i, K + 7 * a + 5 + b] -= force[i - 1, a, 1 + b]
                    body[i, K + 7 * a + 3 + b] -= force[i - 1, a, 3 + b]
    if system.with_base:
        _next_hinge(body, 0, base_length, D, cA, cO, cP)
        ux, uy = body[0, UX], body[0, UY]
        fx, fy = body[1, FX], body[1, FY]
        moment = body[1, TORQUE] + body[1, Z_TORQUE] + base_length * (uy * fx - ux * fy)
        body[0, RESIDUAL] = body[0, PHI] + compliance * moment
        body[0, BETA] = cP + compliance * (
            body[0, KX + 2]
            + base_length * (uy * body[0, KX] - ux * body[0, KX + 1])
            - base_length * (ux * fx + uy * fy) * cP
        )


@njit(**INLINE)
def solve(system, body, D, rhs, x, d):
    """Column x of `body` = -J^-1 (column rhs of `body`), with the factors of `factor`; d (7,) is working space."""
    literally(D)
    chain, base_length, compliance = system.chain, system.base_length, system.line[2]
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
        moment = base_length * (body[0, UY] * fx - body[0, UX] * fy) + torque
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
