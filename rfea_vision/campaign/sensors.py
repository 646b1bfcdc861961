"""Faults that show in a log's rows alone: a sensor stuck at one value, missing rows, two recordings mixed into one."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray, stretches
from rfea_vision.scatter import rounding_noise, third_difference_noise

#: Successive rows with exactly one value that are no chance: with noise above the last digit, a row equals the one before with a
#: probability of a half at most, and 30 rows do so in one of 10^9 logs.
_ROWS = 30
#: Noise over the step of the last digit, below which equal rows are normal.
_NOISY = 1.0
#: A dropout to zero falls and rises by this share of the log's span from one row to the next, and lasts for at most this share of its
#: rows: a tube that is vented by valves rests for longer. Chosen.
_LEAP, _MOMENT = 0.2, 0.05
#: A pause is longer than so many usual steps, and than so many s: water and tube follow a valve within a tenth of a second.
_PAUSE_STEPS, _PAUSE_S = 10.0, 0.1
#: Share of the usual step within which the steps of an even clock agree; and the quantile of the steps that is the usual one.
_EVEN, _NEARLY_ALL = 0.1, 0.75


def of_mixed(time_s: FloatArray) -> list[str]:
    """Doubt a log (samples,) that is read evenly but for a stretch, in which rows come twice as densely: two are mixed there."""
    steps = np.diff(time_s)
    if steps.size < 4 * _ROWS:
        return []
    usual = float(np.quantile(steps, _NEARLY_ALL))  # up to three quarters of the rows may lie in the stretch
    uneven = np.abs(steps - usual / 2) > _EVEN * usual  # a log that is read twice as fast for a while is not meant
    apart = (np.abs(steps[:-1] + steps[1:] - usual) < _EVEN * usual) & uneven[:-1]
    even = np.abs(steps - usual) < _EVEN * usual
    begins, ends = stretches(apart)
    if not begins.size or (ends - begins).max() < _ROWS:
        return []
    longest = int(np.argmax(ends - begins))
    inside = np.zeros(steps.size, dtype=bool)
    inside[begins[longest] : ends[longest] + 1] = True
    if (~inside).sum() < _ROWS or np.mean(even[~inside]) < 1 - _EVEN:
        return []
    from_s, to_s = time_s[begins[longest]], time_s[ends[longest]]
    return [
        f"from {from_s:.3f} to {to_s:.3f} s its rows come twice as densely as elsewhere; are two recordings mixed there, as when a log "
        "is sorted whose clock was set back? Split it, or move the rows after that on, before they are sorted"
    ]


def of_pauses(time_s: FloatArray) -> list[str]:
    """Doubt a log (samples,) that is read evenly, and stretches of which are missing: between their ends a straight line is taken."""
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if steps.size > _ROWS else np.inf
    paused = np.flatnonzero(steps > max(_PAUSE_STEPS * usual, _PAUSE_S))
    if not paused.size or np.mean(np.abs(steps - usual) < _EVEN * usual) < 1 - _EVEN:
        return []
    longest = paused[np.argmax(steps[paused])]
    where = f"from {time_s[longest]:.3f} to {time_s[longest + 1]:.3f} s" + " and elsewhere" * (paused.size > 1)
    return [f"has no row {where}, and a straight line stands in for the pressure there; did the logger pause? Cut the run there"]


def of_standstill(pressure_kPa: FloatArray, unit: str = "kPa") -> list[str]:
    """Doubt a pressure (samples,), or a force, that stands at exactly one value, row after row, where elsewhere it is noisy.

    Zero and the lowest value count where the pressure leaps there and back alone: at rest many sensors end there, which does no harm.
    """
    turns = np.flatnonzero(np.diff(pressure_kPa)) + 1
    begins, ends = np.concatenate([[0], turns]), np.concatenate([turns, [len(pressure_kPa)]])
    lasts = ends - begins
    low, high = float(pressure_kPa.min()), float(pressure_kPa.max())
    leaps = np.abs(np.diff(pressure_kPa)) > _LEAP * (high - low)
    inside = (begins > 0) & (ends < len(pressure_kPa)) & (lasts < _MOMENT * len(pressure_kPa))
    torn = inside & leaps[np.maximum(begins - 1, 0)] & leaps[np.minimum(ends, len(pressure_kPa) - 1) - 1]
    rests = (pressure_kPa[begins] == low) | (pressure_kPa[begins] == 0.0)
    stands = (lasts >= _ROWS) & (torn | ~rests)
    if not stands.any():
        return []
    lively = pressure_kPa[~np.repeat(lasts >= _ROWS, lasts)][:, None]
    if len(lively) < _ROWS:
        return []
    noise, step = float(third_difference_noise(lively)[0]), rounding_noise(lively) * np.sqrt(12.0)
    if noise < _NOISY * step:
        return []
    rows = int(lasts[stands].sum())
    at = pressure_kPa[begins[stands]]
    if np.all(at == high):
        return [
            f"stands at exactly {high:.6g} {unit}, the highest of the log, in {rows} of {len(pressure_kPa)} rows, and elsewhere "
            f"scatters by {noise:.2g} {unit}; does the sensor's or the logger's range end there? The tube felt more than that"
        ]
    longest = int(np.argmax(np.where(stands, lasts, 0)))
    return [
        f"stands at exactly {pressure_kPa[begins[longest]]:.6g} {unit} for {lasts[longest]} rows, from row {begins[longest] + 1} on, "
        f"and elsewhere scatters by {noise:.2g} {unit}; did the sensor or the logger hang, or a plug come off? Take the run anew, or "
        "cut it before that"
    ]


def of_tension(tension_N: FloatArray) -> list[str]:
    """Doubt the tension of a tendon (rows,): it pulls, and changes."""
    lowest, highest = float(tension_N.min()), float(tension_N.max())
    if lowest == highest:
        return ["is flat: nothing can be synchronised or fitted on it; is it the right column?"]
    if -lowest > max(highest, 0.0):
        return ["is below zero where it is largest, and a tendon only pulls; is its sign turned in the log?"]
    return of_standstill(tension_N, "N")
