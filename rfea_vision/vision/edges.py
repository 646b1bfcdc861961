"""Both edges of the tube to a fraction of a pixel, from raw pixels, compiled.

Where an edge runs steeply, picture rows are used; elsewhere, columns. Each row (or column) crosses the edge once; its raw pixels are
compared with the model of a blurred edge, integrated over the pixel, and one Newton step gives the edge's place. No
pixel is interpolated or used twice, so the noise of neighbouring stations stays independent and the estimate comes
close to the Cramer-Rao bound.

The edge model: level `inside` on the tube, `outside` beyond it, a Gaussian blur of `blur` px between them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rfea_vision.calibration.projection import project_point

# Normal distribution function, its integral and the density for z in [-6, 6], side by side: small enough to stay in a
# processor's first cache, and wrong by 4e-6 at most between its steps.
_REACH, _STEPS = 6.0, 1024
_Z = np.linspace(-_REACH, _REACH, _STEPS + 1)
_CDF = np.array([0.5 * math.erfc(-z / math.sqrt(2.0)) for z in _Z])
_PDF = np.exp(-0.5 * _Z**2) / math.sqrt(2.0 * math.pi)
_TABLE = np.ascontiguousarray(np.column_stack([_CDF, _Z * _CDF + _PDF, _PDF]))
_PER_STEP = _STEPS / (2.0 * _REACH)

MAX_STATIONS = 8192
# Columns of the station table.
U, SIDE, SHIFT, INFO, MISFIT, VERTEX, LIGHT = 0, 1, 2, 3, 4, 5, 6
STATION_COLUMNS = 7
# Columns of the level sums, per side and vertex.
SUM_IN, COUNT_IN, SUM_OUT, COUNT_OUT, BLUR_UP, BLUR_DOWN = 0, 1, 2, 3, 4, 5
LEVEL_COLUMNS = 6


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def _normal_table(z):
    """Distribution function, its integral, and the density at `z`."""
    if z <= -_REACH:
        return 0.0, 0.0, 0.0
    if z >= _REACH:
        return 1.0, z, 0.0
    x = (z + _REACH) * _PER_STEP
    i = int(x)
    f = x - i
    cdf = _TABLE[i, 0] + f * (_TABLE[i + 1, 0] - _TABLE[i, 0])
    integral = _TABLE[i, 1] + f * (_TABLE[i + 1, 1] - _TABLE[i, 1])
    pdf = _TABLE[i, 2] + f * (_TABLE[i + 1, 2] - _TABLE[i, 2])
    return cdf, integral, pdf


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def cross_edge(
    picture, along_row, line, place, outward, blur, inside, outside, reach_in, reach_out, sums, vertex, result
):
    """Compare one row (or column) with the edge model.

    `place` is where the edge is expected on row (column) `line`; `outward` is +1 or -1. Writes the Newton step in px
    along the line (positive outward), its information per unit noise variance, the misfit, and how much lighter than
    `inside` the tube is here into `result`; adds level and blur statistics to row `vertex` of `sums`. Returns False
    where pixels are missing.
    """
    height, width = picture.shape
    limit = width if along_row else height
    if line < 0 or line >= (height if along_row else width):
        return False
    low = place - reach_in if outward > 0 else place - reach_out
    high = place + reach_out if outward > 0 else place + reach_in
    first, last = math.ceil(low), math.floor(high)
    if first < 0 or last >= limit:
        return False
    contrast = inside - outside
    core = 2.5 * blur + 0.6
    plateau = core + 3.2
    inverse = 1.0 / blur
    j = first if outward > 0 else last
    number = last - first + 1
    x = (j - place) * outward
    while x < -plateau and number > 0:
        x += 1.0
        j += outward
        number -= 1
    total = 0.0
    count = 0
    while x < -core and number > 0:  # on the tube
        total += float(picture[line, j]) if along_row else float(picture[j, line])
        count += 1
        x += 1.0
        j += outward
        number -= 1
    sums[vertex, SUM_IN] += total
    sums[vertex, COUNT_IN] += count
    result[3] = total / count - inside if count > 0 else 0.0
    gain = info = misfit = up = down = 0.0
    count = 0
    cdf0, integral0, pdf0 = _normal_table((x - 0.5) * inverse)
    while x <= core and number > 0:  # across the edge
        value = float(picture[line, j]) if along_row else float(picture[j, line])
        cdf1, integral1, pdf1 = _normal_table((x + 0.5) * inverse)
        residual = value - outside - contrast * (1.0 - blur * (integral1 - integral0))
        slope = contrast * (cdf1 - cdf0)
        by_blur = -contrast * (pdf1 - pdf0)
        gain += slope * residual
        info += slope * slope
        misfit += residual * residual
        up += by_blur * residual
        down += by_blur * by_blur
        count += 1
        cdf0, integral0, pdf0 = cdf1, integral1, pdf1
        x += 1.0
        j += outward
        number -= 1
    sums[vertex, BLUR_UP] += up
    sums[vertex, BLUR_DOWN] += down
    across = count
    total = 0.0
    count = 0
    while x <= plateau and number > 0:  # beyond it
        total += float(picture[line, j]) if along_row else float(picture[j, line])
        count += 1
        x += 1.0
        j += outward
        number -= 1
    sums[vertex, SUM_OUT] += total
    sums[vertex, COUNT_OUT] += count
    if info < 1e-9 or across == 0:
        return False
    result[0] = gain / info
    result[1] = info
    result[2] = max(misfit - gain * gain / info, 0.0) / across
    return True


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
def measure_polyline(
    picture, camera, points, outward, side, u, levels, blurs, stride, hop, reach_limit, stations, filled, sums
):
    """Measure along one edge.

    Parameters
    ----------
    points, outward : (V, 2) mm, expected edge and the direction (unit) in which its shift is counted
    u : (V,) parameter written to the stations
    levels : (V, 2) inside and outside grey level; blurs : (V,) px
    stride : use every so many rows; hop : and every so many points
    reach_limit : px on the inner side that still belong to the tube
    stations : table to append to, from row `filled` on; returns the new count
    sums : (V, 6) level and blur statistics, added to
    """
    count = points.shape[0]
    result = np.empty(4)
    px0, py0 = project_point(camera, points[0, 0], points[0, 1])
    tip_x, tip_y = project_point(camera, points[0, 0] + 0.5 * outward[0, 0], points[0, 1] + 0.5 * outward[0, 1])
    ox0, oy0 = 2.0 * (tip_x - px0), 2.0 * (tip_y - py0)
    v = -hop
    following = 0
    while following < count - 1:
        v = following
        following = min(v + hop, count - 1)
        px1, py1 = project_point(camera, points[following, 0], points[following, 1])
        ox1, oy1 = ox0, oy0
        if following % 4 == 0 or following == count - 1:  # how far a mm reaches changes slowly
            tip_x, tip_y = project_point(
                camera,
                points[following, 0] + 0.5 * outward[following, 0],
                points[following, 1] + 0.5 * outward[following, 1],
            )
            ox1, oy1 = 2.0 * (tip_x - px1), 2.0 * (tip_y - py1)
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
            a = py0 if along_row else px0
            b = py1 if along_row else px1
            # Inside the picture only: a curve that ran away must not be walked to its end.
            limit = float(picture.shape[0] if along_row else picture.shape[1])
            first = math.ceil(min(max(min(a, b), 0.0), limit))
            last = math.ceil(min(max(max(a, b), 0.0), limit))
            for line in range(first, last):
                if line % stride != 0:
                    continue
                f = (line - a) / span
                place = px0 + f * dx if along_row else py0 + f * dy
                blur = blurs[v] + f * (blurs[following] - blurs[v])
                # The pixel is a box along the line and smears the edge across it by its slope: exact where aligned.
                seen = math.sqrt(blur * blur + (1.0 - cosine * cosine) / 12.0) / cosine
                reach = 2.5 * seen + 3.8
                inner = min(reach, reach_limit / cosine)
                vertex = v if f < 0.5 else following
                if not cross_edge(
                    picture,
                    along_row,
                    line,
                    place,
                    direction,
                    seen,
                    levels[vertex, 0],
                    levels[vertex, 1],
                    inner,
                    reach,
                    sums,
                    vertex,
                    result,
                ):
                    continue
                if filled >= stations.shape[0]:
                    return filled
                ox, oy = ox0 + f * (ox1 - ox0), oy0 + f * (oy1 - oy0)
                per_mm = (ox * nx + oy * ny) / cosine  # px along the line per mm along `outward`
                if per_mm <= 1e-6:
                    continue
                stations[filled, U] = u[v] + f * (u[following] - u[v])
                stations[filled, SIDE] = side
                stations[filled, SHIFT] = result[0] / per_mm
                stations[filled, INFO] = result[1] * per_mm * per_mm
                stations[filled, MISFIT] = result[2]
                stations[filled, VERTEX] = vertex
                stations[filled, LIGHT] = result[3]
                filled += 1
        px0, py0, ox0, oy0 = px1, py1, ox1, oy1
    return filled


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
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
