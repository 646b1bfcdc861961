"""A corner of a checkerboard where two blurred edges cross, fitted to the grey levels around it.

    I(r) = level + contrast erf(n1 . (r - c) / (sqrt(2) s)) erf(n2 . (r - c) / (sqrt(2) s)) + slope . (r - c),

with the corner c, the normals n1 and n2 of the two edges (they need not be at right angles), the blur s, and an even
slope of the light. Least squares with Gaussian weights, Gauss-Newton with damping. Unlike the usual refinement by
orthogonal gradients, whose error depends on where the corner lies within its pixel (0.04 px on a board that is level
in the picture), this is unbiased, and what is left is noise, as the covariance of the calibration assumes.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray

_COUNT = 9  # x, y, two angles, blur, level, contrast, slope of the light in x and y
_STEPS = 30  # of Levenberg-Marquardt, at most
_LEAST_BLUR_PX = 0.2  # standard deviation of the blur: pixels show none sharper
_FIRST_BLUR_PX = 0.8  # where the fit begins


def fit_corners(
    grey: NDArray[np.float32], corners: FloatArray, normals_rad: FloatArray, half_px: int, limit_px: float
) -> tuple[FloatArray, FloatArray]:
    """Fit every corner.

    Parameters
    ----------
    grey : (height, width) grey levels
    corners : (n, 2) px, within a pixel or so
    normals_rad : (n, 2) directions of the normals of the two edges in the picture
    half_px : reach of the window; its weights fall to 0.14 there
    limit_px : a corner that moves farther has been lost

    Returns
    -------
    corners : (n, 2) px; NaN where the fit was lost
    blur_px : (n,) standard deviation of the blur of the edges
    """
    grey = np.ascontiguousarray(grey)
    found, blur = np.full(corners.shape, np.nan), np.full(len(corners), np.nan)
    for k, (column, row) in enumerate(np.floor(corners + 0.5).astype(int).tolist()):
        if half_px <= row < grey.shape[0] - half_px and half_px <= column < grey.shape[1] - half_px:
            fitted = _fit_one(grey, row, column, half_px, corners[k], normals_rad[k])
            found[k], blur[k] = fitted[:2], fitted[4]
    lost = ~(np.linalg.norm(found - corners, axis=1) < limit_px) | ~(blur < 0.7 * half_px)
    found[lost] = np.nan
    return found, blur


def _fit_one(
    grey: NDArray[np.float32], row: int, column: int, half: int, corner: FloatArray, normals: FloatArray
) -> FloatArray:
    """Damped Gauss-Newton from `corner`; the last accepted parameters."""
    accepted = np.array([*corner, *normals, _FIRST_BLUR_PX, 0.0, 0.0, 0.0, 0.0], dtype=np.float64)
    _level_and_contrast(grey, row, column, half, accepted)
    matrix, right, cost = _normal_equations(grey, row, column, half, accepted)
    damping = 1e-3
    for _ in range(_STEPS):
        # in plain Python, as compiling a linear solver takes longer than all corners of a calibration
        damped = matrix + np.diag(damping * np.diagonal(matrix) + 1e-12)
        trial = np.asarray(accepted + np.linalg.solve(damped, right), dtype=np.float64)
        trial[4] = max(trial[4], _LEAST_BLUR_PX)
        new_matrix, new_right, new_cost = _normal_equations(grey, row, column, half, trial)
        if new_cost <= cost:
            gain = (cost - new_cost) / max(new_cost, 1e-12)
            accepted, matrix, right, cost = trial, new_matrix, new_right, new_cost
            damping *= 0.2
            if gain < 1e-7:
                break
        else:
            damping *= 6
            if damping > 1e8:
                break
    return accepted


@njit(cache=True, nogil=True)
def _level_and_contrast(grey, row, column, half, p):
    """Weighted linear fit of level and contrast, in place."""
    w1, we, wv, wee, wev = 0.0, 0.0, 0.0, 0.0, 0.0
    c1, s1, c2, s2 = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    k = 1 / (p[4] * math.sqrt(2.0))
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            weight = math.exp(-2.0 * (i * i + j * j) / (half * half))
            dx, dy = column + j - p[0], row + i - p[1]
            e = math.erf((c1 * dx + s1 * dy) * k) * math.erf((c2 * dx + s2 * dy) * k)
            value = float(grey[row + i, column + j])
            w1 += weight
            we += weight * e
            wv += weight * value
            wee += weight * e * e
            wev += weight * e * value
    p[6] = (wev - we * wv / w1) / max(wee - we * we / w1, 1e-12)
    p[5] = (wv - p[6] * we) / w1


@njit(cache=True, nogil=True)
def _normal_equations(grey, row, column, half, p):
    """J'WJ, J'Wr and r'Wr at the parameters `p`."""
    matrix, right, cost = np.zeros((_COUNT, _COUNT)), np.zeros(_COUNT), 0.0
    d = np.zeros(_COUNT)
    c1, s1, c2, s2 = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    k = 1 / (p[4] * math.sqrt(2.0))
    rise = 2 / math.sqrt(math.pi)
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            weight = math.exp(-2.0 * (i * i + j * j) / (half * half))
            dx, dy = column + j - p[0], row + i - p[1]
            u, v = (c1 * dx + s1 * dy) * k, (c2 * dx + s2 * dy) * k
            eu, ev = math.erf(u), math.erf(v)
            du, dv = p[6] * rise * math.exp(-u * u) * ev, p[6] * rise * math.exp(-v * v) * eu
            d[0] = -k * (du * c1 + dv * c2) - p[7]
            d[1] = -k * (du * s1 + dv * s2) - p[8]
            d[2] = k * du * (c1 * dy - s1 * dx)
            d[3] = k * dv * (c2 * dy - s2 * dx)
            d[4] = -(du * u + dv * v) / p[4]
            d[5] = 1.0
            d[6] = eu * ev
            d[7] = dx
            d[8] = dy
            residual = float(grey[row + i, column + j]) - (p[5] + p[6] * eu * ev + p[7] * dx + p[8] * dy)
            cost += weight * residual * residual
            for a in range(_COUNT):
                right[a] += weight * d[a] * residual
                for b in range(a + 1):
                    matrix[a, b] += weight * d[a] * d[b]
    for a in range(_COUNT):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return matrix, right, cost
