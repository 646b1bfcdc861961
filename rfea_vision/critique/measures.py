"""How good a fit is: errors on training and held-out runs, what is left above the noise, and when an effect matters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfea_vision.fitting.fit import Fitted, Problem
from rfea_vision.fitting.observation import MM, Observed, noise_floor_deg, noise_floor_mm
from rfea_vision.fitting.residual_tests import correlation_time
from rfea_vision.fitting.residuals import Predicted, predict_observed
from rfea_vision.fitting.scoring import gaps
from rfea_vision.fitting.solver import fit_clocks

FloatArray = NDArray[np.float64]
#: An effect matters if it lowers the held-out error by this share and by this many noise floors (docs/formats.md).
MATTERS_SHARE = 0.10
MATTERS_FLOORS = 0.2
#: Structure below half a noise floor does not change the verdict.
STRUCTURE_FLOORS = 0.5
#: Differences over frames up to this far apart are noise, not motion.
NOISE_SPAN_S = 0.02
#: Residuals may raise the noise floor by this factor at most: beyond, they are not noise.
MOST_RAISED = 4.0


@dataclass(frozen=True)
class Errors:
    """RMS errors of a model: tip and midline (mm), or angle (deg) in place of the tip, on training and held-out runs."""

    train: float
    held: float
    held_midline: float | None
    train_midline: float | None


def held_out(problem: Problem) -> tuple[Observed, ...]:
    """Runs on which candidates are judged: validation runs, or the training runs where there are none."""
    return problem.validate or problem.train


def _rms(items: Sequence[Observed], predicted: Sequence[Predicted]) -> tuple[float, float | None]:
    tips, lines = [], []
    for item, one in zip(items, predicted, strict=True):
        part = gaps(item, one)
        tips.append(part.tip if part.tip is not None else part.angle)
        if part.midline is not None:
            lines.append(part.midline)
    tip = float(np.sqrt(np.nanmean(np.concatenate(tips))))  # type: ignore[arg-type]
    return tip, float(np.sqrt(np.nanmean(np.concatenate(lines)))) if lines else None


def errors_of(problem: Problem, fitted: Fitted) -> Errors:
    """Errors of a solved fit; held-out runs may adjust their clocks where these were found from the motion."""
    train, train_line = _rms(problem.train, fitted.solution.evaluation.predicted)
    if not problem.validate:
        return Errors(train, train, train_line, train_line)
    clocks = fit_clocks(fitted.model, problem.validate, fitted.par)
    predicted = []
    for item, clock in zip(problem.validate, clocks, strict=True):
        one = predict_observed(fitted.model, fitted.par, item, (), float(clock))
        if one is None:
            return Errors(train, float("inf"), float("inf"), train_line)
        predicted.append(one)
    held, held_line = _rms(problem.validate, predicted)
    return Errors(train, held, held_line, train_line)


def _tip_gaps(problem: Problem, fitted: Fitted) -> list[FloatArray]:
    """Residual of the tip in mm (frames, 2), or of the angle in deg (frames, 1), per training run."""
    out = []
    for item, predicted in zip(problem.train, fitted.solution.evaluation.predicted, strict=True):
        if item.has_tip:
            out.append((item.points[:, -1] - predicted.points[:, -1]) / MM)
        else:
            out.append(np.rad2deg(item.angle - predicted.angle)[:, None])
    return out


def floor_of(problem: Problem, fitted: Fitted) -> float:
    """Noise floor in the norm of the held-out error (mm, or deg where only an angle was measured).

    Noise that is correlated over a few frames hides from the track's own high frequencies, where the tube's motion would
    drown it. In the residual the motion is gone, so there third differences may be taken over longer and longer strides.
    """
    known, _ = noise_floor_mm(list(problem.with_roles("train", "validate")), problem.recordings)
    known = known or noise_floor_deg(list(problem.train)) or 0.0
    seen = []
    for item, gap in zip(problem.train, _tip_gaps(problem, fitted), strict=True):
        period = float(np.median(np.diff(item.time)))
        strides = range(1, max(1, int(NOISE_SPAN_S / period + 1e-6)) + 1)
        seen.append(max((_spread(gap, stride) for stride in strides), default=0.0))
    raised = float(np.sqrt(np.mean(np.square(seen))))
    return float(np.clip(raised, known, MOST_RAISED * known))


def _spread(gap: FloatArray, stride: int) -> float:
    third = gap[3 * stride :] - 3 * gap[2 * stride : -stride] + 3 * gap[stride : -2 * stride] - gap[: -3 * stride]
    if third.shape[0] < 12:
        return 0.0
    sigma = np.median(np.abs(third - np.median(third, axis=0)), axis=0) / 0.6745 / np.sqrt(20)
    return float(np.sqrt(np.sum(sigma**2)))


def effective_count(problem: Problem, fitted: Fitted) -> float:
    """Number of independent residuals: frames over the integrated autocorrelation time of the tip residual, run by run."""
    total = 0.0
    for gap in _tip_gaps(problem, fitted):
        for axis in range(gap.shape[1]):
            frames = 2 * correlation_time(gap[:, axis], 1.0)  # one frame after the other where the residual is white
            total += gap.shape[0] / frames if frames > 0 else 0.0
    return max(total, 10.0)


def delta_bic(problem: Problem, before: Fitted, after: Fitted) -> float:
    """Change of BIC on the training runs, with the number of independent residuals of the better model."""
    count = max(effective_count(problem, before), effective_count(problem, after))
    added = len(after.coordinates.free) - len(before.coordinates.free)
    ratio = after.solution.evaluation.cost / max(before.solution.evaluation.cost, 1e-300)
    return float(count * np.log(max(ratio, 1e-12)) + added * np.log(count))


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


def excess(errors: Errors, floor: float) -> float:
    """Squared held-out error above the noise floor, tip and midline together."""
    line = errors.held_midline if errors.held_midline is not None else 0.0
    return max(errors.held**2 - floor**2, 0.0) + max(line**2 - floor**2, 0.0)


def structure(errors: Errors, floor: float) -> float:
    """What is left above the noise, in noise floors: of the tip or of the midline, whichever is more."""
    worst = max(errors.held, errors.held_midline if errors.held_midline is not None else 0.0)
    return float(np.sqrt(max(worst**2 - floor**2, 0.0))) / floor if floor > 0 else float("inf")


def merit(errors: Errors) -> float:
    """Held-out error by which candidates are ranked: tip and midline together."""
    return errors.held if errors.held_midline is None else float(np.hypot(errors.held, errors.held_midline))
