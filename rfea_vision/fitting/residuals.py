"""Residuals of a model against recordings, with exact Jacobians. Everything in units of the measurement's standard error."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.simulation import Model, Motion
from rfea_vision.effects.catalogue import parameters_of
from rfea_vision.fitting.camera_view import angle_zero, origin_shift, seen_by_camera, stretching
from rfea_vision.fitting.nuisance import answer, eliminate
from rfea_vision.fitting.observed import MM, Observed

THREADS = min(2, os.cpu_count() or 1)
_Each = TypeVar("_Each")
_Found = TypeVar("_Found")


@dataclass(frozen=True)
class Predicted:
    """What the camera would have seen, SI: points (frames, m, 2), angle (frames,), with derivatives and velocity.

    The last column of the derivatives is that of the clock offset.
    """

    motion: Motion
    points: FloatArray
    dpoints: FloatArray
    angle: FloatArray
    dangle: FloatArray
    nuisance: dict[str, float] = field(default_factory=dict)
    #: Of the waves that were found for it (k,): where to seek them for parameters near to these.
    amplitude: FloatArray | None = None


def left_of(item: Observed, predicted: Predicted) -> FloatArray:
    """What a prediction leaves of the tip in mm (frames, 2), or of the angle in deg (frames, 1) where there is no tip."""
    if item.has_tip:
        return (item.points[:, -1] - predicted.points[:, -1]) / MM
    return np.rad2deg(item.angle - predicted.angle)[:, None]


def predict_observed(
    model: Model,
    par: FloatArray,
    item: Observed,
    free: Sequence[int],
    clock_s: float = 0.0,
    fractions: FloatArray | None = None,
    near: Predicted | None = None,
) -> Predicted | None:
    """Simulate one experiment and look at it as the camera did; None if the simulation fails.

    par : (parameters,) in SI, in the order of `model.names`; free : places in it to differentiate by
    clock_s : what is added to the times of the frames to have those of the log
    fractions : (k,) places on the centre line, 0 at the clamp; by default those that were observed
    near : what it was for parameters near to these, from which the search for what a run does not tell begins

    What a run does not tell (`nuisance`) is found and eliminated here.
    """
    unknowns = item.unknowns
    if unknowns is None:
        return _predict(model, par, item, free, clock_s, fractions)
    waves, opening = unknowns.waves, item.informative

    def driven(part: Observed, amplitude: FloatArray) -> Observed:
        return replace(part, excitation=unknowns.driven(part.excitation, amplitude))

    def look(amplitude: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        one = _predict(model, par, driven(opening, amplitude), (), clock_s, waves=waves)
        if one is None:
            return None
        residual, slopes = rows(opening, one)
        if not (np.isfinite(slopes).all() and np.isfinite(residual @ residual)):
            return None  # a motion that runs away
        return residual, slopes[:, : len(waves)]

    begun = None if near is None else near.amplitude
    amplitude = eliminate(np.zeros(len(waves)) if begun is None else begun, look)
    if amplitude is None:
        return None
    predicted = _predict(model, par, driven(item, amplitude), free, clock_s, fractions, waves)
    if predicted is None:
        return None
    columns = np.arange(len(free), len(free) + len(waves))
    predicted = _without_waves(predicted, columns, item if fractions is None else None)
    if predicted is None:
        return None
    return replace(predicted, nuisance=predicted.nuisance | unknowns.values_kPa(amplitude), amplitude=amplitude)


def _without_waves(predicted: Predicted, waves: NDArray[np.int64], item: Observed | None) -> Predicted | None:
    """Derivatives without the columns of the waves' amplitudes, which follow the parameters where `item` is what they are fitted to."""
    others = np.delete(np.arange(predicted.dangle.shape[1]), waves)
    follow = np.zeros((waves.size, others.size))
    if item is not None:
        for slopes in (predicted.dpoints, predicted.dangle):
            slopes[item.informative.time.size :, ..., waves] = 0.0  # later frames have forgotten them
        slopes = rows(item, predicted)[1]
        if not np.isfinite(slopes).all():
            return None
        follow = answer(slopes[:, waves], slopes[:, others], follow)
    dpoints = predicted.dpoints[..., others] + predicted.dpoints[..., waves] @ follow
    dangle = predicted.dangle[..., others] + predicted.dangle[..., waves] @ follow
    return replace(predicted, dpoints=dpoints, dangle=dangle)


def why_not(model: Model, par: FloatArray, item: Observed, clock_s: float = 0.0) -> str:
    """Why an experiment cannot be simulated with `par` (parameters,) in SI: when, where in the log, and why. Empty where it can."""
    frames = np.clip(item.time + clock_s, item.excitation.start_s, item.excitation.end_s)
    message = as_it_stood(model, par, item, frames).message
    if message or predict_observed(model, par, item, (), clock_s) is not None:
        return message
    return "the start of the run, which the log does not tell, could not be found"


