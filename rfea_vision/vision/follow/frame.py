"""One frame from the last: fit both edges and the end, and say how well it went. Compiled."""

from __future__ import annotations

import math

import numpy as np

from rfea_vision.calibration.projection import project_point
from rfea_vision.vision.compiled import compiled, lean
from rfea_vision.vision.curve import VERTICES, point_and_tangent, turning, value_at, vertices_of
from rfea_vision.vision.edges.cap import cap_contrast, cap_levels, measure_cap
from rfea_vision.vision.edges.sides import fit_sides, gaps, measure_sides, move_state, profile_error, update_levels

TURNS = 8
MOST_BLUR = 0.55  # of the half width: beyond it the two edges are one
FORETOLD = 0.6  # of the edges, chosen: where fewer are near their expected places, they are looked for farther off
AT_ONCE_PX = 0.4  # a first step that is no longer ends on its place within the noise: edges know their own curve
ON_PLACE_PX = 0.06  # the same of the steps that follow, which start from what was read elsewhere
END_AT_ONCE_PX = 0.1  # farther, and the end is looked at once more
ROUNDED = 1.5  # length of a rounded end over the sagitta that is fitted to its middle: of a half circle, a bit less
LEAST_CAP_CONTRAST = 0.45  # of the light step at the edges


@lean
def _margin_px(shot, state, u):
    """How near to an end the edges can be used: blur of the end, and its corner where rows cross the edge at a slant."""
    camera, px_per_mm = shot.camera, shot.px_per_mm
    x, y, tx, ty, _ = point_and_tangent(state.coefficients, u)
    ax, ay = project_point(camera, x, y)
    bx, by = project_point(camera, x + tx, y + ty)
    dx, dy = abs(bx - ax), abs(by - ay)
    slant = min(dx, dy) / max(dx, dy, 1e-9)
    blur = state.blurs[0, 0] if u < 0.5 else state.blurs[0, -1]
    margin = 1.2 + 2.0 * blur + slant * (2.5 * blur + 0.8)
    if u > 0.5:  # along a rounded end the edges turn inwards
        half = value_at(state.width, 1.0)
        margin = max(margin, 1.0 + blur + ROUNDED * max(-state.cap[1], 0.0) * half * half * px_per_mm)
    return margin


@compiled
def fit_frame(shot, state, work, shape_gain, noise):
    """Fit one frame; `state` holds the prediction and becomes the result. Numbers land in `work.numbers`, which are nought before.

    `shape_gain` is how fast the end's shape follows what is seen. `noise` is that of the last frame, in grey levels.
    """
    numbers, px_per_mm = work.numbers[0], shot.px_per_mm
    length = vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    px_per_vertex = max(length * px_per_mm / (VERTICES - 1), 0.2)
    blur_limit = MOST_BLUR * px_per_mm * work.half_width[VERTICES // 2]
    from_u = _margin_px(shot, state, 0.0) / px_per_mm / max(length, 1.0)
    to_u = 1.0 - _margin_px(shot, state, 1.0) / px_per_mm / max(length, 1.0)
    near, enough = True, AT_ONCE_PX
    for turn in range(TURNS):
        filled, length = measure_sides(shot, state, work, from_u, to_u)
        rows = max(2.0 * length * px_per_mm * (to_u - from_u) * 0.85, 1.0)
        solution, noise, kept = fit_sides(state, work, filled, (2.5 if near else 6.0) / px_per_mm, noise)
        if turn == 0 and kept < FORETOLD * rows:
            near = False
            solution, noise, kept = fit_sides(state, work, filled, 6.0 / px_per_mm, noise)
        numbers.used = kept / rows
        if kept < 20 or not _plausible(work.half_width) or not np.isfinite(solution).all():
            numbers.length = 0.0
            return
        numbers.profile = profile_error(state, work, filled, noise)
        gaps(work, filled, numbers, to_u)
        update_levels(state, work, 1.0 if turn == 0 else 0.5, blur_limit, px_per_vertex)
        largest = 0.0
        for k in range(33):
            largest = max(largest, abs(value_at(solution[: state.coefficients.shape[0]], k / 32.0)))
        move_state(state, solution, 0.0)
        if turn == 0 and largest * px_per_mm > 3.0:  # on the way here the end's blur was read from anything but the end
            state.blurs[2] = np.median(state.blurs[0])
        looks = 2 if turn == 0 else 1  # the first look reads the light of this frame, the second the place
        moved, cap_used = _fit_end(shot, state, work, noise, shape_gain * near, blur_limit, looks)
        largest = max(largest, moved) * px_per_mm
        numbers.last_step = largest
        unseen = cap_used <= 0.3 or cap_contrast(state) < LEAST_CAP_CONTRAST
        if near and largest < enough and not (turn == 0 and unseen):
            break
        enough = ON_PLACE_PX
        near = near or largest < 0.8 or turn >= 4
    _describe(shot.camera, state, work, noise, cap_used)


@compiled
def _describe(camera, state, work, noise, cap_used):
    """Numbers of the fitted frame: length, bend, tip, width, noise, light steps and blurs."""
    numbers = work.numbers[0]
    numbers.length = vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    numbers.bend = turning(work.normal)
    numbers.tip_x, numbers.tip_y = project_point(camera, work.centre[VERTICES - 1, 0], work.centre[VERTICES - 1, 1])
    numbers.width = 2.0 * np.mean(work.half_width)
    numbers.noise = noise
    numbers.cap_used = cap_used
    numbers.cap_contrast = cap_contrast(state)
    numbers.cap_round = -state.cap[1] * work.half_width[VERTICES - 1]
    numbers.blur = np.median(state.blurs[0])
    numbers.end_blur = np.mean(state.blurs[0, 7 * VERTICES // 8 :])
    # A picture taken while the tube moves by s has the blur of a box of that width on top of the lens's own.
    numbers.smear = math.sqrt(
        12.0 * max(numbers.end_blur ** 2 - (1.1 * np.mean(state.blurs[0, : VERTICES // 8])) ** 2, 0.0)
    )
    numbers.saturated = _saturated(state)


@compiled
def _fit_end(shot, state, work, noise, shape_gain, blur_limit, looks):
    """Put the end of the curve on the end of the tube; returns how far it went in mm, and the share of the cap seen."""
    shift = variance = used = 0.0
    limit = 4.0 / shot.px_per_mm
    for look in range(looks + 1):
        gain = shape_gain if look == looks - 1 else 0.0
        shift, variance, used = measure_cap(shot, state, work, noise, gain)
        cap_levels(state, work, blur_limit)
        work.numbers[0].tip_variance = variance
        if look < looks - 1:
            continue
        if used <= 0.3:
            return 0.0, used
        shift = min(max(shift, -limit), limit)
        move_state(state, np.zeros(state.coefficients.shape[0] + state.width.shape[0]), shift)
        if abs(shift) * shot.px_per_mm < END_AT_ONCE_PX:
            break
    return abs(shift), used


@compiled
def _saturated(state):
    """1 where the light on the tube or beside it is as bright, or as dark, as the camera can tell; else 0."""
    for s in range(2):
        for k in range(2):
            level = np.median(state.levels[s, ::8, k])
            if level > 253.0 or level < 1.0:
                return 1.0
    return 0.0


@compiled
def _plausible(half_width):
    """A width that has run away (to nothing, or beyond all measure) cannot be fitted any further."""
    middle = half_width[VERTICES // 2]
    low, high = half_width.min(), half_width.max()
    return low > 0.3 * middle and high < 3.0 * middle and middle > 0.0
