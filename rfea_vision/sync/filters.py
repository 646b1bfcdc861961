"""Motion and pressure on even grids, through the same zero-phase filter: what is compared of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from rfea_vision.arrays import FloatArray
from rfea_vision.sync.ambiguity import gaps_of, outside_gaps
from rfea_vision.sync.sections import ObservedMotion, noise_covariance, supplements, terms

LOW_HZ, HIGH_HZ = 0.8, 8.0  # creep and drift lie below, and above the noise of accelerations grows
FILTER_REACH_S = 0.15  # at which the low-pass at HIGH_HZ has died away
#: 12,000 samples tell a variance to 1 %.
MOST_REPLICATES, REPLICATED_SAMPLES = 8, 12_000
QUIET_S = 0.12  # of a stretch in which noise just above the band is measured


@dataclass(frozen=True)
class FilteredMotion:
    """The motion on an even grid: times (n,), amplitudes (n, m) raw, `solid` where frames are near, band-passed terms."""

    motion: ObservedMotion
    grid: FloatArray
    raw: FloatArray
    solid: NDArray[np.bool_]
    rate: float
    high: float
    terms: FloatArray

    @staticmethod
    def of(motion: ObservedMotion, highest_Hz: float = np.inf) -> FilteredMotion:
        """Resample, smooth, and form the terms; `highest_Hz` is what the log can follow."""
        time = motion.time_s
        rate = 1.0 / float(np.median(np.diff(time)))
        high = max(min(HIGH_HZ, 0.15 * rate, highest_Hz), 2 * LOW_HZ)
        grid = np.arange(time[0], time[-1], 1.0 / rate)
        raw = np.column_stack([np.interp(grid, time, column) for column in motion.amplitudes.T])
        solid = np.ones(len(grid), dtype=bool)
        gap = np.diff(time) > max(2.5 / rate, 0.12 / high)
        for begin, end in zip(time[:-1][gap], time[1:][gap], strict=True):
            solid &= (grid < begin - 0.3 / high) | (grid > end + 0.3 / high)
        edge = round(min(0.08 * len(grid), 0.12 * rate))
        solid[:edge] = solid[len(grid) - edge :] = False
        smooth = gauss(raw, rate, 2 * high)
        formed = np.stack([band(section, rate, high) for section in terms(motion, smooth, rate)])
        return FilteredMotion(motion, grid, raw, solid, rate, high, formed)

    def columns(self, raw: FloatArray, use: NDArray[np.bool_]) -> FloatArray:
        """Terms and supplements (sections, samples of `use`, terms), without their slow part within `use`."""
        smooth = gauss(raw, self.rate, 2 * self.high)
        every = np.concatenate(
            [terms(self.motion, smooth, self.rate), supplements(self.motion, smooth, self.rate)], axis=2
        )
        return np.stack([without_slow(gauss(section, self.rate, self.high), use, self.rate) for section in every])

    def noises(self, use: NDArray[np.bool_], own: FloatArray) -> FloatArray:
        """What the track's own noise, once more added, changes in the columns: (2, R, sections, n, terms).

        First with the noise of the highest frequencies, then with that just above the compared band: in a film, noise
        lasts over frames, and is stronger there.
        """
        generator = np.random.default_rng(0)
        count = int(np.clip(REPLICATED_SAMPLES / len(self.grid), 2, MOST_REPLICATES))
        found = []
        for covariance in (noise_covariance(self.raw), self.noise_above_band()):
            values, vectors = np.linalg.eigh(covariance)
            spread = vectors * np.sqrt(np.maximum(values, 0))
            drawn = (generator.normal(size=self.raw.shape) @ spread.T for _ in range(count))
            found.append(np.stack([self.columns(self.raw + noise, use) - own for noise in drawn]))
        return np.stack(found)

    def noise_above_band(self) -> FloatArray:
        """Covariance (m, m) of white noise with the power that lies in the octave above the compared band.

        Of the quieter half of all stretches, as the tube's own motion in that octave is brief.
        """

        def octave(values: FloatArray) -> FloatArray:
            return gauss(values, self.rate, 3 * self.high) - gauss(values, self.rate, 1.5 * self.high)

        impulse = np.zeros((2 * int(self.rate) + 1, 1))
        impulse[len(impulse) // 2] = 1.0
        length = max(int(QUIET_S * self.rate), 4)
        count = max(len(self.raw) // length, 1)
        parts = octave(self.raw)[: count * length].reshape(count, length, -1)
        each = np.einsum("kni,knj->kij", parts, parts) / length
        size = np.einsum("kii,i->k", each, 1 / np.maximum(np.diag(each.mean(axis=0)), 1e-30))
        quiet = np.argsort(size)[: max(count // 2, 1)]
        return each[quiet].mean(axis=0) / float(np.sum(octave(impulse) ** 2))


def gauss(values: FloatArray, rate: float, cut_Hz: float) -> FloatArray:
    """Gaussian low-pass of (samples, ...) along axis 0, zero phase, half power at `cut_Hz`."""
    sigma = np.sqrt(np.log(2)) / (2 * np.pi * cut_Hz) * rate
    return np.asarray(gaussian_filter1d(values, sigma, axis=0, mode="nearest", truncate=4.5), dtype=float)


def band(values: FloatArray, rate: float, high: float) -> FloatArray:
    """Band-pass of (samples, ...) from LOW_HZ to `high`, zero phase."""
    return gauss(values, rate, high) - gauss(values, rate, LOW_HZ)


def without_slow(values: FloatArray, use: NDArray[np.bool_], rate: float) -> FloatArray:
    """The samples of `use` (samples,) out of (samples, ...), less the weighted mean of those samples about each.

    Nothing outside of `use` enters, so that whatever holds between columns sample by sample holds between the results:
    beyond the ends of a film the log goes on and the film does not.
    """
    sigma = np.sqrt(np.log(2)) / (2 * np.pi * LOW_HZ) * rate
    weight = use.astype(float).reshape((-1,) + (1,) * (values.ndim - 1))
    kind = {"axis": 0, "mode": "constant", "truncate": 4.5}
    slow = gaussian_filter1d(values * weight, sigma, **kind)[use] / gaussian_filter1d(weight, sigma, **kind)[use]
    return np.asarray(values[use] - slow, dtype=float)


class Target:
    """The log's pressure, filtered like the terms, at any offset."""

    def __init__(self, time: FloatArray, pressure: FloatArray, rate: float, high: float) -> None:
        step = min(float(np.median(np.diff(time))), 1.0 / rate)
        self.time = np.arange(time[0], time[-1], step)
        raw = np.interp(self.time, time, pressure)
        # The amplitudes were smoothed once before the terms were formed, and so is the pressure.
        self.smooth = gauss(gauss(raw, 1 / step, 2 * high), 1 / step, high)
        self.smooth_slope = np.gradient(self.smooth, self.time)
        self.values = self.smooth - gauss(gauss(raw, 1 / step, 2 * high), 1 / step, LOW_HZ)
        self.first, self.last = self.time[0] + 0.1, self.time[-1] - 0.1
        self.gaps = gaps_of(time)

    def inside(self, times: FloatArray) -> NDArray[np.bool_]:
        """Where the log covers `times` (samples,) in s."""
        covered = (times >= self.first) & (times <= self.last)
        return covered & outside_gaps(times, self.gaps, FILTER_REACH_S) if len(self.gaps) else covered

    def at(self, times: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Band-passed pressure at `times` (samples,) in s, and where the log covers them."""
        return np.interp(times, self.time, self.values), self.inside(times)
