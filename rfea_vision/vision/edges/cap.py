"""The free end of the tube: where along the axis it lies, and the shape it has. Compiled."""

from __future__ import annotations

import math

import numpy as np

from rfea_vision.vision.compiled import compiled, lean
from rfea_vision.vision.curve import point_and_tangent, value_at
from rfea_vision.vision.edges.edgels import CAP, INFO, LEVEL_WINDOW, MISFIT, SHIFT, U, measure_polyline, smooth_levels

CAP_VERTICES = 33
CAP_REACH = 0.75  # share of the half width on which the end of the tube is measured, at most: its corners are blurred, too,
FROM_CORNERS = 2.0  # of the blur, and as far again where rows cross it at half a right angle, for they run along it
LEAST_CAP_REACH = 0.5  # chosen: of an end that is smeared by its motion less is too little
STEEPEST_TILT = 0.5  # of the end against the cross-section
ROUNDEST = 1.0  # sagitta of the end over the half width; a half circle fitted on CAP_REACH has 0.6
CLEAR_CAP = 0.08  # of its light step: by how much even a clear end, with its corners, is not a blurred step
UNLIKELY = 6.0  # standard errors by which a sum of squares must exceed its mean to say anything
PIXELS_ACROSS = 4.0  # of an edge, that tell its fit
CAP_PARTS = 3.0


@lean
def cap_contrast(state):
    """Step in the light at the end, as a share of the one at the edges: 1 where the tube really ends here."""
    levels = state.levels[CAP, :CAP_VERTICES]
    contrast = np.mean(levels[:, 0]) - np.mean(levels[:, 1])
    return contrast / state.reference[CAP, 0] if state.reference[CAP, 0] != 0.0 else 0.0


@compiled
def measure_cap(shot, state, work, noise, shape_gain):
    """Shift of the tube's end along its axis; None of it is applied here.

    Returns the shift in mm, its variance, and the share of the cap that could be used. `shape_gain` is how fast the
    cap's tilt and roundness follow what is seen.
    """
    x, y, tx, ty, _ = point_and_tangent(state.coefficients, 1.0)
    half = value_at(state.width, 1.0)
    px_per_mm, across = shot.px_per_mm, np.empty(CAP_VERTICES)
    slant = 1.0 + min(abs(tx), abs(ty)) / max(abs(tx), abs(ty))
    corners = FROM_CORNERS * slant * np.mean(state.blurs[CAP, :CAP_VERTICES]) / (px_per_mm * half)
    reach = min(CAP_REACH, max(1.0 - corners, LEAST_CAP_REACH))
    for k in range(CAP_VERTICES):
        q = reach * half * (2.0 * k / (CAP_VERTICES - 1) - 1.0)
        along = state.cap[0] * q + state.cap[1] * q * q
        work.edge[k, 0], work.edge[k, 1] = x - q * ty + along * tx, y + q * tx + along * ty
        work.outward[k, 0], work.outward[k, 1] = tx, ty
        across[k] = q
    work.sums[CAP] = 0.0
    levels, blurs = state.levels[CAP, :CAP_VERTICES], state.blurs[CAP, :CAP_VERTICES]
    nothing = np.int64(0)
    filled = measure_polyline(
        shot, state, work, np.int64(CAP), nothing, np.int64(CAP_VERTICES), across, 3.0 * px_per_mm * half, nothing
    )
    expected = 2.0 * reach * half * px_per_mm * max(abs(tx), abs(ty))
    if filled < 4:
        return 0.0, 1.0, 0.0
    shift, weight, used, spread = _cap_mean(work, filled, state, half)
    if weight <= 0.0:
        return 0.0, 1.0, 0.0
    if shape_gain > 0.0 and 0.8 < used / expected < 1.2 and 0.75 < cap_contrast(state) < 1.3:  # a clear view only
        _follow_cap_shape(work, filled, state, half, shape_gain)
    # Where the end is not one clear edge (a highlight runs into it), its stations disagree by more than their noise, and
    # neighbours do so together: there are no more than a few independent ones.
    beyond_chance = 1.0 + UNLIKELY * math.sqrt(2.0 / max(used - 1.0, 1.0))
    disagreement = max(spread - beyond_chance * noise * noise * (used - 1.0), 0.0) / (weight * CAP_PARTS)
    own = _not_a_step(work, filled, levels, blurs, noise) / px_per_mm
    return shift, noise * noise / weight + disagreement + own * own, used / expected


@lean
def _cap_mean(work, filled, state, half):
    levels = state.levels[CAP, :CAP_VERTICES]
    contrast = abs(np.mean(levels[:, 0]) - np.mean(levels[:, 1]))
    limit = 1e9
    shift = weight = spread = 0.0
    used = 0
    for _ in range(3):
        total = weight = 0.0
        used = 0
        for n in range(filled):
            work.keep[n] = (
                abs(work.stations[n, SHIFT] - shift) < limit and work.stations[n, MISFIT] < 0.09 * contrast**2 + 400.0
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
    return shift, weight, used, spread


@lean
def _not_a_step(work, filled, levels, blurs, noise):
    """How far in px the end may be from its place because it does not look like a blurred step (a band just before it)."""
    missed = number = 0.0
    for n in range(filled):
        if work.keep[n]:
            missed += work.stations[n, MISFIT]
            number += 1.0
    contrast = np.mean(levels[:, 0]) - np.mean(levels[:, 1])
    chance = 1.0 + UNLIKELY * math.sqrt(2.0 / max(PIXELS_ACROSS * number, 1.0))
    clear = chance * noise * noise + (CLEAR_CAP * contrast) ** 2
    beyond = max(missed / max(number, 1.0) - clear, 0.0)
    return 1.5 * math.sqrt(beyond / max(contrast * contrast, 1.0)) * (2.5 * np.mean(blurs) + 0.6)


@compiled
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
        tilt = state.cap[0] + gain * solution[1] / half
        round_ = state.cap[1] + gain * solution[2] / (half * half)
        state.cap[0] = min(max(tilt, -STEEPEST_TILT), STEEPEST_TILT)
        state.cap[1] = min(max(round_, -ROUNDEST / half), ROUNDEST / half)


@compiled
def cap_levels(state, work, blur_limit):
    """Levels that follow the light across the cap (a tube is shaded), and one blur for the whole of it."""
    sums, levels, blurs = work.sums[CAP, :CAP_VERTICES], state.levels[CAP, :CAP_VERTICES], state.blurs[CAP, :CAP_VERTICES]
    smooth_levels(sums, levels, blurs, np.int64(LEVEL_WINDOW), np.int64(CAP_VERTICES), blur_limit, 1.0)
