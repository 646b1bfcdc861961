"""Both edges of the tube to a fraction of a pixel, from raw pixels, compiled.

Where an edge runs steeply, picture rows are used; elsewhere, columns. Each row (or column) crosses the edge once; its raw pixels are
compared with the model of a blurred edge, integrated over the pixel, and one Newton step gives the edge's place. No
pixel is interpolated or used twice, so the noise of neighbouring stations stays independent and the estimate comes
close to the Cramer-Rao bound.

The edge model: level `inside` on the tube, `outside` beyond it, a Gaussian blur of `blur` px between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfea_vision.calibration.projection import project_point
from rfea_vision.vision.compiled import compiled, inlined, lean
from rfea_vision.vision.edges.step import BEGIN, BLUR_PX, HALF_REACH, PHASES, PIXELS, RATIO

MAX_STATIONS = 8192
# Columns of the station table.
U, SIDE, SHIFT, INFO, MISFIT, VERTEX, LIGHT = 0, 1, 2, 3, 4, 5, 6
STATION_COLUMNS = 7
# Columns of the level sums, per side and vertex.
SUM_IN, COUNT_IN, SUM_OUT, COUNT_OUT, BLUR_UP, BLUR_DOWN = 0, 1, 2, 3, 4, 5
LEVEL_COLUMNS = 6

LEFT, RIGHT, CAP = 0, 1, 2  # rows of a state's levels and blurs, and of their sums
HOP = 4  # points from one place to the next at which it is worked out how far a mm reaches
PLATEAU_PX = 3.2  # of the level light to either side that is read with an edge
LEVEL_WINDOW = 8  # vertices to either side over which the light is averaged


@lean
def _blur_row(blurs, blur, near):
    """Row of `blurs` whose blur is nearest to `blur`, looked for from row `near` on."""
    last = blurs.shape[0] - 1
    half_step = 1.0 + 0.5 * (RATIO - 1.0)
    while near < last and blur > blurs[near, BLUR_PX] * half_step:
        near += 1
    while near > 0 and blur * half_step < blurs[near, BLUR_PX]:
        near -= 1
    return near


class Line(NamedTuple):
    """A row (or column): all pixels of the picture, where in these it starts, how far apart its own lie, and how many it has."""

    pixels: NDArray[np.uint8]
    start: int
    step: int
    size: int


@inlined
def _sum(line, first, end):
    """Light of the pixels from `first` to before `end`, and their number."""
    # Indices are unsigned, because those that might count from the end take longer.
    at, step, number, total = np.uint64(line.start + first * line.step), np.uint64(line.step), max(end - first, 0), 0.0
    for _ in range(number):
        total += line.pixels[at]
        at += step
    return total, float(number)


class Expected(NamedTuple):
    """An edge on a row (or column): its place, +1 or -1 for outward, its blur and the row of the tabulated ones that is nearest.

    And the light on the tube and beyond it, and how many px of the tube may be used.
    """

    place: float
    outward: int
    blur: float
    row: int
    inside: float
    outside: float
    inner: float


@inlined
def cross_edge(line, edge, steps, sums, vertex):
    """Compare a `Line` with the edge that is `Expected` there.

    `steps` is the tabulated edge. Adds level and blur statistics to row `vertex` of `sums`.
    Returns the Newton step in px along the line (positive outward), its information per unit noise variance (negative
    where pixels are missing), the misfit, and how much lighter than `inside` the tube is here.
    """
    place, outward, blur, row, inside, outside, inner = edge
    half, blur_off = steps.blurs[row, HALF_REACH], blur - steps.blurs[row, BLUR_PX]
    beyond = half + PLATEAU_PX
    inward = min(beyond, inner)
    first = math.ceil(place - (inward if outward > 0 else beyond))
    last = math.floor(place + (beyond if outward > 0 else inward))
    if first < 0 or last >= line.size:
        return 0.0, -1.0, 0.0, 0.0
    # From low to high pixels, whichever of them are the tube's: the model turned round is one minus itself.
    number = int(steps.blurs[row, PIXELS])
    begin = math.ceil(place - half)
    nearest = int((begin - place + half) * PHASES + 0.5)
    off = (begin - place + half) - nearest * (1.0 / PHASES)
    low, high = (inside, outside) if outward > 0 else (outside, inside)
    step, table = low - high, steps.table
    gain = info = misfit = up = down = 0.0
    from_k, to_k = max(first - begin, 0), min(last + 1 - begin, number)
    at = np.uint64(int(steps.blurs[row, BEGIN]) + 3 * number * nearest + from_k)
    at_slope, at_blur = at + np.uint64(number), at + np.uint64(2 * number)
    at_pixel, apart = np.uint64(line.start + (begin + from_k) * line.step), np.uint64(line.step)
    for k in range(np.uint64(max(to_k - from_k, 0))):
        slope, by_blur = table[at_slope + k], table[at_blur + k]
        residual = line.pixels[at_pixel + k * apart] - high - step * (table[at + k] - off * slope + blur_off * by_blur)
        gain += slope * residual
        info += slope * slope
        misfit += residual * residual
        up += by_blur * residual
        down += by_blur * by_blur
    below, above = _sum(line, first, begin), _sum(line, max(begin + number, first), last + 1)
    (on_tube, count), (beyond_it, others) = (below, above) if outward > 0 else (above, below)
    sums[vertex, SUM_IN] += on_tube
    sums[vertex, COUNT_IN] += count
    sums[vertex, SUM_OUT] += beyond_it
    sums[vertex, COUNT_OUT] += others
    sums[vertex, BLUR_UP] += step * up
    sums[vertex, BLUR_DOWN] += step * step * down
    if info * step * step < 1e-9:
        return 0.0, -1.0, 0.0, 0.0
    # The step is that of a straight line; what the curve of a Gaussian edge adds to it is known.
    shift = gain / (step * info)
    curved = 1.0 + min(shift * shift / (blur * blur + 1.0 / 12.0), 1.0) / 12.0
    unlike = max(misfit - gain * gain / info, 0.0) / (to_k - from_k)
    lighter = on_tube / count - inside if count > 0.0 else 0.0
    return outward * shift * curved, step * step * info, unlike, lighter


@inlined
def _px_per_mm(camera, point, pixel_x, pixel_y, outward):
    """Px (x, y) by which a mm along `outward` moves a point (2,) mm that is seen at a pixel."""
    x, y = project_point(camera, point[0] + 0.5 * outward[0], point[1] + 0.5 * outward[1])
    return 2.0 * (x - pixel_x), 2.0 * (y - pixel_y)


@inlined
def _lines_between(a, b, limit):
    """Rows (columns) from `a` to `b`, inside the picture only: a curve that ran away must not be walked to its end."""
    return range(math.ceil(min(max(min(a, b), 0.0), limit)), math.ceil(min(max(max(a, b), 0.0), limit)))


@lean
def measure_polyline(shot, state, work, which, low, high, u, inner_px, filled):
    """Measure along one edge, whose points and outward directions are in `work`.

    Parameters
    ----------
    which : `LEFT`, `RIGHT` or `CAP`; the sums of light and blur in `work` are added to
    low, high : the points that are used
    u : (V,) parameter written to the stations
    inner_px : on the inner side that still belong to the tube
    filled : row of the table from which on stations are appended; returns the new count
    """
    picture, width, camera, _ = shot
    pixels, height, padded = picture.reshape(-1), picture.shape[0], picture.shape[1]
    stations, points, outward, sums = work.stations, work.edge, work.outward, work.sums[which]
    levels, blurs = state.levels[which], state.blurs[which]
    side = 0.0 if which == CAP else 1.0 - 2.0 * which
    px0, py0 = project_point(camera, points[low, 0], points[low, 1])
    ox0, oy0 = _px_per_mm(camera, points[low], px0, py0, outward[low])
    following, row = low, np.int64(0)
    while following < high - 1:
        v = following
        following = v + 1
        px1, py1 = project_point(camera, points[following, 0], points[following, 1])
        ox1, oy1 = ox0, oy0
        if (following - low) % HOP == 0 or following == high - 1:  # how far a mm reaches changes slowly
            ox1, oy1 = _px_per_mm(camera, points[following], px1, py1, outward[following])
        dx, dy = px1 - px0, py1 - py0
        along_row = abs(dy) >= abs(dx)
        span = dy if along_row else dx
        length = math.sqrt(dx * dx + dy * dy)
        if 1e-9 < length < 1e6 and abs(span) > 1e-9:  # false where it is not a number
            nx, ny = dy / length, -dx / length
            if nx * ox0 + ny * oy0 < 0:
                nx, ny = -nx, -ny
            cosine = abs(nx) if along_row else abs(ny)
            direction = 1 if (nx if along_row else ny) > 0 else -1
            a, b = (py0, py1) if along_row else (px0, px1)
            # The pixel is a box along the line and smears the edge across it by its slope: exact where aligned.
            blur = 0.5 * (blurs[v] + blurs[following])
            seen = math.sqrt(blur * blur + (1.0 - cosine * cosine) / 12.0) / cosine
            row = _blur_row(work.steps.blurs, seen, row)
            for number in _lines_between(a, b, float(height if along_row else width)):
                f = (number - a) / span
                vertex = v if f < 0.5 else following
                place = px0 + f * dx if along_row else py0 + f * dy
                edge = Expected(place, direction, seen, row, levels[vertex, 0], levels[vertex, 1], inner_px / cosine)
                line = Line(pixels, number * padded, 1, width) if along_row else Line(pixels, number, padded, height)
                shift, info, misfit, lighter = cross_edge(line, edge, work.steps, sums, vertex)
                if info < 0.0:
                    continue
                if filled >= stations.shape[0]:
                    return filled
                ox, oy = ox0 + f * (ox1 - ox0), oy0 + f * (oy1 - oy0)
                per_mm = (ox * nx + oy * ny) / cosine  # px along the line per mm along `outward`
                if per_mm <= 1e-6:
                    continue
                stations[filled, U] = u[v] + f * (u[following] - u[v])
                stations[filled, SIDE] = side
                stations[filled, SHIFT] = shift / per_mm
                stations[filled, INFO] = info * per_mm * per_mm
                stations[filled, MISFIT] = misfit
                stations[filled, VERTEX] = vertex
                stations[filled, LIGHT] = lighter
                filled += 1
        px0, py0, ox0, oy0 = px1, py1, ox1, oy1
    return filled


@compiled
def smooth_levels(sums, levels, blurs, half_window, blur_window, blur_limit, fresh):
    """Turn level sums into smooth levels and blurs along one edge, in place.

    `fresh` is the weight of the new value against the one kept from the last frame.
    """
    count = levels.shape[0]
    cumulative = np.zeros((count + 1, LEVEL_COLUMNS))
    for v in range(count):
        for k in range(LEVEL_COLUMNS):
            cumulative[v + 1, k] = cumulative[v, k] + sums[v, k]
    for v in range(count):
        low, high = max(0, v - half_window), min(count, v + half_window + 1)
        for k in range(2):
            number = cumulative[high, 2 * k + 1] - cumulative[low, 2 * k + 1]
            if number >= 6:
                mean = (cumulative[high, 2 * k] - cumulative[low, 2 * k]) / number
                levels[v, k] += fresh * (mean - levels[v, k])
    # Blurs are averaged over the same window: what the window cannot tell apart must not drift.
    total = np.zeros(count + 1)
    for v in range(count):
        total[v + 1] = total[v] + blurs[v]
    for v in range(count):
        low, high = max(0, v - blur_window), min(count, v + blur_window + 1)
        blurs[v] = (total[high] - total[low]) / (high - low)
        down = cumulative[high, BLUR_DOWN] - cumulative[low, BLUR_DOWN]
        if down > 1e-6:
            change = (cumulative[high, BLUR_UP] - cumulative[low, BLUR_UP]) / down
            change = min(max(change, -0.3), 0.3)
            blurs[v] = min(max(blurs[v] + 0.5 * change, 0.15), blur_limit)
