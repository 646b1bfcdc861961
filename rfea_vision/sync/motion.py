"""The offset between two clocks from the motion itself.

Inverse dynamics as a regression: whatever its parameters are, the tube's equation of motion gives the pressure from
its bending, bending rate and bending acceleration at the same instant,

    p(t + offset) = sum of c_i f_i(q, q', q''),

with q the tangent angle at a few places along the tube. The offset is where this explains most. Nothing about the tube
is assumed known: stiffness, damping (two directions), inertia, friction and slow relaxation are all free coefficients,
so the tube's own delay is left to the model that is fitted later. Both sides pass the same zero-phase filter. What the
regression cannot tell from an offset is a line that delays the pressure itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts import Track
from rfea_vision.errors import DataError

FloatArray = NDArray[np.float64]

LOW_HZ, HIGH_HZ = 0.4, 16.0
PLACES = (0.35, 0.7, 1.0)
COARSE_S = 0.008
LEAST_OVERLAP_S = 1.0
LEAST_SWING_DEG = 1.0
LEAST_EXPLAINED = 0.5


@dataclass(frozen=True)
class Alignment:
    """Log clock minus camera clock, and how sure that is; `curve` is (offset_s, explained share)."""

    offset_s: float
    offset_stderr_s: float
    drift_ppm: float
    drift_stderr_ppm: float
    explained: float
    curve: tuple[FloatArray, FloatArray]
    note: str


def align_by_motion(
    track: Track, log_time_s: FloatArray, pressure_kPa: FloatArray, *, experiment: str, bends: str
) -> Alignment:
    """Estimate offset and drift.

    Raises
    ------
    DataError
        If the motion or the pressure is too small, or the two do not belong together.
    """
    time, angles = bending(track, bends)
    if len(time) < 30 or time[-1] - time[0] < LEAST_OVERLAP_S:
        raise DataError(
            f"{experiment}: sync: {len(time)} tracked frames are too few to align by motion; use sync.method offset"
        )
    if np.ptp(angles[:, -1]) < np.radians(LEAST_SWING_DEG):
        raise DataError(
            f"{experiment}: sync: the tube hardly moves ({np.degrees(np.ptp(angles[:, -1])):.2f} deg); use sync.method offset, led or trigger"
        )
    rate = 1.0 / float(np.median(np.diff(time)))
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    q = np.column_stack([np.interp(grid, time, column) for column in angles.T])
    solid = _near(grid, time, 2.5 / rate)
    high = min(HIGH_HZ, 0.2 * rate)
    q, velocity, acceleration = _smooth_derivatives(q, rate, high)
    terms = _band(_regressors(q, velocity, acceleration, rate), rate, high)
    edge = round(min(0.08 * len(grid), 0.12 * rate))
    solid[:edge] = solid[len(grid) - edge :] = False
    target = _Target(log_time_s, pressure_kPa, rate, high)
    coarse = _search(grid, terms, solid, target)
    if coarse.explained < LEAST_EXPLAINED:
        raise DataError(
            f"{experiment}: sync: the motion explains only {100 * coarse.explained:.0f} % of the pressure at any offset; check that video and log belong together, or use sync.method offset"
        )
    return _refine(grid, terms, solid, target, coarse)


def bending(track: Track, bends: str) -> tuple[FloatArray, FloatArray]:
    """Times (n,) and tangent angles (n, places) in rad of the valid frames, from what the track has."""
    dataset, valid = track.dataset, track.valid
    time = track.time_s[valid]
    if "midline" in dataset:
        midline = dataset["midline"].values[valid]
        step = np.diff(midline, axis=1)
        sign = 1.0 if bends == "left" else -1.0
        angle = np.unwrap(np.arctan2(-sign * step[..., 0], -step[..., 1]), axis=1)
        smooth = np.cumsum(angle, axis=1)
        n = angle.shape[1]
        w = max(n // 6, 1)
        columns = []
        for place in PLACES:
            last = min(round(place * n), n)
            first = max(last - w, 0)
            before = smooth[:, first - 1] if first > 0 else 0.0
            columns.append((smooth[:, last - 1] - before) / (last - first))
        found = np.column_stack(columns)
    elif "bend_angle" in dataset:
        found = np.radians(dataset["bend_angle"].values[valid])[:, None]
    else:
        tip = dataset["tip"].values[valid]
        found = tip / max(float(np.abs(tip).max()), 1e-9)
    good = np.all(np.isfinite(found), axis=1)
    time, found = time[good], found[good]
    first = np.concatenate([[True], np.diff(time) > 1e-9])
    return time[first], np.unwrap(found[first], axis=0)


def _near(grid: FloatArray, time: FloatArray, reach: float) -> NDArray[np.bool_]:
    after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    return (time[after] - time[after - 1]) < reach


def _gauss(values: FloatArray, rate: float, cut_Hz: float, order: int = 0) -> FloatArray:
    """Gaussian low-pass (half power at `cut_Hz`) and its time derivatives, zero phase, along axis 0."""
    sigma = np.sqrt(np.log(2) / 2) / np.pi / 2 / cut_Hz * np.sqrt(2) * rate
    reach = int(np.ceil(4.5 * sigma)) + 1
    x = np.arange(-reach, reach + 1)
    kernel = np.exp(-0.5 * (x / sigma) ** 2)
    kernel /= kernel.sum()
    if order == 1:
        kernel = -x * kernel / np.sum(x * x * kernel) * rate
    elif order == 2:
        kernel = (x * x / sigma**2 - 1) * kernel
        kernel -= kernel.mean()
        kernel /= np.sum(x * x * kernel) / 2 / rate**2
    padded = np.pad(values, [(reach, reach)] + [(0, 0)] * (values.ndim - 1), mode="edge")
    flat = padded.reshape(len(padded), -1)
    out = np.column_stack([np.convolve(column, kernel[::-1] if order == 0 else kernel, "valid") for column in flat.T])
    return out.reshape(values.shape)


def _smooth_derivatives(q: FloatArray, rate: float, high: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    return _gauss(q, rate, 2 * high), _gauss(q, rate, 2 * high, 1), _gauss(q, rate, 2 * high, 2)


def _band(values: FloatArray, rate: float, high: float) -> FloatArray:
    return _gauss(values, rate, high) - _gauss(values, rate, LOW_HZ)


def _regressors(q: FloatArray, velocity: FloatArray, acceleration: FloatArray, rate: float) -> FloatArray:
    """Terms of an unknown equation of motion, (n, terms)."""
    main, speed, push = q[:, -1], velocity[:, -1], acceleration[:, -1]
    scale = max(float(np.sqrt(np.mean(speed**2))), 1e-9)
    terms = [*q.T, *velocity.T, *acceleration.T]
    terms += [main**2, main**3, main * speed, main * push, np.abs(speed), main * np.abs(speed), speed**2]
    terms += [np.tanh(speed / (0.1 * scale)), np.tanh(speed / (0.5 * scale))]
    for constant_s in (0.15, 0.6, 2.5):
        terms.append(_relaxed(main, constant_s * rate))
    return np.column_stack(terms)


def _relaxed(values: FloatArray, samples: float) -> FloatArray:
    from scipy.signal import lfilter

    a = np.exp(-1.0 / samples)
    return values[0] + lfilter([1 - a], [1, -a], values - values[0])


class _Target:
    """The log's pressure, filtered like the regressors, at any offset."""

    def __init__(self, time: FloatArray, pressure: FloatArray, rate: float, high: float) -> None:
        step = float(np.median(np.diff(time)))
        fine = min(step, 1.0 / rate)
        self.time = np.arange(time[0], time[-1], fine)
        self.rate = 1.0 / fine
        raw = np.interp(self.time, time, pressure)
        self.values = _band(raw[:, None], self.rate, high)[:, 0]
        # the regressors were low-passed once more when they were differentiated
        self.values = _gauss(self.values[:, None], self.rate, 2 * high)[:, 0]
        self.slope = np.gradient(self.values, self.time)
        margin = 0.1
        self.first, self.last = self.time[0] + margin, self.time[-1] - margin

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        inside = (times >= self.first) & (times <= self.last)
        return np.interp(times, self.time, self.values), np.interp(times, self.time, self.slope), inside


