"""The integrator: a planar chain of hinged bodies, implicit in time, linear in the number of bodies, exact in parameters.

Equations of motion are written body by body (Newton and Euler, eq. GeneralEoM of the paper in absolute angles) and
linearised by a sweep from tip to clamp: the force and torque that a body passes on are an affine function of the
motion of its hinge, so that Newton's step for the whole chain costs O(n) (an articulated-body recursion carried through
the implicit step). Time: singly diagonally implicit Runge-Kutta, L-stable and stiffly accurate, fixed step, full Newton.
Sensitivities follow from the implicit function theorem inside each stage, with the factors that Newton left behind.

Legend. Index 0 is the clamp (it turns only if it is compliant), 1..n the bodies.
    phi, om, al   absolute angle, rate, acceleration of a body        u = (-sin phi, -cos phi) along it; n = du/dphi
    P, V, A       position, velocity, acceleration of a body's hinge
    f, tau        force and torque that body i receives at its hinge
    x             Newton's unknown: change of al (dynamic) or of phi (static); cA, cO, cP: d(al, om, phi)/dx
    d             what a body sees of its inner neighbour: (dA, x of the neighbour, dV, dP), of which the first `D` count
"""

from __future__ import annotations

import numpy as np
from numba import float64, njit, types, void

VECTOR = float64[::1]
MATRIX = float64[:, ::1]
CUBE = float64[:, :, ::1]
JOINT_LAW = types.FunctionType(void(VECTOR, VECTOR, MATRIX, float64, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, MATRIX))
JOINT_CUBE = types.FunctionType(void(VECTOR, VECTOR, MATRIX, float64, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, CUBE))
FORCE_LAW = types.FunctionType(void(MATRIX, VECTOR, VECTOR, VECTOR, CUBE))

# Columns of `chain`
LENGTH, MASS, ALONG, ACROSS, INERTIA, FORCE_ALONG, FORCE_ACROSS = range(7)
# Columns of the joint law's output
TAU, TAU_THETA, TAU_RATE, TAU_PRESSURE, ADDED, ADDED_THETA, FIXED = range(7)

OK, NOT_CONVERGED, BLOWN_UP = 0, 1, 2
_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}


@njit(inline="never", **_OPTIONS)
def _kinematics(chain, base_length, phi, om, al, u, ac, motion, gravity, with_force):
    """Directions, and acceleration of each centre of mass less gravity; motion of the points where body forces act."""
    n = chain.shape[0]
    px, py, vx, vy, ax, ay = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n + 1):
        s, c = np.sin(phi[i]), np.cos(phi[i])
        ux, uy = -s, -c
        nx, ny = -c, s
        u[i, 0], u[i, 1] = ux, uy
        w2 = om[i] * om[i]
        length = base_length
        if i > 0:
            length = chain[i - 1, LENGTH]
            along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
            rx, ry = along * ux - across * nx, along * uy - across * ny
            qx, qy = along * nx + across * ux, along * ny + across * uy
            ac[i, 0] = ax + al[i] * qx - w2 * rx - gravity[0]
            ac[i, 1] = ay + al[i] * qy - w2 * ry - gravity[1]
            if with_force:
                along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
                motion[i - 1, 0] = px + along * ux - across * nx
                motion[i - 1, 1] = py + along * uy - across * ny
                motion[i - 1, 2] = vx + om[i] * (along * nx + across * ux)
                motion[i - 1, 3] = vy + om[i] * (along * ny + across * uy)
        ax += length * (al[i] * nx - w2 * ux)
        ay += length * (al[i] * ny - w2 * uy)
        if with_force:
            px += length * ux
            py += length * uy
            vx += length * om[i] * nx
            vy += length * om[i] * ny


