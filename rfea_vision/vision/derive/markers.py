"""Marks, painted bands, print or fibre texture as material: elongation without assuming an inextensible side.

Of single coloured marks their distances along the centre line tell it: from the clamp to the first, from each to the next, and
from the last to the tip. Of texture, the light along the centre line is one profile per frame. The profile of the straightest frames,
drawn out and pushed together segment by segment, must give that of every other frame; how far each segment has to be drawn out
is its elongation. Only what marks or texture can carry is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.stats import chi2

from rfea_vision.arrays import FloatArray
from rfea_vision.calibration.projection import project_point
from rfea_vision.vision.curve import point_and_tangent, value_at

SAMPLES = 512
ACROSS = (-0.5, -0.25, 0.0, 0.25, 0.5)  # half widths at which the light is read
WINDOW_SHARE = 0.15  # of the length: slower changes of the light are shading, not marks
LEAST_TO_NOISE = 4.0  # texture over noise
LEAST_TO_CONTRAST = 0.02  # texture over the light step at the tube's edge
LARGEST_SIGMA = 0.03  # a segment that is known no better is left out;
LARGEST_BETWEEN = 0.1  # likewise where single marks tell it, on bodies that stretch by a fifth
PRIOR_STRAIN = 0.1  # how much neighbouring segments may differ, a priori: far more than any tube
PLACE_FLOOR = 0.06  # of a sample: what interpolation and the curve's own parameter leave in the place of a mark
FIT_LEAST = 0.6  # correlation of warped and seen profile

STRIDES = (1, 2, 4, 8)  # frames between the places of a mark whose scatter is looked at
FEWEST_DIFFERENCES = 8  # of which a scatter is told

ASSUMPTION = (
    "marks on the tube move with it, clamp and tip are its ends; nothing is assumed about an inextensible side: "
    "stretch of the centre line against the straightest frames"
)


@njit(cache=True, nogil=True)
def light_along(picture, camera, coefficients, width, out):
    """Mean light over the middle half of the tube at even steps of the centre line, into `out` (n,)."""
    height, length = picture.shape
    count = out.shape[0]
    for k in range(count):
        u = (k + 0.5) / count
        x, y, tx, ty, _ = point_and_tangent(coefficients, u)
        half = value_at(width, u)
        cx, cy = project_point(camera, x, y)
        ex, ey = project_point(camera, x - half * ty, y + half * tx)
        total, number = 0.0, 0
        for q in ACROSS:
            px, py = cx + q * (ex - cx), cy + q * (ey - cy)
            i, j = int(np.floor(py)), int(np.floor(px))
            if i < 0 or j < 0 or i >= height - 1 or j >= length - 1:
                continue
            a, b = py - i, px - j
            top = (1.0 - b) * picture[i, j] + b * picture[i, j + 1]
            low = (1.0 - b) * picture[i + 1, j] + b * picture[i + 1, j + 1]
            total += (1.0 - a) * top + a * low
            number += 1
        out[k] = total / number if number > 0 else 0.0


def texture_of(profiles: FloatArray) -> FloatArray:
    """What of the profiles (t, n) is texture: without slow shading, in units of its own strength there."""
    width = max(round(WINDOW_SHARE * profiles.shape[1]) // 2, 4)
    padded = np.pad(profiles, ((0, 0), (width, width)), mode="edge")
    quick = profiles - _running_mean(padded, width)
    strength = np.sqrt(_running_mean(np.pad(quick**2, ((0, 0), (width, width)), mode="reflect"), width))
    floor = 0.3 * np.sqrt(np.mean(quick**2, axis=1, keepdims=True)) + 1e-9
    return quick / np.maximum(strength, floor)


def _running_mean(padded: FloatArray, half: int) -> FloatArray:
    total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
    window = 2 * half + 1
    return (total[:, window:] - total[:, :-window]) / window


def has_texture(profiles: FloatArray, contrast: float) -> bool:
    """Whether a few successive profiles (t, n) show the same marks, well beyond noise."""
    inner = slice(round(0.05 * profiles.shape[1]), round(0.95 * profiles.shape[1]))
    width = max(round(WINDOW_SHARE * profiles.shape[1]) // 2, 4)
    quick = (profiles - _running_mean(np.pad(profiles, ((0, 0), (width, width)), mode="edge"), width))[:, inner]
    noise = float(np.std(np.diff(quick, axis=0))) / np.sqrt(2 * (1 - 1 / len(profiles)))
    signal = float(np.std(quick.mean(axis=0)))
    return bool(signal > LEAST_TO_NOISE * noise / np.sqrt(len(profiles)) and signal > LEAST_TO_CONTRAST * abs(contrast))


@njit(cache=True, nogil=True)
def register(reference, seen, knots, moved, prior, floor):
    """Where the knots of `reference` (n,) lie in `seen` (n,), by Gauss-Newton from `moved`, which is changed.

    `knots` and `moved` (m,) run from 0 to n; the first and last stay. `floor` is added to the standard error of every
    knot. Returns the covariance of the knots (m, m), and the correlation of the profiles.
    """
    m = knots.shape[0]
    size = m - 2
    matrix, right = np.zeros((size, size)), np.zeros(size)
    covariance = np.zeros((m, m))
    agreement = 0.0
    for _ in range(12):
        matrix[:], right[:] = 0.0, 0.0
        squares, lagged, agreement, number = _add_samples(reference, seen, knots, moved, matrix, right)
        variance = squares / max(number - size, 1)
        chance = min(max(lagged / max(squares, 1e-12), 0.0), 0.95)
        variance *= (1.0 + chance) / (1.0 - chance)
        _add_likeness(knots, moved, variance / (prior * prior), matrix, right)
        inverse = np.linalg.inv(matrix + 1e-9 * np.eye(size))
        step = inverse @ right
        largest = np.max(np.abs(step))
        step *= min(1.0, 4.0 / max(largest, 1e-12))
        moved[1:-1] += step
        covariance[1:-1, 1:-1] = inverse * variance + floor * floor * np.eye(size)
        if largest < 1e-3:
            break
    return covariance, agreement


@njit(cache=True, nogil=True)
def _add_samples(reference, seen, knots, moved, matrix, right):
    """Add what every sample of the profiles says of the knots that it lies between.

    Returns the sum of squared residuals and of their products with the one before, the correlation, and how many there are.
    """
    n, size = reference.shape[0], right.shape[0]
    squares = product = own = other = lagged = last = 0.0
    number, k = 0, 0
    for i in range(n):
        at = i + 0.5
        while k < size and knots[k + 1] < at:
            k += 1
        f = (at - knots[k]) / (knots[k + 1] - knots[k])
        place = moved[k] + f * (moved[k + 1] - moved[k]) - 0.5
        j = int(np.floor(place))
        if j < 0 or j >= n - 1:
            continue
        g = place - j
        value = seen[j] + g * (seen[j + 1] - seen[j])
        slope = seen[j + 1] - seen[j]
        residual = reference[i] - value
        squares += residual * residual
        lagged += residual * last
        last = residual
        product += reference[i] * value
        own += reference[i] * reference[i]
        other += value * value
        number += 1
        for a, wa in ((k - 1, 1.0 - f), (k, f)):
            if 0 <= a < size:
                right[a] += wa * slope * residual
                for b, wb in ((k - 1, 1.0 - f), (k, f)):
                    if 0 <= b < size:
                        matrix[a, b] += wa * wb * slope * slope
    return squares, lagged, product / max(np.sqrt(own * other), 1e-12), number


@njit(cache=True, nogil=True)
def _add_likeness(knots, moved, weight, matrix, right):
    """Add that neighbouring segments are drawn out alike, loosely."""
    size = right.shape[0]
    for c in range(1, size + 1):
        left, span = knots[c] - knots[c - 1], knots[c + 1] - knots[c]
        row = (1.0 / left, -1.0 / left - 1.0 / span, 1.0 / span)
        value = moved[c - 1] * row[0] + moved[c] * row[1] + moved[c + 1] * row[2]
        for a in range(3):
            p = c - 2 + a
            if 0 <= p < size:
                right[p] -= weight * row[a] * value
                for b in range(3):
                    q = c - 2 + b
                    if 0 <= q < size:
                        matrix[p, q] += weight * row[a] * row[b]


@dataclass(frozen=True)
class Marked:
    """Elongation (t, segments) and its standard error from marks, NaN where they do not carry it; and what to say."""

    elongation: FloatArray
    sigma: FloatArray
    attributes: dict[str, float | str]


def marker_elongation(profiles: FloatArray, length_mm: FloatArray, bend_rad: FloatArray, segments: int) -> Marked:
    """Register every profile against the straightest frames.

    Parameters
    ----------
    profiles : (t, n) light along the centre line, valid frames in their order
    length_mm : (t,) length of the centre line
    bend_rad : (t,) total turning
    segments : parts of equal length at rest
    """
    count, n = profiles.shape
    texture = texture_of(profiles)
    rest = int(np.argmin(np.abs(bend_rad)))
    near = np.flatnonzero(np.abs(bend_rad - bend_rad[rest]) < 0.02)
    near = near[np.argsort(np.abs(near - rest))][:25]
    reference = texture[near].mean(axis=0)
    knots = np.linspace(0, n, segments + 1)
    elongation, sigma = np.full((count, segments), np.nan), np.full((count, segments), np.nan)
    covariances: dict[int, FloatArray] = {}
    most = int(np.argmax(np.abs(bend_rad - bend_rad[rest])))
    for order in (range(rest, count), range(rest, -1, -1)):
        moved = knots.copy()
        for t in order:
            start = moved.copy()
            covariance, agreement = register(reference, texture[t], knots, moved, PRIOR_STRAIN, PLACE_FLOOR)
            if agreement < FIT_LEAST or np.any(np.diff(moved) <= 0):
                moved = start
                continue
            longer = length_mm[t] / length_mm[rest]
            step = n / segments
            spread = np.diff(np.diff(covariance, axis=0), axis=1) / step**2 * longer**2
            if t == most:
                covariances[t] = spread
            error = np.sqrt(np.maximum(np.diag(spread), 0.0))
            known = error < LARGEST_SIGMA
            elongation[t, known] = (np.diff(moved) / step * longer - 1.0)[known]
            sigma[t, known] = error[known]
    attributes: dict[str, float | str] = {"marker_elongation_assumption": ASSUMPTION}
    if most in covariances and np.isfinite(elongation[most]).all():
        attributes |= uniformity(elongation[most], covariances[most])
    return Marked(elongation, sigma, attributes)


def elongation_between(
    material: list[dict[float, tuple[float, float]]],
    length_mm: FloatArray,
    tip_mm: FloatArray,
    heading_rad: FloatArray,
    across_mm: FloatArray,
    segments: int,
) -> Marked:
    """What lies between the clamp, single marks and the tip, over what it was in the first frame, less one.

    Parameters
    ----------
    material : of every valid frame the marks that were seen, by their share of the length in the first frame: mm along the
        centre line, and its standard error
    length_mm, tip_mm : (t,) length of the centre line, and standard error of its end along it
    heading_rad : (t, n) direction of the centre line at even shares of its length
    across_mm : (t,) how far the whole line may lie beside the body's middle: where it has turned, it is as much longer or shorter
    segments : parts of equal length in the first frame; those between the same two marks share one value
    """
    joints = np.linspace(0, length_mm[0], segments + 1)
    noise_mm = {
        share: _scatter_mm(material, length_mm, share) for share in sorted({s for seen in material for s in seen})
    }
    evenly = np.linspace(0, 1, heading_rad.shape[1])
    elongation, sigma = np.full((len(material), segments), np.nan), np.full((len(material), segments), np.nan)
    for t, seen in enumerate(material):
        shares = np.array([0.0, *sorted(seen), 1.0])
        at_rest = shares * length_mm[0]
        marks = [(seen[share][0], noise_mm[share] or seen[share][1]) for share in sorted(seen)]
        places, errors = np.array([(0.0, 0.0), *marks, (length_mm[t], tip_mm[t])]).T
        parts = np.diff(at_rest)
        if np.any(parts <= 0) or np.any(np.diff(places) <= 0):
            continue
        turned = np.interp(places / length_mm[t], evenly, heading_rad[t]) - np.interp(shares, evenly, heading_rad[0])
        # Both frames err; the clamp is the same place in both.
        spread = np.hypot(np.sqrt(2.0) * np.hypot(errors[1:], errors[:-1]), across_mm[t] * np.diff(turned)) / parts
        first = np.clip(np.searchsorted(at_rest, joints[:-1], side="right") - 1, 0, len(parts) - 1)
        last = np.clip(np.searchsorted(at_rest, joints[1:], side="left") - 1, 0, len(parts) - 1)
        error = np.array([spread[a : b + 1].max() for a, b in zip(first, last, strict=True)])
        known = error < LARGEST_BETWEEN
        drawn = np.diff(np.interp(joints, at_rest, places)) / np.diff(joints) - 1.0
        elongation[t, known], sigma[t, known] = drawn[known], error[known]
    said = ASSUMPTION.replace("the straightest frames", "the first frame")
    return Marked(elongation, sigma, {"marker_elongation_assumption": said})


def _scatter_mm(material: list[dict[float, tuple[float, float]]], length_mm: FloatArray, share: float) -> float:
    """Standard error of a mark's place from its scatter about a smooth motion; zero where it was seen too rarely to tell.

    By third differences of its share of the line, over ever longer steps, since in compressed pictures errors last over frames;
    all of them count alike: a body that rests for most of a film scatters less then.
    """
    places = np.array([seen[share][0] if share in seen else np.nan for seen in material]) / length_mm
    largest = 0.0
    for stride in STRIDES:
        third = np.diff(places[: len(places) // stride * stride].reshape(-1, stride), n=3, axis=0)
        third = third[np.isfinite(third)]
        if len(third) >= FEWEST_DIFFERENCES:
            largest = max(largest, float(np.sqrt(np.mean(third**2) / 20.0)))  # 1 + 9 + 9 + 1 times the variance
    return largest * float(np.mean(length_mm))


def uniformity(elongation: FloatArray, covariance: FloatArray) -> dict[str, float | str]:
    """Whether all segments are drawn out alike, in the frame that is bent most: chi-square over its covariance."""
    inverse = np.linalg.pinv(covariance, hermitian=True, rcond=1e-6)
    freedom = len(elongation) - 1  # the sum is that of the whole tube, whose length is known
    off = elongation - elongation.mean()
    statistic = float(off @ inverse @ off)
    p = float(chi2.sf(statistic, freedom))
    spread = 100 * float(np.ptp(elongation))
    said = f"the segments are drawn out alike within their errors (range {spread:.1f} %, p = {p:.2g})"
    if p < 0.01:
        said = f"the segments are not drawn out alike: they differ by {spread:.1f} % (p = {p:.2g})"
    return {
        "marker_uniformity_chi2": statistic,
        "marker_uniformity_freedom": float(freedom),
        "marker_uniformity_p": p,
        "marker_uniformity": said,
    }
