"""Range of each slider: what the data leave open, within what physics allows."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from rfea_vision.artefacts import Actuator, ModelFit, Parameter
from rfea_vision.dynamics.simulation import Model
from rfea_vision.effects.base import BASE_UNITS, EffectParameter
from rfea_vision.fitting.coordinates import sized
from rfea_vision.report.prose import MEANINGS

#: A slider reaches this many 95 % intervals beyond the fitted value: inside of one nothing is seen to change. Where there is
#: no interval, it reaches so many times the value itself.
INTERVALS, TIMES = 3.0, 1.0


@dataclass(frozen=True)
class Slider:
    """One parameter in SI.

    Attributes
    ----------
    course : ``linear``; ``log`` for what only makes sense by its order of magnitude; ``cubic`` for an amplitude, fine near
        the value `zero` at which its effect is absent
    interval : 95 % interval of the fit, to be marked on the slider
    """

    name: str
    unit: str
    text: str
    value: float
    low: float
    high: float
    course: str
    zero: float = 0.0
    effect: str | None = None
    interval: tuple[float, float] | None = None
    fitted: bool = False

    def as_dict(self) -> dict[str, object]:
        """Plain values for the page."""
        return asdict(self)


def sliders_of(fit: ModelFit, model: Model, start: np.ndarray) -> list[Slider]:
    """Sliders of all parameters of a model, in its order; those that the fit does not have stand where they are absent.

    What the body's section has no use for has none.
    Torques reach as far as in a fit: as far as this body is stiff.
    """
    effects = sized(model.effects, Actuator(**fit.actuator))
    declared = {
        f"{effect.id}.{name}": (effect.id, spec) for effect in effects for name, spec in effect.parameters.items()
    }
    out = []
    for name, first in zip(model.names, start, strict=True):
        known = fit.parameters.get(name)
        effect, spec = declared.get(name, (None, None))
        if known is not None and name not in fit.told:
            continue
        if known is not None and (spec is None or known.interval_95 is not None):
            out.append(_around_fit(name, known, effect, spec))
        elif spec is not None:
            out.append(_over_bounds(name, spec, effect, None if known is None else known.value))
        else:
            out.append(
                Slider(
                    name, BASE_UNITS[name], MEANINGS.get(name, ""), float(first), *_reach(float(first), None), "linear"
                )
            )
    return out


def _around_fit(name: str, known: Parameter, effect: str | None, spec: EffectParameter | None) -> Slider:
    low, high = _reach(known.value, known.interval_95)
    lower = known.lower if known.lower is not None else (spec.lower if spec else -math.inf)
    upper = known.upper if known.upper is not None else (spec.upper if spec else math.inf)
    low, high = max(low, lower), min(high, upper)
    if spec is not None and spec.absent is not None:  # an amplitude can be taken back to nothing, and doubled
        twice = min(max(2 * known.value - spec.absent, lower), upper)
        low, high = min(low, spec.absent, twice), max(high, spec.absent, twice)
    text = spec.text if spec else MEANINGS.get(name, "")
    return Slider(name, known.unit, text, known.value, low, high, "linear", 0.0, effect, known.interval_95, True)


def _reach(value: float, interval: tuple[float, float] | None) -> tuple[float, float]:
    half = TIMES * abs(value) if interval is None else INTERVALS * (interval[1] - interval[0]) / 2
    half = half or 1.0
    return value - half, value + half


def _over_bounds(name: str, spec: EffectParameter, effect: str | None, value: float | None) -> Slider:
    """A parameter that no fit has an interval for: over all that physics allows."""
    fitted = value is not None
    if spec.absent is not None:
        first = spec.absent if value is None else value
        return Slider(
            name, spec.unit, spec.text, first, spec.lower, spec.upper, "cubic", spec.absent, effect, None, fitted
        )
    first = (spec.grid[0] if spec.grid else spec.start) if value is None else value
    course = "log" if spec.lower > 0 and spec.upper / spec.lower > 30 else "linear"
    return Slider(name, spec.unit, spec.text, first, spec.lower, spec.upper, course, 0.0, effect, None, fitted)
