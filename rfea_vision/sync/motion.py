"""The offset between two clocks from the motion itself.

Inverse dynamics as a regression: whatever its parameters are, the tube's equation of motion gives the pressure from
shape, velocity and acceleration at the same instant (`rfea_vision.sync.sections`). The offset is where this explains
most of the logged pressure. Stiffness, damping and inertia are free coefficients, so the tube's own delay is left to
the model that is fitted later. Both sides pass the same zero-phase filter. What the regression cannot tell from an
offset is a line that delays the pressure itself.

Noise in the track makes its derivatives, and so the coefficients, a little wrong, which leans on the offset. The lean
is measured by adding the track's own noise a second time, and taken off (Cook and Stefanski, J. Am. Stat. Assoc. 89,
1994, 1314).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts import Track
from rfea_vision.errors import DataError
from rfea_vision.sync.doubts import check_direction, gaps_of, log_notes, outside_gaps, repetition
from rfea_vision.sync.sections import Motion, motion_of, terms

FloatArray = NDArray[np.float64]

LOW_HZ, HIGH_HZ = 0.8, 8.0
COARSE_S = 0.006
LEAST_OVERLAP_S = 1.0
HIGHEST_OF_LOG_RATE = 0.15
BETWEEN_SAMPLES = 1.2  # s^-1: times the square of the log's step, as a standard error
FILTER_REACH_S = 0.15
LEAST_SWING_DEG = 1.0
LEAST_EXPLAINED = 0.5
PARTS = 6
REPLICATES = 6


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
    motion = motion_of(track, bends)
    time = motion.time_s
    if len(time) < 60 or time[-1] - time[0] < LEAST_OVERLAP_S:
        raise DataError(
            f"{experiment}: sync: {len(time)} tracked frames are too few to align by motion; use sync.method offset"
        )
    if motion.swing_rad < np.radians(LEAST_SWING_DEG):
        raise DataError(
            f"{experiment}: sync: the tube bends by only {np.degrees(motion.swing_rad):.2f} deg; "
            "use sync.method offset, led or trigger"
        )
    log_rate = 1.0 / float(np.median(np.diff(log_time_s)))
    seen = Seen.of(motion, HIGHEST_OF_LOG_RATE * log_rate)
    target = Target(log_time_s, pressure_kPa, seen.rate, seen.high)
    offsets, shares, own = search(seen, target)
    best = int(np.argmax(shares))
    if shares[best] < LEAST_EXPLAINED:
        raise DataError(
            f"{experiment}: sync: the motion explains only {100 * shares[best]:.0f} % of the pressure at any offset; "
            "check that video and log belong together, or use sync.method offset"
        )
    repeats = repetition(offsets, shares, own, experiment=experiment)
    found = refine(seen, target, float(offsets[best]), (offsets, shares))
    shifted = time * (1 + 1e-6 * found.drift_ppm) + found.offset_s
    within = (shifted > log_time_s[0]) & (shifted < log_time_s[-1])
    pressed = np.interp(shifted[within], log_time_s, pressure_kPa)
    check_direction(motion.bend_rad[within], pressed, experiment=experiment, bends=bends)
    # A slow log knows the pressure between its samples by a line only.
    error = float(np.hypot(found.offset_stderr_s, BETWEEN_SAMPLES / log_rate**2))
    notes = [
        *log_notes(log_time_s, target.gaps),
        *([repeats] if repeats else []),
        *([found.note] if found.note else []),
    ]
    return replace(found, offset_stderr_s=error, note="; ".join(notes))


@dataclass(frozen=True)
class Seen:
    """The motion on an even grid: times (n,), amplitudes (n, m) raw, `solid` where frames are near, band-passed terms."""

    motion: Motion
    grid: FloatArray
    raw: FloatArray
    solid: NDArray[np.bool_]
    rate: float
    high: float
    terms: FloatArray

    @staticmethod
    def of(motion: Motion, highest_Hz: float = np.inf) -> Seen:
        """Resample, smooth, and form the terms; `highest_Hz` is what the log can follow."""
        time = motion.time_s
        rate = 1.0 / float(np.median(np.diff(time)))
        grid = np.arange(time[0], time[-1], 1.0 / rate)
        raw = np.column_stack([np.interp(grid, time, column) for column in motion.amplitudes.T])
        after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
        solid = (time[after] - time[after - 1]) < 2.5 / rate
        edge = round(min(0.08 * len(grid), 0.12 * rate))
        solid[:edge] = solid[len(grid) - edge :] = False
        high = max(min(HIGH_HZ, 0.15 * rate, highest_Hz), 2 * LOW_HZ)
        return Seen(motion, grid, raw, solid, rate, high, _terms(motion, raw, rate, high))

    def with_more_noise(self, seed: int) -> FloatArray:
        """Terms after the track's own noise (from fourth differences in time) has been added once more."""
        differences = np.diff(self.raw, n=4, axis=0)
        covariance = differences.T @ differences / len(differences) / 70.0
        values, vectors = np.linalg.eigh(covariance)
        noise = np.random.default_rng(seed).normal(size=self.raw.shape) * np.sqrt(np.maximum(values, 0)) @ vectors.T
        return _terms(self.motion, self.raw + noise, self.rate, self.high)