@njit(inline="never", **_OPTIONS)
def _factor(
    chain,
    base_length,
    compliance,
    phi,
    om,
    al,
    u,
    ac,
    out,
    force,
    stiff,
    zc_torque,
    D,
    cA,
    cO,
    cP,
    f,
    tau,
    residual,
    beta,
    gamma,
    K,
    Kx,
    xf,
    e,
    with_base,
):
    """Residual of every body, and the factors of the linearised chain, by one sweep from tip to clamp."""
    n = chain.shape[0]
    f[n + 1, 0], f[n + 1, 1], tau[n + 1] = 0.0, 0.0, 0.0
    for a in range(3):
        for b in range(D):
            K[n + 1, a, b] = 0.0
    for i in range(n, -1, -1):
        if i == 0 and not with_base:
            break
        ux, uy = u[i, 0], u[i, 1]
        nx, ny = uy, -ux
        w2 = om[i] * om[i]
        length = base_length if i == 0 else chain[i - 1, LENGTH]
        # How the next hinge moves with x of this body.
        e[i, 0] = length * (cA * nx - cP * (al[i] * ux + w2 * nx) - 2 * cO * om[i] * ux)
        e[i, 1] = length * (cA * ny - cP * (al[i] * uy + w2 * ny) - 2 * cO * om[i] * uy)
        e[i, 2] = 1.0
        if D > 3:
            e[i, 3] = length * (cO * nx - cP * om[i] * ux)
            e[i, 4] = length * (cO * ny - cP * om[i] * uy)
            e[i, 5] = length * cP * nx
            e[i, 6] = length * cP * ny
        for a in range(3):
            total = 0.0
            for b in range(D):
                total += K[i + 1, a, b] * e[i, b]
            Kx[i, a] = total
        fx, fy = f[i + 1, 0], f[i + 1, 1]
        if i == 0:
            moment = tau[1] + base_length * (nx * fx + ny * fy)
            residual[0] = phi[0] + compliance * moment
            beta[0] = cP + compliance * (
                Kx[0, 2] + length * (nx * Kx[0, 0] + ny * Kx[0, 1]) - length * (ux * fx + uy * fy) * cP
            )
            break
        mass = chain[i - 1, MASS] + out[i - 1, ADDED]
        along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
        rx, ry = along * ux - across * nx, along * uy - across * ny
        qx, qy = along * nx + across * ux, along * ny + across * uy
        gx = cA * qx - cP * (al[i] * rx + w2 * qx) - 2 * cO * om[i] * rx
        gy = cA * qy - cP * (al[i] * ry + w2 * qy) - 2 * cO * om[i] * ry
        accx, accy = ac[i, 0], ac[i, 1]
        acc_q = accx * qx + accy * qy
        T = stiff[i - 1]
        grow = out[i - 1, ADDED_THETA] * cP
        t = out[i - 1, TAU]
        residual[i] = chain[i - 1, INERTIA] * al[i] + mass * acc_q + length * (nx * fx + ny * fy) + tau[i + 1] - t
        b0 = (
            chain[i - 1, INERTIA] * cA
            + mass * (gx * qx + gy * qy)
            - mass * (accx * rx + accy * ry) * cP
            + length * (nx * Kx[i, 0] + ny * Kx[i, 1])
            + Kx[i, 2]
            - length * (ux * fx + uy * fy) * cP
            - T
            + grow * acc_q
        )
        # Row of d in this body's equation, and rows of d in what it passes on.
        for b in range(D):
            gamma[i, b] = length * (nx * K[i + 1, 0, b] + ny * K[i + 1, 1, b]) + K[i + 1, 2, b]
        gamma[i, 2] = T - grow * acc_q
        gamma[i, 0] += mass * qx
        gamma[i, 1] += mass * qy
        xf0 = mass * gx + grow * accx + Kx[i, 0]
        xf1 = mass * gy + grow * accy + Kx[i, 1]
        f[i, 0] = mass * accx + fx
        f[i, 1] = mass * accy + fy
        if D > 3:
            along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
            srx, sry = along * ux - across * nx, along * uy - across * ny
            sqx, sqy = along * nx + across * ux, along * ny + across * uy
            Fx, Fy = force[i - 1, 0, 0], force[i - 1, 1, 0]
            residual[i] -= Fx * sqx + Fy * sqy
            f[i, 0] -= Fx
            f[i, 1] -= Fy
            vx, vy = cO * sqx - cP * om[i] * srx, cO * sqy - cP * om[i] * sry
            dFx = (
                (force[i - 1, 0, 1] * sqx + force[i - 1, 0, 2] * sqy) * cP
                + force[i - 1, 0, 3] * vx
                + force[i - 1, 0, 4] * vy
            )
            dFy = (
                (force[i - 1, 1, 1] * sqx + force[i - 1, 1, 2] * sqy) * cP
                + force[i - 1, 1, 3] * vx
                + force[i - 1, 1, 4] * vy
            )
            b0 += (Fx * srx + Fy * sry) * cP - (dFx * sqx + dFy * sqy)
            xf0 -= dFx
            xf1 -= dFy
            for b in range(2):
                gamma[i, 5 + b] -= force[i - 1, 0, 1 + b] * sqx + force[i - 1, 1, 1 + b] * sqy
                gamma[i, 3 + b] -= force[i - 1, 0, 3 + b] * sqx + force[i - 1, 1, 3 + b] * sqy
        tau[i] = t
        beta[i] = b0
        xf[i, 0], xf[i, 1] = xf0, xf1
        inverse = 1.0 / b0
        for b in range(D):
            share = -gamma[i, b] * inverse
            K[i, 0, b] = K[i + 1, 0, b] + xf0 * share
            K[i, 1, b] = K[i + 1, 1, b] + xf1 * share
            K[i, 2, b] = T * share
        K[i, 0, 2] = -grow * accx + xf0 * (-gamma[i, 2] * inverse)
        K[i, 1, 2] = -grow * accy + xf1 * (-gamma[i, 2] * inverse)
        K[i, 0, 0] += mass
        K[i, 1, 1] += mass
        K[i, 2, 2] -= T
        if D > 3:
            for a in range(2):
                for b in range(2):
                    K[i, a, 5 + b] -= force[i - 1, a, 1 + b]
                    K[i, a, 3 + b] -= force[i - 1, a, 3 + b]
        # What the hidden states' own residual does to the torques.
        residual[i] -= zc_torque[i - 1]
        if i < n:
            residual[i] += zc_torque[i]
    if with_base:
        residual[0] += compliance * zc_torque[0]


