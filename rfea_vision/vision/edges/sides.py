"""Both edges of the tube at the present curve: measure them, choose the good stations, fit, move. Compiled."""

from __future__ import annotations

import math

import numpy as np

from rfea_vision.scatter import NORMAL
from rfea_vision.vision.compiled import compiled, lean, put_rows
from rfea_vision.vision.curve import REFIT, VERTICES, moved_curve, point_and_tangent, value_at, vertices_of
from rfea_vision.vision.edges.edgels import (
    BLUR_DOWN,
    BLUR_UP,
    INFO,
    LEVEL_WINDOW,
    LIGHT,
    MISFIT,
    SHIFT,
    SIDE,
    U,
    measure_polyline,
    smooth_levels,
)
from rfea_vision.vision.edges.fitted import SECTIONS
from rfea_vision.vision.edges.solve import PRIOR_BEND_MM, PRIOR_WIDTH_MM, normal_equations, residuals_of

BLUR_WINDOW = 48  # vertices to either side over which blurs are averaged
LEAST_CONTRAST = 0.35  # of the light step at the edges, in the first frame
UNEVEN_LIGHT = 0.1  # of the light step at the edge: how much a place on the tube may differ from its surroundings
UNSEEN_SECTIONS = 3  # where more than so many running are not seen at all,
LONE_SECTIONS = 4  # more lone edges than that beside them do not count
ODD_SHARE = 0.1  # of the reach: an edge that lies farther off is not where a tube of this width has it
MARKED_SHARE = 0.3  # of the stations: where so many differ, the tube is painted all along, and that is no reason