def _terms(motion: Motion, raw: FloatArray, rate: float, high: float) -> FloatArray:
    formed = terms(motion, gauss(raw, rate, 2 * high), rate)
    return np.stack([band(section, rate, high) for section in formed])


def gauss(values: FloatArray, rate: float, cut_Hz: float) -> FloatArray:
    """Gaussian low-pass along axis 0, zero phase, half power at `cut_Hz`."""
    sigma = np.sqrt(np.log(2)) / (2 * np.pi * cut_Hz) * rate
    reach = int(np.ceil(4.5 * sigma)) + 1
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(values, [(reach, reach)] + [(0, 0)] * (values.ndim - 1), mode="edge")
    flat = padded.reshape(len(padded), -1)
    smooth = np.column_stack([np.convolve(column, kernel, "valid") for column in flat.T])
    return np.asarray(smooth, dtype=float).reshape(values.shape)


def band(values: FloatArray, rate: float, high: float) -> FloatArray:
    """Band-pass from LOW_HZ to `high`, zero phase."""
    return gauss(values, rate, high) - gauss(values, rate, LOW_HZ)


class Target:
    """The log's pressure, filtered like the terms, at any offset."""

    def __init__(self, time: FloatArray, pressure: FloatArray, rate: float, high: float) -> None:
        step = min(float(np.median(np.diff(time))), 1.0 / rate)
        self.time = np.arange(time[0], time[-1], step)
        raw = np.interp(self.time, time, pressure)
        # The amplitudes were smoothed once before the terms were formed, and so is the pressure.
        self.values = band(gauss(raw, 1 / step, 2 * high), 1 / step, high)
        self.slope = np.gradient(self.values, self.time)
        self.first, self.last = self.time[0] + 0.1, self.time[-1] - 0.1
        self.gaps = gaps_of(time)

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Pressure, its slope, and where the log covers `times`."""
        inside = (times >= self.first) & (times <= self.last)
        if len(self.gaps):
            inside &= outside_gaps(times, self.gaps, FILTER_REACH_S)
        return np.interp(times, self.time, self.values), np.interp(times, self.time, self.slope), inside


def search(seen: Seen, target: Target) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Every offset at which enough of the motion lies within the log; the share of the pressure that is explained.

    Twice: as a share of the whole motion, and of the part within the log.
    """
    thin = slice(None, None, max(len(seen.grid) // 1200, 1))
    grid, solid, x = seen.grid[thin], seen.solid[thin], seen.terms[:, thin]
    span = grid[-1] - grid[0]
    least = min(max(LEAST_OVERLAP_S, 0.5 * min(span, target.last - target.first)), span)
    low, high = target.first - grid[-1] + least, target.last - grid[0] - least
    offsets = np.linspace(low, high, int(min(max((high - low) / COARSE_S, 1), 5000)) + 1)
    whole = _projector(x[:, solid])
    overall = float(np.mean(target.values**2))
    shares, own = np.zeros(len(offsets)), np.zeros(len(offsets))
    for k, offset in enumerate(offsets):
        values, _, inside = target.at(grid + offset)
        use = solid & inside
        if use.sum() < 4 * x.shape[2] or np.mean(values[use] ** 2) < 0.05 * overall:
            continue
        if use.sum() == solid.sum():
            projector = whole
        else:
            if k % 4:  # partial overlaps cost more; every fourth is enough to find the place
                continue
            projector = _projector(x[:, use])
        y = values[use]
        # A short overlap is easily explained: what counts is the share of the whole motion.
        own[k] = np.sum((projector.T @ y) ** 2) / (len(x) * float(y @ y))
        shares[k] = own[k] * use.sum() / solid.sum()
        if use.sum() < 0.5 * solid.sum():  # a short piece can be explained at many places
            own[k] = 0.0
    return offsets, shares, own


def _projector(x: FloatArray) -> FloatArray:
    """Sum over sections of an orthonormal basis of the stacked terms, (n, terms)."""
    sections, n, count = x.shape
    flat = x.reshape(sections * n, count)
    q = np.linalg.qr(flat / (np.linalg.norm(flat, axis=0) + 1e-12))[0]
    return q.reshape(sections, n, count).sum(axis=0)


def refine(seen: Seen, target: Target, offset: float, curve: tuple[FloatArray, FloatArray]) -> Alignment:
    """Newton steps to the best offset, the lean from noise, standard errors, and the drift."""
    offset = _newton(seen, seen.terms, target, offset)
    values, slope, inside = target.at(seen.grid + offset)
    use = seen.solid & inside
    lean = [_newton(seen, seen.with_more_noise(seed), target, offset) - offset for seed in range(REPLICATES)]
    bias = float(np.mean(lean))
    _, covariance, explained = _step(seen.terms, values, slope, use, None)
    error = max(float(np.sqrt(covariance[0, 0])), _leaving_out(seen.terms, values, slope, use))
    # Taking the lean off is itself uncertain: by its scatter, and by half of its size for being only first order.
    error = float(np.sqrt(error**2 + np.var(lean) / REPLICATES + (0.5 * bias) ** 2))
    middle = float(seen.grid[use].mean())
    both, both_covariance, _ = _step(seen.terms, values, slope, use, seen.grid - middle)
    drift_error = float(np.sqrt(both_covariance[1, 1]))
    drift, note = 0.0, ""
    if abs(both[1]) > 4 * drift_error and abs(both[1]) > 20e-6 and drift_error < 50e-6:
        drift, note = float(both[1]), "drift taken into account"
    return Alignment(offset - bias - drift * middle, error, 1e6 * drift, 1e6 * drift_error, explained, curve, note)


def _newton(seen: Seen, x: FloatArray, target: Target, offset: float) -> float:
    for _ in range(15):
        values, slope, inside = target.at(seen.grid + offset)
        change = float(np.clip(_step(x, values, slope, seen.solid & inside, None)[0][0], -0.015, 0.015))
        offset += change
        if abs(change) < 1e-7:
            break
    return offset


def _step(x: FloatArray, values: FloatArray, slope: FloatArray, use: NDArray[np.bool_], centred: FloatArray | None):
    """Change of offset (and drift) beside all coefficients; its covariance for residuals alike in time; explained share."""
    own = [-slope[use]] if centred is None else [-slope[use], -slope[use] * centred[use]]
    y = values[use]
    blocks = np.stack([np.column_stack([*own, section[use]]) for section in x])  # (sections, n, columns)
    scale = np.sqrt(np.sum(blocks**2, axis=(0, 1))) + 1e-12
    blocks /= scale
    inverse = np.linalg.pinv(np.einsum("sni,snj->ij", blocks, blocks, optimize=True), rcond=1e-11, hermitian=True)
    solution = inverse @ (blocks.sum(axis=0).T @ y)
    residuals = y - blocks @ solution  # (sections, n)
    # Sections at one time share their error, and so do neighbouring times (Newey and West).
    scores = np.sum(blocks * residuals[..., None], axis=0)
    lags = min(int(3 * np.sqrt(len(y))), len(y) // 4)
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1 - lag / (lags + 1)) * (cross + cross.T)
    n = len(own)
    covariance = (inverse @ middle @ inverse)[:n, :n] / scale[:n, None] / scale[None, :n]
    explained = 1.0 - float(np.sum(residuals**2)) / len(x) / max(float(y @ y), 1e-12)
    return solution[:n] / scale[:n], covariance, explained


def _leaving_out(x: FloatArray, values: FloatArray, slope: FloatArray, use: NDArray[np.bool_]) -> float:
    """Standard error from leaving out one stretch at a time (jackknife)."""
    found = []
    for part in np.array_split(np.flatnonzero(use), PARTS):
        rest = use.copy()
        rest[part] = False
        if rest.sum() > 4 * x.shape[2]:
            found.append(float(_step(x, values, slope, rest, None)[0][0]))
    if len(found) < 3:
        return 0.0
    spread = np.array(found) - np.mean(found)
    return float(np.sqrt((len(found) - 1) / len(found) * np.sum(spread**2)))
