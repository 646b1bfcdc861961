"""A tube behind a valve, which fills and drains at rates of its own: the pressure that it feels when the sensor sees another."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray


def behind_a_valve(pressure: FloatArray, step_s: float, fill_s: float, drain_s: float) -> FloatArray:
    """Pressure (samples,) in a tube that follows that before its valve, with one time constant while it fills, another as it drains."""
    felt, now = np.empty_like(pressure), float(pressure[0])
    filling, draining = (1.0 - float(np.exp(-step_s / time_s)) for time_s in (fill_s, drain_s))
    for sample, before in enumerate(pressure):
        now += (before - now) * (filling if before > now else draining)
        felt[sample] = now
    return felt
