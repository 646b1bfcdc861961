"""One frame from the last: predict, search coarsely, fit both edges and the cap, judge. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.calibration.projection import project_point
from rfea_vision.vision.curve import (
    COEFFICIENTS,
    REFIT,
    VERTEX_U,
    VERTICES,
    WIDTH_COEFFICIENTS,
    moved_curve,
    point_and_tangent,
    value_at,
    vertices_of,
)
from rfea_vision.vision.edges import (
    BLUR_DOWN,
    BLUR_UP,
    INFO,
    LEVEL_COLUMNS,
    MAX_STATIONS,
    SHIFT,
    SIDE,
    STATION_COLUMNS,
    U,
    measure_polyline,
    smooth_levels,
)
from rfea_vision.vision.solve import PRIOR_BEND_MM, PRIOR_WIDTH_MM, correlation_length, fit_shift, residuals_of

FloatArray = NDArray[np.float64]

CAP_VERTICES = 33
CAP_REACH = 0.75  # share of the half width on which the end of the tube is measured
LEVEL_WINDOW, BLUR_WINDOW = 8, 48

# Numbers that come out of a frame.
(
    LENGTH,
    WIDTH,
    TIP_SHIFT,
    TIP_VARIANCE,
    NOISE,
    INFLATION,
    USED,
    INNOVATION,
    MISFIT_RATIO,
    BLUR,
    CONTRAST,
    ONE_SIDED,
    CAP_USED,
    LONGEST_GAP,
    LAST_STEP,
    BEND,
    TIP_X,
    TIP_Y,
) = range(18)
NUMBERS = 18


class State(NamedTuple):
    """What is known of the tube, updated in place frame by frame.

    coefficients (K, 2) mm; width (Kw,) half width mm; levels (3, V, 2) inside and outside grey levels of the left
    edge, the right edge and the cap; blurs (3, V) px; reference (3, V) contrast at the start; cap (2,) tilt and
    roundness of the tube's end; clamp (4,) point and axis of the clamp line.
    """

    coefficients: FloatArray
    width: FloatArray
    levels: FloatArray
    blurs: FloatArray
    reference: FloatArray
    cap: FloatArray
    clamp: FloatArray


class Workspace(NamedTuple):
    """Arrays that every frame uses again."""

    centre: FloatArray
    normal: FloatArray
    half_width: FloatArray
    edge: FloatArray
    outward: FloatArray
    stations: FloatArray
    residual: FloatArray
    keep: NDArray[np.bool_]
    sums: FloatArray
    numbers: FloatArray
    covariance: FloatArray


def new_workspace() -> Workspace:
    """Allocate a workspace."""
    size = COEFFICIENTS + WIDTH_COEFFICIENTS
    return Workspace(
        np.empty((VERTICES, 2)),
        np.empty((VERTICES, 2)),
        np.empty(VERTICES),
        np.empty((VERTICES, 2)),
        np.empty((VERTICES, 2)),
        np.zeros((MAX_STATIONS, STATION_COLUMNS)),
        np.empty(MAX_STATIONS),
        np.zeros(MAX_STATIONS, dtype=np.bool_),
        np.zeros((3, VERTICES, LEVEL_COLUMNS)),
        np.zeros(NUMBERS),
        np.zeros((size, size)),
    )


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
        good = good and work.stations[n, 4] < 0.09 * contrast * contrast + 400.0
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
def fit_sides(state, work, filled, wide_mm, least_contrast, assumed):
    """Robust fit of shift and widening: all, then without outliers. Returns solution, covariance, noise, kept."""
    count, width_count = state.coefficients.shape[0], state.width.shape[0]
    for n in range(filled):
        work.residual[n] = work.stations[n, SHIFT]
    kept = select(state, work, filled, wide_mm, least_contrast)
    solution = np.zeros(count + width_count)
    covariance = np.zeros((count + width_count, count + width_count))
    noise = assumed
    if kept < 20:
        return solution, covariance, noise, kept
    for repeat in range(2):
        solution, covariance = fit_shift(
            work.stations,
            filled,
            work.keep,
            max(noise * noise, 0.25),
            state.width,
            count,
            PRIOR_BEND_MM,
            PRIOR_WIDTH_MM,
        )
        residuals_of(work.stations, filled, solution, count, width_count, work.residual)
        noise = max(robust_scale(work, filled), 0.3)
        if repeat == 0:
            before, kept = kept, 0
            for n in range(filled):
                if work.keep[n]:
                    work.keep[n] = abs(work.residual[n]) * math.sqrt(work.stations[n, INFO]) < 4.5 * noise
                    kept += work.keep[n]
            if kept == before:
                covariance *= noise * noise / max(assumed * assumed, 0.25)
                break
    return solution, covariance, noise, kept


@njit(cache=True, nogil=True)
def measure_cap(picture, camera, state, work, px_per_mm, noise, shape_gain):
    """Shift of the tube's end along its axis; None of it is applied here.

    Returns the shift in mm, its variance, and the share of the cap that could be used. `shape_gain` is how fast the
    cap's tilt and roundness follow what is seen.
    """
    x, y, tx, ty, _ = point_and_tangent(state.coefficients, 1.0)
    half = value_at(state.width, 1.0)
    points = np.empty((CAP_VERTICES, 2))
    outward = np.empty((CAP_VERTICES, 2))
    across = np.empty(CAP_VERTICES)
    for k in range(CAP_VERTICES):
        q = CAP_REACH * half * (2.0 * k / (CAP_VERTICES - 1) - 1.0)
        along = state.cap[0] * q + state.cap[1] * q * q
        points[k, 0], points[k, 1] = x - q * ty + along * tx, y + q * tx + along * ty
        outward[k, 0], outward[k, 1] = tx, ty
        across[k] = q
    sums = work.sums[2, :CAP_VERTICES]
    sums[:] = 0.0
    levels, blurs = state.levels[2, :CAP_VERTICES], state.blurs[2, :CAP_VERTICES]
    filled = measure_polyline(
        picture,
        camera,
        points,
        outward,
        0.0,
        across,
        levels,
        blurs,
        1,
        1,
        3.0 * px_per_mm * half,
        work.stations,
        0,
        sums,
    )
    expected = 2.0 * CAP_REACH * half * px_per_mm * max(abs(tx), abs(ty))
    if filled < 4:
        return 0.0, 1.0, 0.0
    shift, weight, used = _cap_mean(work, filled, state, half)
    if weight <= 0.0:
        return 0.0, 1.0, 0.0
    if shape_gain > 0.0:
        _follow_cap_shape(work, filled, state, half, shape_gain)
    return shift, noise * noise / weight, used / expected


@njit(cache=True, nogil=True)
def _cap_mean(work, filled, state, half):
    contrast = abs(state.levels[2, 0, 0] - state.levels[2, 0, 1])
    limit = 1e9
    shift = weight = 0.0
    used = 0
    for _ in range(3):
        total = weight = 0.0
        used = 0
        for n in range(filled):
            work.keep[n] = (
                abs(work.stations[n, SHIFT] - shift) < limit and work.stations[n, 4] < 0.09 * contrast**2 + 400.0
            )
            if work.keep[n]:
                total += work.stations[n, INFO] * work.stations[n, SHIFT]
                weight += work.stations[n, INFO]
                used += 1
        if weight <= 0.0:
            break
        shift = total / weight
        spread = 0.0
        for n in range(filled):
            if work.keep[n]:
                spread += work.stations[n, INFO] * (work.stations[n, SHIFT] - shift) ** 2
        limit = max(4.0 * math.sqrt(spread / weight), 0.05 * half)
    return shift, weight, used


@njit(cache=True, nogil=True)
def _follow_cap_shape(work, filled, state, half, gain):
    matrix = np.zeros((3, 3))
    right = np.zeros(3)
    for n in range(filled):
        if work.keep[n]:
            q = work.stations[n, U] / half
            row = (1.0, q, q * q)
            for i in range(3):
                right[i] += work.stations[n, INFO] * row[i] * work.stations[n, SHIFT]
                for j in range(3):
                    matrix[i, j] += work.stations[n, INFO] * row[i] * row[j]
    strength = 1e-6 * matrix[0, 0]
    for i in range(3):
        matrix[i, i] += strength
    if matrix[0, 0] > 0:
        solution = np.linalg.solve(matrix, right)
        state.cap[0] += gain * solution[1] / half
        state.cap[1] += gain * solution[2] / (half * half)


@njit(cache=True, nogil=True)
def coarse_cap(picture, camera, state, reach_px, px_per_mm):
    """Where along the axis, within `reach_px`, does the tube end? Shift in mm, 0 if nowhere."""
    height, width = picture.shape
    x, y, tx, ty, _ = point_and_tangent(state.coefficients, 1.0)
    half = value_at(state.width, 1.0)
    reach = int(reach_px)
    arm = reach + 4
    strip = np.zeros(2 * arm + 1)
    for k in range(-arm, arm + 1):
        along = k / px_per_mm
        total, number = 0.0, 0
        for m in range(-4, 5):
            q = 0.15 * m * half
            bend = along + state.cap[0] * q + state.cap[1] * q * q
            u, v = project_point(camera, x + bend * tx - q * ty, y + bend * ty + q * tx)
            i, j = round(v), round(u)
            if 0 <= i < height and 0 <= j < width:
                total += float(picture[i, j])
                number += 1
        if number == 0:
            return 0.0
        strip[k + arm] = total / number
    contrast = state.levels[2, 0, 0] - state.levels[2, 0, 1]
    best, place = 0.5, 0
    for d in range(-reach, reach + 1):
        a = arm + d
        step = (strip[a - 1] + strip[a - 2] + strip[a - 3] - strip[a + 1] - strip[a + 2] - strip[a + 3]) / 3.0
        score = min(step / contrast, 1.2) - 0.01 * abs(d)
        if score > best:
            best, place = score, d
    return place / px_per_mm


@njit(cache=True, nogil=True)
def coarse_search(picture, camera, state, work, reach_px, px_per_mm):
    """Find large shifts: where along each normal do both edges together fit best? Writes pseudo-stations.

    Returns their number and the share that found the tube.
    """
    vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    height, width = picture.shape
    count = work.centre.shape[0]
    reach = int(reach_px)
    profile = np.empty(2 * 400 + 1)
    filled = found = asked = 0
    for v in range(4, count, 8):
        cx, cy = project_point(camera, work.centre[v, 0], work.centre[v, 1])
        ex, ey = project_point(camera, work.centre[v, 0] + work.normal[v, 0], work.centre[v, 1] + work.normal[v, 1])
        per_mm = math.sqrt((ex - cx) ** 2 + (ey - cy) ** 2)
        dx, dy = (ex - cx) / per_mm, (ey - cy) / per_mm
        half = round(work.half_width[v] * per_mm)
        arm = min(half + reach + 4, 400)
        asked += 1
        inside_picture = True
        for k in range(-arm, arm + 1):
            px, py = round(cx + k * dx), round(cy + k * dy)
            if px < 0 or py < 0 or px >= width or py >= height:
                inside_picture = False
                break
            profile[k + arm] = float(picture[py, px])
        if not inside_picture:
            continue
        left = state.reference[0, v]  # the left edge lies on the +normal side
        right = state.reference[1, v]
        best, best_shift = -1e9, 0
        for d in range(-reach, reach + 1):
            a = arm + d + half
            b = arm + d - half
            step_left = (
                profile[a - 1] + profile[a - 2] + profile[a - 3] - profile[a + 1] - profile[a + 2] - profile[a + 3]
            ) / 3.0
            step_right = (
                profile[b + 1] + profile[b + 2] + profile[b + 3] - profile[b - 1] - profile[b - 2] - profile[b - 3]
            ) / 3.0
            score = min(step_left / left, 1.2) + min(step_right / right, 1.2) - 0.005 * abs(d)
            if score > best:
                best, best_shift = score, d
        if best > 0.9:
            work.stations[filled, U] = v / (count - 1)
            work.stations[filled, SIDE] = 1.0
            work.stations[filled, SHIFT] = best_shift / per_mm
            work.stations[filled, INFO] = (2.0 * per_mm) ** 2
            work.keep[filled] = True
            filled += 1
            found += 1
    return filled, found / max(asked, 1)


@njit(cache=True, nogil=True)
def apply_coarse(state, work, filled, px_per_mm):
    """Move the curve by the pseudo-stations of a coarse search; returns the largest shift in px."""
    count, width_count = state.coefficients.shape[0], state.width.shape[0]
    solution = np.zeros(count + width_count)
    for repeat in range(4):
        solution, _ = fit_shift(work.stations, filled, work.keep, 1.0, np.zeros(width_count), count, 0.5, 1e-4)
        residuals_of(work.stations, filled, solution, count, width_count, work.residual)
        limit = max(6.0 / px_per_mm / (repeat + 1), 2.0 / px_per_mm)
        for n in range(filled):
            work.keep[n] = abs(work.residual[n]) < limit
    largest = 0.0
    for k in range(33):
        largest = max(largest, abs(value_at(solution[:count], k / 32.0)) * px_per_mm)
    if largest > 1.0:
        move_state(state, solution, 0.0)
    return largest


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
def _cap_levels(state, work, blur_limit):
    """One pair of levels and one blur for the whole cap."""
    sums, levels, blurs = work.sums[2, :CAP_VERTICES], state.levels[2, :CAP_VERTICES], state.blurs[2, :CAP_VERTICES]
    smooth_levels(sums, levels, blurs, CAP_VERTICES, CAP_VERTICES, blur_limit, 1.0)


@njit(cache=True, nogil=True)
def _margin_px(camera, state, u, px_per_mm):
    """How near to an end the edges can be used: blur of the end, and its corner where rows cross the edge at a slant."""
    x, y, tx, ty, _ = point_and_tangent(state.coefficients, u)
    ax, ay = project_point(camera, x, y)
    bx, by = project_point(camera, x + tx, y + ty)
    dx, dy = abs(bx - ax), abs(by - ay)
    slant = min(dx, dy) / max(dx, dy, 1e-9)
    blur = state.blurs[0, 0] if u < 0.5 else state.blurs[0, -1]
    return 1.2 + 2.0 * blur + slant * (2.5 * blur + 0.8)


@njit(cache=True, nogil=True)
def fit_frame(picture, camera, state, work, px_per_mm, reach_px, shape_gain, least_contrast):
    """Fit one frame; `state` holds the prediction and becomes the result. Numbers land in `work.numbers`."""
    numbers = work.numbers
    numbers[:] = 0.0
    length = vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    px_per_vertex = max(length * px_per_mm / (VERTICES - 1), 0.2)
    blur_limit = 0.3 * px_per_mm * work.half_width[VERTICES // 2]
    filled, _ = coarse_search(picture, camera, state, work, reach_px, px_per_mm)
    if filled >= 6:
        numbers[INNOVATION] = apply_coarse(state, work, filled, px_per_mm)
    from_u = _margin_px(camera, state, 0.0, px_per_mm) / px_per_mm / max(length, 1.0)
    to_u = 1.0 - _margin_px(camera, state, 1.0, px_per_mm) / px_per_mm / max(length, 1.0)
    noise = 3.0
    tip_shift = tip_variance = cap_used = 0.0
    for turn in range(5):
        last = turn >= 1
        stride = 1 if last else 3
        filled, length = measure_sides(picture, camera, state, work, stride, from_u, to_u, px_per_mm)
        wide = (6.0 if turn == 0 else 2.5) / px_per_mm
        solution, covariance, noise, kept = fit_sides(state, work, filled, wide, least_contrast, noise)
        numbers[USED] = kept / max(2.0 * length * px_per_mm * (to_u - from_u) / stride * 0.85, 1.0)
        if kept < 20:
            return
        if last:
            numbers[INFLATION] = correlation_length(work.stations, filled, work.keep, work.residual)
            _gaps(work, filled, numbers, to_u - from_u)
        update_levels(state, work, 1.0 if turn == 0 else 0.5, blur_limit, px_per_vertex)
        largest = 0.0
        for k in range(33):
            largest = max(largest, abs(value_at(solution[: state.coefficients.shape[0]], k / 32.0)))
        move_state(state, solution, 0.0)
        if turn == 0 or cap_used <= 0.3:
            beyond = coarse_cap(picture, camera, state, reach_px, px_per_mm)
            if abs(beyond) * px_per_mm > 1.5:
                solution[:] = 0.0
                move_state(state, solution, beyond)
        for again in range(2):  # the first look reads the light of this frame, the second the place
            tip_shift, tip_variance, cap_used = measure_cap(
                picture, camera, state, work, px_per_mm, noise, shape_gain if last and again else 0.0
            )
            _cap_levels(state, work, blur_limit)
        if cap_used > 0.3:
            tip_shift = min(max(tip_shift, -4.0 / px_per_mm), 4.0 / px_per_mm)
            solution[:] = 0.0
            move_state(state, solution, tip_shift)
            largest = max(largest, abs(tip_shift))
        work.covariance[:] = covariance
        numbers[LAST_STEP] = largest * px_per_mm
        if last and largest * px_per_mm < 0.2:
            break
    numbers[LENGTH] = vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    numbers[BEND] = _turning(work.normal)
    numbers[TIP_X], numbers[TIP_Y] = project_point(camera, work.centre[VERTICES - 1, 0], work.centre[VERTICES - 1, 1])
    numbers[WIDTH] = 2.0 * np.mean(work.half_width)
    numbers[TIP_SHIFT] = tip_shift
    numbers[TIP_VARIANCE] = tip_variance
    numbers[NOISE] = noise
    numbers[CAP_USED] = cap_used
    numbers[BLUR] = max(np.median(state.blurs[0]), np.median(state.blurs[1]))


@njit(cache=True, nogil=True)
def _turning(normal):
    """Total turning of the curve in rad, counter-clockwise positive."""
    total = 0.0
    for v in range(normal.shape[0] - 1):
        cross = normal[v, 0] * normal[v + 1, 1] - normal[v, 1] * normal[v + 1, 0]
        total += math.asin(min(max(cross, -1.0), 1.0))
    return total


@njit(cache=True, nogil=True)
def _gaps(work, filled, numbers, span):
    """Longest stretch of u without a kept station on either side, and the share seen from one side only."""
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
    numbers[ONE_SIDED] = one / bins
