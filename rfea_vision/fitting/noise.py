"""How noisy a track is, and the error that it alone may make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import ESTIMATED_ERRORS, Recording
from rfea_vision.artefacts.rows import LEFT_BY_A_MODEL, STATED_ERRORS
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.rules import pushed
from rfea_vision.scatter import rounding_noise, third_difference_noise

#: A repeat may begin so much earlier or later on its log than the run that it repeats: nearest first, in s.
_STEP_S = 0.01
_SEARCHED_S = [_STEP_S * k for k in sorted(range(-50, 51), key=abs)]
#: Share of the frames that may not set the floor alone: the claims of so few say nothing of the noise of the others.
FEW_FRAMES = 0.01
#: Frames that two runs have in common at least, to be compared.
LEAST_COMMON = 12


def white_noise_mm(tip_mm: FloatArray) -> float:
    """Noise of a tip track (frames, 2) in the norm of the tip RMSE, from its own high frequencies; of an angle likewise, in deg."""
    return float(np.linalg.norm(third_difference_noise(tip_mm)))


def noise_floor_mm(
    observed: Sequence[Observed],
    recordings: Mapping[str, Recording],
    *,
    repeats: bool = True,
    left: Mapping[str, FloatArray] = MappingProxyType({}),
    errors: Mapping[str, FloatArray] = MappingProxyType({}),
) -> tuple[float | None, str]:
    """Noise floor in the norm of the tip RMSE, and where it comes from.

    Repeats of the same excitation give it directly; else the tracking errors, but never less than high frequencies show. Those
    of the track hold the tube's ringing, too: where a model has been taken from the tip, by name of the run `left` (frames, 2)
    in mm, the lower of both counts, and other runs are not asked. `errors` (frames,) in mm^2 are a model's, by name of the run:
    they show whether a frame is as far off as it claims, where hardly another claims as much, and whether all of them are.
    """
    by_name = {o.name: o for o in observed}
    pairs = []
    for item in observed if repeats else ():
        other = by_name.get(item.repeat_of or "")
        if other is not None and item.has_tip and other.has_tip:
            inside, before = before_repeat(item, other, other.points[:, -1])
            if inside.any():
                difference = item.points[inside, -1] - before
                pairs.append(float(np.sqrt(np.mean(np.sum(difference**2, axis=1)) / 2)) / MM)
    if pairs:
        return float(np.mean(pairs)), "repeated runs"
    stated, measured = [], []
    for item in observed:
        if not item.has_tip:
            continue
        data = recordings[item.name].dataset
        estimated = data.attrs.get("sigma_source") == ESTIMATED_ERRORS
        if not left or item.name in left:
            seen = white_noise_mm(left[item.name]) if item.name in left else np.inf
            rounded = np.sqrt(2) * rounding_noise(item.points[:, -1] / MM) if estimated else 0.0
            measured.append(max(min(item.tip_noise_mm, seen), rounded))
        if "tip_sigma" in data and not estimated:
            squares = np.sum(data["tip_sigma"].values[item.frame] ** 2, axis=1)
        elif "midline_sigma" in data and not estimated:
            squares = 2 * data["midline_sigma"].values[item.frame, -1] ** 2
        else:
            continue
        stated.append(float(np.mean(_of_many(squares, errors.get(item.name, 0.0)))) - _shared(item, data))
    if not measured:
        return None, "no tip in the data"
    high = float(np.sqrt(np.mean(np.square(measured))))
    if not stated:
        return high, "the track's own high frequencies (no standard errors given)"
    claim = float(np.sqrt(max(np.mean(stated), 0.0)))
    # No noise is larger than what a model of a dozen values leaves of thousands of frames, noise and all.
    most = max((float(np.sqrt(np.nanmean(one))) for one in errors.values()), default=np.inf)
    if high > min(claim, most):
        return high, "the track's own high frequencies (above the stated standard errors)"
    if most < claim:
        return most, LEFT_BY_A_MODEL
    return claim, STATED_ERRORS


def _of_many(squares: FloatArray, found: FloatArray | float) -> FloatArray:
    """Claimed squared errors (frames,) of a run, the few beyond all others held to those, or to what was `found` (frames,) there.

    The noise floor is their mean, of which one frame that claims 4 mm where 500 claim 0.01 would be nearly all; whether it is that far
    off, a model's error there shows. Claims that are much alike stay as they are.
    """
    few = max(1, int(FEW_FRAMES * squares.size))
    others = np.partition(squares, squares.size - 1 - few)[squares.size - 1 - few] if few < squares.size else np.inf
    return np.minimum(squares, np.fmax(others, found))


def before_repeat(item: Observed, other: Observed, seen: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Frames (frames,) of a repeat that the run that it repeats has, too, and what was `seen` (frames of it, k) of that then.

    Their pressures say how much earlier or later a repeat begins on its log; where these do not change, both begin alike.
    No frame where they have less than a dozen in common.
    """
    begun = other.excitation.start_s - item.excitation.start_s
    grid, pressure = item.excitation.grid_s + begun, item.excitation.pressure

    def unlike(shift: float) -> float:
        return float(np.mean((other.excitation.at(grid + shift) - pressure) ** 2))

    shift = 0.0
    if pushed([item]):
        near = min(_SEARCHED_S, key=unlike)
        # Within a step of the search a fast tube goes many times as far as its track is noisy.
        between = minimize_scalar(
            unlike, bounds=(near - _STEP_S, near + _STEP_S), method="bounded", options={"xatol": 1e-6}
        )
        shift = min((near, float(between.x)), key=unlike)  # type: ignore[attr-defined]
    then = item.time + begun + shift
    inside = (then >= other.time[0]) & (then <= other.time[-1])
    apart = np.diff(other.time)  # across lost frames nothing was seen
    inside &= apart[np.clip(np.searchsorted(other.time, then) - 1, 0, apart.size - 1)] < 1.5 * np.median(apart)
    inside &= inside.sum() >= LEAST_COMMON
    # A line between two frames would cut the corners of a ringing tube: at 120 Hz by a third of a millimetre.
    return inside, CubicSpline(other.time, seen)(then[inside])


def noise_floor_deg(
    observed: Sequence[Observed],
    recordings: Mapping[str, Recording],
    *,
    left: Mapping[str, FloatArray] = MappingProxyType({}),
) -> float | None:
    """Noise floor of the bend angle, for runs that have no tip: its errors as stated, or as the high frequencies show them.

    `left` (frames, 1) in deg is what a model leaves of the angle, as for `noise_floor_mm`.
    """
    errors = []
    for item in observed:
        if item.has_tip or (left and item.name not in left):
            continue
        sigma = np.rad2deg(item.angle_sigma)
        if item.name in left and recordings[item.name].dataset.attrs.get("sigma_source") == ESTIMATED_ERRORS:
            seen = max(white_noise_mm(left[item.name]), rounding_noise(np.rad2deg(item.angle[:, None])))
            sigma = np.minimum(sigma, seen)
        errors.append(sigma)
    return float(np.median(np.concatenate(errors))) if errors else None


def _shared(item: Observed, data: xr.Dataset) -> float:
    """Variance (mm^2) of the tip that all frames of a run share and that the fit takes out: where the clamp was seen."""
    if item.origin_sigma == 0:
        return 0.0
    return float(sum(data.attrs.get(f"origin_sigma_{way}_mm", 0.0) ** 2 for way in ("along", "across")))
