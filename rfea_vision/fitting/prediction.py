"""Model against measurement, frame by frame: what `prediction.nc` holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from rfea_vision.artefacts.judgement import ModelFit
from rfea_vision.artefacts.measurement import Recording
from rfea_vision.dynamics.simulation import Model
from rfea_vision.fitting.observation import normals_of
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.problem import observed
from rfea_vision.fitting.residuals import Predicted, predict_observed, side_by_side, why_not
from rfea_vision.fitting.scoring import options_of, rebuild
from rfea_vision.fitting.solver import fit_clocks

NODES = 33  # of the predicted centre line, as many as a track from pictures has


def predict(model: ModelFit, recordings: Mapping[str, Recording]) -> dict[str, xr.Dataset]:
    """Prediction of a fitted model for every recording that is not ignored, at every frame within the pressure log.

    Frames that the score leaves out (not valid, a jump of the track) are predicted as well, and have no residual. A recording on
    which the model cannot be simulated gets NaN, with the reason in the attribute ``note``. ``tip_stderr`` and
    ``bend_angle_stderr`` are what the errors of the free parameters do to the curves, to first order.

    Returns
    -------
    dict
        By experiment ``tip`` (time, xy) and ``midline`` (time, node, xy) in mm in the rig frame, ``bend_angle`` (time,) and
        ``theta`` (time, joint) in deg, ``elongation`` (time, segment), and at the ``scored`` frames the residuals of what was measured.
    """
    simulator, par = rebuild(model)
    known = _known_parameters(model, simulator.names)

    def one(name: str) -> xr.Dataset:
        recording = recordings[name]
        item = observe_as_scored(model, recording)
        clock = model.clock_s(name)
        if clock is None:
            clock = float(fit_clocks(simulator, [item], par)[0])
        item = item.everywhere(recording.time_s.astype(float))
        return _predict_one(simulator, par, item, recording, clock).assign(
            _spread(simulator, par, item, recording, clock, known)
        )

    simulator.law  # noqa: B018 - compiled once, before the threads
    names = [name for name, recording in recordings.items() if recording.role != "ignore"]
    return dict(zip(names, side_by_side(one, names), strict=True))


def observe_as_scored(model: ModelFit, recording: Recording) -> Observed:
    """Prepare a recording as it was when the model was scored on it: seen alike, with the same steps and freedom of the zero."""
    score = model.experiments.get(recording.name)
    step_s = None if score is None else score.step_s
    item = observed(recording, model.observe, options_of(model), longest_step_s=step_s or np.inf)  # type: ignore[arg-type]
    return item.in_steps_of(step_s)


def _known_parameters(model: ModelFit, names: Sequence[str]) -> tuple[list[int], np.ndarray, float]:
    """Places of the free parameters, their covariance, and how many errors a 95 % interval reaches."""
    # A parameter's own error also holds what a finer chain would move, by which parameters make up for one another: the curves stay.
    errors = dict(zip(model.correlation.get("names", ()), model.correlation.get("stderr", ()), strict=False))
    # One of no interval counts, too, at a bound or not determined: what others are off by it makes up for, and the curves stay.
    known = any(item.stderr for item in model.parameters.values())
    chosen = [name for name in errors if known and name in names and not model.parameters[name].fixed]
    rows = [list(errors).index(name) for name in chosen]
    sizes = np.array([errors[name] for name in chosen])
    matrix = np.asarray(model.correlation.get("matrix", np.zeros((0, 0))), dtype=float)
    shared = matrix[np.ix_(rows, rows)] * np.outer(sizes, sizes) if rows else np.zeros((0, 0))
    reach = [
        np.ptp(item.interval_95) / 2 / item.stderr
        for item in model.parameters.values()
        if item.interval_95 and item.stderr
    ]
    return [names.index(name) for name in chosen], shared, float(max(reach, default=np.nan))


def _spread(
    simulator: Model,
    par: np.ndarray,
    item: Observed,
    recording: Recording,
    clock: float,
    known: tuple[list[int], np.ndarray, float],
) -> dict[str, tuple]:
    """Standard errors of the tip (mm) and of the bend angle (deg) from those of the parameters; nothing where none is known."""
    free, covariance, reach = known
    predicted = predict_observed(simulator, par, item, free, clock, np.ones(1)) if free else None
    if predicted is None:
        return {}

    def errors(slopes: np.ndarray) -> np.ndarray:
        return np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", slopes, covariance, slopes), 0.0))

    frames = recording.dataset.sizes["time"]
    tip, angle = np.full((frames, 2), np.nan, np.float32), np.full(frames, np.nan, np.float32)
    tip[item.frame] = errors(predicted.dpoints[:, -1, :, : len(free)]) / MM
    angle[item.frame] = np.rad2deg(errors(predicted.dangle[:, : len(free)]))
    about = {"from": "the errors of the parameters alone", "quantile_95": reach}
    return {
        "tip_stderr": (("time", "xy"), tip, {"units": "mm", **about}),
        "bend_angle_stderr": (("time",), angle, {"units": "deg", **about}),
    }


def _predict_one(simulator: Model, par: np.ndarray, item: Observed, recording: Recording, clock: float) -> xr.Dataset:
    """Prediction for one recording whose clock is `clock` s off; NaN where the model cannot be simulated on it."""
    fractions = np.linspace(0, 1, recording.dataset.sizes.get("node", NODES))
    predicted = predict_observed(simulator, par, item, (), clock, fractions)
    note = "" if predicted is not None else why_not(simulator, par, item, clock)
    return as_dataset(simulator, item, recording, predicted, fractions).assign_attrs(clock_offset_s=clock, note=note)


def as_dataset(
    simulator: Model,
    item: Observed,
    recording: Recording,
    predicted: Predicted | None,
    fractions: np.ndarray,
    normals: np.ndarray | None = None,
) -> xr.Dataset:
    """What was simulated for an experiment at `fractions` of the centre line, beside what was measured, on all its frames.

    normals : (frames, nodes, 2) of the measured centre line, where they are known already
    """
    data = recording.dataset
    nodes = fractions.size
    frames = data.sizes["time"]
    flip = np.array([item.mirror, 1.0])
    scored = np.zeros(frames, dtype=np.int8)
    scored[item.frame[item.counts]] = predicted is not None
    line = np.full((frames, nodes, 2), np.nan)
    if predicted is not None:
        line[item.frame] = predicted.points / MM * flip
    angle = np.full(frames, np.nan)
    theta = np.full((frames, simulator.chain.bodies), np.nan)
    if predicted is not None:
        angle[item.frame] = np.rad2deg(predicted.angle)
        theta[item.frame] = np.rad2deg(predicted.motion.theta)
    variables: dict[str, tuple] = {
        "tip": (("time", "xy"), line[:, -1].astype(np.float32), {"units": "mm"}),
        "midline": (("time", "node", "xy"), line.astype(np.float32), {"units": "mm"}),
        "bend_angle": (("time",), angle.astype(np.float32), {"units": "deg"}),
        "theta": (("time", "joint"), theta.astype(np.float32), {"units": "deg"}),
        "scored": (("time",), scored, {"long_name": "whether the frame is compared with what was measured"}),
    }
    elongation = simulator.chain.offset * np.deg2rad(theta) / simulator.chain.arc[0]
    variables["elongation"] = (("time", "segment"), elongation.astype(np.float32), {"units": "1"})
    line[scored == 0], angle[scored == 0] = np.nan, np.nan  # from here on what is compared
    if "tip" in data:
        gap = data["tip"].values - line[:, -1]
        variables["tip_residual"] = (("time", "xy"), gap.astype(np.float32), {"units": "mm"})
    if "midline" in data:
        measured = data["midline"].values
        across = normals_of(measured) if normals is None else normals
        gap = np.sum(across * (measured - line), axis=2)
        variables["normal_residual"] = (("time", "node"), gap.astype(np.float32), {"units": "mm"})
    if "bend_angle" in data:
        gap = data["bend_angle"].values - angle
        variables["angle_residual"] = (("time",), gap.astype(np.float32), {"units": "deg"})
    return xr.Dataset(
        variables,
        coords={"time": ("time", data["time"].values, {"units": "s"}), "xy": ["x", "y"]},
        attrs={"experiment": item.name, "role": item.role, "line": "centre line"},
    )
