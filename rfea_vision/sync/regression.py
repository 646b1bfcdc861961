"""Least squares for an offset beside the coefficients of a law, where the law's terms carry the track's noise.

Noise in the terms would shrink the coefficients and bias the offset. What it adds to the normal equations is
measured by adding the track's own noise a second time, and taken out of them (Fuller, Measurement Error Models, 1987,
ch. 2.2). A column of `supplements` is added to the law where it leaves at least a twentieth less unexplained, until the
track's noise accounts for the rest.

The error is that of leaving out one stretch at a time (jackknife), at the quantile of Student's t for so many
stretches. To it is added by how much one more supplement would move the offset, times the share of the rest that noise
does not explain. Errors of the terms that last lean the same way in all stretches, so that none that is left out shows
them: noise may have made any part of the rest, up to all of it, the other end of what the data allow (Klepper and Leamer,
Econometrica 52, 1984).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from rfea_vision.arrays import FloatArray

OFFSET, DRIFT, FIRST_TERM = 0, 1, 2  # columns
LEAST_GAIN = 0.05  # of what is unexplained
LEAST_EXPLAINED = 0.5  # of the pressure's variance, by what is accepted
NOISE_ACCOUNTS = 1.15  # a rest at most so many times the noise needs no supplement
STRETCH_S = 0.3  # residuals of neighbouring stretches are taken for independent
FEWEST, MOST = 6, 20  # stretches
TINY = 1e-11  # of the largest eigenvalue: rounding
MOST_NOISE = 1e6  # times the track's own: where it has none to speak of


@dataclass(frozen=True)
class Moments:
    """Sums over each of P stretches for C columns (offset, drift, terms), every column of unit norm before `scale`.

    Attributes
    ----------
    gram, noise : (P, C, C) products of columns, and what the track's noise adds to them
    right : (P, C) products with the pressure
    power : its own square
    scale : (C,) norm of every column
    """

    gram: FloatArray
    noise: FloatArray
    right: FloatArray
    power: float
    scale: FloatArray

    def solve(self, columns: list[int], without: int | None = None) -> FloatArray:
        """Coefficients (column,) of `columns`, all stretches together or all but one."""
        keep = np.arange(len(self.gram)) != (-1 if without is None else without)
        pick = np.ix_(columns, columns)
        values, vectors = np.linalg.eigh((self.gram[keep].sum(0) - self.noise[keep].sum(0))[pick])
        known = values > TINY * values[-1]
        right = vectors[:, known].T @ self.right[keep].sum(0)[columns]
        return vectors[:, known] @ (right / values[known])

    def rest(self, columns: list[int]) -> tuple[float, float]:
        """What is unexplained (sum of squares), and how much of this the track's noise makes."""
        pick, solution = np.ix_(columns, columns), self.solve(columns)
        explained = 2 * solution @ self.right.sum(0)[columns] - solution @ self.gram.sum(0)[pick] @ solution
        made = float(solution @ self.noise.sum(0)[pick] @ solution)
        return max(self.power - float(explained), 0.0), made

    def unaccounted(self, columns: list[int]) -> float:
        """Share of the rest that the track's noise does not make."""
        rest, made = self.rest(columns)
        return max(1.0 - made / rest, 0.0) if rest > 0 else 0.0


def moments(columns: FloatArray, noises: FloatArray, pressure: FloatArray, rate: float) -> Moments:
    """Sums of products of `columns` (sections, n, C), replicates of the terms' `noises` (R, sections, n, C - 2), `pressure` (n,).

    They are kept stretch by stretch, at `rate` samples per second, so that any stretch can be left out.
    """
    sections, n, count = columns.shape
    scale = np.sqrt(np.sum(columns**2, axis=(0, 1))) + 1e-12
    unit, small = columns / scale, noises / scale[FIRST_TERM:]
    stretches = np.array_split(np.arange(n), int(np.clip(n / rate / STRETCH_S, FEWEST, MOST)))
    gram, right = np.zeros((len(stretches), count, count)), np.zeros((len(stretches), count))
    noise = np.zeros_like(gram)
    for k, part in enumerate(stretches):
        own = unit[:, part].reshape(-1, count)
        of_noise = small[:, :, part].reshape(-1, count - FIRST_TERM)
        gram[k] = own.T @ own
        noise[k, FIRST_TERM:, FIRST_TERM:] = of_noise.T @ of_noise / len(noises)
        right[k] = unit[:, part].sum(axis=0).T @ pressure[part]
    return Moments(gram, noise, right, sections * float(pressure @ pressure), scale)