@njit(inline="never", **_OPTIONS)
def _solve(chain, base_length, compliance, u, beta, gamma, stiff, xf, e, D, with_base, rhs, x, d, kf, x0):
    """X = -J^-1 rhs for every column of rhs (n + 1, m), with the factors of `_factor`."""
    n = chain.shape[0]
    m = rhs.shape[1]
    for k in range(m):
        kf[0, k] = 0.0
        kf[1, k] = 0.0
        kf[2, k] = 0.0
    for i in range(n, 0, -1):
        length = chain[i - 1, LENGTH]
        lnx, lny = length * u[i, 1], -length * u[i, 0]
        inverse = -1.0 / beta[i]
        T = stiff[i - 1]
        a0, a1 = xf[i, 0], xf[i, 1]
        for k in range(m):
            value = (rhs[i, k] + lnx * kf[0, k] + lny * kf[1, k] + kf[2, k]) * inverse
            x0[i, k] = value
            kf[0, k] += a0 * value
            kf[1, k] += a1 * value
            kf[2, k] = T * value
    if with_base:
        lnx, lny = base_length * u[0, 1], -base_length * u[0, 0]
        for k in range(m):
            x[0, k] = -(rhs[0, k] + compliance * (lnx * kf[0, k] + lny * kf[1, k] + kf[2, k])) / beta[0]
            for b in range(D):
                d[b, k] = e[0, b] * x[0, k]
    else:
        for k in range(m):
            x[0, k] = 0.0
            for b in range(D):
                d[b, k] = 0.0
    for i in range(1, n + 1):
        inverse = -1.0 / beta[i]
        for k in range(m):
            total = 0.0
            for b in range(D):
                total += gamma[i, b] * d[b, k]
            value = x0[i, k] + total * inverse
            x[i, k] = value
            for b in range(D):
                d[b, k] += e[i, b] * value
            d[2, k] = value


@njit(inline="never", **_OPTIONS)
def _small_inverse(a, inverse):
    """Inverse of a small matrix by Gauss-Jordan with row pivoting; `a` is destroyed."""
    m = a.shape[0]
    for i in range(m):
        for j in range(m):
            inverse[i, j] = 1.0 if i == j else 0.0
    for c in range(m):
        pivot = c
        for r in range(c + 1, m):
            if abs(a[r, c]) > abs(a[pivot, c]):
                pivot = r
        if pivot != c:
            for j in range(m):
                a[c, j], a[pivot, j] = a[pivot, j], a[c, j]
                inverse[c, j], inverse[pivot, j] = inverse[pivot, j], inverse[c, j]
        scale = 1.0 / a[c, c]
        for j in range(m):
            a[c, j] *= scale
            inverse[c, j] *= scale
        for r in range(m):
            if r != c:
                factor = a[r, c]
                if factor != 0.0:
                    for j in range(m):
                        a[r, j] -= factor * a[c, j]
                        inverse[r, j] -= factor * inverse[c, j]


