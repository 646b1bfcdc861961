"""Marks, painted bands, print or fibre texture as material: elongation without assuming an inextensible side.

Of single coloured marks their distances along the centre line tell it: from the clamp to the first, from each to the next, and
from the last to the tip. Of texture, the light along the centre line is one profile per frame. The profile of the straightest frames,
drawn out and pushed together segment by segment, must give that of every other frame; how far each segment has to be drawn out
is its elongation. Only what marks or texture can carry is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import leftwards
from rfea_vision.vision.curve import points_and_tangents
from rfea_vision.vision.find.ends import light_between

SAMPLES = 512
ACROSS = (-0.5, 0.5)  # half widths between which the light is read
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


def light_along(picture: NDArray[np.uint8], camera: FloatArray, coefficients: FloatArray, half_mm: float) -> FloatArray:
    """Mean light (SAMPLES,) over the middle half of the tube at even steps of the centre line."""
    points, tangents = points_and_tangents(coefficients, (np.arange(SAMPLES) + 0.5) / SAMPLES)
    return light_between(picture, camera, points, half_mm * leftwards(tangents), [ACROSS])[:, 0]


def texture_of(profiles: FloatArray) -> FloatArray:
    """What of the profiles (t, n) is texture: without slow shading, in units of its own strength there."""
    quick = _quick(profiles)
    strength = np.sqrt(_running_mean(quick**2, "mirror"))
    floor = 0.3 * np.sqrt(np.mean(quick**2, axis=1, keepdims=True)) + 1e-9
    return quick / np.maximum(strength, floor)


def _running_mean(values: FloatArray, mode: str) -> FloatArray:
    return uniform_filter1d(values, 2 * max(round(WINDOW_SHARE * values.shape[1]) // 2, 4) + 1, axis=1, mode=mode)


def _quick(profiles: FloatArray) -> FloatArray:
    """Profiles (t, n) without slow shading."""
    return profiles - _running_mean(profiles, "nearest")


def has_texture(profiles: FloatArray, contrast: float) -> bool:
    """Whether a few successive profiles (t, n) show the same marks, well beyond noise."""
    quick = _quick(profiles)[:, round(0.05 * profiles.shape[1]) : round(0.95 * profiles.shape[1])]
    noise = float(np.std(np.diff(quick, axis=0))) / np.sqrt(2 * (1 - 1 / len(profiles)))
    signal = float(np.std(quick.mean(axis=0)))
    return bool(signal > LEAST_TO_NOISE * noise / np.sqrt(len(profiles)) and signal > LEAST_TO_CONTRAST * abs(contrast))


def register(reference: FloatArray, seen: FloatArray, knots: FloatArray, moved: FloatArray) -> tuple[FloatArray, float]:
    """Where the knots of `reference` (n,) lie in `seen` (n,), by Gauss-Newton from `moved`, which is changed.

    `knots` and `moved` (m,) run from 0 to n; the first and last stay. Neighbouring segments are drawn out alike, loosely.
    Returns the covariance of the knots (m, m), and the correlation of the profiles.
    """
    n, m = len(reference), len(knots)
    hats = np.array([np.interp(np.arange(n) + 0.5, knots, knot) for knot in np.eye(m)]).T  # share of each knot in a sample's place
    unlike = np.diff(np.diff(np.eye(m), axis=0) / np.diff(knots)[:, None], axis=0) / PRIOR_STRAIN  # of neighbours' stretches
    covariance, agreement = np.zeros((m, m)), 0.0
    for _ in range(12):
        place = hats @ moved - 0.5
        low = np.floor(place).astype(int)
        there = (low >= 0) & (low < n - 1)
        low = low[there]
        slope = seen[low + 1] - seen[low]
        value = seen[low] + (place[there] - low) * slope
        residual, rows = reference[there] - value, slope[:, None] * hats[there]
        squares = float(residual @ residual)
        chance = min(max(float(residual[1:] @ residual[:-1]) / max(squares, 1e-12), 0.0), 0.95)
        variance = squares / max(len(residual) - m + 2, 1) * (1.0 + chance) / (1.0 - chance)
        agreement = float(np.corrcoef(reference[there], value)[0, 1])
        matrix = rows.T @ rows + variance * unlike.T @ unlike
        inverse = np.linalg.inv(matrix[1:-1, 1:-1] + 1e-9 * np.eye(m - 2))
        step = inverse @ (rows.T @ residual - variance * unlike.T @ (unlike @ moved))[1:-1]
        largest = float(np.max(np.abs(step)))
        moved[1:-1] += step * min(1.0, 4.0 / max(largest, 1e-12))
        covariance[1:-1, 1:-1] = inverse * variance + PLACE_FLOOR**2 * np.eye(m - 2)
        if largest < 1e-3:
            break
    return covariance, agreement


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
            covariance, agreement = register(reference, texture[t], knots, moved)
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
