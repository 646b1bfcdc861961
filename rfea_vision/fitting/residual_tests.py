"""Are the residuals noise? Whiteness in time, and independence of pressure, angle and rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.rows import ResidualTest
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.residuals import Predicted, left_of
from rfea_vision.scatter import scatter

BINS = 16  # of quantiles: each holds at least eight values
#: A residual with a shorter memory counts as white. Of white noise it is half a frame; of 75 frames of it 99.3 % stay below.
WHITE_FRAMES = 1.0


def correlation_ratio(explained: FloatArray, by: FloatArray) -> float:
    """Share of the variance of one series (samples,) that a smooth function of another explains, 0 to 1.

    The correlation ratio over quantile bins, less what chance would give.
    """
    good = np.isfinite(explained) & np.isfinite(by)
    y, x = explained[good], by[good]
    if y.size < 8 * BINS or np.ptp(x) == 0 or np.var(y) == 0:
        return 0.0
    edges = np.quantile(x, np.linspace(0, 1, BINS + 1))
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
    counts = np.bincount(index, minlength=BINS)
    means = np.bincount(index, y, minlength=BINS) / np.maximum(counts, 1)
    between = float(np.sum(counts * (means - y.mean()) ** 2))
    chance = (BINS - 1) / y.size
    return max(0.0, (between / float(np.sum((y - y.mean()) ** 2)) - chance) / (1 - chance))


def autocorrelation(series: FloatArray) -> FloatArray:
    """Autocorrelation over lags (frames,) of a series (frames,), or of (frames, columns) of one unit, which are pooled."""
    columns = series.reshape(series.shape[0], -1)
    frames = columns.shape[0]
    spectrum = np.sum(np.abs(np.fft.rfft(columns - columns.mean(axis=0), 2 * frames, axis=0)) ** 2, axis=1)
    covariance = np.fft.irfft(spectrum)[:frames]
    return covariance / covariance[0] if covariance[0] > 0 else np.zeros(frames)


def correlation_time(series: FloatArray, period_s: float) -> float:
    """Integrated autocorrelation time (s) of a series as in `autocorrelation`, up to the first fall below 0.05.

    Half a period for white noise.
    """
    correlation = autocorrelation(series)
    if correlation[0] <= 0:
        return 0.0
    below = np.flatnonzero(correlation < 0.05)
    stop = int(below[0]) if below.size else correlation.size
    return period_s * (0.5 + float(correlation[1:stop].sum()))


#: Second differences of a residual beyond this many of their robust standard deviations are jumps, not motion.
JUMP = 15.0
#: Frames this far apart tell no jump from motion: a tenth of the period of the fastest ringing of soft tubes (5 Hz).
SLOW_FRAMES_S = 0.02


def count_jumps(item: Observed, predicted: Predicted) -> int:
    """Frames at which a track leaves the model from one frame to the next: wrong points, not physics, which takes time.

    A tube whose physics the model lacks moves otherwise, but about as smoothly: a jump is sharper than anything in the modelled
    motion. None where the frames are so slow that the tube itself can go anywhere from one to the next.
    """
    if item.period_s > SLOW_FRAMES_S:
        return 0
    gap, motion = (item.angle - predicted.angle)[:, None], predicted.angle[:, None]
    if item.has_tip:
        gap, motion = (
            points.reshape(item.time.size, -1) for points in (item.points - predicted.points, predicted.points)
        )
    if gap.shape[0] < 12:
        return 0
    bend = np.diff(gap, n=2, axis=0)
    near = np.diff(item.time[1:-1]) < 1.5 * item.period_s
    noise = item.sigma[:, -1] if item.has_tip else item.angle_sigma
    scale = np.maximum(scatter(bend), np.sqrt(6) * float(np.median(noise)))
    # A step in position bends the curve one way and at once the other; a blow only bends it.
    sharpest = float(np.max(np.abs(np.diff(motion, n=2, axis=0))))
    far = np.minimum(np.abs(bend[1:]), np.abs(bend[:-1])) > np.maximum(JUMP * scale, sharpest)
    return int(np.sum(np.any(far & (bend[1:] * bend[:-1] < 0), axis=1) & near))


def examine_residuals(items: Sequence[Observed], predicted: Sequence[Predicted]) -> dict[str, ResidualTest]:
    """Tests of the tip's residual (or the angle's) over several runs, worst axis; each with a sentence."""
    times, periods = [], []
    columns: dict[str, list[FloatArray]] = {"pressure": [], "angle": [], "rate": []}
    residuals = []
    for item, one in zip(items, predicted, strict=True):
        gap = left_of(item, one)
        axis = int(np.argmax(gap.std(axis=0)))
        series = gap[:, axis]
        times.append(correlation_time(series, item.period_s))
        periods.append(item.period_s)
        residuals.append(series)
        columns["pressure"].append(item.excitation.at(item.time))
        columns["angle"].append(one.angle)
        columns["rate"].append(one.motion.rate[:, -1])
    time, period = float(np.mean(times)), float(np.mean(periods))
    white = time < WHITE_FRAMES * period
    out: dict[str, ResidualTest] = {
        "whiteness": {
            "correlation_time_s": time,
            "sentence": "the residual is white"
            if white
            else f"the residual is correlated over {time * 1e3:.0f} ms: it is not noise alone",
        }
    }
    stacked = np.concatenate(residuals)
    for name, values in columns.items():
        share = correlation_ratio(stacked, np.concatenate(values))
        words = f"{100 * share:.0f} % of its variance goes with the {name}"
        out[f"independence_of_{name}"] = {"share": share, "sentence": words}
    return out
