"""From a recording to what the fit sees of it: which frames, which points with which weights, from when on."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Recording, bend_sign
from rfea_vision.dynamics.excitation import LONGEST_STEP_S
from rfea_vision.dynamics.simulation import STANDARD_GRAVITY, Excitation
from rfea_vision.errors import DataError
from rfea_vision.fitting.noise import white_noise_mm
from rfea_vision.fitting.nuisance import BEFORE_S
from rfea_vision.fitting.observed import MM, Observed
from rfea_vision.fitting.release import Held, release_frame, release_time_s
from rfea_vision.options.fit import Observe
from rfea_vision.scatter import leaps

FITTED_NODES = 8  # of the centre line, evenly spaced, beside that at the clamp
ORIGIN_SIGMA_MM = 0.1  # of a track that does not say it, see `residuals.origin_shift`
#: No track is better than this; runs that claim no error would outweigh all others.
SMALLEST_SIGMA_MM = 0.005
SMALLEST_SIGMA_DEG = 0.005
#: What a clock that was found from the motion may be off by beyond its own standard error: lines and tubes lag by so much.
TUBE_LAG_S = 0.05
#: Steps of the integrator to a period of the faster of log and camera, and the longest step that is taken.
STEPS_PER_PERIOD = 5
SLOWEST_STEP_S = 8e-3
#: Log before the first frame that is simulated too, at most; what came before has died away by the first frame after half.
LONGEST_BEFORE_S, SETTLED_S = 3.0, 1.5
#: A log whose pressure stands still for this long at first is taken to begin with the tube at rest.
STILL_PA, STILL_S = 1e3, 0.25


def default_observe(recordings: list[Recording]) -> Observe:
    """The richest observation that every recording offers."""
    for name, key in (("midline", "midline"), ("tip", "tip"), ("angle", "bend_angle")):
        if all(key in r.dataset for r in recordings):
            return name  # type: ignore[return-value]
    return "angle"


def normals_of(line: FloatArray) -> FloatArray:
    """Unit normals (frames, m, 2) of centre lines (frames, m, 2); zero where two points of a line are one."""
    tangent = np.gradient(line, axis=1)
    length = np.linalg.norm(tangent, axis=2, keepdims=True)
    return np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1) / np.where(length > 0, length, 1.0)


def _points(
    recording: Recording, valid: NDArray[np.bool_], mirror: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Fractions, points, normals and sigma of the valid frames."""
    data = recording.dataset
    flip = np.array([mirror, 1.0])
    count = int(valid.sum())
    if "midline" in data:
        line = data["midline"].values[valid] * flip * MM
        normals = normals_of(line)
        total = line.shape[1]
        pick = np.unique(np.linspace(0, total - 1, FITTED_NODES + 1).round().astype(int))[1:]
        fractions = pick / (total - 1)
        if "midline_sigma" in data:
            sigma = data["midline_sigma"].values[valid][:, pick] * MM
        else:
            sigma = np.full((count, pick.size), white_noise_mm(data["midline"].values[valid][:, -1]) * MM / np.sqrt(2))
        if "tip" in data:
            line[:, -1] = data["tip"].values[valid] * flip * MM
        return fractions, line[:, pick], normals[:, pick], sigma
    if "tip" in data:
        points = (data["tip"].values[valid] * flip * MM)[:, None, :]
        normals = np.tile(np.array([1.0, 0.0]), (count, 1, 1))
        if "tip_sigma" in data:
            sigma = np.sqrt(np.mean(data["tip_sigma"].values[valid] ** 2, axis=1))[:, None] * MM
        else:
            sigma = np.full((count, 1), white_noise_mm(data["tip"].values[valid]) * MM / np.sqrt(2))
        return np.array([1.0]), points, normals, sigma
    return np.zeros(0), np.zeros((count, 0, 2)), np.zeros((count, 0, 2)), np.zeros((count, 0))


