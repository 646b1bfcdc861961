"""Where the tube begins and ends: steps in the light along its axis, on it and beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from rfea_vision.arrays import FloatArray
from rfea_vision.calibration.projection import project
from rfea_vision.lines import along, leftwards
from rfea_vision.vision.curve import VERTEX_U, points_and_tangents

STEP_MM = 0.05
HALF_WINDOW = 20  # steps of `STEP_MM` to either side of a place, over which light is averaged
LEAST_STEP = 0.3  # of the contrast between tube and background
LEAST_TIP_STEP = 0.2  # the same where a tube of its own light may end in a ferrule of another
BANDS = (-0.6, 0.6), (1.18, 1.75), (-1.75, -1.18)  # half widths off the line: in the tube, and beside it,
BAND_PLACES = 9  # at so many places of which the light is read
LEAST_STDERR_MM = 0.002
LENGTH_TOLERANCE = 0.03  # standard error of the length that was given, as a share


@dataclass(frozen=True)
class End:
    """An end of the tube: `along_mm` from the curve's end (positive beyond it), its standard error, and what it is."""

    along_mm: float
    stderr_mm: float
    kind: str  # "step" | "hint" | "path"


def extended(coefficients: FloatArray, at_tip: bool, reach_mm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points along the axis through one end, from inside to beyond, where it goes straight on.

    Returns s (n,), positive beyond the end, points (n, 2) and outward tangents (n, 2).
    """
    length = float(along(points_and_tangents(coefficients, VERTEX_U)[0])[-1])
    s = np.arange(-reach_mm, reach_mm + STEP_MM / 2, STEP_MM)
    inside = np.minimum(s, 0.0) / length
    points, tangents = points_and_tangents(coefficients, 1.0 + inside if at_tip else -inside)
    if not at_tip:
        tangents = -tangents
    return s, points + np.maximum(s, 0.0)[:, None] * tangents, tangents


def strips(
    picture: NDArray[np.uint8], camera: FloatArray, points: FloatArray, tangents: FloatArray, half_mm: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Mean light (n, 3) in the tube, beside its left and its right edge, along the axis; and which rows are in the picture."""
    across = half_mm * leftwards(tangents)
    means = light_between(picture, camera, points, across, BANDS)
    seen = np.ones(len(points), dtype=bool)
    height, width = picture.shape
    for side in (-1.1, 1.1):
        px = project(camera, points + side * across)
        seen &= (px[:, 0] > 1) & (px[:, 1] > 1) & (px[:, 0] < width - 2) & (px[:, 1] < height - 2)
    return means, seen


def light_between(
    picture: NDArray[np.uint8], camera: FloatArray, points: FloatArray, across: FloatArray, bands: Sequence[tuple[float, float]]
) -> FloatArray:
    """Mean light (n, bands) at `points` (n, 2) mm, over places between each two shares of `across` (n, 2) mm beside them."""
    shares = np.concatenate([np.linspace(*band, BAND_PLACES) for band in bands])
    places = project(camera, points[:, None] + shares[:, None] * across[:, None])
    values = cv2.remap(picture, places.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # pyright: ignore[reportCallIssue, reportArgumentType]
    return values.reshape(len(points), len(bands), -1).mean(axis=2, dtype=float)


def _steps(means: FloatArray, contrast: float) -> tuple[NDArray[np.int64], FloatArray]:
    """How much the light (n, strips) changes at a row, from window to window, in units of the contrast; and which rows these are."""
    m = HALF_WINDOW
    total = np.pad(np.cumsum(means, axis=0), [(1, 0), (0, 0)])
    k = np.arange(m, len(means) - m)
    return k, np.abs((total[k + m] - total[k] - (total[k] - total[k - m])) / m / abs(contrast))


def end_candidates(
    picture: NDArray[np.uint8],
    camera: FloatArray,
    coefficients: FloatArray,
    half_mm: float,
    contrast: float,
    *,
    at_tip: bool,
    reach_mm: float,
) -> list[tuple[End, float]]:
    """Every cross-section within `reach_mm` where the tube could end, with how much of a step it is (0 to 1).

    A tube begins where its light, or that beside it, changes, and ends where what comes behind no longer looks like a tube
    between two edges. A painted band or a ferrule changes the light as well, but behind it the tube goes on.
    """
    s, points, tangents = extended(coefficients, at_tip, reach_mm)
    means, seen = strips(picture, camera, points, tangents, half_mm)
    if len(s) <= 2 * HALF_WINDOW:  # of a worm under a microscope: no step is so sharp
        return []
    k, size = _steps(means[:, :1] if at_tip else means, contrast)
    if not seen.all():
        size[k + HALF_WINDOW > np.argmin(seen)] = 0.0  # from the first row on that is not in the picture
    strongest, least = size.max(axis=1), LEAST_TIP_STEP if at_tip else LEAST_STEP
    likeness = np.clip((means[:, :1] - means[:, 1:]) / contrast, 0.0, 1.0).mean(axis=1)
    reach = max(round(half_mm / STEP_MM), HALF_WINDOW)
    out: list[tuple[End, float]] = []
    for peak in np.flatnonzero((strongest > least) & (strongest == maximum_filter1d(strongest, HALF_WINDOW + 1))):
        strength = float(min(strongest[peak], 1.0))
        if at_tip:
            before, after = likeness[max(k[peak] - reach, 0) : k[peak]].mean(), likeness[k[peak] : k[peak] + reach].mean()
            strength *= float(np.clip((before - after) / max(before, 0.5), 0.0, 1.0))
        if strength > 0.1:
            out.append((_end_at(s, means, size, k, int(peak), least), strength))
    return out


def _end_at(s: FloatArray, means: FloatArray, size: FloatArray, k: NDArray[np.int64], peak: int, least: float) -> End:
    """Place of the step at `peak`, over all strips that show it; what they disagree about is its standard error."""
    places, weights, doubts = [], [], []
    near = slice(max(peak - HALF_WINDOW // 2, 0), peak + HALF_WINDOW // 2 + 1)
    for channel in range(size.shape[1]):
        if size[near, channel].max() > least:
            centre = k[near.start + int(size[near, channel].argmax())]
            place, doubt = _crossing(s, means[:, channel], centre)
            places.append(place)
            doubts.append(doubt)
            weights.append(float(size[near, channel].max()))
    # Of three strips the middle one: a mark on the tube, or a shadow beside it, spoils one of them.
    place = float(np.median(places) if len(places) == 3 else np.average(places, weights=weights))
    spread = float(np.ptp(places)) / 2 if len(places) > 1 else 0.01
    return End(place, max(spread / np.sqrt(len(places)), float(np.median(doubts)), LEAST_STDERR_MM), "step")


def choose_ends(
    bases: list[tuple[End, float]], tips: list[tuple[End, float]], hinge_mm: float, length_mm: float
) -> tuple[End, End]:
    """The pair of ends with the clearest steps whose distance is the tube's length.

    `hinge_mm` is the length of the inextensible side between the present ends of the curve. The length that was given
    decides among steps of like size; it does not overrule a clear step that has no rival.
    """
    here = (End(0.0, 1.0, "path"), 0.05)
    best, chosen = -np.inf, (here[0], here[0])
    for base, base_strength in [*bases, here]:
        for tip, tip_strength in [*tips, here]:
            off = np.log(max(hinge_mm + base.along_mm + tip.along_mm, 1e-3) / length_mm) / LENGTH_TOLERANCE
            score = base_strength + tip_strength - 0.5 * off**2 / (1.0 + 0.3 * off**2)
            if score > best:
                best, chosen = score, (base, tip)
    return chosen


def _crossing(s: FloatArray, values: FloatArray, centre: int) -> tuple[float, float]:
    """Place of a step from the area under its profile: exact for any symmetric blur; and the doubt about it.

    The area rests on level light to either side. Where it is not level (a band, a shadow), the place is off by about
    the share of the step by which the light varies there, times the reach that is summed.
    """
    m = HALF_WINDOW
    low, high = max(centre - 2 * m, 0), min(centre + 2 * m, len(s) - 1)
    inner, outer = values[low : centre - m // 2], values[centre + m // 2 : high]
    before, after = inner.mean(), outer.mean()
    height = after - before if abs(after - before) > 1e-9 else 1e-9
    window = slice(max(centre - m, 0), centre + m + 1)
    share = (values[window] - before) / height
    far = values[max(centre - 4 * m, 0) : max(centre - m, 1)]  # a band that fills the window is seen from farther off
    uneven = float(np.hypot(np.std(far), np.std(outer[len(outer) // 3 :])) / abs(height))
    return float(s[window][-1] + STEP_MM / 2 - STEP_MM * share.sum()), uneven * m * STEP_MM