@njit(inline="never", **_OPTIONS)
def _joint_factors(out, m, s, z, z_star, cO, cP, stiff, tau_p, zc, zc_torque, Sx, zp, Minv, small):
    """Eliminate the hidden states of every joint: z = z* + s g(theta, rate, p, z)."""
    n = out.shape[0]
    for j in range(n):
        stiff[j] = out[j, TAU_THETA] * cP + out[j, TAU_RATE] * cO
        tau_p[j] = out[j, TAU_PRESSURE]
        zc_torque[j] = 0.0
        if m == 0:
            continue
        base = FIXED + m
        for a in range(m):
            for b in range(m):
                small[a, b] = (1.0 if a == b else 0.0) - s * out[j, base + 4 * m + a * m + b]
        _small_inverse(small, Minv[j])
        for a in range(m):
            sx = 0.0
            sp = 0.0
            c = 0.0
            for b in range(m):
                row = base + 4 * b
                sx += Minv[j, a, b] * s * (out[j, row + 1] * cP + out[j, row + 2] * cO)
                sp += Minv[j, a, b] * s * out[j, row + 3]
                c -= Minv[j, a, b] * (z[j, b] - z_star[j, b] - s * out[j, row])
            Sx[j, a] = sx
            zp[j, a] = sp
            zc[j, a] = c
            stiff[j] += out[j, FIXED + a] * sx
            tau_p[j] += out[j, FIXED + a] * sp
            zc_torque[j] += out[j, FIXED + a] * c


@njit(inline="never", **_OPTIONS)
def _relaxed_factors(out, relaxed, m, cP, z, stiff, tau_p, zc, zc_torque, Sx, zp):
    """The same in a steady state: z is the relaxed value for theta and p."""
    n = out.shape[0]
    for j in range(n):
        stiff[j] = out[j, TAU_THETA] * cP
        tau_p[j] = out[j, TAU_PRESSURE]
        zc_torque[j] = 0.0
        for a in range(m):
            z[j, a] = relaxed[j, a, 0]
            Sx[j, a] = relaxed[j, a, 1] * cP
            zp[j, a] = relaxed[j, a, 2]
            zc[j, a] = 0.0
            stiff[j] += out[j, FIXED + a] * Sx[j, a]
            tau_p[j] += out[j, FIXED + a] * zp[j, a]