@dataclass(frozen=True)
class _Coarse:
    offset_s: float
    explained: float
    offsets_s: FloatArray
    shares: FloatArray


def _explained(terms: FloatArray, values: FloatArray, use: NDArray[np.bool_]) -> float:
    x = terms[use] - terms[use].mean(axis=0)
    y = values[use] - values[use].mean()
    total = float(y @ y)
    if total <= 0:
        return 0.0
    left = np.linalg.qr(x / (np.linalg.norm(x, axis=0) + 1e-12))[0]
    projected = left.T @ y
    freedom = max(len(y) - terms.shape[1], 1)
    return 1.0 - (total - float(projected @ projected)) / total * len(y) / freedom


def _search(grid: FloatArray, terms: FloatArray, solid: NDArray[np.bool_], target: _Target) -> _Coarse:
    """Try every offset at which enough of the motion lies within the log."""
    thin = slice(None, None, max(len(grid) // 1500, 1))
    grid, terms, solid = grid[thin], terms[thin], solid[thin]
    span = grid[-1] - grid[0]
    least = max(LEAST_OVERLAP_S, 0.5 * min(span, target.last - target.first))
    low, high = target.first - grid[-1] + least, target.last - grid[0] - least
    count = int(min(max((high - low) / COARSE_S, 1), 4000))
    offsets = np.linspace(low, high, count + 1)
    x = terms / (np.linalg.norm(terms, axis=0) + 1e-12)
    whole = np.linalg.qr(x[solid] - x[solid].mean(axis=0))[0]
    shares = np.zeros(len(offsets))
    overall = float(np.mean(target.values**2))
    for k, offset in enumerate(offsets):
        values, _, inside = target.at(grid + offset)
        use = solid & inside
        if use.sum() < 3 * terms.shape[1] or np.mean(values[use] ** 2) < 0.05 * overall:
            continue
        if use.sum() == solid.sum():
            y = values[solid] - values[solid].mean()
            p = whole.T @ y
            shares[k] = float(p @ p) / max(float(y @ y), 1e-12)
        else:
            # a short overlap is easily explained by many terms: what counts is the share of the whole motion
            shares[k] = _explained(terms, values, use) * use.sum() / solid.sum()
    best = int(np.argmax(shares))
    return _Coarse(float(offsets[best]), float(shares[best]), offsets, shares)


def _refine(
    grid: FloatArray, terms: FloatArray, solid: NDArray[np.bool_], target: _Target, coarse: _Coarse
) -> Alignment:
    offset, drift = coarse.offset_s, 0.0
    middle = float(grid[solid].mean())
    step_limit = 2 * max(COARSE_S, float(np.diff(coarse.offsets_s[:2])[0]) if len(coarse.offsets_s) > 1 else COARSE_S)
    for _ in range(15):
        values, slope, inside = target.at(grid + offset)
        change, _, _ = _newton(terms, values, slope, solid & inside, None)
        change = float(np.clip(change[0], -step_limit, step_limit))
        offset += change
        if abs(change) < 1e-7:
            break
    values, slope, inside = target.at(grid + offset)
    use = solid & inside
    _, covariance, residual = _newton(terms, values, slope, use, None)
    both, both_covariance, _ = _newton(terms, values, slope, use, grid - middle)
    error = max(float(np.sqrt(covariance[0, 0])), _jackknife(terms, values, slope, use))
    drift_error = float(np.sqrt(both_covariance[1, 1]))
    note = ""
    if abs(both[1]) > 4 * drift_error and abs(both[1]) > 20e-6 and drift_error < 50e-6:
        drift = float(both[1])
        note = "drift taken into account"
    explained = 1.0 - float(residual @ residual) / float(np.sum((values[use] - values[use].mean()) ** 2))
    return Alignment(
        offset - drift * middle,
        error,
        1e6 * drift,
        1e6 * drift_error,
        explained,
        (coarse.offsets_s, coarse.shares),
        note,
    )


def _newton(terms, values, slope, use, centred_time):
    """One step for the offset (and the drift, if times are given) beside all coefficients; HAC covariance, residual."""
    columns = [-slope[use]]
    if centred_time is not None:
        columns.append(-slope[use] * centred_time[use])
    x = np.column_stack([*columns, terms[use], np.ones(int(use.sum()))])
    scale = np.linalg.norm(x, axis=0) + 1e-12
    x = x / scale
    y = values[use]
    inverse = np.linalg.pinv(x.T @ x, rcond=1e-12, hermitian=True)
    solution = inverse @ (x.T @ y)
    residual = y - x @ solution
    # Newey and West: neighbouring residuals are alike.
    lags = min(int(1.5 * np.sqrt(len(y))), len(y) // 4)
    scores = x * residual[:, None]
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        weight = 1 - lag / (lags + 1)
        cross = scores[lag:].T @ scores[:-lag]
        middle += weight * (cross + cross.T)
    covariance = inverse @ middle @ inverse
    n = len(columns)
    return solution[:n] / scale[:n], covariance[:n, :n] / scale[:n, None] / scale[None, :n], residual


def _jackknife(terms, values, slope, use, parts: int = 6) -> float:
    """Standard error from leaving out one stretch at a time."""
    places = np.array_split(np.flatnonzero(use), parts)
    found = []
    for part in places:
        rest = use.copy()
        rest[part] = False
        if rest.sum() > 3 * terms.shape[1]:
            found.append(_newton(terms, values, slope, rest, None)[0][0])
    if len(found) < 3:
        return 0.0
    found = np.array(found)
    return float(np.sqrt((len(found) - 1) / len(found) * np.sum((found - found.mean()) ** 2)))
