"""The joint torque that would close the gap between model and measurement, and what it depends on.

The gap in joint angles is read from the residual of the midline with a few smooth functions along the tube, smoothed in
time before any derivative is taken; inverse dynamics of the measured minus that of the modelled motion then gives the torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.polynomial import legendre
from scipy.signal import savgol_filter

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import ModelFit
from rfea_vision.artefacts.measurement import CHOOSING_ROLES, Recording
from rfea_vision.artefacts.rows import Dependence, TorqueSummary
from rfea_vision.critique.phases import label_phases
from rfea_vision.dynamics.inverse import joint_torques
from rfea_vision.dynamics.simulation import Model, Motion
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.prediction import observe_as_scored
from rfea_vision.fitting.residual_tests import correlation_ratio
from rfea_vision.fitting.residuals import Predicted, as_rigged, predict_observed, side_by_side
from rfea_vision.fitting.scoring import rebuild

SHAPES = 4  # Legendre functions of the position along the tube
WINDOW_S = 0.06  # of the polynomial that differentiates twice: a quarter of a swing, so that it follows ringing


@dataclass(frozen=True)
class ResidualTorque:
    """torque, sigma (frames, n) in N m at the frames of the observation; angle and rate of the joints beside them, as modelled.

    Those of the measured motion hold the noise that the torque is made from, too: dampers turn it into a torque that goes with it.
    """

    torque: FloatArray
    sigma: FloatArray
    theta: FloatArray
    rate: FloatArray


def _angle_gap(model: Model, item: Observed, predicted: Predicted) -> tuple[FloatArray, FloatArray]:
    """Gap in absolute angles phi (frames, n + 1) and its standard error, from the midline (or the tip) residual."""
    n = model.chain.bodies
    position = (np.arange(n) + 0.5) / n
    shapes = SHAPES if item.has_midline else (2 if item.has_tip else 1)
    basis = legendre.legvander(2 * position - 1, shapes - 1)  # of d theta along the tube
    phi_basis = np.vstack([np.zeros(shapes), np.cumsum(basis, axis=0)])
    frames = item.time.size
    if not item.has_tip:
        gain = phi_basis[-1, 0]
        gap = (item.angle - predicted.angle) / gain
        return gap[:, None] * phi_basis[:, 0], (item.angle_sigma / abs(gain))[:, None] * np.abs(phi_basis[:, 0])
    # Sensitivity of the points to each function, exact at the modelled pose; contiguous as a motion's own, for which it is compiled.
    S = np.ascontiguousarray(np.broadcast_to(phi_basis, (frames, n + 1, shapes)), dtype=np.float64)
    motion = predicted.motion
    posed = Motion(0, "", motion.phi, motion.rate, motion.states, S, np.arange(shapes), pivot=motion.pivot[:1])
    _, slope = model.centre_line(posed, item.fractions)
    gap = item.points - predicted.points
    normal = np.einsum("fma,fma->fm", item.normals, gap) if item.has_midline else gap.reshape(frames, -1)
    design = np.einsum("fma,fmap->fmp", item.normals, slope) if item.has_midline else slope.reshape(frames, -1, shapes)
    sigma = item.sigma if item.has_midline else np.repeat(item.sigma, 2, axis=1)
    weighted = design / sigma[..., None]
    information = np.einsum("fmp,fmq->fpq", weighted, weighted)
    information += 1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(shapes)
    inverse = np.linalg.inv(information)
    coefficients = np.einsum("fpq,fmq,fm->fp", inverse, weighted, normal / sigma)
    spread = np.sqrt(np.einsum("ip,fpq,iq->fi", phi_basis, inverse, phi_basis))
    return coefficients @ phi_basis.T, spread


def residual_torque(model: Model, par: FloatArray, item: Observed, clock_s: float) -> ResidualTorque | None:
    """Residual torque of one experiment at parameters (parameters,) in SI; None if it cannot be simulated, or has under 25 frames."""
    predicted = predict_observed(model, par, item, (), clock_s)
    if predicted is None or item.time.size < 25:
        return None
    gap, spread = _angle_gap(model, item, predicted)
    smooth, window = _smoothed(item.time, gap)
    motion = predicted.motion
    acceleration = np.gradient(motion.rate, item.time, axis=0)
    model, par, _ = as_rigged(model, par, item)
    excitation, instants = item.excitation, item.time + clock_s
    pressure = excitation.at(instants, model.combined(par, excitation)[0])
    opposed = excitation.at(instants, excitation.opposed)
    seen = (motion.phi + smooth[0], motion.rate + smooth[1], acceleration + smooth[2])
    measured = joint_torques(model, par, *seen, motion.states, pressure, opposed)
    modelled = joint_torques(model, par, motion.phi, motion.rate, acceleration, motion.states, pressure, opposed)
    # Error band: stiffness times the smoothed error of the joint angle.
    stiffness = float(par[0])
    sigma = stiffness * np.sqrt(spread[:, 1:] ** 2 + spread[:, :-1] ** 2) / np.sqrt(window / 3)
    return ResidualTorque(measured - modelled, sigma, np.diff(motion.phi, axis=1), np.diff(motion.rate, axis=1))


def _smoothed(time: FloatArray, gap: FloatArray) -> tuple[list[FloatArray], int]:
    """Series (frames, n), its rate and its acceleration, and the frames that each is taken over; lost frames are bridged."""
    period = float(np.median(np.diff(time)))
    even = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / period) + 1)
    bridged = np.column_stack([np.interp(even, time, column) for column in gap.T])
    window = min(max(5, round(WINDOW_S / period) | 1), even.size // 2 * 2 - 1)
    smooth: list[FloatArray] = [
        np.asarray(savgol_filter(bridged, window, 3, deriv=d, delta=even[1] - even[0], axis=0)) for d in range(3)
    ]
    return [np.column_stack([np.interp(time, even, column) for column in part.T]) for part in smooth], window


_WORDS = {
    "angle": "the joint's angle",
    "rate": "the joint's rate",
    "pressure": "the pressure",
    "pressure rate": "the rate of the pressure",
    "time since reversal": "the time since the last reversal",
    "place": "the place along the tube",
    "time": "the time into the run",
}


def _regressors(result: ResidualTorque, item: Observed, clock_s: float) -> dict[str, FloatArray]:
    frames, n = result.torque.shape
    pressure = item.excitation.at(item.time + clock_s)
    rate = np.gradient(np.asarray(savgol_filter(pressure, min(31, frames // 2 * 2 - 1), 2)), item.time)
    bend_rate = result.rate.sum(axis=1)
    turned = np.concatenate([[True], np.sign(bend_rate[1:]) != np.sign(bend_rate[:-1])])
    since = item.time - np.maximum.accumulate(np.where(turned, item.time, item.time[0]))
    wide = {
        "pressure": pressure,
        "pressure rate": rate,
        "time since reversal": since * np.sign(bend_rate),
        "time": item.time - item.time[0],
    }
    out = {name: np.broadcast_to(values[:, None], (frames, n)).ravel() for name, values in wide.items()}
    out["angle"], out["rate"] = result.theta.ravel(), result.rate.ravel()
    out["place"] = np.broadcast_to(np.arange(n, dtype=float), (frames, n)).ravel()
    return out


def summarise_torque(results: list[tuple[ResidualTorque, Observed, float]]) -> TorqueSummary:
    """RMS and ranked dependence of the residual torque over several experiments."""
    if not results:
        return {
            "note": "the residual torque needs at least 25 valid frames in an experiment that the model can be simulated on"
        }
    torque = np.concatenate([r.torque.ravel() for r, _, _ in results])
    sigma = np.concatenate([r.sigma.ravel() for r, _, _ in results])
    columns = [_regressors(*each) for each in results]
    ranked: list[Dependence] = []
    for name in columns[0]:
        score = correlation_ratio(torque, np.concatenate([c[name] for c in columns]))
        ranked.append(
            {
                "on": name,
                "what": _WORDS[name],
                "score": score,
                "sentence": f"{100 * score:.0f} % of its variance goes with {_WORDS[name]}.",
            }
        )
    ranked.sort(key=lambda row: -row["score"])
    return {
        "rms_mNm": float(np.sqrt(np.mean(torque**2)) * 1e3),
        "sigma_mNm": float(np.sqrt(np.mean(sigma**2)) * 1e3),
        "depends_on": ranked,
        "note": "inverse dynamics of the measured minus the modelled motion, smoothed over 60 ms (five frames at least) and four "
        "functions along the tube",
    }


def all_residual_torques(
    artefact: ModelFit, recordings: Mapping[str, Recording]
) -> dict[str, tuple[ResidualTorque, Observed, float]]:
    """Residual torque of every experiment that was scored."""
    model, par = rebuild(artefact)

    def one(name: str) -> tuple[ResidualTorque | None, Observed, float]:
        item = observe_as_scored(artefact, recordings[name])
        clock = artefact.clock_s(name) or 0.0
        return residual_torque(model, par, item, clock), item, clock

    model.law  # noqa: B018 - compiled once, before the threads
    names = [name for name, recording in recordings.items() if recording.role in CHOOSING_ROLES]
    found = zip(names, side_by_side(one, names), strict=True)
    return {name: (result, item, clock) for name, (result, item, clock) in found if result is not None}


def with_residual_torque(
    artefact: ModelFit, recordings: Mapping[str, Recording], predictions: Mapping[str, xr.Dataset]
) -> dict[str, xr.Dataset]:
    """Predictions with `residual_torque`, `residual_torque_sigma` (mN m) and `phase` added."""
    torques = all_residual_torques(artefact, recordings)
    out = {}
    for name, dataset in predictions.items():
        recording = recordings[name].dataset
        frames = dataset.sizes["time"]
        added: dict[str, tuple] = {}
        if name in torques:
            result, item, _ = torques[name]
            for key, values in (("residual_torque", result.torque), ("residual_torque_sigma", result.sigma)):
                full = np.full((frames, values.shape[1]), np.nan, dtype=np.float32)
                full[item.frame] = values / MM
                added[key] = (("time", "segment"), full, {"units": "mN m"})
        pressure = np.interp(dataset["time"].values, recording["log_time"].values, recording["pressure"].values)
        bend = np.nan_to_num(dataset["bend_angle"].values.astype(float), nan=0.0)
        added["phase"] = (("time",), label_phases(dataset["time"].values, pressure, bend).astype(object))
        out[name] = dataset.assign(added)
    return out
