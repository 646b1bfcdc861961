"""Below what an error tells nothing: noise of the measurement, motion that does not come again, and calibration, kept apart."""

from __future__ import annotations

import numpy as np
from scipy.fft import dct

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import Floors
from rfea_vision.artefacts.rows import LEFT_BY_A_MODEL
from rfea_vision.fitting.noise import before_repeat, noise_floor_deg, noise_floor_mm
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.residuals import left_of
from rfea_vision.fitting.solver import at_own_clock
from rfea_vision.scatter import third_difference_noise

#: Differences over frames up to this far apart are noise, not motion: a tenth of the period of the fastest ringing seen (5 Hz).
NOISE_SPAN_S = 0.02
#: Residuals may raise the noise floor by this factor at most: beyond, they are not noise.
MOST_RAISED = 4.0
#: Systematic errors of clamp, calibration and of a chain of segments, over the tube's length (0.03 mm of 155): what the twin's
#: films, whose truth is known, are read with.
CALIBRATION_SHARE = 2e-4
#: Coefficients of a cosine transform that are looked at together, and by how much the residual in such a band must stand out
#: from the modelled motion, the input and the noise there. Motion that is only late differs from itself by four times its square at
#: the most; with half as much again it is not that.
BAND, CLEAR = 16, 6.0


def _gaps(problem: Problem, fitted: Fitted) -> list[tuple[Observed, FloatArray]]:
    """Residual of the tip in mm (frames, 2), or of the angle in deg (frames, 1), per training run."""
    seen = zip(problem.train, fitted.solution.evaluation.predicted, strict=True)
    return [(item, left_of(item, predicted)) for item, predicted in seen]


def measurement(problem: Problem, fitted: Fitted) -> tuple[float, str]:
    """Noise of the measurement in the norm of the held-out error (mm, or deg where only an angle was measured), and whence it is known.

    Noise that is correlated over a few frames hides from the track's own high frequencies, where the tube's motion would
    drown it. In the residual the motion is gone, so there third differences may be taken over longer and longer strides.
    """
    gaps = _gaps(problem, fitted)
    left = {item.name: gap for item, gap in gaps}
    errors = {item.name: np.sum(gap**2, axis=1) for item, gap in (*gaps, *_held_gaps(problem, fitted)) if item.has_tip}
    known, source = noise_floor_mm(problem.scored, problem.recordings, repeats=False, left=left, errors=errors)
    if not known:
        known, source = noise_floor_deg(problem.train, problem.recordings, left=left) or 0.0, "standard errors of the angle"
    seen = []
    for item, gap in gaps:
        strides = range(1, max(1, int(NOISE_SPAN_S / item.period_s + 1e-6)) + 1)
        seen.append(
            max((float(np.linalg.norm(third_difference_noise(gap, stride))) for stride in strides), default=0.0)
        )
    raised = float(np.sqrt(np.mean(np.square(seen))))
    if raised > known:
        return float(min(raised, MOST_RAISED * known)), "the high frequencies that the best model tried leaves"
    return float(known), source


def floors_of(problem: Problem, fitted: Fitted) -> Floors:
    """The three floors, from the training runs and the repeats; null where the runs do not tell."""
    noise, source = measurement(problem, fitted)
    again = from_repeats(problem, fitted)
    uncaused = float(np.sqrt(np.mean([_uncaused(item, gap, noise) for item, gap in _gaps(problem, fitted)])))
    parts = [] if again is None else [again]
    parts += [float(np.hypot(noise, uncaused))] if uncaused > 0 else []
    in_mm = problem.train[0].has_tip
    return Floors(
        measurement=noise,
        irreproducible=max(parts, default=None),
        calibration=CALIBRATION_SHARE * problem.actuator.length / MM if in_mm else None,
        unit="mm" if in_mm else "deg",
        source=source,
    )


def binding(floors: Floors) -> float:
    """The floor that rules: no model is promised the noise of the measurement where the tube itself is not the same again."""
    return max(floors.measurement or 0.0, floors.irreproducible or 0.0)


def left_by_a_model(floors: Floors, problem: Problem) -> bool:
    """Whether the floor that rules is no more than what a model leaves, and no repeat has shown as much."""
    repeated = any(item.repeat_of for item in problem.scored)
    shown = (floors.irreproducible or 0.0) if repeated else 0.0
    return floors.source == LEFT_BY_A_MODEL and shown < (floors.measurement or 0.0)


def from_repeats(problem: Problem, fitted: Fitted) -> float | None:
    """Root mean square of what two runs of the same excitation differ by, over root two; None without repeats.

    What the model predicts of the difference (a pressure that was not quite the same) is taken out first.
    """
    if not any(item.repeat_of for item in problem.scored):
        return None
    residuals = {item.name: (item, gap) for item, gap in _gaps(problem, fitted)}
    residuals |= {item.name: (item, gap) for item, gap in _held_gaps(problem, fitted)}
    squares = []
    for item, gap in residuals.values():
        if item.repeat_of not in residuals:
            continue
        other, seen = residuals[str(item.repeat_of)]
        inside, before = before_repeat(item, other, seen)
        if inside.any():
            squares.append(float(np.mean(np.sum((gap[inside] - before) ** 2, axis=1))) / 2)
    return float(np.sqrt(np.mean(squares))) if squares else None


def _held_gaps(problem: Problem, fitted: Fitted) -> list[tuple[Observed, FloatArray]]:
    out = []
    for item in problem.validate:
        one = at_own_clock(fitted.model, item, fitted.par)
        if one is not None and item.has_tip == problem.train[0].has_tip:
            out.append((item, left_of(item, one)))
    return out


def _power(series: FloatArray) -> FloatArray:
    """Square of the cosine transform (frames,) of columns (frames, k), summed over these."""
    return np.sum(np.asarray(dct(series, axis=0, norm="ortho"), dtype=np.float64) ** 2, axis=1)


def _uncaused(item: Observed, gap: FloatArray, noise: float) -> float:
    """Mean square of the residual in those bands of frequency in which the modelled tube hardly moves, less the noise there."""
    pressure = item.excitation.at(item.time)
    span = max(float(np.ptp(pressure)), 1e-300)
    moved = item.tip_or_angle
    driven = _power((pressure / span)[:, None]) * float(np.sum(np.var(moved, axis=0)))
    left, caused = _power(gap), np.maximum(_power(moved - gap), driven)
    total = 0.0
    for low in range(0, left.size - BAND, BAND):
        band = slice(low, low + BAND)
        own = float(np.mean(left[band]))
        if own > CLEAR * max(float(np.mean(caused[band])), noise**2):
            total += BAND * (own - noise**2)
    return total / left.size