def _predict(
    model: Model,
    par: FloatArray,
    item: Observed,
    free: Sequence[int],
    clock_s: float = 0.0,
    fractions: FloatArray | None = None,
    waves: FloatArray | None = None,
) -> Predicted | None:
    """Simulate an experiment whose excitation is all known; derivatives by amplitudes of `waves` (k, grid) stand before the clock's."""
    model, par, free = as_rigged(model, par, item, free)
    frames, slopes = _in_log(model, par, item, clock_s)
    given = item.excitation
    own = None if waves is None else waves[:, : given.pressure.size]
    motion = model.simulate(par, given, frames, free, **_start(model, item), waves=own)
    return _seen(model, par, item, free, frames, slopes, motion, fractions) if motion.ok else None


def by_clock(model: Model, par: FloatArray, item: Observed) -> Callable[[float], Predicted | None]:
    """`predict_observed` without derivatives as a function of the offset of the clock (s).

    The motion does not depend on that clock: it is simulated once and read between the ends of its steps, unless unknowns of the run
    are found with the clock. par : (parameters,) in SI, in the order of `model.names`
    """
    if item.unknowns is not None:
        return lambda clock_s: predict_observed(model, par, item, (), clock_s)
    model, par, _ = as_rigged(model, par, item)
    motion = model.simulate(par, item.excitation, item.excitation.grid_s, **_start(model, item))
    if not motion.ok:
        return lambda _: None
    phi = CubicHermiteSpline(item.excitation.grid_s, motion.phi, motion.rate)  # what the engine reads frames off

    def look(clock_s: float) -> Predicted | None:
        frames, slopes = _in_log(model, par, item, clock_s)
        angles = phi(frames)
        none = np.zeros((*angles.shape, 0))  # of hidden states nobody asks here
        between = replace(motion, phi=angles, rate=phi(frames, 1), sensitivity=none, states=none[:, 1:])
        return _seen(model, par, item, [], frames, slopes, between, None)

    return look


def _in_log(model: Model, par: FloatArray, item: Observed, clock_s: float) -> tuple[FloatArray, list[FloatArray]]:
    """Times of the frames (frames,) in s of the log, and the law's row of their shift: by its place, its values and derivatives."""
    row = model.law.time_shift(par, model._constants, item.time - item.middle_s)[0]
    shift = np.broadcast_to(np.asarray(row[0], dtype=float), item.time.shape)
    return np.clip(item.time + shift + clock_s, item.excitation.start_s, item.excitation.end_s), row


def _start(model: Model, item: Observed) -> dict[str, Any]:
    return {} if item.held is None else item.held.start(model.chain)


def _seen(
    model: Model,
    par: FloatArray,
    item: Observed,
    free: Sequence[int],
    frames: FloatArray,
    slopes: list[FloatArray],
    motion: Motion,
    fractions: FloatArray | None,
) -> Predicted:
    """What the camera sees of a motion at `frames` (frames,) in s of the log; `slopes` as `_in_log` gives them."""
    # The velocity is one more sensitivity: that to time.
    extended = np.concatenate([motion.sensitivity, motion.rate[:, :, None]], axis=2)
    for column, k in enumerate(free):
        slope = np.broadcast_to(np.asarray(slopes[2 + k], dtype=float), item.time.shape)
        if np.any(slope):
            extended[:, :, column] += motion.rate * slope[:, None]
    seen = replace(motion, message="", sensitivity=extended)
    pressure = item.excitation.at(frames, model.combined(par, item.excitation)[0])
    pressures = (pressure, *stretching(model, par, item.excitation, frames))
    shift, dshift = np.zeros(2), np.zeros((2, extended.shape[2]))
    if item.origin_sigma > 0:
        shift, dshift = origin_shift(item, *seen_by_camera(model, par, seen, item.fractions, free, *pressures))
    points, dpoints = seen_by_camera(
        model, par, seen, item.fractions if fractions is None else fractions, free, *pressures
    )
    angle, dangle = motion.phi[:, -1], extended[:, -1, :]
    if model.law.changes("angle_drift") and not item.has_tip:
        drift = model.law.angle_drift(par, model._constants, item.time - item.middle_s)[0]
        angle = angle + drift[0]
        dangle = dangle.copy()
        for column, k in enumerate(free):
            dangle[:, column] += drift[2 + k]
    zero = {}
    if item.angle_zero_sd > 0 and not item.has_tip:
        offset, doffset = angle_zero(item, angle, dangle)
        angle, dangle, zero = angle + offset, dangle + doffset, {"angle_zero_deg": float(np.rad2deg(offset))}
    dpoints = dpoints + dshift
    known = [k for k, index in enumerate(free) if model.names[index] in item.conditions]
    if known:  # these are not to be found from this run
        dpoints[..., known], dangle[..., known] = 0.0, 0.0
    return Predicted(motion, points + shift, dpoints, angle, dangle, zero)


def as_it_stood(model: Model, par: FloatArray, item: Observed, frames_s: FloatArray) -> Motion:
    """Motion of a run at instants (frames,) of the log, from where its rig held it and with what is known of it.

    par : (parameters,) in SI, in the order of `model.names`
    """
    rigged, values, _ = as_rigged(model, par, item)
    return rigged.simulate(values, item.excitation, frames_s, **_start(model, item))


