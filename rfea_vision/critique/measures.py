"""How good a fit is: its errors run by run, what of them is above the floor, and when a fall of them matters."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.residuals import Predicted
from rfea_vision.fitting.scoring import gaps
from rfea_vision.fitting.solver import at_own_clock

#: An effect matters if it lowers the held-out error by this share and by this many noise floors (docs/formats.md).
MATTERS_SHARE = 0.10
MATTERS_FLOORS = 0.2
#: Structure below half a noise floor does not change the verdict (docs/formats.md).
STRUCTURE_FLOORS = 0.5


@dataclass(frozen=True)
class RunErrors:
    """Mean squared errors on one run: of the tip (mm^2) or, without a tip, of the angle (deg^2); and of the midline (mm^2)."""

    role: str
    frames: int
    tip: float
    midline: float | None


@dataclass(frozen=True)
class Errors:
    """Errors of a model on the runs on which it could be simulated; each in mm, or in deg where only an angle was seen."""

    runs: Mapping[str, RunErrors] = field(default_factory=dict)

    def on(self, names: Collection[str]) -> Errors:
        """The same on fewer runs: candidates are compared on those that all of them can be simulated on."""
        return Errors({name: run for name, run in self.runs.items() if name in names})

    def _rms(self, roles: Collection[str], key: str) -> float | None:
        rows = [(getattr(run, key), run.frames) for run in self.runs.values() if run.role in roles]
        rows = [row for row in rows if row[0] is not None]
        frames = sum(count for _, count in rows)
        return float(np.sqrt(sum(square * count for square, count in rows) / frames)) if frames else None

    @property
    def judges(self) -> tuple[str, ...]:
        """Roles of the runs that judge: validation, or training where there are no others."""
        return ("validate",) if any(run.role == "validate" for run in self.runs.values()) else ("train",)

    @property
    def train(self) -> float:
        """Root mean square error of the tip, or the angle, on training runs; 0 where none could be simulated."""
        return self._rms(("train",), "tip") or 0.0

    @property
    def held(self) -> float:
        """Root mean square error of the tip, or the angle, on the runs that judge."""
        return self._rms(self.judges, "tip") or 0.0

    @property
    def validate(self) -> float | None:
        """The same on validation runs; None where there are none, or none on which the model could be simulated."""
        return self._rms(("validate",), "tip")

    @property
    def held_midline(self) -> float | None:
        """Root mean square error of the centre line (mm) on the runs that judge; None where it was not seen."""
        return self._rms(self.judges, "midline")

    def excess(self, floor: float) -> dict[str, float]:
        """Squared error above the floor, by run; mean of tip and midline where there are both."""
        out = {}
        for name, run in self.runs.items():
            parts = [run.tip] if run.midline is None else [run.tip, run.midline]
            out[name] = float(np.mean([max(part - floor**2, 0.0) for part in parts]))
        return out

    def held_excess(self, floor: float) -> float:
        """Squared error above the floor on the runs that judge."""
        left = self.excess(floor)
        rows = [(left[name], run.frames) for name, run in self.runs.items() if run.role in self.judges]
        return sum(square * frames for square, frames in rows) / max(sum(frames for _, frames in rows), 1)


def mean_squares(item: Observed, predicted: Predicted) -> RunErrors:
    """Mean squared errors of one prediction."""
    part = gaps(item, predicted)
    line = None if part.midline is None else float(np.nanmean(part.midline))
    return RunErrors(item.role, int(item.time.size), float(np.nanmean(np.asarray(part.main))), line)


def errors_of(problem: Problem, fitted: Fitted) -> Errors:
    """Errors of a solved fit; held-out runs may adjust their clocks where these were found from the motion.

    In one unit: runs of which only the angle was measured are left out where the first training run has a tip, and the other way round.
    """
    odd = in_another_unit(problem)
    runs = {
        item.name: mean_squares(item, one)
        for item, one in zip(problem.train, fitted.solution.evaluation.predicted, strict=True)
        if item.name not in odd
    }
    for item in problem.validate:
        if item.name in odd:
            continue
        one = at_own_clock(fitted.model, item, fitted.par)
        if one is not None:
            runs[item.name] = mean_squares(item, one)
    return Errors(runs)


def in_another_unit(problem: Problem) -> list[str]:
    """Runs that were measured in another unit (mm or deg) than the first training run, and so judge nothing."""
    runs = (*problem.train, *problem.validate)
    return [item.name for item in runs if item.has_tip != problem.train[0].has_tip]


def motion(problem: Problem) -> float:
    """Root mean square distance of what was seen from its mean, of the run that moves most: in the unit of the errors."""
    odd = in_another_unit(problem)
    seen = [item.tip_or_angle for item in (*problem.train, *problem.validate) if item.name not in odd]
    return float(np.sqrt(max(np.sum(np.var(one, axis=0)) for one in seen)))


def common_runs(errors: Iterable[Errors]) -> set[str]:
    """Runs on which all of these could be simulated: one that is missing is left out for all alike."""
    names = [set(one.runs) for one in errors]
    return set.intersection(*names) if names else set()


def matters(before: Errors, after: Errors, floor: float) -> bool:
    """The rule of docs/formats.md, on the tip or on the midline."""

    def better(old: float | None, new: float | None) -> bool:
        return (
            old is not None
            and new is not None
            and old - new >= MATTERS_SHARE * old
            and old - new >= MATTERS_FLOORS * floor
        )

    return better(before.held, after.held) or (
        better(before.held_midline, after.held_midline) and after.held <= before.held * 1.02 + 0.05 * floor
    )


def share(before: Errors, after: Errors, floor: float) -> float:
    """Share of the held-out squared error above the floor that is gone; negative where it grew."""
    had = before.held_excess(floor)
    return 1 - after.held_excess(floor) / had if had > 0 else 0.0


def on_common_runs(first: Errors, second: Errors) -> tuple[Errors, Errors]:
    """Two fits' errors on the runs that both could be simulated on."""
    names = common_runs([first, second])
    return first.on(names), second.on(names)


def structure(errors: Errors, floor: float) -> float:
    """What is left above the floor, in floors: of the tip or of the midline, whichever is more."""
    worst = max(errors.held, errors.held_midline or 0.0)
    return float(np.sqrt(max(worst**2 - floor**2, 0.0))) / floor if floor > 0 else float("inf")
