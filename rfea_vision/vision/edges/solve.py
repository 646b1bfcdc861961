"""Least squares of the edge stations: the shift of the centre line and of the half width along the tube, compiled."""

from __future__ import annotations

import math

import numpy as np

from rfea_vision.vision.compiled import compiled, lean, put_rows
from rfea_vision.vision.edges.edgels import INFO, SHIFT, SIDE, U

PRIOR_BEND_MM = 0.4  # how much a second difference of the shift may be, a priori
PRIOR_WIDTH_MM = 0.02  # the same for the half width, which hardly changes from frame to frame


# The four pieces of the basis as polynomials in the place t within a span: B_k(t) = sum over p of BASIS[k, p] t^p.
BASIS = np.array([[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]) / 6.0


@compiled
def normal_equations(stations, filled, keep, variance, width, count, prior_bend, prior_width):
    """Matrix and right-hand side for shift(u) (count coefficients) and widening(u) (width_count) of the kept stations.

    A station of side s sees s * shift + widening along its outward normal. The prior bends the shift little, and the
    half width that results, `width` (width_count,) plus widening, even less. `variance` is that of the grey levels;
    the inverse of the matrix is the covariance. The spans of the widening are whole numbers of spans of the shift, so
    that within one of these both are cubics in t, and the sums of t^p over its stations are all that is needed.
    """
    width_count = width.shape[0]
    size, spans = count + width_count, count - 3
    wider = spans // (width_count - 3)
    matrix = np.zeros((size, size))
    right = np.zeros(size)
    powers = np.zeros((spans, 2, 7))  # weights times t^p of the left side, and of the right one
    values = np.zeros((spans, 2, 4))  # the same times the station's shift
    for n in range(filled):
        if not keep[n]:
            continue
        x = stations[n, U] * spans
        i = min(max(math.floor(x), 0), spans - 1)
        t = x - i
        side = 0 if stations[n, SIDE] > 0 else 1
        term, shift = stations[n, INFO] / variance, stations[n, SHIFT]
        for p in range(4):
            values[i, side, p] += term * shift
            powers[i, side, p] += term
            term *= t
        for p in range(4, 7):
            powers[i, side, p] += term
            term *= t
    cubics, products = np.empty((8, 4)), np.empty((8, 4))
    put_rows(cubics, BASIS)
    for i in range(spans):
        _stretched(cubics[4:], (i % wider) / wider, 1.0 / wider)
        _add_span(cubics, products, powers[i], values[i], matrix, right, i, count + i // wider)
    _add_prior(matrix, np.int64(0), count, 1.0 / prior_bend**2)
    strength = 1.0 / prior_width**2
    _add_prior(matrix, count, width_count, strength)
    for i in range(width_count - 2):
        bend = strength * (width[i] - 2.0 * width[i + 1] + width[i + 2])
        right[count + i] -= bend
        right[count + i + 1] += 2.0 * bend
        right[count + i + 2] -= bend
    for i in range(count, size):
        matrix[i, i] += 1.0 / (10.0 * prior_width) ** 2
    return matrix, right


@lean
def _stretched(out, start, scale):
    """Fill `out` (4, 4) with the basis at start + scale t, as polynomials in t."""
    for k in range(4):
        a, b, c, d = BASIS[k, 0], BASIS[k, 1], BASIS[k, 2], BASIS[k, 3]
        out[k, 0] = a + start * (b + start * (c + start * d))
        out[k, 1] = scale * (b + start * (2.0 * c + 3.0 * start * d))
        out[k, 2] = scale * scale * (c + 3.0 * start * d)
        out[k, 3] = scale * scale * scale * d


@lean
def _add_span(cubics, products, powers, values, matrix, right, i, j):
    """Add one span's stations to its unknowns: i to i + 3 of the shift, j to j + 3 of the widening."""
    for mixed in range(2):  # the sides pull the shift one way each, and the widening both ways
        sign = -1.0 if mixed else 1.0
        for k in range(4 * mixed, 8):
            row = i + k if k < 4 else j + k - 4
            for q in range(4):
                products[k, q] = 0.0
                for p in range(4):
                    products[k, q] += cubics[k, p] * (powers[0, p + q] + sign * powers[1, p + q])
            for m in range(0 if mixed else 4 * (k // 4), 4 if mixed else k + 1):
                column = i + m if m < 4 else j + m - 4
                total = 0.0
                for q in range(4):
                    total += products[k, q] * cubics[m, q]
                matrix[row, column] += total
                if row != column:
                    matrix[column, row] += total
    for k in range(8):
        row, sign = (i + k, -1.0) if k < 4 else (j + k - 4, 1.0)
        for p in range(4):
            right[row] += cubics[k, p] * (values[0, p] + sign * values[1, p])


@lean
def _add_prior(matrix, first, count, strength):
    for i in range(count - 2):
        a, b, c = first + i, first + i + 1, first + i + 2
        for p, x in ((a, 1.0), (b, -2.0), (c, 1.0)):
            for q, y in ((a, 1.0), (b, -2.0), (c, 1.0)):
                matrix[p, q] += strength * x * y
    for i in range(count):
        matrix[first + i, first + i] += 1e-6 * strength


@compiled
def residuals_of(stations, filled, solution, count, width_count, out):
    """Shift of every station minus its fit, mm."""
    spans = count - 3
    wider = spans // (width_count - 3)
    cubics, fits = np.empty((4, 4)), np.zeros((spans, 2, 4))  # of each span, what its sides see as polynomials in t
    for i in range(spans):
        _stretched(cubics, (i % wider) / wider, 1.0 / wider)
        for k in range(4):
            shift, widening = solution[i + k], solution[count + i // wider + k]
            for p in range(4):
                fits[i, 0, p] += widening * cubics[k, p] + shift * BASIS[k, p]
                fits[i, 1, p] += widening * cubics[k, p] - shift * BASIS[k, p]
    for n in range(filled):
        x = stations[n, U] * spans
        i = min(max(math.floor(x), 0), spans - 1)
        t = x - i
        side = 0 if stations[n, SIDE] > 0 else 1
        fit = fits[i, side]
        out[n] = stations[n, SHIFT] - (fit[0] + t * (fit[1] + t * (fit[2] + t * fit[3])))
