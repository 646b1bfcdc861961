"""What the tube was doing: rise, hold, fall, reversal, rest or ringing, frame by frame, from pressure and motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.scatter import scatter

# Words for the eye: no fit and no verdict depends on these numbers, which were set on runs of the paper's kind.
SMOOTHING_S = 0.04  # of the pressure before its slope is taken: longer than a sensor's ripple, shorter than a step
REVERSAL_S = 0.15  # about a change of direction: a half swing of the paper's tube
TURNS_WITHIN_S = 0.3  # between rise and fall: longer is a hold
HOLDS = 0.03  # of the pressure's range per second: slower is no rise, but a regulator's creep
RESTS = 0.05  # of the pressure's range beyond its least
RINGS = 0.1  # of the bend's range per second, while the pressure holds
BEND_SMOOTHING_S = 0.02
# Ripple of a regulator or of a sensor goes to and fro within that, and for more than half of the time nothing else does.
RIPPLE_WITHIN_S = 0.3
LARGEST_RIPPLE = 0.1  # of the range: more is motion


def _smooth(time: FloatArray, values: FloatArray, width_s: float) -> FloatArray:
    period = float(np.median(np.diff(time))) if time.size > 1 else width_s
    count = max(1, round(width_s / max(period, 1e-9)) | 1)
    padded = np.pad(values, count // 2, mode="edge")
    return np.convolve(padded, np.full(count, 1 / count), mode="valid")[: values.size]


def _without_ripple(time: FloatArray, values: FloatArray) -> FloatArray:
    """Values (frames,) that follow only what goes beyond the ripple of the given ones, as a gear with play does."""
    ripple = float(scatter((values - _smooth(time, values, RIPPLE_WITHIN_S))[:, None])[0])
    play = min(3 * ripple, LARGEST_RIPPLE * float(np.ptp(values)))
    out = values.copy()
    for k in range(1, values.size):
        out[k] = min(max(out[k - 1], values[k] - play), values[k] + play)
    return out


def _moving(
    time: FloatArray, values: FloatArray, width_s: float, least: float
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Smoothed values, their slope, and where it is more than `least` of their range a second (frames,)."""
    smooth = _smooth(time, _without_ripple(time, values), width_s)
    rate = np.gradient(smooth, time) if time.size > 2 else np.zeros_like(smooth)
    return smooth, rate, np.abs(rate) > least * max(float(np.ptp(smooth)), 1e-12)


def label_phases(time: FloatArray, pressure: FloatArray, bend: FloatArray) -> NDArray[np.str_]:
    """One label per frame. time (s), pressure (any unit) and bend (any measure that grows with bending), all (frames,)."""
    smooth, rate, moving = _moving(time, pressure, SMOOTHING_S, HOLDS)
    labels = np.full(time.size, "hold", dtype="U8")
    least = np.abs(smooth)  # of chambers on both sides the sum falls below zero where it bends to the other
    labels[(least < least.min() + RESTS * np.ptp(smooth)) & ~moving] = "rest"
    labels[moving & (rate > 0)] = "rise"
    labels[moving & (rate < 0)] = "fall"
    # A hold in which the tube moves to and fro is ringing; one in which it creeps is not.
    _, speed, swings = _moving(time, bend, BEND_SMOOTHING_S, RINGS)
    labels[~moving & swings & _turns_near(time, np.where(swings, speed, 0.0))] = "ringing"
    for turn in _turns(time, np.where(moving, rate, 0.0)):
        # Its turning point included, though nothing moves there.
        labels[np.abs(time - turn) < REVERSAL_S / 2] = "reversal"
    return labels


def _turns(time: FloatArray, rate: FloatArray) -> FloatArray:
    """Times at which the direction has changed, where no longer pause lies between; a rate of 0 is a pause."""
    going = np.flatnonzero(rate)
    ways, times = np.sign(rate[going]), time[going]
    return times[1:][(np.diff(ways) != 0) & (np.diff(times) < TURNS_WITHIN_S)]


def _turns_near(time: FloatArray, rate: FloatArray) -> NDArray[np.bool_]:
    """Where (frames,) the direction changes within the next or the last `TURNS_WITHIN_S`."""
    turns = np.concatenate([[-np.inf], _turns(time, rate), [np.inf]])
    after = np.searchsorted(turns, time)
    return np.minimum(np.abs(turns[after] - time), np.abs(time - turns[after - 1])) < TURNS_WITHIN_S
