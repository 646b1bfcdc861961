"""Whether one run is off as if its pressure log had another gain than those of the other runs: a unit, or a sensor's range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import ExperimentScore
from rfea_vision.dynamics.simulation import Model
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.residuals import predict_observed, rows, side_by_side
from rfea_vision.fitting.rules import CONSTANT_PA
from rfea_vision.units import rounded

#: Frames of a run that tell its gain.
_FRAMES = 300
#: Gains (log) are looked for so far to both sides, to this error. `rfea check` doubts from a factor of four on by itself.
_REACH, _ERROR = float(np.log(6.0)), 0.01
#: A gain is odd from this factor on, and where it is as many times as far from all others as these are from one another. Chosen: what
#: is missing from a model moves the gains of runs apart by up to 6 %, and none of them stands alone.
_ODD, _APART = 1.2, 3.0
#: With its gain a run must lose all but this share of its squared error: a missing effect is made up for in part.
_LEFT = 0.25
#: A run whose pressure (with its gain) changes by more or less than this factor beside that of the others asks for other physics:
#: that of a tube that stiffens as it bends, say.
_ALIKE = 2.0


def odd_pressure(model: Model, par: FloatArray, items: Sequence[Observed], clocks: FloatArray) -> dict[str, float]:
    """How many times what the other runs' logs tell that of one run tells, by its name; empty where none stands apart.

    One gain of the pressure is found for each run, the model left as it was fitted: par (parameters,) in SI, clocks (runs,) in s.
    """
    pushed = [k for k, item in enumerate(items) if np.ptp(item.excitation.pressure) > CONSTANT_PA]
    if len(pushed) < 3:  # of two runs neither is the odd one
        return {}
    found = side_by_side(lambda k: _gain(model, par, items[k].rough(_FRAMES), float(clocks[k])), pushed)
    known = [(items[k], *one) for k, one in zip(pushed, found, strict=True) if one is not None]
    gains = np.array([gain for _, gain, _ in known])
    felt = np.array([np.log(np.ptp(item.excitation.pressure)) + gain for item, gain, _ in known])
    for k, (item, gain, left) in enumerate(known):
        others = np.delete(gains, k)
        if others.size < 2 or left > _LEFT or abs(felt[k] - np.median(np.delete(felt, k))) > np.log(_ALIKE):
            continue
        if np.abs(others - gain).min() > max(np.log(_ODD), _APART * np.ptp(others)):
            return {item.name: float(np.exp(np.median(others) - gain))}
    return {}


def _gain(model: Model, par: FloatArray, item: Observed, clock_s: float) -> tuple[float, float] | None:
    """Logarithm of the gain of its pressure that fits a run best, and the share of its squared error that is left with it."""
    given = item.excitation

    def error(gain: float) -> float:
        times = float(np.exp(gain))
        chambers = {name: (sign, times * own) for name, (sign, own) in given.chambers.items()}
        driven = replace(item, excitation=replace(given, pressure=times * given.pressure, chambers=chambers))
        predicted = predict_observed(model, par, driven, (), clock_s)
        return np.inf if predicted is None else float(np.sum(rows(driven, predicted)[0] ** 2))

    now = error(0.0)
    if not 0 < now < np.inf:
        return None
    best = minimize_scalar(error, bounds=(-_REACH, _REACH), method="bounded", options={"xatol": _ERROR})
    return (float(best.x), float(best.fun) / now) if best.fun < now else (0.0, 1.0)


def about_odd_pressure(scores: Mapping[str, ExperimentScore]) -> list[str]:
    """Say which run's pressure is not that of the others, and what to look at."""
    return [
        f"run {name} is off as if its pressure were logged {rounded(one.pressure_times, 3)} times as high as that of the other runs; "
        "check pressure.unit and the sensor of that run, or leave it out with role: ignore."
        for name, one in scores.items()
        if one.pressure_times is not None
    ]