def as_rigged(
    model: Model, par: FloatArray, item: Observed, free: Sequence[int] = ()
) -> tuple[Model, FloatArray, list[int]]:
    """The model in the rig of a run, its parameters (parameters,) in SI with what is known of the run in place, and `free` in it."""
    rigged = model.rigged(item.gravity, item.mounting, item.conditions)
    if not item.conditions:
        return rigged, par, list(free)
    own = dict(zip(model.names, par, strict=True))
    specs = parameters_of(rigged.effects).items()
    rest = {name: spec.start if spec.absent is None else spec.absent for name, spec in specs}
    values = [item.conditions.get(name, own.get(name, rest.get(name))) for name in rigged.names]
    return rigged, np.array(values, dtype=float), [rigged.names.index(model.names[k]) for k in free]


def rows(item: Observed, predicted: Predicted) -> tuple[FloatArray, FloatArray]:
    """Weighted residual (rows,), measured minus modelled, and its Jacobian (rows, p) for the free parameters and the clock.

    midline: the normal distance at every node but the tip, and both coordinates of the tip, each by its own standard error;
    that the errors of a frame are alike is left to the intervals.
    """
    p = predicted.dpoints.shape[-1]
    if item.observe == "angle":
        residual = (item.angle - predicted.angle) / item.angle_sigma
        return residual, -predicted.dangle / item.angle_sigma[:, None]
    gap = item.points - predicted.points
    if item.observe == "tip_y":
        sigma = item.sigma[:, -1]
        return gap[:, -1, 1] / sigma, -predicted.dpoints[:, -1, 1] / sigma[:, None]
    sigma = item.sigma[:, -1:, None]
    tip = (gap[:, -1:] / sigma).reshape(-1)
    dtip = (-predicted.dpoints[:, -1:] / sigma[..., None]).reshape(-1, p)
    if item.observe == "tip" or item.fractions.size == 1:
        return tip, dtip
    normal, sigma = item.normals[:, :-1], item.sigma[:, :-1]
    body = (np.einsum("fma,fma->fm", normal, gap[:, :-1]) / sigma).reshape(-1)
    dbody = (-np.einsum("fma,fmap->fmp", normal, predicted.dpoints[:, :-1]) / sigma[..., None]).reshape(-1, p)
    return np.concatenate([body, tip]), np.concatenate([dbody, dtip])


@dataclass(frozen=True)
class Evaluation:
    """Residuals of all experiments stacked; `slices` says which rows are whose."""

    residual: FloatArray
    jacobian: FloatArray
    slices: tuple[slice, ...]
    predicted: tuple[Predicted, ...]

    @property
    def cost(self) -> float:
        """Sum of the squared residuals, each in standard deviations."""
        return float(self.residual @ self.residual)


def side_by_side(run: Callable[[_Each], _Found], over: Sequence[_Each]) -> list[_Found]:
    """What `run` finds for each, in their order, on up to two threads: no result depends on how many."""
    if len(over) < 2 or THREADS < 2:
        return [run(each) for each in over]
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(run, over))


def evaluate(
    model: Model,
    par: FloatArray,
    items: Sequence[Observed],
    free: Sequence[int],
    clocks: FloatArray | None = None,
    near: Evaluation | None = None,
) -> Evaluation | None:
    """Residual and Jacobian [free parameters, one clock per experiment]; None if any simulation fails.

    par : (parameters,) in SI; clocks : (experiments,) offset of each clock in s, 0 by default
    near : an evaluation of the same experiments for parameters near to these, see `predict_observed`
    """
    offsets = np.zeros(len(items)) if clocks is None else clocks
    known = [None] * len(items) if near is None else near.predicted

    def run(index: int) -> Predicted | None:
        return predict_observed(model, par, items[index], free, float(offsets[index]), near=known[index])

    model.law  # noqa: B018 - compiled once, before the threads
    predicted = side_by_side(run, range(len(items)))
    if any(one is None for one in predicted):
        return None
    residuals, jacobians, slices, start = [], [], [], 0
    for index, (item, one) in enumerate(zip(items, predicted, strict=True)):
        residual, jacobian = rows(item, one)  # type: ignore[arg-type]
        wide = np.zeros((residual.size, len(free) + len(items)))
        wide[:, : len(free)] = jacobian[:, :-1]
        wide[:, len(free) + index] = jacobian[:, -1]
        residuals.append(residual)
        jacobians.append(wide)
        slices.append(slice(start, start + residual.size))
        start += residual.size
    stacked, wide = np.concatenate(residuals), np.concatenate(jacobians)
    # A motion that runs away may stay finite while its derivatives leave what a square of them can hold.
    if not np.isfinite(np.vdot(stacked, stacked) + np.vdot(wide, wide)):
        return None
    return Evaluation(stacked, wide, tuple(slices), tuple(predicted))  # type: ignore[arg-type]
