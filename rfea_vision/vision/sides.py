"""Both edges of the tube at the present curve: measure them, choose the good stations, fit, move. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rfea_vision.vision.curve import REFIT, VERTEX_U, VERTICES, moved_curve, point_and_tangent, value_at, vertices_of
from rfea_vision.vision.edges import BLUR_DOWN, BLUR_UP, INFO, MISFIT, SHIFT, SIDE, U, measure_polyline, smooth_levels
from rfea_vision.vision.fitted import END_GAP, LONGEST_GAP, ONE_SIDED
from rfea_vision.vision.solve import (
    PRIOR_BEND_MM,
    PRIOR_WIDTH_MM,
    cholesky_inverse,
    cholesky_solve,
    normal_equations,
    residuals_of,
)

LEVEL_WINDOW, BLUR_WINDOW = 8, 48


@njit(cache=True, nogil=True)
def measure_sides(picture, camera, state, work, stride, from_u, to_u, px_per_mm):
    """Stations of both edges at the present curve; returns their number."""
    length = vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    work.sums[:] = 0.0
    filled = 0
    count = work.centre.shape[0]
    low, high = math.ceil(from_u * (count - 1)), math.floor(to_u * (count - 1)) + 1
    for s in range(2):
        side = 1.0 if s == 0 else -1.0
        for v in range(count):
            for k in range(2):
                work.outward[v, k] = side * work.normal[v, k]
                work.edge[v, k] = work.centre[v, k] + work.half_width[v] * work.outward[v, k]
        reach = 0.9 * px_per_mm * work.half_width[count // 2]
        filled = measure_polyline(
            picture,
            camera,
            work.edge[low:high],
            work.outward[low:high],
            side,
            VERTEX_U[low:high],
            state.levels[s, low:high],
            state.blurs[s, low:high],
            stride,
            4 if stride > 1 else 1,
            reach,
            work.stations,
            filled,
            work.sums[s, low:high],
        )
    return filled, length


@njit(cache=True, nogil=True)
def update_levels(state, work, fresh, blur_limit, px_per_vertex):
    """Levels and blurs of both edges from the sums of the last measurement."""
    window = max(LEVEL_WINDOW, int(25.0 / px_per_vertex))
    # One blur for both edges, over a long stretch: at a single sub-pixel phase blur and place are not told apart.
    for v in range(VERTICES):
        for k in (BLUR_UP, BLUR_DOWN):
            both = work.sums[0, v, k] + work.sums[1, v, k]
            work.sums[0, v, k] = both
            work.sums[1, v, k] = both
    for s in range(2):
        smooth_levels(work.sums[s], state.levels[s], state.blurs[s], window, BLUR_WINDOW, blur_limit, fresh)
    state.blurs[1] = state.blurs[0]


@njit(cache=True, nogil=True)
def select(state, work, filled, limit_mm, least_contrast):
    """Mark the stations that agree with the reference contrast and lie within `limit_mm` of their fit."""
    kept = 0
    for n in range(filled):
        side = 0 if work.stations[n, SIDE] > 0 else 1
        v = int(work.stations[n, U] * (VERTICES - 1) + 0.5)
        v = min(max(v, 0), VERTICES - 1)
        contrast = state.levels[side, v, 0] - state.levels[side, v, 1]
        reference = state.reference[side, v]
        good = contrast * reference > 0 and abs(contrast) > least_contrast * abs(reference)
        good = good and work.stations[n, MISFIT] < 0.09 * contrast * contrast + 400.0
        good = good and abs(work.residual[n]) < limit_mm
        work.keep[n] = good
        kept += good
    return kept


@njit(cache=True, nogil=True)
def robust_scale(work, filled):
    """1.48 times the median of the absolute residuals of the kept stations, weighted to unit information."""
    values = np.empty(filled)
    m = 0
    for n in range(filled):
        if work.keep[n]:
            values[m] = abs(work.residual[n]) * math.sqrt(work.stations[n, INFO])
            m += 1
    return 1.4826 * np.median(values[:m]) if m > 0 else 0.0


@njit(cache=True, nogil=True)
def fit_sides(state, work, filled, wide_mm, least_contrast, assumed, with_covariance):
    """Robust fit of shift and widening: all, then without outliers. Returns solution, noise, kept.

    The covariance lands in `work.covariance`, where it is asked for.
    """
    count, width_count = state.coefficients.shape[0], state.width.shape[0]
    for n in range(filled):
        work.residual[n] = work.stations[n, SHIFT]
    kept = select(state, work, filled, wide_mm, least_contrast)
    solution = np.zeros(count + width_count)
    noise = assumed
    if kept < 20:
        return solution, noise, kept
    for repeat in range(2):
        variance = max(noise * noise, 0.25)
        matrix, right = normal_equations(
            work.stations, filled, work.keep, variance, state.width, count, PRIOR_BEND_MM, PRIOR_WIDTH_MM
        )
        solution = cholesky_solve(matrix, right)
        residuals_of(work.stations, filled, solution, count, width_count, work.residual)
        noise = max(robust_scale(work, filled), 0.3)
        before = kept
        if repeat == 0:
            kept = 0
            for n in range(filled):
                if work.keep[n]:
                    work.keep[n] = abs(work.residual[n]) * math.sqrt(work.stations[n, INFO]) < 4.5 * noise
                    kept += work.keep[n]
        if repeat == 1 or kept == before:
            if with_covariance:
                work.covariance[:] = cholesky_inverse(matrix)
                if repeat == 0:
                    work.covariance[:] *= noise * noise / variance
            break
    return solution, noise, kept


@njit(cache=True, nogil=True)
def move_state(state, solution, beyond_mm):
    """Apply a shift (and widening) to the state; the start stays on the clamp line."""
    count = state.coefficients.shape[0]
    offset = solution[:count]
    x, y, tx, ty, _ = point_and_tangent(state.coefficients, 0.0)
    d = value_at(offset, 0.0)
    along = (state.clamp[0] - x + d * ty) * state.clamp[2] + (state.clamp[1] - y - d * tx) * state.clamp[3]
    lean = tx * state.clamp[2] + ty * state.clamp[3]
    start = along / max(lean, 0.3)
    start = min(max(start, -8.0), 8.0)
    state.coefficients[:] = moved_curve(state.coefficients, offset, start, beyond_mm, REFIT)
    state.width[:] += solution[count:]


@njit(cache=True, nogil=True)
def gaps(work, filled, numbers, to_u):
    """Longest stretch of u without a kept station on either side, the one at the free end, the share seen from one side."""
    bins = 64
    seen = np.zeros((2, bins))
    for n in range(filled):
        if work.keep[n]:
            k = min(max(int(work.stations[n, U] * bins), 0), bins - 1)
            seen[0 if work.stations[n, SIDE] > 0 else 1, k] += 1
    run = longest = one = 0
    for k in range(bins):
        left, right = seen[0, k] > 0, seen[1, k] > 0
        if not (left or right):
            run += 1
            longest = max(longest, run)
        else:
            run = 0
            one += left != right
    numbers[LONGEST_GAP] = longest / bins
    numbers[END_GAP] = max(run / bins - (1.0 - to_u), 0.0)
    numbers[ONE_SIDED] = one / bins