def _without_jumps(points: FloatArray, angle: FloatArray, sigma: FloatArray) -> NDArray[np.bool_]:
    """Frames whose tip does not stand out alone from its neighbours (base and tip swapped, a reflection caught)."""
    signal = points[:, -1] if points.shape[1] else angle[:, None]
    return ~leaps(signal, 10 * np.median(sigma[:, -1]) if sigma.shape[1] else 0.0)


def observe_recording(
    recording: Recording, observe: Observe | None = None, *, longest_step_s: float = np.inf
) -> Observed:
    """Prepare a recording, to be simulated in steps that resolve what log and frames can show, and no longer than those given.

    Raises
    ------
    DataError
        Too few valid frames within the pressure log, or an observation the track does not carry.
    """
    data, name = recording.dataset, recording.name
    log_time, pressure, chambers = _log(data)
    time, valid = recording.time_s.astype(float), _usable(recording, log_time)
    mirror = bend_sign(data.attrs.get("bends", "left"))
    fractions, points, normals, sigma = _points(recording, valid, mirror)
    sigma = np.where(np.isfinite(sigma), sigma, np.nanmedian(sigma) if sigma.size else 0)
    sigma = np.maximum(sigma, SMALLEST_SIGMA_MM * MM)
    angle, angle_sigma = _angles(data, valid)
    wanted: Observe = observe or default_observe([recording])
    _refuse_unseen(recording, wanted, fractions, angle)
    keep = _without_jumps(points, angle, sigma)
    method = str(data.attrs.get("sync_method", "common_clock"))
    held, keep = _held(recording, time[valid], points, angle, keep)
    if held is not None:
        from_s, unknown_before_s = held.until_s, None
    elif "earlier_pressure" in data:  # the tube still carries what the runs before did to it
        log_time, pressure, chambers = _with_earlier(data, log_time, pressure, chambers)
        from_s, unknown_before_s = float(log_time[0]), None
    else:
        from_s, unknown_before_s = _beginning(
            log_time, pressure, time[valid][keep], points[keep, -1] if fractions.size else angle[keep, None]
        )
    step_s = min(longest_step_s, _longest_step_s(log_time, time[valid]))
    until_s, let_loose = float(time[valid][-1]) + 0.25, held is not None
    excitation = Excitation.from_log(log_time, pressure, from_s, until_s, step_s, chambers, at_once=let_loose)
    # A hand lets go when it does: where nothing but that is timed by the log's clock, the moment is found with the fit.
    let_go = let_loose and bool(np.ptp(pressure) < 1e3)
    gravity, mounting = rig_of(data)
    seen_s = time[valid][keep]
    tip_mm = points[keep, -1] / MM if fractions.size else np.zeros((0, 2))
    return Observed(
        name=name,
        role=recording.role,
        mirror=mirror,
        time=seen_s,
        frame=np.flatnonzero(valid)[keep],
        fractions=fractions,
        points=points[keep],
        normals=normals[keep],
        sigma=sigma[keep],
        angle=angle[keep],
        angle_sigma=angle_sigma[keep],
        excitation=excitation,
        observe=wanted,
        clock_sigma=_clock_sigma(recording, method, float(np.median(np.diff(time[valid]))) if let_go else None),
        middle_s=float(0.5 * (seen_s[0] + seen_s[-1])),
        repeat_of=data.attrs.get("repeat_of") or None,
        tip_noise_mm=white_noise_mm(tip_mm),
        origin_sigma=_origin_sigma(data) if fractions.size > 1 else 0.0,
        unknown_before_s=unknown_before_s,
        gravity=gravity,
        mounting=mounting,
        held=held,
        conditions=json.loads(str(data.attrs.get("conditions", "{}"))),
    )


def _usable(recording: Recording, log_time: FloatArray) -> NDArray[np.bool_]:
    """Frames that are valid, whole, in order, and within the pressure log."""
    time = recording.time_s.astype(float)
    margin = 0.02  # s: a clock is moved by so much without leaving the log
    valid = recording.valid & (time >= log_time[0] + margin) & (time <= log_time[-1] - margin)
    valid &= np.concatenate([[True], np.diff(time) > 0])
    for key in ("tip", "midline", "bend_angle"):
        if key in recording.dataset:
            valid &= np.all(np.isfinite(recording.dataset[key].values.reshape(time.size, -1)), axis=1)
    if valid.sum() < 10:
        raise DataError(
            f"experiment {recording.name}: only {int(valid.sum())} valid frames lie within the pressure log; "
            "check the track's reasons (`rfea check`) and the clock offset"
        )
    return valid


