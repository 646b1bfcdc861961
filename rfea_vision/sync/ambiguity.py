"""Reasons to doubt an alignment by motion, each as a sentence: gaps, slow logs, repetition, the wrong direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.errors import DataError, InputError

GAP_STEPS = 4.0  # a step so many times the usual one is a gap,
LEAST_GAP_S = 0.03  # and no shorter than a frame at 33 Hz
APART_S = 0.12  # two offsets nearer than this are one peak
ALIKE = 1.6  # a rival explains as well if it leaves at most so much more unexplained,
ALIKE_SHARE = 0.004  # plus this share of the pressure,
ALIKE_AT_MOST = 0.02  # and no more than this share of the motion: wind or a missing effect makes no excitation repeat
SLOW_LOG_HZ = 30.0  # four samples to a period of `HIGH_HZ`


def gaps_of(log_time_s: FloatArray) -> FloatArray:
    """Begin and end (k, 2) of stretches in which the log has no samples."""
    steps = np.diff(log_time_s)
    long = steps > max(GAP_STEPS * float(np.median(steps)), LEAST_GAP_S)
    return np.column_stack([log_time_s[:-1][long], log_time_s[1:][long]])


def outside_gaps(times: FloatArray, gaps: FloatArray, reach_s: float) -> NDArray[np.bool_]:
    """Which `times` (samples,) in s are farther than `reach_s` from every gap (k, 2): so far a filter spreads interpolated values."""
    good = np.ones(len(times), dtype=bool)
    for begin, end in gaps:
        good &= (times < begin - reach_s) | (times > end + reach_s)
    return good


def log_notes(log_time_s: FloatArray, gaps: FloatArray) -> list[str]:
    """Sentences about the log's clock: times (samples,) in s, and its gaps (k, 2) as `gaps_of` finds them."""
    notes = []
    if len(gaps):
        lengths = gaps[:, 1] - gaps[:, 0]
        notes.append(
            f"the log has {len(gaps)} gap{'s' if len(gaps) > 1 else ''} of together {lengths.sum():.2f} s, the first at "
            f"{gaps[0, 0]:.2f} s; nothing was aligned there"
        )
    rate = 1.0 / float(np.median(np.diff(log_time_s)))
    if rate < SLOW_LOG_HZ:
        notes.append(f"the log has only {rate:.3g} samples per second, which limits the offset; log at 100 Hz or more")
    return notes


def short_log(time_s: FloatArray, log_time_s: FloatArray, share: float) -> str:
    """Say that a log (samples,) lasts less than a share of what the frames (n,) do, wherever it begins, and the remedy; else empty."""
    film_s, log_s = float(np.ptp(time_s)), float(np.ptp(log_time_s))
    if log_s >= share * film_s:
        return ""
    return f"the film lasts {film_s:.2f} s and the log {log_s:.2f} s, which is all that both can share; give the log of the whole run"


def repeat_notes(repeats: int, frames: int) -> list[str]:
    """Notes on frames that repeat the picture before; none on a few, which are chance."""
    if repeats <= max(2, 0.003 * frames):
        return []
    return [f"at least {repeats} frames show the picture before once more, and were left out"]


def slow_note(away_s: float) -> str:
    """What is said of offsets so far apart (s) of which none can be told from the others."""
    return (
        f"the pressure changes too slowly to tell offsets within {away_s:.2f} s apart: the fit is left to find the best of "
        "them; begin the run with a step, or use sync.method led, trigger or offset"
    )


def repetition(
    offsets: FloatArray, shares: FloatArray, own: FloatArray, *, slowest_s: float, experiment: str
) -> tuple[str, float]:
    """A note where the excitation nearly repeats, or is slow, and a standard error (s); an error where repetitions are alike.

    A slow excitation leaves several offsets within `slowest_s` of one another, and none farther away: the best is taken, with a
    standard error that covers the others.

    Parameters
    ----------
    offsets : (n,) s
    shares : explained share of the motion, less what lies outside of the log
    own : explained share of what lies within the log
    slowest_s : the longest period that is compared

    Raises
    ------
    DataError
        If another offset explains the whole motion as well as the best one.
    """
    best = int(np.argmax(shares))
    rivals = _rivals(offsets, own, best)
    if len(rivals) == 0:
        return "", 0.0
    # Where a rival leaves more of the film outside of the log, the better covered offset is taken, and that is said.
    covered = np.divide(shares, own, out=np.zeros_like(shares), where=own > 0)
    as_good = rivals[covered[rivals] > 0.97 * covered[best]]
    away_s = float(np.max(np.abs(offsets[as_good] - offsets[best]), initial=0.0))
    if 0 < away_s < slowest_s:
        return slow_note(away_s), away_s / float(np.sqrt(2))
    if len(as_good):
        nearest = as_good[np.argmin(np.abs(offsets[as_good] - offsets[best]))]
        raise DataError(
            f"{experiment}: sync: the excitation repeats: offsets of {offsets[best]:.2f} s and {offsets[nearest]:.2f} s "
            "explain the motion equally well; begin the run with something that does not repeat, "
            "or use sync.method led, trigger or offset"
        )
    nearest = rivals[np.argmin(np.abs(offsets[rivals] - offsets[best]))]
    return (
        f"the excitation nearly repeats after {abs(offsets[nearest] - offsets[best]):.2f} s; "
        "the offset at which the log covers most of the film was taken"
    ), 0.0


def _rivals(offsets: FloatArray, own: FloatArray, best: int) -> NDArray[np.intp]:
    """Local maxima apart from the best that explain as well."""
    known = np.flatnonzero(own > 0)
    inner = known[1:-1]
    found = inner[(own[inner] >= own[known[:-2]]) & (own[inner] >= own[known[2:]])]
    alike = (1 - own[found]) <= ALIKE * (1 - own[best]) + ALIKE_SHARE
    alike &= own[found] >= own[best] - ALIKE_AT_MOST
    return found[alike & (np.abs(offsets[found] - offsets[best]) > APART_S)]


def check_direction(bend_rad: FloatArray, pressure_kPa: FloatArray, *, experiment: str, bends: str) -> None:
    """Refuse a motion that falls as the pressure rises: the direction of bending or the sign of the pressure is wrong.

    bend_rad, pressure_kPa : (frames,) angle to the side where it should bend, and the pressure at the same times

    Raises
    ------
    InputError
        If the bend falls as the pressure rises.
    """
    if len(bend_rad) < 10 or np.ptp(bend_rad) == 0 or np.ptp(pressure_kPa) == 0:
        return
    if float(np.corrcoef(bend_rad, pressure_kPa)[0, 1]) < -0.5:
        raise InputError(
            f"{experiment}: sync: the tube's bend falls as the pressure rises; actuator.bends says '{bends}': correct "
            "it, the sign of pressure.pressure, or video.rate where the film runs too fast or too slow"
        )
