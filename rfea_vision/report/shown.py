"""Which error stands for a model: that of the tip in mm or, where only an angle was measured, that of the angle in deg."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import ModelFit, Parameter
from rfea_vision.report.collect import Evidence, LadderStep

PER_JOINT = ("k_", "b_")


@dataclass(frozen=True)
class Shown:
    """Root mean square errors of one model in ``unit``; ``what`` names them in the reader's words."""

    unit: str
    what: str
    train: float | None
    validate: float | None
    floor: float | None

    @property
    def best(self) -> float | None:
        """The held-out error, else that of training."""
        return self.validate if self.validate is not None else self.train


def errors_of(step: LadderStep, evidence: Evidence) -> Shown:
    """Return what the page shows as the error of this rung."""
    rung, unit = step.rung, step.rung.unit
    what, floor = "Tip error" if unit == "mm" else "Angle error", _floor(step, evidence, f"noise_floor_{unit}")
    return Shown(unit, what, rung.error("train"), rung.error("validate"), floor)


def error_over_time(modelled: xr.Dataset) -> tuple[FloatArray, str] | None:
    """Length of the gap at the tip that a prediction keeps, or of an inclinometer's the gap in angle; and its unit."""
    if "tip_residual" in modelled:
        return np.hypot(*modelled["tip_residual"].values.astype(float).T), "mm"
    if "angle_residual" in modelled:
        return np.abs(modelled["angle_residual"].values.astype(float)), "deg"
    return None


def offsets_tried(data: xr.Dataset) -> tuple[FloatArray, FloatArray] | None:
    """Offsets of the clock (ms) that an alignment by motion tried, and the share of the motion explained at each."""
    if "sync_explained" not in data.variables or "sync_offset" not in data.variables:
        return None
    explained = data["sync_explained"].values.astype(float)
    tried = explained != 0  # far from the answer only every fifth offset was tried
    return 1000.0 * data["sync_offset"].values.astype(float)[tried], explained[tried]


def _floor(step: LadderStep, evidence: Evidence, key: str) -> float | None:
    """The one floor of a page: that by which the last rung was judged, which knows the quietest residual; else that of the fit."""
    judges = [one.diagnosis for one in reversed(evidence.steps) if one.on_ladder]
    known = (getattr(one, key) for one in (*judges, step.diagnosis, evidence.ladder, step.fit) if one is not None)
    return next((floor for floor in known if floor), None)


def of_the_tube(fit: ModelFit) -> dict[str, Parameter]:
    """Parameters of a model, with stiffness and damping of the whole tube, so that chains of any number of segments can be compared."""
    return {
        name: _in_series(item, fit.segments) if name.startswith(PER_JOINT) else item
        for name, item in fit.told.items()
    }


def _in_series(item: Parameter, segments: int) -> Parameter:
    interval = None if item.interval_95 is None else (item.interval_95[0] / segments, item.interval_95[1] / segments)
    stderr = None if item.stderr is None else item.stderr / segments
    return item.model_copy(update={"value": item.value / segments, "interval_95": interval, "stderr": stderr})


def of_candidate(candidate: object, name: str, unit: str) -> float | None:
    """``predicted``, ``train`` or ``validate`` error of a candidate in the page's unit."""
    return getattr(candidate, f"{name}_rmse_{unit}", None)