def _angles(data: xr.Dataset, valid: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Bend angle of the valid frames (rad), NaN where there is none, and its standard error."""
    count = int(valid.sum())
    angle = np.deg2rad(data["bend_angle"].values[valid]) if "bend_angle" in data else np.full(count, np.nan)
    if "bend_angle_sigma" in data:
        sigma = np.deg2rad(data["bend_angle_sigma"].values[valid])
    else:
        pair = np.column_stack([np.rad2deg(angle), np.zeros(count)])
        sigma = np.full(count, np.deg2rad(white_noise_mm(pair)))
    return angle, np.maximum(np.where(np.isfinite(sigma), sigma, 0), np.deg2rad(SMALLEST_SIGMA_DEG))


def _refuse_unseen(recording: Recording, wanted: Observe, fractions: FloatArray, angle: FloatArray) -> None:
    """Refuse an observation that the track does not carry."""
    lacks = {
        "midline": fractions.size < 2,
        "tip": fractions.size == 0,
        "tip_y": fractions.size == 0,
        "angle": not np.any(np.isfinite(angle)),
    }
    if lacks[wanted]:
        what = "bend angle" if wanted == "angle" else wanted.split("_")[0]
        remedy = f"use --observe {default_observe([recording])}"
        raise DataError(f"experiment {recording.name}: its track has no {what}; {remedy}")


#: Sign and pressure (Pa) of each of several chambers, by its name.
Chambers = dict[str, tuple[float, FloatArray]]


def _log(data: xr.Dataset) -> tuple[FloatArray, FloatArray, Chambers]:
    """Times (s) and pressures (Pa) of the log: their sum, and those of each chamber where there are several."""
    pressure = data["pressure"].values.astype(float) * 1e3
    chambers: Chambers = {}
    if "chamber_sign" in data:
        for name, sign, own in zip(
            data["chamber"].values, data["chamber_sign"].values, data["chamber_pressure"].values, strict=True
        ):
            chambers[str(name)] = (float(sign), own.astype(float) * 1e3)
    return data["log_time"].values.astype(float), pressure, chambers


def _with_earlier(
    data: xr.Dataset, log_time: FloatArray, pressure: FloatArray, chambers: Chambers
) -> tuple[FloatArray, FloatArray, Chambers]:
    """The log with that of the runs before; of these the sum alone is known: to its own effects a chamber stands as at the start."""
    earlier = np.ones(data["earlier_time"].size)
    return (
        np.concatenate([data["earlier_time"].values, log_time]),
        np.concatenate([data["earlier_pressure"].values * 1e3, pressure]),
        {name: (sign, np.concatenate([own[0] * earlier, own])) for name, (sign, own) in chambers.items()},
    )


def _longest_step_s(log_time: FloatArray, time: FloatArray) -> float:
    """Longest step (s) that resolves what this run's log and frames can show.

    Frames show no motion faster than one of two of their periods, a log no change faster than from one sample to the next:
    a fifth of the shorter period is ten steps to the fastest motion that is compared.
    """
    period = min(float(np.median(np.diff(log_time))), float(np.median(np.diff(time))))
    return float(np.clip(period / STEPS_PER_PERIOD, LONGEST_STEP_S, SLOWEST_STEP_S))


def _clock_sigma(recording: Recording, method: str, let_go_s: float | None) -> float:
    """Standard error (s) with which the clock of a run is known; 0 where it is better than the log's own step needs.

    Motion shows log and tube together: what it says of the clock is off by as much as the tube lags. The moment at which a
    hand let go is seen to one frame, `let_go_s`.
    """
    found = float(recording.dataset.attrs.get("offset_stderr_s", 0.0) or 0.0)
    if let_go_s is not None:
        return let_go_s
    if method == "motion":
        return float(np.hypot(found if np.isfinite(found) else 0.0, TUBE_LAG_S))
    return found if np.isfinite(found) and found > LONGEST_STEP_S else 0.0


def _held(
    recording: Recording, time: FloatArray, points: FloatArray, angle: FloatArray, keep: NDArray[np.bool_]
) -> tuple[Held | None, NDArray[np.bool_]]:
    """How the tube was held at first, if it was, and the frames that show it after that."""
    attributes = recording.dataset.attrs
    if "held_until_s" not in attributes:
        return None, keep
    signal = (points[:, -1] if points.shape[1] else angle[:, None])[keep]
    until_s = float(attributes["held_until_s"])
    told = until_s * (1 + 1e-6 * float(attributes.get("drift_ppm", 0.0))) + float(attributes.get("offset_s", 0.0))
    first = release_frame(recording.name, time[keep], signal, told)
    shown = np.flatnonzero(keep)[:first]
    if not np.isfinite(until_s):
        told = release_time_s(time[keep], signal, first)
    line = points[shown].mean(axis=0) if points.shape[1] else np.zeros((0, 2))
    free = keep & (time >= told)
    force = None
    if "pulled_N" in attributes:
        way = np.deg2rad(float(attributes["pulled_deg"]))
        force = float(attributes["pulled_N"]) * np.array([-np.sin(way), -np.cos(way)])
    return Held(told, line, float(np.mean(angle[shown])), force), free


def _beginning(
    log_time: FloatArray, pressure: FloatArray, time: FloatArray, signal: FloatArray
) -> tuple[float, float | None]:
    """Where a simulation starts from rest, and before which time its pressure is unknown (None: it did begin at rest).

    As much of the log as is at hand is simulated, up to three seconds, unless the pressure stands still in it.
    """
    before = (log_time >= time[0] - LONGEST_BEFORE_S) & (log_time <= time[0])
    still = (np.ptp(pressure[before]) if before.any() else 0.0) <= 0.005 * float(np.ptp(pressure)) + STILL_PA
    from_s = float(time[0]) - 0.25
    if not still:
        from_s = min(from_s, max(float(log_time[0]), float(time[0]) - LONGEST_BEFORE_S))
    opening = log_time <= log_time[0] + STILL_S
    begins_at_rest = (
        time[0] - log_time[0] > STILL_S and np.ptp(pressure[opening]) <= 0.005 * np.ptp(pressure) + STILL_PA
    )
    if begins_at_rest or time[0] - log_time[0] > SETTLED_S or not _moves_at_first(time, signal):
        return from_s, None
    return float(log_time[0]) - BEFORE_S, float(log_time[0])


def _moves_at_first(time: FloatArray, signal: FloatArray) -> bool:
    """Whether the tube moves in the first tenth of a second by far more than its track scatters."""
    first = time <= time[0] + 0.1
    if first.sum() < 6:
        return False
    line = np.polyfit(time[first] - time[0], signal[first], 1)
    travelled = np.abs(line[0]) * (time[first][-1] - time[0])
    scatter = np.std(np.diff(signal[first], axis=0), axis=0) / np.sqrt(2)
    return bool(np.any((travelled > 0.01 * np.ptp(signal, axis=0).max()) & (travelled > 6 * scatter)))


def rig_of(data: xr.Dataset) -> tuple[float, float]:
    """Gravity (m/s^2) in the plane of a recording, and its direction (rad) from down, positive towards the side of the bend."""
    gravity = 0.0 if data.attrs.get("gravity") == "none" else STANDARD_GRAVITY
    return gravity, float(np.deg2rad(float(data.attrs.get("gravity_deg", 0.0))))


def _origin_sigma(data: xr.Dataset) -> float:
    """Standard error (m) of the origin of a track read from pictures: where the first visible cross-section was seen."""
    if "clamp_found_by" not in data.attrs:
        return 0.0
    return float(data.attrs.get("origin_sigma_mm", ORIGIN_SIGMA_MM)) * MM
