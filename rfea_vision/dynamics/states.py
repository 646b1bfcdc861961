"""Hidden states of the joints inside an implicit stage: z = z* + s g(theta, rate, p, z), eliminated joint by joint.

Legend as in `engine`; g's derivatives stand in the joint law's output, four columns per state, then d g_a / d z_b.
"""

from __future__ import annotations

from numba import njit

from rfea_vision.dynamics.system import FIXED, INLINE, STIFF, TAU_P, TAU_PRESSURE, TAU_RATE, TAU_THETA, Z_TORQUE


@njit(**INLINE)
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
                part = a[r, c]
                if part != 0.0:
                    for j in range(m):
                        a[r, j] -= part * a[c, j]
                        inverse[r, j] -= part * inverse[c, j]


@njit(**INLINE)
def joint_factors(work, m, s, cO, cP):
    """Torque's derivative by x with the states eliminated; per state: its own correction zc, and d z by x (Sx) and p (zp)."""
    out, body, z, z_star = work.out, work.body, work.z, work.z_star
    zc, Sx, zp, inverse, small = work.zc, work.Sx, work.zp, work.inverse, work.small
    for j in range(out.shape[0]):
        stiff = out[j, TAU_THETA] * cP + out[j, TAU_RATE] * cO
        by_pressure = out[j, TAU_PRESSURE]
        correction = 0.0
        if m > 0:
            base = FIXED + m
            if m == 1:
                inverse[j, 0, 0] = 1.0 / (1.0 - s * out[j, base + 4])
            else:
                for a in range(m):
                    for b in range(m):
                        small[a, b] = (1.0 if a == b else 0.0) - s * out[j, base + 4 * m + a * m + b]
                _small_inverse(small, inverse[j])
            for a in range(m):
                by_x, by_p, own = 0.0, 0.0, 0.0
                for b in range(m):
                    row = base + 4 * b
                    by_x += inverse[j, a, b] * s * (out[j, row + 1] * cP + out[j, row + 2] * cO)
                    by_p += inverse[j, a, b] * s * out[j, row + 3]
                    own -= inverse[j, a, b] * (z[j, b] - z_star[j, b] - s * out[j, row])
                Sx[j, a], zp[j, a], zc[j, a] = by_x, by_p, own
                stiff += out[j, FIXED + a] * by_x
                by_pressure += out[j, FIXED + a] * by_p
                correction += out[j, FIXED + a] * own
        body[j + 1, STIFF], body[j + 1, TAU_P], body[j + 1, Z_TORQUE] = stiff, by_pressure, correction


@njit(**INLINE)
def relaxed_factors(work, relaxed, m):
    """The same in a steady state, where x is the change of phi and z the relaxed value for theta and p."""
    out, body, z, Sx = work.out, work.body, work.z, work.Sx
    for j in range(out.shape[0]):
        stiff = out[j, TAU_THETA]
        for a in range(m):
            z[j, a] = relaxed[j, a, 0]
            Sx[j, a] = relaxed[j, a, 1]
            stiff += out[j, FIXED + a] * Sx[j, a]
        body[j + 1, STIFF], body[j + 1, Z_TORQUE] = stiff, 0.0
