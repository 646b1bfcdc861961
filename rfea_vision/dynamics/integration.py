"""One run of the chain: steady state at the first pressure, then fixed steps along the pressure log.

Legend as in `engine`. S_* are sensitivities with respect to the free parameters, in SI units.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, njit, types

from rfea_vision.dynamics.engine import (
    _OPTIONS,
    BLOWN_UP,
    CUBE,
    FIXED,
    FORCE_LAW,
    JOINT_CUBE,
    JOINT_LAW,
    MATRIX,
    NOT_CONVERGED,
    OK,
    VECTOR,
    _explicit,
    _factor,
    _joint_factors,
    _kinematics,
    _relaxed_factors,
    _solve,
)

LARGEST_JOINT_ANGLE = 3.0  # rad; beyond it the chain has wound up
NEWTON_STEPS = 60
# Full steps at first; a law that is steep at rest (dry friction) can make them swing about the solution, then shorter ones.
FULL_STEPS = 8

# Signatures are spelled out so that laws enter as function pointers and one compiled engine serves them all.
_INDEX = int64[::1]
_BODIES = (MATRIX, CUBE, float64, VECTOR, MATRIX, VECTOR, MATRIX, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR)
_EQUILIBRIUM = types.Tuple((int64, float64))(
    JOINT_LAW,
    JOINT_CUBE,
    JOINT_CUBE,
    FORCE_LAW,
    *_BODIES,
    float64,
    VECTOR,
    VECTOR,
    int64,
    int64,
    boolean,
    boolean,
    _INDEX,
    VECTOR,
    MATRIX,
    MATRIX,
    CUBE,
)
_INTEGRATE = types.Tuple((int64, int64, int64))(
    JOINT_LAW,
    JOINT_CUBE,
    FORCE_LAW,
    MATRIX,
    float64,
    *_BODIES,
    MATRIX,
    CUBE,
    CUBE,
    int64,
    int64,
    boolean,
    boolean,
    boolean,
    float64,
    _INDEX,
    VECTOR,
    VECTOR,
    MATRIX,
    MATRIX,
    MATRIX,
    CUBE,
    _INDEX,
    VECTOR,
    MATRIX,
    MATRIX,
    CUBE,
    CUBE,
    float64,
)


@njit(inline="never", **_OPTIONS)
def _joint_angles(phi, om, theta, rate):
    for j in range(theta.size):
        theta[j] = phi[j + 1] - phi[j]
        rate[j] = om[j + 1] - om[j]


@njit(_EQUILIBRIUM, **_OPTIONS)
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
    n = chain.shape[0]
    D = 7 if with_force else 3
    count = par.size
    u = np.zeros((n + 1, 2))
    ac = np.zeros((n + 1, 2))
    om = np.zeros(n + 1)
    al = np.zeros(n + 1)
    motion = np.zeros((n, 4))
    force = np.zeros((n, 2, 5 + count))
    out = np.zeros((n, columns))
    relaxed = np.zeros((n, max(m, 1), 3 + count))
    theta, rate = np.zeros(n), np.zeros(n)
    stiff, tau_p, zc_torque = np.zeros(n), np.zeros(n), np.zeros(n)
    zc, Sx, zp = np.zeros((n, max(m, 1))), np.zeros((n, max(m, 1))), np.zeros((n, max(m, 1)))
    f, tau = np.zeros((n + 2, 2)), np.zeros(n + 2)
    residual, beta, gamma = np.zeros((n + 1, 1)), np.zeros(n + 1), np.zeros((n + 1, D))
    K, Kx, xf, e = np.zeros((n + 2, 3, D)), np.zeros((n + 1, 3)), np.zeros((n + 1, 2)), np.zeros((n + 1, 7))
    x, d, kf, x0 = np.zeros((n + 1, 1)), np.zeros((D, 1)), np.zeros((3, 1)), np.zeros((n + 1, 1))
    length = chain[:, 0].copy()
    compliance = line[2]
    status = NOT_CONVERGED
    flat = residual[:, 0]
    res = np.zeros(n + 1)
    for _ in range(60):
        _joint_angles(phi, om, theta, rate)
        if m > 0:
            relaxed_law(theta, rate, z, pressure, position, arc, weights, par, con, relaxed)
            for j in range(n):
                for a in range(m):
                    z[j, a] = relaxed[j, a, 0]
        law(theta, rate, z, pressure, position, arc, weights, par, con, out)
        for j in range(n):
            out[j, 0] += drive[j]
        _kinematics(chain, base_length, phi, om, al, u, ac, motion, gravity, with_force)
        if with_force:
            force_law(motion, length, par, con, force)
        _relaxed_factors(out, relaxed, m, 1.0, z, stiff, tau_p, zc, zc_torque, Sx, zp)
        _factor(
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
            0.0,
            0.0,
            1.0,
            f,
            tau,
            res,
            beta,
            gamma,
            K,
            Kx,
            xf,
            e,
            with_base,
        )
        for i in range(n + 1):
            flat[i] = res[i]
        _solve(chain, base_length, compliance, u, beta, gamma, stiff, xf, e, D, with_base, residual, x, d, kf, x0)
        largest = 0.0
        for i in range(n + 1):
            largest = max(largest, abs(x[i, 0] - (x[i - 1, 0] if i > 0 else 0.0)))
        if not np.isfinite(largest):
            return BLOWN_UP, 0.0
        damp = min(1.0, 0.3 / largest) if largest > 0 else 1.0
        for i in range(n + 1):
            phi[i] += damp * x[i, 0]
        if largest < 1e-12:
            status = OK
            break
    stability = np.inf
    for i in range(1, n + 1):
        stability = min(stability, beta[i])
    _joint_angles(phi, om, theta, rate)
    for j in range(n):
        if abs(theta[j]) > LARGEST_JOINT_ANGLE:
            return BLOWN_UP, stability
    p = free.size
    if p > 0 and status == OK:
        out_par = np.zeros((n, 2 + m, count))
        zeta, tau_z_zeta = np.zeros((n, max(m, 1), p)), np.zeros((n, p))
        zero = np.zeros((n + 1, p))
        law_par(theta, rate, z, pressure, position, arc, weights, par, con, out_par)
        for j in range(n):
            for k in range(p):
                total = 0.0
                for a in range(m):
                    zeta[j, a, k] = relaxed[j, a, 3 + free[k]] + relaxed[j, a, 2] * dpressure[free[k]]
                    total += out[j, FIXED + a] * zeta[j, a, k]
                tau_z_zeta[j, k] = total
        dp = np.zeros(p)
        for k in range(p):
            dp[k] = dpressure[free[k]]
        rhs = np.zeros((n + 1, p))
        _explicit(
            chain,
            dchain,
            base_length,
            compliance,
            dline[2],
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
            zero,
            zero,
            dp,
            free,
            rhs,
            np.zeros((2, p)),
            np.zeros((2, p)),
            np.zeros((2, p)),
            np.zeros((n + 1, 2, p)),
            np.zeros((2, p)),
            np.zeros(p),
            np.zeros(p),
            np.zeros((n + 1, 2, p)),
        )
        _solve(
            chain,
            base_length,
            compliance,
            u,
            beta,
            gamma,
            stiff,
            xf,
            e,
            D,
            with_base,
            rhs,
            S_phi,
            np.zeros((D, p)),
            np.zeros((3, p)),
            np.zeros((n + 1, p)),
        )
        for j in range(n):
            for a in range(m):
                for k in range(p):
                    S_z[j, a, k] = zeta[j, a, k] + Sx[j, a] * (S_phi[j + 1, k] - S_phi[j, k])
    return status, stability


@njit(_INTEGRATE, **_OPTIONS)
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
    S_om,
    S_z,
    frame_step,
    frame_fraction,
    out_phi,
    out_om,
    out_z,
    out_S,
    tolerance,
):
    """March along the log; phi (n + 1), om, z (n, m) and their sensitivities are updated in place.

    pressure (steps, stages) at the stage times; dpressure (steps, stages, parameters) or with no rows; drive
    (steps, stages, n) or with no rows. Frames (sorted) are read off by cubic Hermite interpolation inside each step:
    out_phi, out_om (frames, n + 1), out_S (frames, n + 1, p). Returns (status, steps done, Newton iterations).
    """
    n = chain.shape[0]
    D = 7 if with_force else 3
    count, p = par.size, free.size
    stages = tableau.shape[0]
    steps = pressure.shape[0]
    m1 = max(m, 1)
    u, ac = np.zeros((n + 1, 2)), np.zeros((n + 1, 2))
    al = np.zeros(n + 1)
    phi_s, om_s = np.zeros(n + 1), np.zeros(n + 1)
    z_star = np.zeros((n, m1))
    stage_om, stage_al = np.zeros((stages, n + 1)), np.zeros((stages, n + 1))
    stage_g = np.zeros((stages, n, m1))
    motion = np.zeros((n, 4))
    force = np.zeros((n, 2, 5 + count))
    out = np.zeros((n, columns))
    theta, rate = np.zeros(n), np.zeros(n)
    stiff, tau_p, zc_torque = np.zeros(n), np.zeros(n), np.zeros(n)
    zc, Sx, zp = np.zeros((n, m1)), np.zeros((n, m1)), np.zeros((n, m1))
    Minv, small = np.zeros((n, m1, m1)), np.zeros((m1, m1))
    f, tau = np.zeros((n + 2, 2)), np.zeros(n + 2)
    columns_solved = 2 if with_line else 1
    residual, res = np.zeros((n + 1, columns_solved)), np.zeros(n + 1)
    beta, gamma = np.zeros(n + 1), np.zeros((n + 1, D))
    K, Kx, xf, e = np.zeros((n + 2, 3, D)), np.zeros((n + 1, 3)), np.zeros((n + 1, 2)), np.zeros((n + 1, 7))
    x, d = np.zeros((n + 1, columns_solved)), np.zeros((D, columns_solved))
    kf, x0 = np.zeros((3, columns_solved)), np.zeros((n + 1, columns_solved))
    length = chain[:, 0].copy()
    resistance, inertance, compliance = line[0], line[1], line[2]
    # sensitivities
    out_par = np.zeros((n, 2 + m, count))
    zeta, tau_z_zeta = np.zeros((n, m1, p)), np.zeros((n, p))
    S_phi_s, S_om_s, S_al = np.zeros((n + 1, p)), np.zeros((n + 1, p)), np.zeros((n + 1, p))
    S_z_star, S_z_s = np.zeros((n, m1, p)), np.zeros((n, m1, p))
    S_stage_om, S_stage_al = np.zeros((stages, n + 1, p)), np.zeros((stages, n + 1, p))
    S_stage_g = np.zeros((stages, n, m1, p))
    rhs, dp = np.zeros((n + 1, p)), np.zeros(p)
    dA, dV, dP, df = np.zeros((2, p)), np.zeros((2, p)), np.zeros((2, p)), np.zeros((2, p))
    dtau_next, dtau = np.zeros(p), np.zeros(p)
    dac, dforce = np.zeros((n + 1, 2, p)), np.zeros((n + 1, 2, p))
    Sd, Skf, Sx0 = np.zeros((D, p)), np.zeros((3, p)), np.zeros((n + 1, p))
    line_rhs, line_x = np.zeros((n + 1, 1)), np.zeros((n + 1, 1))
    ld, lkf, lx0 = np.zeros((D, 1)), np.zeros((3, 1)), np.zeros((n + 1, 1))
    phi_old, om_old = np.zeros(n + 1), np.zeros(n + 1)
    S_phi_old, S_om_old = np.zeros((n + 1, p)), np.zeros((n + 1, p))
    frames = frame_step.size
    frame = 0
    iterations = 0
    volume = volume_rate
    for step in range(steps):
        phi_old[:] = phi
        om_old[:] = om
        if p > 0:
            S_phi_old[:, :] = S_phi
            S_om_old[:, :] = S_om
        for stage in range(stages):
            gamma_h = h * tableau[stage, stage]
            s = gamma_h
            # Known part of the stage, and a start from the last acceleration.
            for i in range(n + 1):
                v, q = om_old[i], phi_old[i]
                for b in range(stage):
                    v += h * tableau[stage, b] * stage_al[b, i]
                    q += h * tableau[stage, b] * stage_om[b, i]
                om_s[i] = v + s * al[i]
                phi_s[i] = q + s * om_s[i]
            for j in range(n):
                for a in range(m):
                    value = z[j, a]
                    for b in range(stage):
                        value += h * tableau[stage, b] * stage_g[b, j, a]
                    z_star[j, a] = value
            z_s = stage_g[stage]  # reused as the stage's own states until its rates are known
            for j in range(n):
                for a in range(m):
                    z_s[j, a] = z_star[j, a]
            converged = False
            felt = pressure[step, stage]
            for iteration in range(NEWTON_STEPS):
                iterations += 1
                _joint_angles(phi_s, om_s, theta, rate)
                if with_line:
                    felt = pressure[step, stage] - volume * (
                        resistance * (om_s[n] - om_s[0]) + inertance * (al[n] - al[0])
                    )
                law(theta, rate, z_s, felt, position, arc, weights, par, con, out)
                if drive.shape[0] > 0:
                    for j in range(n):
                        out[j, 0] += drive[step, stage, j]
                _kinematics(chain, base_length, phi_s, om_s, al, u, ac, motion, gravity, with_force)
                if with_force:
                    force_law(motion, length, par, con, force)
                _joint_factors(out, m, s, z_s, z_star, s, s * s, stiff, tau_p, zc, zc_torque, Sx, zp, Minv, small)
                _factor(
                    chain,
                    base_length,
                    compliance,
                    phi_s,
                    om_s,
                    al,
                    u,
                    ac,
                    out,
                    force,
                    stiff,
                    zc_torque,
                    D,
                    1.0,
                    s,
                    s * s,
                    f,
                    tau,
                    res,
                    beta,
                    gamma,
                    K,
                    Kx,
                    xf,
                    e,
                    with_base,
                )
                for i in range(n + 1):
                    residual[i, 0] = res[i]
                if with_line:
                    for i in range(n + 1):
                        residual[i, 1] = (tau_p[i] if i < n else 0.0) - (tau_p[i - 1] if i > 0 else 0.0)
                    residual[0, 1] = compliance * tau_p[0]
                _solve(
                    chain, base_length, compliance, u, beta, gamma, stiff, xf, e, D, with_base, residual, x, d, kf, x0
                )
                change = 0.0
                if with_line:
                    q = (resistance * s + inertance) * volume
                    w = (x[n, 0] - x[0, 0]) / (1.0 + q * (x[n, 1] - x[0, 1]))
                    change = -q * w
                    for i in range(n + 1):
                        x[i, 0] += change * x[i, 1]
                damp = 1.0 if iteration < FULL_STEPS else (0.5 if iteration < 3 * FULL_STEPS else 0.2)
                if damp < 1.0:
                    change *= damp
                    for i in range(n + 1):
                        x[i, 0] *= damp
                    for j in range(n):
                        for a in range(m):
                            zc[j, a] *= damp
                largest = 0.0
                for i in range(n + 1):
                    al[i] += x[i, 0]
                    om_s[i] += s * x[i, 0]
                    phi_s[i] += s * s * x[i, 0]
                    largest = max(largest, abs(x[i, 0]))
                for j in range(n):
                    relative = x[j + 1, 0] - x[j, 0]
                    for a in range(m):
                        z_s[j, a] += Sx[j, a] * relative + zc[j, a] + zp[j, a] * change
                largest *= s * s
                if not (largest < 1.0):
                    return BLOWN_UP, step, iterations
                if largest < tolerance * damp:
                    converged = True
                    break
            if not converged:
                return NOT_CONVERGED, step, iterations
            _joint_angles(phi_s, om_s, theta, rate)
            for j in range(n):
                if abs(theta[j]) > LARGEST_JOINT_ANGLE:
                    return BLOWN_UP, step, iterations
            if p > 0:
                if with_line:
                    felt = pressure[step, stage] - volume * (
                        resistance * (om_s[n] - om_s[0]) + inertance * (al[n] - al[0])
                    )
                law(theta, rate, z_s, felt, position, arc, weights, par, con, out)
                law_par(theta, rate, z_s, felt, position, arc, weights, par, con, out_par)
                if drive.shape[0] > 0:
                    for j in range(n):
                        out[j, 0] += drive[step, stage, j]
                _kinematics(chain, base_length, phi_s, om_s, al, u, ac, motion, gravity, with_force)
                if with_force:
                    force_law(motion, length, par, con, force)
                _joint_factors(out, m, s, z_s, z_star, s, s * s, stiff, tau_p, zc, zc_torque, Sx, zp, Minv, small)
                _factor(
                    chain,
                    base_length,
                    compliance,
                    phi_s,
                    om_s,
                    al,
                    u,
                    ac,
                    out,
                    force,
                    stiff,
                    zc_torque,
                    D,
                    1.0,
                    s,
                    s * s,
                    f,
                    tau,
                    res,
                    beta,
                    gamma,
                    K,
                    Kx,
                    xf,
                    e,
                    with_base,
                )
                for i in range(n + 1):
                    for k in range(p):
                        v, q = S_om_old[i, k], S_phi_old[i, k]
                        for b in range(stage):
                            v += h * tableau[stage, b] * S_stage_al[b, i, k]
                            q += h * tableau[stage, b] * S_stage_om[b, i, k]
                        S_om_s[i, k] = v
                        S_phi_s[i, k] = q + s * v
                for k in range(p):
                    dp[k] = 0.0
                if dpressure.shape[0] > 0:
                    for k in range(p):
                        dp[k] = dpressure[step, stage, free[k]]
                if with_line:
                    for k in range(p):
                        dp[k] -= volume * (
                            dline[0, free[k]] * (om_s[n] - om_s[0])
                            + dline[1, free[k]] * (al[n] - al[0])
                            + resistance * (S_om_s[n, k] - S_om_s[0, k])
                        )
                if m > 0:
                    base = FIXED + m
                    for j in range(n):
                        for a in range(m):
                            for k in range(p):
                                value = S_z[j, a, k]
                                for b in range(stage):
                                    value += h * tableau[stage, b] * S_stage_g[b, j, a, k]
                                S_z_star[j, a, k] = value
                        for a in range(m):
                            for k in range(p):
                                zeta[j, a, k] = 0.0
                        for b in range(m):
                            row = base + 4 * b
                            for k in range(p):
                                known = S_z_star[j, b, k] + s * (
                                    out[j, row + 1] * (S_phi_s[j + 1, k] - S_phi_s[j, k])
                                    + out[j, row + 2] * (S_om_s[j + 1, k] - S_om_s[j, k])
                                    + out[j, row + 3] * dp[k]
                                    + out_par[j, 2 + b, free[k]]
                                )
                                for a in range(m):
                                    zeta[j, a, k] += Minv[j, a, b] * known
                        for k in range(p):
                            total = 0.0
                            for a in range(m):
                                total += out[j, FIXED + a] * zeta[j, a, k]
                            tau_z_zeta[j, k] = total
                _explicit(
                    chain,
                    dchain,
                    base_length,
                    compliance,
                    dline[2],
                    dgravity,
                    phi_s,
                    om_s,
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
                    S_phi_s,
                    S_om_s,
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
                )
                _solve(
                    chain, base_length, compliance, u, beta, gamma, stiff, xf, e, D, with_base, rhs, S_al, Sd, Skf, Sx0
                )
                if with_line:
                    for i in range(n + 1):
                        line_rhs[i, 0] = (tau_p[i] if i < n else 0.0) - (tau_p[i - 1] if i > 0 else 0.0)
                    line_rhs[0, 0] = compliance * tau_p[0]
                    _solve(
                        chain,
                        base_length,
                        compliance,
                        u,
                        beta,
                        gamma,
                        stiff,
                        xf,
                        e,
                        D,
                        with_base,
                        line_rhs,
                        line_x,
                        ld,
                        lkf,
                        lx0,
                    )
                    q = (resistance * s + inertance) * volume
                    denominator = 1.0 + q * (line_x[n, 0] - line_x[0, 0])
                    for k in range(p):
                        w = (S_al[n, k] - S_al[0, k]) / denominator
                        dp[k] = -q * w
                        for i in range(n + 1):
                            S_al[i, k] += dp[k] * line_x[i, 0]
                for i in range(n + 1):
                    for k in range(p):
                        S_om_s[i, k] += s * S_al[i, k]
                        S_phi_s[i, k] += s * s * S_al[i, k]
                        S_stage_al[stage, i, k] = S_al[i, k]
                        S_stage_om[stage, i, k] = S_om_s[i, k]
                if m > 0:
                    for j in range(n):
                        for a in range(m):
                            for k in range(p):
                                S_z_s[j, a, k] = zeta[j, a, k] + Sx[j, a] * (S_al[j + 1, k] - S_al[j, k])
                                if with_line:
                                    S_z_s[j, a, k] += zp[j, a] * dp[k]
                                S_stage_g[stage, j, a, k] = (S_z_s[j, a, k] - S_z_star[j, a, k]) / s
            for i in range(n + 1):
                stage_al[stage, i] = al[i]
                stage_om[stage, i] = om_s[i]
            if stage == stages - 1:
                for j in range(n):
                    for a in range(m):
                        z[j, a] = z_s[j, a]
            for j in range(n):
                for a in range(m):
                    z_s[j, a] = (z_s[j, a] - z_star[j, a]) / s
        phi[:] = phi_s
        om[:] = om_s
        if p > 0:
            S_phi[:, :] = S_phi_s
            S_om[:, :] = S_om_s
            if m > 0:
                S_z[:, :, :] = S_z_s
        while frame < frames and frame_step[frame] <= step:
            t = frame_fraction[frame]
            h00, h10 = (1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2 * h
            h01, h11 = t * t * (3 - 2 * t), t * t * (t - 1) * h
            g00, g10 = 6 * t * (t - 1) / h, (1 - t) * (1 - 3 * t)
            g11 = t * (3 * t - 2)
            for i in range(n + 1):
                out_phi[frame, i] = h00 * phi_old[i] + h10 * om_old[i] + h01 * phi[i] + h11 * om[i]
                out_om[frame, i] = g00 * (phi_old[i] - phi[i]) + g10 * om_old[i] + g11 * om[i]
                for k in range(p):
                    out_S[frame, i, k] = (
                        h00 * S_phi_old[i, k] + h10 * S_om_old[i, k] + h01 * S_phi[i, k] + h11 * S_om[i, k]
                    )
            for j in range(n):
                for a in range(m):
                    out_z[frame, j, a] = z[j, a]
            frame += 1
    return OK, steps, iterations
