"""What the tube was doing: rise, hold, fall, reversal, rest or ringing, frame by frame, from pressure and motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray

# Words for the eye: no fit and no verdict depends on these numbers, which were set on runs of the paper's kind.
SMOOTHING_S = 0.04  # of the pressure before its slope is taken: longer than a sensor's ripple, shorter than a step
REVERSAL_S = 0.15  # about a change of direction: a half swing of the paper's tube
TURNS_WITHIN_S = 0.3  # between rise and fall: longer is a hold
HOLDS = 0.03  # of the pressure's range per second: slower is no rise, but a regulator's creep
RESTS = 0.05  # of the pressure's range above its least
RINGS = 0.1  # of the bend's range per second, while the pressure holds
BEND_SMOOTHING_S = 0.02


def _smooth(time: FloatArray, values: FloatArray, width_s: float) -> FloatArray:
    period = float(np.median(np.diff(time))) if time.size > 1 else width_s
    count = max(1, round(width_s / max(period, 1e-9)) | 1)
    padded = np.pad(values, count // 2, mode="edge")
    return np.convolve(padded, np.full(count, 1 / count), mode="valid")[: values.size]


def label_phases(time: FloatArray, pressure: FloatArray, bend: FloatArray) -> NDArray[np.str_]:
    """One label per frame. time (s), pressure (any unit) and bend (any measure that grows with bending), all (frames,)."""
    smooth = _smooth(time, pressure, SMOOTHING_S)
    span = max(float(np.ptp(smooth)), 1e-12)
    rate = np.gradient(smooth, time) if time.size > 2 else np.zeros_like(smooth)
    moving = np.abs(rate) > HOLDS * span
    labels = np.full(time.size, "hold", dtype="U8")
    labels[(smooth < smooth.min() + RESTS * span) & ~moving] = "rest"
    labels[moving & (rate > 0)] = "rise"
    labels[moving & (rate < 0)] = "fall"
    # A hold in which the tube still moves is ringing.
    speed = np.abs(np.gradient(_smooth(time, bend, BEND_SMOOTHING_S), time)) if time.size > 2 else np.zeros_like(smooth)
    labels[~moving & (speed > RINGS * max(float(np.ptp(bend)), 1e-12))] = "ringing"
    sign = np.sign(np.where(moving, rate, 0.0))
    last, last_time = 0.0, -np.inf
    for k in range(time.size):
        if sign[k] != 0:
            if last != 0 and sign[k] != last and time[k] - last_time < TURNS_WITHIN_S:
                near = np.abs(time - time[k]) < REVERSAL_S / 2
                labels[near] = "reversal"  # its turning point included, though nothing moves there
            last, last_time = sign[k], time[k]
    return labels