def most_noise(found: Moments, columns: list[int]) -> float:
    """The largest factor on the noise at which it makes no more than the rest, the law still explains `LEAST_EXPLAINED` of the
    pressure, and the equations stay positive.
    """
    gram, noise, right = (part.sum(0) for part in (found.gram, found.noise, found.right))
    pick = np.ix_(columns, columns)

    def possible(factor: float) -> bool:
        values, vectors = np.linalg.eigh((gram - factor * noise)[pick])
        if values[0] < -TINY * values[-1]:
            return False
        known = values > TINY * values[-1]
        solution = vectors[:, known] @ ((vectors[:, known].T @ right[columns]) / values[known])
        accounted = float(solution @ right[columns])
        explained = 2 * accounted - float(solution @ gram[pick] @ solution)
        return accounted <= found.power and explained >= LEAST_EXPLAINED * found.power

    low, high = 0.0, 1.0
    while possible(high) and high < MOST_NOISE:
        low, high = high, 4 * high
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if possible(middle) else (low, middle)
    return low


def with_possible_noise(found: Moments, columns: list[int]) -> Moments:
    """The same with as much of its noise as is possible: fast motion looks like noise at high frequencies."""
    return replace(found, noise=min(most_noise(found, columns), 1.0) * found.noise)


def shift_by_noise(found: Moments, columns: list[int], which: int = OFFSET) -> float:
    """By how much the coefficient `which` would move if the track's noise made all of the rest."""
    place = columns.index(which)
    noisier = replace(found, noise=most_noise(found, columns) * found.noise)
    return float(noisier.solve(columns)[place] - found.solve(columns)[place]) / float(found.scale[which])


def choose(found: Moments, law: list[int], supplements: list[int]) -> list[int]:
    """Columns of the law and of the supplements that the data ask for."""
    chosen = list(law)
    left = [k for k in supplements if found.scale[k] > 1e-9]
    while left:
        rest, made = found.rest(chosen)
        if rest <= NOISE_ACCOUNTS * made:
            break
        rests = [found.rest([*chosen, k])[0] for k in left]
        best = int(np.argmin(rests))
        if rests[best] > (1 - LEAST_GAIN) * rest:
            break
        chosen.append(left.pop(best))
    return chosen


def standard_error(found: Moments, columns: list[int], supplements: list[int], which: int = OFFSET) -> float:
    """Standard error of the coefficient `which`, from stretches and from what the law may lack."""
    place = columns.index(which)
    count = len(found.gram)
    left_out = np.array([found.solve(columns, without=k)[place] for k in range(count)])
    apart = (left_out - left_out.mean()) ** 2
    spread = float(np.sum(apart)) * (count - 1) / count
    # Where a few steps tell nearly all, few stretches do (Satterthwaite: the fourth power of a normal number is 3).
    freedom = float(np.clip(3 * np.sum(apart) ** 2 / max(float(np.sum(apart**2)), 1e-300) - 1, 2, count - 1))
    error = np.sqrt(spread) * float(student.ppf(0.975, freedom)) / 1.96
    others = [k for k in supplements if k not in columns and found.scale[k] > 1e-9]
    if not others:
        return float(error) / float(found.scale[which])
    now = found.solve(columns)[place]
    moved = np.array([found.solve([*columns, k])[place] - now for k in others])
    return float(np.sqrt(error**2 + found.unaccounted(columns) * np.mean(moved**2))) / float(found.scale[which])