@lean
def measure_sides(shot, state, work, from_u, to_u):
    """Stations of both edges at the present curve; returns their number, and the length of the curve."""
    length = vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    work.sums[:] = 0.0
    filled = np.int64(0)
    count = work.centre.shape[0]
    low, high = math.ceil(from_u * (count - 1)), math.floor(to_u * (count - 1)) + 1
    inner_px = 0.9 * shot.px_per_mm * work.half_width[count // 2]
    for which in range(2):
        side = 1.0 - 2.0 * which
        for v in range(count):
            for k in range(2):
                work.outward[v, k] = side * work.normal[v, k]
                work.edge[v, k] = work.centre[v, k] + work.half_width[v] * work.outward[v, k]
        filled = measure_polyline(shot, state, work, which, low, high, work.u, inner_px, filled)
    return filled, length


@compiled
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
        smooth_levels(work.sums[s], state.levels[s], state.blurs[s], window, np.int64(BLUR_WINDOW), blur_limit, fresh)
    state.blurs[1] = state.blurs[0]


@lean
def select(state, work, filled, limit_mm, noise):
    """Mark the stations that agree with the reference contrast and lie within `limit_mm` of their fit.

    Where the tube is lighter or darker than around (a shadow's rim, a band, something in front), the levels of the
    edge model belong to neither, and the edge would be read beside its place. A tube with bands all along it is like
    that everywhere: there it is the mean that counts, for both edges alike.
    """
    kept, uneven = _select(state, work, filled, limit_mm, noise, UNEVEN_LIGHT)
    if uneven > MARKED_SHARE * filled:
        kept, _ = _select(state, work, filled, limit_mm, noise, 1e9)
    return kept


@lean
def _select(state, work, filled, limit_mm, noise, uneven_light):
    """Mark the stations, given how uneven the light may be; how many are kept, and how many only the light rules out."""
    stations, residual, keep, odd = work.stations, work.residual, work.keep, work.odd
    levels, reference = state.levels, state.reference
    both = left = 0.0
    of_left = 0
    for n in range(filled):
        on_left = stations[n, SIDE] > 0
        both += stations[n, LIGHT]
        left += on_left * stations[n, LIGHT]
        of_left += on_left
    left_lighter, right_lighter = left / max(of_left, 1), (both - left) / max(filled - of_left, 1)
    kept = ruled_out = 0
    for n in range(filled):
        side = 0 if stations[n, SIDE] > 0 else 1
        v = min(max(int(stations[n, U] * (VERTICES - 1) + 0.5), 0), VERTICES - 1)
        contrast = levels[side, v, 0] - levels[side, v, 1]
        step = contrast if reference[side, v] > 0 else -contrast
        uneven = abs(stations[n, LIGHT] - (left_lighter if side == 0 else right_lighter))
        sound = (
            (step > LEAST_CONTRAST * abs(reference[side, v]))
            & (step > 0.0)
            & (stations[n, MISFIT] < 0.09 * contrast * contrast + 400.0)
        )
        good = sound & (uneven < uneven_light * step + 2.0 * noise)
        ruled_out += sound and not good
        near = abs(residual[n]) < limit_mm
        odd[n] = good and not near
        keep[n] = good and near
        kept += keep[n]
    return kept, ruled_out


@lean
def section_of(u):
    """In which of the `SECTIONS` a station is."""
    return min(max(int(u * SECTIONS), 0), SECTIONS - 1)


@lean
def _count_sections(work, filled):
    """Count in `work.sections` the stations that are kept, to the left and to the right, and those that are odd, likewise."""
    work.sections[:] = 0.0
    for n in range(filled):
        if work.keep[n] or work.odd[n]:
            row = (0 if work.keep[n] else 2) + (0 if work.stations[n, SIDE] > 0 else 1)
            work.sections[row, section_of(work.stations[n, U])] += 1.0


@lean
def drop_odd_sections(work, filled):
    """Where one edge is clear and not where a tube of this width has it, the other does not count either.

    A sleeve on the tube, or another body beside it: one edge alone would draw the centre line to its side. Returns
    how many stations are left.
    """
    _count_sections(work, filled)
    seen, kept = work.sections, 0
    for n in range(filled):
        k = section_of(work.stations[n, U])
        if seen[2, k] > max(seen[0, k], 2.0) or seen[3, k] > max(seen[1, k], 2.0):
            work.keep[n] = False
        kept += work.keep[n]
    return kept


@compiled
def robust_scale(work, filled):
    """Standard deviation of the residuals of the kept stations by their median, weighted to unit information."""
    values = np.empty(filled)
    m = 0
    for n in range(filled):
        if work.keep[n]:
            values[m] = abs(work.residual[n]) * math.sqrt(work.stations[n, INFO])
            m += 1
    return np.median(values[:m]) / NORMAL if m > 0 else 0.0


@compiled
def fit_sides(state, work, filled, wide_mm, assumed):
    """Robust fit of shift and widening: all, then without outliers. Returns solution, noise, kept.

    The covariance lands in `work.covariance`.
    """
    count, width_count = state.coefficients.shape[0], state.width.shape[0]
    for n in range(filled):
        work.residual[n] = work.stations[n, SHIFT]
    select(state, work, filled, wide_mm, assumed)
    kept = drop_odd_sections(work, filled)
    solution = np.zeros(count + width_count)
    noise = assumed
    if kept < 20:
        return solution, noise, kept
    for repeat in range(2):
        variance = max(noise * noise, 0.25)
        matrix, right = normal_equations(
            work.stations, filled, work.keep, variance, state.width, count, PRIOR_BEND_MM, PRIOR_WIDTH_MM
        )
        covariance = np.linalg.inv(matrix)
        solution = covariance @ right
        residuals_of(work.stations, filled, solution, count, width_count, work.residual)
        noise = max(robust_scale(work, filled), 0.3)
        before = kept
        if repeat == 0:
            for n in range(filled):
                if work.keep[n]:
                    off = abs(work.residual[n])
                    work.keep[n] = off * math.sqrt(work.stations[n, INFO]) < 4.5 * noise
                    # In the still parts of a compressed video noise is next to nothing, and unlikely is not yet odd.
                    work.odd[n] = work.odd[n] or (not work.keep[n] and off > ODD_SHARE * wide_mm)
            kept = drop_odd_sections(work, filled)
        if repeat == 1 or kept == before:
            scale = noise * noise / variance if repeat == 0 else 1.0
            put_rows(work.covariance, scale * covariance)
            break
    return solution, noise, kept


@compiled
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
    put_rows(state.coefficients, moved_curve(state.coefficients, offset, start, beyond_mm, REFIT))
    for i in range(state.width.shape[0]):
        state.width[i] += solution[count + i]


@lean
def profile_error(state, work, filled, noise):
    """How far in px both edges together may be from their places because they do not look like a blurred step.

    The noise of the picture is known from how the places scatter; what the pixels across an edge miss the model by
    beyond it is the edge's own: a highlight, a shadow beside it, a second edge. It moves the middle of the tube by half
    of what it moves either edge, and an edge by about the share of the light step that is missed times its width.
    """
    stations, keep = work.stations, work.keep
    total = 0.0
    for side in range(2):
        missed = contrast = 0.0
        number = 0
        for n in range(filled):
            if keep[n] and (stations[n, SIDE] > 0) == (side == 0):
                missed += stations[n, MISFIT]
                number += 1
        if number > 0:
            for v in range(VERTICES):
                contrast += (state.levels[side, v, 0] - state.levels[side, v, 1]) / VERTICES
            chance = 1.0 + 4.0 * math.sqrt(2.0 / (4.0 * number))  # four pixels each tell how well it fits
            beyond = max(missed / number - chance * noise * noise, 0.0)
            total += beyond / max(contrast * contrast, 1.0)
    return 0.5 * math.sqrt(total) * (2.5 * np.mean(state.blurs[0]) + 0.6)


@lean
def gaps(work, filled, numbers, to_u):
    """Stretches of u without kept stations: the longest without any, and those at the free end.

    At the free end: how much is not seen at all, how much is seen from one side or beside its place, and how much of
    the latter shows clear edges that are not where those of the tube should be.
    """
    _count_sections(work, filled)
    bins, seen = SECTIONS, work.sections
    run = longest = lone = strange = broken = unseen = 0
    for k in range(bins):
        left, right = seen[0, k] > 0, seen[1, k] > 0
        run = 0 if left or right else run + 1
        longest = max(longest, run)
        # Beside what hides the tube, one edge alone may be an edge of that.
        broken = 0 if left and right else broken + 1
        unseen = 0 if left and right else unseen + (not left and not right)
        if unseen > UNSEEN_SECTIONS:
            longest = max(longest, broken - LONE_SECTIONS)
        odd = seen[2, k] + seen[3, k] > 2
        lone = 0 if left and right else lone + (left != right or odd)
        strange = 0 if left and right else strange + odd
    hidden = 1.0 - to_u
    numbers.longest_gap = longest / bins
    numbers.end_gap = max(run / bins - hidden, 0.0)
    numbers.end_lone = lone / bins
    numbers.end_odd = strange / bins