@njit(inline="never", **_OPTIONS)
def _explicit(
    chain,
    dchain,
    base_length,
    compliance,
    dcompliance,
    dgravity,
    phi,
    om,
    al,
    u,
    ac,
    f,
    tau,
    out,
    out_par,
    force,
    tau_z_zeta,
    D,
    with_base,
    dphi,
    dom,
    dp,
    free,
    rhs,
    dA,
    dV,
    dP,
    dac,
    df,
    dtau_next,
    dtau,
    dforce,
):
    """Directional derivative of every body's residual for the known part of the motion's and parameters' change."""
    n = chain.shape[0]
    m = free.size
    for k in range(m):
        for a in range(2):
            dA[a, k] = 0.0
            dV[a, k] = 0.0
            dP[a, k] = 0.0
            df[a, k] = 0.0
        dtau_next[k] = 0.0
    for i in range(n + 1):
        ux, uy = u[i, 0], u[i, 1]
        nx, ny = uy, -ux
        w, w2 = om[i], om[i] * om[i]
        length = base_length
        if i > 0:
            length = chain[i - 1, LENGTH]
            along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
            rx, ry = along * ux - across * nx, along * uy - across * ny
            qx, qy = along * nx + across * ux, along * ny + across * uy
            cx, cy = -(al[i] * rx + w2 * qx), -(al[i] * ry + w2 * qy)
            for k in range(m):
                p = free[k]
                dc, dd = dchain[i - 1, 1, p], dchain[i - 1, 2, p]
                dac[i, 0, k] = (
                    dA[0, k]
                    + cx * dphi[i, k]
                    - 2 * w * rx * dom[i, k]
                    - dgravity[0, p]
                    + al[i] * (dc * nx + dd * ux)
                    - w2 * (dc * ux - dd * nx)
                )
                dac[i, 1, k] = (
                    dA[1, k]
                    + cy * dphi[i, k]
                    - 2 * w * ry * dom[i, k]
                    - dgravity[1, p]
                    + al[i] * (dc * ny + dd * uy)
                    - w2 * (dc * uy - dd * ny)
                )
            if D > 3:
                along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
                srx, sry = along * ux - across * nx, along * uy - across * ny
                sqx, sqy = along * nx + across * ux, along * ny + across * uy
                for k in range(m):
                    ex, ey = dP[0, k] + sqx * dphi[i, k], dP[1, k] + sqy * dphi[i, k]
                    vx = dV[0, k] + sqx * dom[i, k] - w * srx * dphi[i, k]
                    vy = dV[1, k] + sqy * dom[i, k] - w * sry * dphi[i, k]
                    for a in range(2):
                        dforce[i, a, k] = (
                            force[i - 1, a, 1] * ex
                            + force[i - 1, a, 2] * ey
                            + force[i - 1, a, 3] * vx
                            + force[i - 1, a, 4] * vy
                            + force[i - 1, a, 5 + free[k]]
                        )
        cx, cy = -length * (al[i] * ux + w2 * nx), -length * (al[i] * uy + w2 * ny)
        for k in range(m):
            dA[0, k] += cx * dphi[i, k] - 2 * length * w * ux * dom[i, k]
            dA[1, k] += cy * dphi[i, k] - 2 * length * w * uy * dom[i, k]
        if D > 3:
            for k in range(m):
                dP[0, k] += length * nx * dphi[i, k]
                dP[1, k] += length * ny * dphi[i, k]
                dV[0, k] += length * (nx * dom[i, k] - w * ux * dphi[i, k])
                dV[1, k] += length * (ny * dom[i, k] - w * uy * dphi[i, k])
    for i in range(n, 0, -1):
        ux, uy = u[i, 0], u[i, 1]
        nx, ny = uy, -ux
        length = chain[i - 1, LENGTH]
        mass = chain[i - 1, MASS] + out[i - 1, ADDED]
        along, across = chain[i - 1, ALONG], chain[i - 1, ACROSS]
        rx, ry = along * ux - across * nx, along * uy - across * ny
        qx, qy = along * nx + across * ux, along * ny + across * uy
        accx, accy = ac[i, 0], ac[i, 1]
        acc_q, acc_r = accx * qx + accy * qy, accx * rx + accy * ry
        acc_n, acc_u = accx * nx + accy * ny, accx * ux + accy * uy
        fu = length * (ux * f[i + 1, 0] + uy * f[i + 1, 1])
        grow = out[i - 1, ADDED_THETA]
        for k in range(m):
            p = free[k]
            dtheta = dphi[i, k] - dphi[i - 1, k]
            drate = dom[i, k] - dom[i - 1, k]
            dtau[k] = (
                out[i - 1, TAU_THETA] * dtheta
                + out[i - 1, TAU_RATE] * drate
                + out[i - 1, TAU_PRESSURE] * dp[k]
                + out_par[i - 1, 0, p]
                + tau_z_zeta[i - 1, k]
            )
            dm = dchain[i - 1, 0, p] + out_par[i - 1, 1, p] + grow * dtheta
            rhs[i, k] = (
                dchain[i - 1, 3, p] * al[i]
                + dm * acc_q
                + mass * (dac[i, 0, k] * qx + dac[i, 1, k] * qy)
                - mass * acc_r * dphi[i, k]
                + mass * (dchain[i - 1, 1, p] * acc_n + dchain[i - 1, 2, p] * acc_u)
                + length * (nx * df[0, k] + ny * df[1, k])
                - fu * dphi[i, k]
                + dtau_next[k]
                - dtau[k]
            )
            df[0, k] += dm * accx + mass * dac[i, 0, k]
            df[1, k] += dm * accy + mass * dac[i, 1, k]
            dtau_next[k] = dtau[k]
        if D > 3:
            along, across = chain[i - 1, FORCE_ALONG], chain[i - 1, FORCE_ACROSS]
            srx, sry = along * ux - across * nx, along * uy - across * ny
            sqx, sqy = along * nx + across * ux, along * ny + across * uy
            F_r = force[i - 1, 0, 0] * srx + force[i - 1, 1, 0] * sry
            for k in range(m):
                rhs[i, k] += F_r * dphi[i, k] - dforce[i, 0, k] * sqx - dforce[i, 1, k] * sqy
                df[0, k] -= dforce[i, 0, k]
                df[1, k] -= dforce[i, 1, k]
    if with_base:
        ux, uy = u[0, 0], u[0, 1]
        nx, ny = uy, -ux
        moment = tau[1] + base_length * (nx * f[1, 0] + ny * f[1, 1])
        fu = base_length * (ux * f[1, 0] + uy * f[1, 1])
        for k in range(m):
            rhs[0, k] = (
                dphi[0, k]
                + dcompliance[free[k]] * moment
                + compliance * (dtau_next[k] + base_length * (nx * df[0, k] + ny * df[1, k]) - fu * dphi[0, k])
            )
    else:
        for k in range(m):
            rhs[0, k] = 0.0
