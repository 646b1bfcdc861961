"""Pressure programmes: what a valve is told, and what it makes of it.

Programmes differ in what they excite: holds show slow memory, ramps rate dependence, multi-sines the spectrum,
staircases the static curve. All start with a rest at their first level, and all stay within 0 and the rig's limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from rfea_vision.arrays import FloatArray

GRID_S = 0.00025  # a quarter of the log's step

# order in which experiments take them: two runs for training should already differ in kind
KINDS = ("steps", "multisine", "mixed", "staircase", "ramps")


@dataclass(frozen=True)
class Programme:
    """Pressure in the line over time on an even grid of `GRID_S`, linear in between; Pa."""

    kind: str
    time_s: FloatArray
    pressure_Pa: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        """Pressure (times,) in Pa at any time in s; the ends hold."""
        return np.interp(time_s, self.time_s, self.pressure_Pa)


def programme(
    kind: str, generator: np.random.Generator, start_s: float, end_s: float, rest_until_s: float, highest_Pa: float
) -> Programme:
    """Draw one programme of a kind.

    Parameters
    ----------
    kind : one of `KINDS`
    start_s, end_s : of the pressure log
    rest_until_s : until then the line is at rest
    highest_Pa : never exceeded
    """
    time = start_s + GRID_S * np.arange(int(np.ceil((end_s - start_s) / GRID_S)) + 1, dtype=float)
    moving = np.maximum(time - rest_until_s, 0.0)
    duration = end_s - rest_until_s
    command = highest_Pa * _DRAW[kind](moving, duration, generator)
    valve = generator.uniform(0.025, 0.06)
    pressure = _first_order(_first_order(command, valve), 0.3 * valve)
    return Programme(kind, time, np.clip(pressure, 0.0, highest_Pa))


def given_programme(time_s: FloatArray, pressure_Pa: FloatArray) -> Programme:
    """A logged pressure (rows,) in Pa as a programme that starts at 0 s."""
    time = GRID_S * np.arange(int(np.floor((time_s[-1] - time_s[0]) / GRID_S)) + 1, dtype=float)
    return Programme("given", time, np.interp(time, time_s - time_s[0], pressure_Pa))


def _first_order(signal: FloatArray, constant_s: float) -> FloatArray:
    share = 1 - np.exp(-GRID_S / constant_s)
    return lfilter([share], [1.0, share - 1.0], signal, zi=[(1 - share) * signal[0]])[0]


def _levels(moving: FloatArray, times: FloatArray, levels: FloatArray) -> FloatArray:
    """Piecewise constant: `levels[i]` from `times[i]` on; 0 before the first."""
    index = np.searchsorted(times, moving, side="right")
    return np.where(moving > 0, np.concatenate([[0.0], levels])[index], 0.0)


def _steps(moving: FloatArray, duration: float, generator: np.random.Generator) -> FloatArray:
    """Steps up and down with holds of differing length, one of them back at rest."""
    count = max(4, round(duration / 0.9))
    holds = generator.uniform(0.6, 1.5, count)
    times = np.concatenate([[0.0], np.cumsum(holds)[:-1]]) * duration / holds.sum()
    levels = np.empty(count)
    levels[0::2] = generator.uniform(0.55, 1.0, levels[0::2].size)
    levels[1::2] = generator.uniform(0.05, 0.45, levels[1::2].size)
    levels[generator.integers(0, (count + 1) // 2) * 2] = 1.0
    levels[generator.integers(1, count // 2 + 1) * 2 - 1] = 0.0
    return _levels(moving, times, levels)


def _staircase(moving: FloatArray, duration: float, generator: np.random.Generator) -> FloatArray:
    """Up a staircase and down again, in uneven steps."""
    up = max(3, round(duration / 1.6))
    rise = np.cumsum(generator.uniform(0.7, 1.3, up))
    down = np.cumsum(generator.uniform(0.7, 1.3, up - 1))
    levels = np.concatenate([rise / rise[-1], 1 - down / (down[-1] + generator.uniform(0.0, 0.6))])
    times = np.arange(levels.size) * duration / levels.size
    return _levels(moving, times, levels)


def _ramps(moving: FloatArray, duration: float, generator: np.random.Generator) -> FloatArray:
    """Ramps of differing rate between turning points, with short holds."""
    count = max(4, round(duration / 1.1))
    share = generator.uniform(0.5, 1.8, count)
    knots = np.concatenate([[0.0], np.cumsum(share)]) * duration / share.sum()
    levels = np.zeros(count + 1)
    levels[1::2] = generator.uniform(0.6, 1.0, levels[1::2].size)
    levels[2::2] = generator.uniform(0.0, 0.4, levels[2::2].size)
    levels[1 + 2 * generator.integers(0, levels[1::2].size)] = 1.0
    held = np.repeat(knots, 2)[1:]
    held[1::2] += 0.25 * np.diff(np.append(knots, duration + 1.0))[: held[1::2].size]
    return np.interp(moving, held, np.repeat(levels, 2)[:-1])


def _multisine(moving: FloatArray, duration: float, generator: np.random.Generator) -> FloatArray:
    """Sum of sines from 0.2 to 5 Hz about half the range, faded in, scaled to use the range."""
    frequency = np.geomspace(0.2, 5.0, 9) * generator.uniform(0.93, 1.07, 9)
    phase = generator.uniform(0, 2 * np.pi, 9)
    wave = np.sum(frequency[:, None] ** -0.7 * np.sin(2 * np.pi * frequency[:, None] * moving + phase[:, None]), axis=0)
    active = moving > 0
    low, high = wave[active].min(), wave[active].max()
    fade = np.clip(moving / 0.3, 0.0, 1.0)
    return np.where(active, (0.05 + 0.93 * (wave - low) / (high - low)) * fade, 0.0)


def _mixed(moving: FloatArray, duration: float, generator: np.random.Generator) -> FloatArray:
    """A step with its hold, a rest, then a ramp with a sine on it."""
    split = duration * generator.uniform(0.42, 0.52)
    first = _levels(moving, np.array([0.0, 0.6 * split]), np.array([generator.uniform(0.65, 0.95), 0.0]))
    later = moving - split
    rest = duration - split
    ramp = np.interp(later, [0.0, 0.55 * rest, 0.7 * rest, rest], [0.0, 0.85, 0.85, 0.25])
    frequency = generator.uniform(1.2, 2.5)
    wave = 0.13 * np.sin(2 * np.pi * frequency * later) * np.clip(ramp / 0.3, 0.0, 1.0)
    return np.where(later > 0, np.clip(ramp + wave, 0.0, 1.0), first)


_DRAW = {"steps": _steps, "multisine": _multisine, "mixed": _mixed, "staircase": _staircase, "ramps": _ramps}
