"""Large motions: where the tube has gone since the last frame, to a few pixels. Compiled."""

from __future__ import annotations

import math

import numpy as np

from rfea_vision.calibration.projection import project_point
from rfea_vision.vision.compiled import compiled
from rfea_vision.vision.curve import value_at
from rfea_vision.vision.edges.edgels import INFO, SHIFT, SIDE, U
from rfea_vision.vision.edges.sides import move_state
from rfea_vision.vision.edges.solve import normal_equations, residuals_of

LONGEST_ARM = 1024  # px to either side of the centre line
NEAR_PX = 1.5  # what lies nearer is found by the edges themselves


@compiled
def coarse_search(shot, state, work, reach_px):
    """Find large shifts: where along each normal do both edges together fit best? Writes pseudo-stations.

    `work` holds the vertices of the curve. Returns the number of stations.
    """
    picture, width, camera, _ = shot
    height = picture.shape[0]
    count = work.centre.shape[0]
    reach = int(reach_px)
    profile, means = np.empty(2 * LONGEST_ARM + 1), np.empty(2 * LONGEST_ARM + 1)
    filled = 0
    for v in range(4, count, 8):
        cx, cy = project_point(camera, work.centre[v, 0], work.centre[v, 1])
        ex, ey = project_point(camera, work.centre[v, 0] + work.normal[v, 0], work.centre[v, 1] + work.normal[v, 1])
        per_mm = math.sqrt((ex - cx) ** 2 + (ey - cy) ** 2)
        dx, dy = (ex - cx) / per_mm, (ey - cy) / per_mm
        half = round(work.half_width[v] * per_mm)
        arm = half + reach + 4
        if half < 1 or arm > LONGEST_ARM:
            continue
        x, y = cx - arm * dx, cy - arm * dy
        if not (0 <= x < width - 1 and 0 <= y < height - 1):
            continue
        if not (0 <= cx + arm * dx < width - 1 and 0 <= cy + arm * dy < height - 1):
            continue
        for k in range(2 * arm + 1):
            profile[k] = picture[np.uint64(y + k * dy + 0.5), np.uint64(x + k * dx + 0.5)]
        left = 1.0 / state.reference[0, v]  # the left edge lies on the +normal side
        right = 1.0 / state.reference[1, v]
        best, best_shift = -1e9, 0
        for k in range(1, 2 * arm):
            means[k] = (profile[k - 1] + profile[k] + profile[k + 1]) / 3.0
        for d in range(-reach, reach + 1):
            a = arm + d + half
            b = arm + d - half
            step_left, step_right = means[a - 2] - means[a + 2], means[b + 2] - means[b - 2]
            score = min(step_left * left, 1.2) + min(step_right * right, 1.2) - 0.005 * abs(d)
            if score > best:
                best, best_shift = score, d
        if best > 0.9:
            work.stations[filled, U] = v / (count - 1)
            work.stations[filled, SIDE] = 1.0
            work.stations[filled, SHIFT] = best_shift / per_mm
            work.stations[filled, INFO] = (2.0 * per_mm) ** 2
            work.keep[filled] = True
            filled += 1
    return filled


@compiled
def apply_coarse(state, work, filled, px_per_mm):
    """Move the curve by the pseudo-stations of a coarse search; returns the largest shift in px."""
    count, width_count = state.coefficients.shape[0], state.width.shape[0]
    largest = 0.0
    for n in range(filled):
        largest = max(largest, abs(work.stations[n, SHIFT]) * px_per_mm)
    if largest < NEAR_PX:
        return largest
    solution = np.zeros(count + width_count)
    for repeat in range(4):
        matrix, right = normal_equations(work.stations, filled, work.keep, 1.0, np.zeros(width_count), count, 0.5, 1e-4)
        solution = np.linalg.solve(matrix, right)
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
