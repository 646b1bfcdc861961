"""Where the camera sees a motion: points of the centre line with their derivatives, and what of a rig is found run by run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.excitation import Excitation, lagged
from rfea_vision.dynamics.line import scalar, sensed
from rfea_vision.dynamics.simulation import Model, Motion
from rfea_vision.fitting.observed import Observed


def stretching(
    model: Model, par: FloatArray, excitation: Excitation, frames_s: FloatArray
) -> tuple[FloatArray, FloatArray | None]:
    """Sum of the pressures in all chambers (frames,) in Pa as the body's length follows it, and its derivative (frames, parameters).

    The derivative is None where nothing of it depends on a parameter. par : (parameters,) in SI; frames_s : (frames,) of the log
    """
    own = [values for _, values in excitation.chambers.values()]
    total = np.sum(own, axis=0) if own else model.combined(par, excitation)[0]
    if not model.law.changes("stretch_time_constant"):
        return excitation.at(frames_s, total), None
    lag, by_par = scalar(model.law.stretch_time_constant, par, model._constants)
    ends = np.array([0.0, 1.0])  # of every step
    late, by_lag = (np.append(part[:1, 0], part[:, 1]) for part in lagged(total, excitation.step_s, ends, max(lag, 0.0)))
    return excitation.at(frames_s, late), excitation.at(frames_s, by_lag)[:, None] * by_par


def seen_by_camera(
    model: Model,
    par: FloatArray,
    seen: Motion,
    fractions: FloatArray,
    free: Sequence[int],
    pressure: FloatArray,
    total: FloatArray | None = None,
    change: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Points on the centre line as the camera reports them (frames, k, 2) in m, with their derivatives (frames, k, 2, p).

    par : (parameters,) in SI; fractions : (k,) of the line's length; free : places in `par` to differentiate by
    pressure : (frames,) at the sensor in Pa; total, change : (frames,) and (frames, parameters) as `stretching` gives them
    """
    points, dpoints = model.centre_line(seen, fractions)
    if model.law.changes("stretch"):
        felt, by_felt = sensed(
            model.law.felt_pressure, par, model._constants, pressure if total is None else total, change
        )
        row = model.law.stretch(par, model._constants, felt)[0]
        factor = np.broadcast_to(1.0 + np.asarray(row[0], dtype=float), felt.shape)[:, None, None]
        dpoints = factor[..., None] * dpoints
        for column, k in enumerate(free):
            change = np.broadcast_to(row[2 + k] + row[1] * by_felt[:, k], felt.shape)
            dpoints[..., column] += change[:, None, None] * points
        points = factor * points
    if model.law.changes("line_shift"):
        shift_out, dshift_out = _shifted_line(model, par, seen, fractions, free, pressure)
        points, dpoints = points + shift_out, dpoints + dshift_out
    if not model.law.changes("observed_position"):
        return points, dpoints
    rows = model.law.observed_position(par, model._constants, points[..., 0], points[..., 1])
    jacobian = np.empty((*points.shape[:-1], 2, 2))
    explicit = np.zeros_like(dpoints)
    moved = np.empty_like(points)
    for axis in range(2):
        moved[..., axis] = rows[axis][0]
        jacobian[..., axis, 0], jacobian[..., axis, 1] = rows[axis][1], rows[axis][2]
        for column, k in enumerate(free):
            explicit[..., axis, column] = rows[axis][3 + k]
    return moved, np.einsum("...ab,...bp->...ap", jacobian, dpoints) + explicit


def _shifted_line(
    model: Model, par: FloatArray, seen: Motion, fractions: FloatArray, free: Sequence[int], pressure: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Shift of the centre line (frames, m, 2) away from the inextensible side, as against its first cross-section's."""
    felt, by_felt = sensed(model.law.felt_pressure, par, model._constants, pressure, None)
    row = model.law.line_shift(par, model._constants, felt)[0]
    size = np.broadcast_to(np.asarray(row[0], dtype=float), pressure.shape)[:, None, None]
    # Bend and material coordinate go together closely enough for a shift of a tenth of a millimetre.
    ends = np.linspace(0, 1, seen.phi.shape[1])
    weights = np.stack([np.interp(fractions, ends, one) for one in np.eye(ends.size)], axis=1)
    phi, slope = seen.phi @ weights.T, np.einsum("mk,fkp->fmp", weights, seen.sensitivity)
    clamp, clamp_slope = seen.phi[:, :1], seen.sensitivity[:, :1]
    outward = np.stack([np.cos(phi) - np.cos(clamp), np.sin(clamp) - np.sin(phi)], axis=-1)
    turned, clamp_turned = (np.stack([-np.sin(a), -np.cos(a)], axis=-1) for a in (phi, clamp))
    derivative = turned[..., None] * slope[:, :, None] - clamp_turned[..., None] * clamp_slope[:, :, None]
    derivative *= size[..., None]
    for column, k in enumerate(free):
        change = np.broadcast_to(row[2 + k] + row[1] * by_felt[:, k], pressure.shape)
        derivative[..., column] += change[:, None, None] * outward
    return size * outward, derivative


#: The origin of a track from pictures may be moved by at most this many of its standard errors.
LARGEST_ORIGIN_SHIFT = 3.0


def origin_shift(item: Observed, points: FloatArray, dpoints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shift of the origin (2,) in m that fits a run best, with its derivatives (2, p).

    The end of the clamp is known to a tenth of a millimetre or so, with the same error in all frames of a run. That error would be
    taken for physics; it enters linearly, so it is eliminated here (variable projection, Golub and Pereyra 1973, doi:10.1137/0710036).
    """
    gap = item.points - points
    normal, tip = item.normals[:, :-1], 1 / item.sigma[:, -1] ** 2
    weight = 1 / item.sigma[:, :-1] ** 2
    information = np.einsum("fm,fma,fmb->ab", weight, normal, normal) + np.eye(2) * (tip.sum() + item.origin_sigma**-2)
    right = np.einsum("fm,fma,fmb,fmb->a", weight, normal, normal, gap[:, :-1]) + np.einsum("f,fa->a", tip, gap[:, -1])
    shift = np.linalg.solve(information, right)
    slope = np.einsum("fm,fma,fmb,fmbp->ap", weight, normal, normal, dpoints[:, :-1], optimize=True)
    slope = -np.linalg.solve(information, slope + np.einsum("f,fap->ap", tip, dpoints[:, -1]))
    limit = LARGEST_ORIGIN_SHIFT * item.origin_sigma
    inside = np.abs(shift) < limit
    return np.clip(shift, -limit, limit), slope * inside[:, None]


def angle_zero(item: Observed, angle: FloatArray, dangle: FloatArray) -> tuple[float, FloatArray]:
    """Zero of an angle sensor (rad) that fits a run best, with its derivatives (p,); eliminated as in `origin_shift`."""
    weight = item.angle_sigma**-2
    weight = weight / (weight.sum() + item.angle_zero_sd**-2)
    return float(weight @ (item.angle - angle)), -weight @ dangle
