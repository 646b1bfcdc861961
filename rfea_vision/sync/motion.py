"""The offset between two clocks from the motion itself.

Inverse dynamics as a regression: whatever its parameters are, the tube's equation of motion gives the pressure from
shape, velocity and acceleration at the same instant (`rfea_vision.sync.sections`). The offset is where this explains
most of the logged pressure. Stiffness, damping and inertia are free coefficients, so the tube's own delay is left to
the model that is fitted later. Both sides pass the same zero-phase filter. What the regression cannot tell from an
offset is a line that delays the pressure itself. A pressure so slow that this leaves nothing of it is for `rfea_vision.sync.slow`.

Where the tube's law lacks something that the data show, a term of `sections.SUPPLEMENTS` is added. The regression
itself, with the noise of its terms and its errors, is `rfea_vision.sync.regression`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Track
from rfea_vision.errors import DataError
from rfea_vision.sync.alignment import Alignment
from rfea_vision.sync.ambiguity import check_direction, log_notes, repeat_notes, repetition, short_log
from rfea_vision.sync.filters import LOW_HZ, FilteredMotion, Target, without_slow
from rfea_vision.sync.regression import (
    DRIFT,
    FIRST_TERM,
    LEAST_EXPLAINED,
    OFFSET,
    Moments,
    choose,
    moments,
    shift_by_noise,
    standard_error,
    with_possible_noise,
)
from rfea_vision.sync.sections import ANGLE_INERTIA, ANGLE_STIFFNESS, SUPPLEMENTS, motion_of
from rfea_vision.sync.slow import align_by_bend, is_slow

COARSE_S = 0.006  # a twentieth of the shortest period of the band
LEAST_OVERLAP_S, LEAST_FRAMES = 1.0, 60  # a period of LOW_HZ, nearly
HIGHEST_OF_LOG_RATE = 0.15  # of the log's rate: a third of what it can show
BETWEEN_SAMPLES = 1.2  # s^-1: times the square of the log's step, as a standard error
LEAST_SWING_KPA = 1.0  # a log that moves by less is flat
FLAT_REMEDY = "check the column and its unit, say 'pressure: {value: 50 kPa}' of a run at constant pressure, or use sync.method offset"
LEAST_SWING_DEG = 1.0  # less is hardly told from noise
SLOWEST_RAD_S = 10.0  # first mode of a slow tube, where the angle alone does not tell it
ONE_ANGLE = "tip or angle alone do not show the tube's shape: the bend's own delay along the tube is within the error"
COUNTED_DRIFT = "drift taken into account"
REMARKS = frozenset({ONE_ANGLE, COUNTED_DRIFT})  # what a person need do nothing about
LEFT_THE_PEAK = "the tube does more than the law of the clocks, as one that rubs or remembers: the fit is left to find the best offset"
LEAST_ERROR_S = 5e-5  # four modes and the filters' own errors


def align_by_motion(
    track: Track,
    log_time_s: FloatArray,
    pressure_kPa: FloatArray,
    *,
    experiment: str,
    bends: str,
    gravity_deg: float | None = 0.0,
) -> Alignment:
    """Estimate offset (s) and drift (ppm) of the log's clock against the camera's.

    log_time_s, pressure_kPa : (samples,) the log on its own clock; bends : the side to which pressure bends the tube
    gravity_deg : where gravity points, from down and positive towards that side; None where the plane of motion is level

    Raises
    ------
    DataError
        If the motion or the pressure is too small, or the two do not belong together.
    """
    motion = motion_of(track, bends, gravity_deg)
    time = motion.time_s
    film_s = float(np.ptp(time)) if len(time) else 0.0
    if len(time) < LEAST_FRAMES or film_s < LEAST_OVERLAP_S:
        raise DataError(
            f"{experiment}: sync: {len(time)} tracked frames over {film_s:.2f} s are too few to align by motion, which needs "
            f"{LEAST_FRAMES} over {LEAST_OVERLAP_S:g} s; record longer, or use sync.method offset"
        )
    if motion.swing_rad < np.radians(LEAST_SWING_DEG):
        raise DataError(
            f"{experiment}: sync: the tube bends by only {np.degrees(motion.swing_rad):.2f} deg; use sync.method offset, led or trigger"
        )
    log_rate = 1.0 / float(np.median(np.diff(log_time_s)))
    seen = FilteredMotion.of(motion, HIGHEST_OF_LOG_RATE * log_rate)
    target = Target(log_time_s, pressure_kPa, seen.rate, seen.high)
    if (swing := float(np.ptp(target.smooth))) < LEAST_SWING_KPA:
        raise DataError(f"{experiment}: pressure: the log is flat but for its noise ({swing:.2f} kPa once smoothed); {FLAT_REMEDY}")
    if is_slow(seen, target):
        found = align_by_bend(seen, target, experiment=experiment, bends=bends)
    else:
        found = align_by_law(seen, target, experiment=experiment)
    if found.explained < LEAST_EXPLAINED:
        told = f"the motion explains only {100 * max(found.explained, 0.0):.0f} % of the pressure at any offset"
        why = "check that motion and log belong together"
        if found.explained == 0.0:
            told = f"at any offset too few of {len(time)} tracked frames lie within the log, beside gaps and what is lost at the ends"
            why = "record longer, or at a higher rate"
        raise DataError(f"{experiment}: sync: {told}; {short_log(time, log_time_s, LEAST_EXPLAINED) or why}, or use sync.method offset")
    shifted = time * (1 + 1e-6 * found.drift_ppm) + found.offset_s
    within = (shifted > log_time_s[0]) & (shifted < log_time_s[-1])
    pressed = np.interp(shifted[within], log_time_s, pressure_kPa)
    check_direction(motion.bend_rad[within], pressed, experiment=experiment, bends=bends)
    # A slow log knows the pressure between its samples by a line only.
    error = float(np.hypot(found.offset_stderr_s, BETWEEN_SAMPLES / log_rate**2))
    notes = [
        *log_notes(log_time_s, target.gaps),
        *repeat_notes(motion.repeats, len(time)),
        *([found.note] if found.note else []),
    ]
    return replace(found, offset_stderr_s=error, note="; ".join(notes))


def align_by_law(seen: FilteredMotion, target: Target, *, experiment: str) -> Alignment:
    """The offset at which the tube's law explains most of the pressure within the band; `explained` is small where it does not.

    Raises
    ------
    DataError
        If several offsets explain it alike.
    """
    offsets, shares, own = search(seen, target)
    best = int(np.argmax(shares))
    if shares[best] < LEAST_EXPLAINED:
        return Alignment(float(offsets[best]), explained=float(shares[best]))
    repeats, doubt_s = repetition(offsets, shares, own, slowest_s=1 / LOW_HZ, experiment=experiment)
    found = refine(seen, target, float(offsets[best]), (offsets, shares))
    away_s = abs(found.offset_s - float(offsets[best]))
    if away_s > 0.5 / seen.high and found.explained < shares[best]:  # it has left the peak, beyond which no slope leads
        kept = replace(found, offset_s=float(offsets[best]), drift_ppm=0.0, explained=float(shares[best]))
        found = replace(kept, offset_stderr_s=float(np.hypot(found.offset_stderr_s, away_s)), note=LEFT_THE_PEAK)
    note = "; ".join(filter(None, [repeats, found.note]))
    return replace(found, offset_stderr_s=float(np.hypot(found.offset_stderr_s, doubt_s)), note=note)


def search(seen: FilteredMotion, target: Target) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Every offset (k,) in s at which enough of the motion lies within the log; the share (k,) of the pressure that is explained.

    Twice: as a share of the whole motion, and of the part within the log.
    """
    thin = slice(None, None, max(len(seen.grid) // 1200, 1))
    grid, solid, x = seen.grid[thin], seen.solid[thin], seen.terms[:, thin]
    span = grid[-1] - grid[0]
    least = min(max(LEAST_OVERLAP_S, 0.5 * min(span, target.last - target.first)), span)
    low, high = target.first - grid[-1] + least, target.last - grid[0] - least
    offsets = np.linspace(low, high, int(max((high - low) / COARSE_S, 1)) + 1)
    whole = _projector(x[:, solid])
    overall = float(np.mean(target.values**2))
    shares, own = np.zeros(len(offsets)), np.zeros(len(offsets))
    for k, offset in enumerate(offsets):
        values, inside = target.at(grid + offset)
        use = solid & inside
        if use.sum() < 4 * x.shape[2] or np.mean(values[use] ** 2) < 0.05 * overall:
            continue
        if use.sum() == solid.sum():
            projector = whole
        else:
            if k % 4:  # partial overlaps cost more; every fourth is enough to find the place
                continue
            projector = _projector(x[:, use])
        y = values[use]
        # A short overlap is easily explained: what counts is the share of the whole motion.
        own[k] = np.sum((projector.T @ y) ** 2) / (len(x) * float(y @ y))
        shares[k] = own[k] * use.sum() / solid.sum()
        if use.sum() < 0.5 * solid.sum():  # a short piece can be explained at many places
            own[k] = 0.0
    return offsets, shares, own


def _projector(x: FloatArray) -> FloatArray:
    """Sum over sections of an orthonormal basis of the stacked terms, (n, terms)."""
    sections, n, count = x.shape
    flat = x.reshape(sections * n, count)
    q = np.linalg.qr(flat / (np.linalg.norm(flat, axis=0) + 1e-12))[0]
    return q.reshape(sections, n, count).sum(axis=0)


def refine(seen: FilteredMotion, target: Target, offset: float, curve: tuple[FloatArray, FloatArray]) -> Alignment:
    """Newton steps from an offset (s) to the best one, its standard error, and the drift.

    curve : offsets (k,) in s and shares (k,) that are explained, as `search` finds them; they are handed on
    """
    use = seen.solid & target.inside(seen.grid + offset - COARSE_S) & target.inside(seen.grid + offset + COARSE_S)
    columns = seen.columns(seen.raw, use)
    each = seen.noises(use, columns)
    extra = list(range(FIRST_TERM + columns.shape[2] - len(SUPPLEMENTS), FIRST_TERM + columns.shape[2]))
    chosen = [OFFSET, *range(FIRST_TERM, extra[0])]
    offset, found = _newton(seen, target, offset, use, columns, each[0], chosen)
    lasting = 0.5 * found.unaccounted(chosen)  # half: the rest of what noise does not explain may be lacking in the law
    noises = np.concatenate([np.sqrt(2 * (1 - lasting)) * each[0], np.sqrt(2 * lasting) * each[1]])
    for _ in range(2):  # supplements change the offset, and the offset which supplements are chosen
        offset, found = _newton(seen, target, offset, use, columns, noises, chosen)
        chosen = choose(found, [OFFSET, *range(FIRST_TERM, extra[0])], extra)
    offset, found = _newton(seen, target, offset, use, columns, noises, chosen)
    others = [_newton(seen, target, offset, use, columns, kind, chosen) for kind in each]
    by_white = others[0][0] - offset
    most = max(abs(at - offset + shift_by_noise(sums, chosen)) for at, sums in others)
    doubt = float(np.linalg.norm([LEAST_ERROR_S, by_white, most / np.sqrt(3)]))  # noise may have made any part of the rest
    error = float(np.hypot(standard_error(found, chosen, extra), doubt))
    both = [OFFSET, DRIFT, *chosen[1:]]
    drift_error = standard_error(found, both, extra, DRIFT)
    change = found.solve(both)[:2] / found.scale[:2]
    middle, drift, note = float(seen.grid[use].mean()), 0.0, ""
    if abs(change[1]) > 4 * drift_error and abs(change[1]) > 20e-6 and drift_error < 50e-6:
        drift, note = float(change[1]), COUNTED_DRIFT
        offset = offset + float(change[0]) - drift * middle
        error = float(np.sqrt(standard_error(found, both, extra) ** 2 + (middle * drift_error) ** 2 + doubt**2))
    if not seen.motion.modal:
        error = float(np.hypot(error, _lag_of_one_angle(found)))
        note = f"{note}; {ONE_ANGLE}" if note else ONE_ANGLE
    explained = 1.0 - found.rest(chosen)[0] / max(found.power, 1e-12)
    return Alignment(offset, error, 1e6 * drift, 1e6 * drift_error, explained, curve, note)


def _lag_of_one_angle(found: Moments) -> float:
    """Standard error, s, of the time by which one angle lags beyond what its own stiffness and inertia tell.

    The bend takes its time along the tube, which one angle does not show: anything from nothing to the inverse of the
    first natural frequency, the tangent at the tip more than the chord.
    """
    columns = [OFFSET, *range(FIRST_TERM, FIRST_TERM + ANGLE_INERTIA + 1)]
    solution = found.solve(columns) / found.scale[columns]
    stiffness, inertia = solution[1 + ANGLE_STIFFNESS], solution[1 + ANGLE_INERTIA]
    first = float(np.sqrt(stiffness / inertia)) if stiffness * inertia > 0 else SLOWEST_RAD_S
    return 1.0 / (np.sqrt(12) * max(first, SLOWEST_RAD_S))


def _newton(
    seen: FilteredMotion,
    target: Target,
    offset: float,
    use: NDArray[np.bool_],
    columns: FloatArray,
    noises: FloatArray,
    chosen: list[int],
) -> tuple[float, Moments]:
    """Best offset for the chosen columns, and the sums there."""
    times = seen.grid[use]
    sections = len(columns)
    for last in range(15):
        shifted = seen.grid + offset
        pressure = without_slow(np.interp(shifted, target.time, target.smooth), use, seen.rate)
        slope = np.interp(shifted, target.time, target.smooth_slope)
        moving = np.column_stack(
            [without_slow(-slope, use, seen.rate), without_slow(-slope * (seen.grid - times.mean()), use, seen.rate)]
        )
        every = np.concatenate([np.broadcast_to(moving, (sections, *moving.shape)), columns], axis=2)
        found = with_possible_noise(moments(every, noises, pressure, seen.rate), chosen)
        change = float(np.clip(found.solve(chosen)[0] / found.scale[OFFSET], -0.015, 0.015))
        if abs(change) < 1e-7 or last == 14:
            break
        offset += change
    return offset, found
