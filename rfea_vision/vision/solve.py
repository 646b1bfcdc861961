"""Least squares of the edge stations: the shift of the centre line and of the half width along the tube, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from rfea_vision.vision.curve import basis_at
from rfea_vision.vision.edges import INFO, SHIFT, SIDE, U

PRIOR_BEND_MM = 0.4  # how much a second difference of the shift may be, a priori
PRIOR_WIDTH_MM = 0.02  # the same for the half width, which hardly changes from frame to frame


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def cholesky_inverse(matrix):
    """Inverse of a symmetric positive definite matrix; a pivot that vanishes is treated as infinite."""
    n = matrix.shape[0]
    low = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            if i == j:
                low[i, i] = np.sqrt(total) if total > 1e-12 else 1e6
            else:
                low[i, j] = total / low[j, j]
    inverse_low = np.zeros((n, n))
    for i in range(n):
        inverse_low[i, i] = 1.0 / low[i, i]
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total -= low[i, k] * inverse_low[k, j]
            inverse_low[i, j] = total / low[i, i]
    out = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += inverse_low[k, i] * inverse_low[k, j]
            out[i, j] = total
            out[j, i] = total
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def fit_shift(stations, filled, keep, variance, width, count, prior_bend, prior_width):
    """Fit shift(u) (count coefficients) and widening(u) (width_count) to the kept stations.

    A station of side s sees s * shift + widening along its outward normal. The prior bends the shift little, and the
    half width that results, `width` (width_count,) plus widening, even less. Returns the coefficients (count +
    width_count), and the covariance for `variance` (grey levels^2).
    """
    width_count = width.shape[0]
    size = count + width_count
    matrix = np.zeros((size, size))
    right = np.zeros(size)
    w = np.empty(4)
    h = np.empty(4)
    row = np.empty(8)
    where = np.empty(8, dtype=np.int64)
    for n in range(filled):
        if not keep[n]:
            continue
        weight = stations[n, INFO] / variance
        i = basis_at(stations[n, U], count, w)
        j = basis_at(stations[n, U], width_count, h)
        side = stations[n, SIDE]
        for k in range(4):
            row[k], where[k] = side * w[k], i + k
            row[4 + k], where[4 + k] = h[k], count + j + k
        value = weight * stations[n, SHIFT]
        for k in range(8):
            weighted = weight * row[k]
            right[where[k]] += value * row[k]
            for m in range(k + 1):
                matrix[where[k], where[m]] += weighted * row[m]
    for i in range(size):
        for j in range(i):
            total = matrix[i, j] + matrix[j, i]
            matrix[i, j] = total
            matrix[j, i] = total
    _add_prior(matrix, 0, count, 1.0 / prior_bend**2)
    strength = 1.0 / prior_width**2
    _add_prior(matrix, count, width_count, strength)
    for i in range(width_count - 2):
        bend = strength * (width[i] - 2.0 * width[i + 1] + width[i + 2])
        right[count + i] -= bend
        right[count + i + 1] += 2.0 * bend
        right[count + i + 2] -= bend
    for i in range(count, size):
        matrix[i, i] += 1.0 / (10.0 * prior_width) ** 2
    covariance = cholesky_inverse(matrix)
    return covariance @ right, covariance


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _add_prior(matrix, first, count, strength):
    for i in range(count - 2):
        a, b, c = first + i, first + i + 1, first + i + 2
        for p, x in ((a, 1.0), (b, -2.0), (c, 1.0)):
            for q, y in ((a, 1.0), (b, -2.0), (c, 1.0)):
                matrix[p, q] += strength * x * y
    for i in range(count):
        matrix[first + i, first + i] += 1e-6 * strength


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def residuals_of(stations, filled, solution, count, width_count, out):
    """Shift of every station minus its fit, mm."""
    w = np.empty(4)
    h = np.empty(4)
    for n in range(filled):
        i = basis_at(stations[n, U], count, w)
        j = basis_at(stations[n, U], width_count, h)
        fit = 0.0
        for k in range(4):
            fit += stations[n, SIDE] * w[k] * solution[i + k] + h[k] * solution[count + j + k]
        out[n] = stations[n, SHIFT] - fit


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def correlation_length(stations, filled, keep, residual):
    """By how much neighbouring stations of one side agree beyond chance: variance of block sums over its white value."""
    block = 24
    inflation_sum = 0.0
    blocks = 0
    for side in (-1.0, 1.0):
        total = square = 0.0
        number = 0
        for n in range(filled):
            if not keep[n] or stations[n, SIDE] != side:
                continue
            z = residual[n] * np.sqrt(stations[n, INFO])
            total += z
            square += z * z
            number += 1
            if number == block:
                inflation_sum += total * total / max(square, 1e-30)
                blocks += 1
                total = square = 0.0
                number = 0
    return inflation_sum / blocks if blocks > 8 else 1.0
