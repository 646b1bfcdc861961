"""The smoothing spline: how strongly a recording's centre lines are smoothed, and how noisy they are, follow from their own wiggles.

A tube's curvature changes slowly along it. The prior says so: across the tube, the third differences w of the spline's
coefficients (spacing cubed times the change of curvature; zero for any arc) have one standard deviation tau for the
whole recording. With C the covariance of edges that err independently, f what their errors have in common makes of it, and D the
third difference, each frame is moved along its normals by

    d = -(C^-1 / f + D'D / tau^2)^-1 D'w / tau^2,

and tau is where the marginal likelihood of all frames is greatest. Precise pictures are left as they are; noisy ones are smoothed
as much as the tube's own shapes allow. Noise shows in all that the spline can follow, and a tube least where it turns fastest: f is
what the faster half of the wiggles have of the noise that they should have. It holds what a compressed film's blocks do to
neighbouring edges alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import leftwards
from rfea_vision.vision.curve import tangents
from rfea_vision.vision.derive.rows import BLOCK, Rows

TAUS_MM = np.geomspace(3e-3, 10.0, 36)
SAMPLE = 400


@dataclass(frozen=True)
class Smoothed:
    """Coefficients (t, K, 2) after smoothing, and what variances of `Rows.shift_rows` are to be multiplied by.

    `inflation` is that of an edge's variance by what neighbours have in common, `tau_mm` the tube's own third differences.
    """

    coefficients: FloatArray
    variance_factor: FloatArray
    inflation: float
    tau_mm: float


def smooth(rows: Rows, *, inflated: bool) -> Smoothed:
    """Smooth all good frames; their noise is `inflated` by what their wiggles tell, or taken to be what the frames' fits say."""
    coefficients = rows.good_ones("coefficients")
    noise = np.maximum(rows.good_ones("numbers")["noise"], 1e-3)
    covariance = float(np.median(noise)) ** 2 * rows.covariance_sum / max(rows.good, 1)
    count = covariance.shape[0]
    third = np.diff(np.eye(count), n=3, axis=0)
    variances, axes = np.linalg.eigh(third @ covariance @ third.T)
    wiggles = _wiggles(coefficients[:: max(len(coefficients) // SAMPLE, 1)], third) @ axes
    inflation = inflation_of(wiggles, variances) if inflated else 1.0
    tau = best_tau(wiggles, inflation * variances)
    covariance *= inflation
    posterior = np.linalg.inv(np.linalg.inv(covariance) + third.T @ third / tau**2)
    pull = third @ posterior / tau**2
    places = np.clip((np.arange(count) - 1) / (count - 3), 0, 1)
    for start in range(0, len(coefficients), BLOCK):  # in parts, which need little memory
        part = coefficients[start : start + BLOCK]
        part -= (_wiggles(part, third) @ pull)[..., None] * _normals(part, places)
    before = np.einsum("ri,ij,rj->r", rows.shift_rows, covariance, rows.shift_rows)
    after = np.einsum("ri,ij,rj->r", rows.shift_rows, posterior, rows.shift_rows)
    return Smoothed(coefficients, inflation * after / before, inflation, tau)


def _wiggles(coefficients: FloatArray, third: FloatArray) -> FloatArray:
    """Third differences across the tube, (t, K - 3)."""
    count = coefficients.shape[1]
    middles = (np.arange(count - 3) + 0.5) / (count - 3)
    return np.sum(np.matmul(third, coefficients) * _normals(coefficients, middles), axis=-1)


def _normals(coefficients: FloatArray, u: FloatArray) -> FloatArray:
    """Left-hand unit normals (t, len(u), 2)."""
    return leftwards(tangents(coefficients, u))


def inflation_of(wiggles: FloatArray, variances: FloatArray) -> float:
    """How many times their `variances` (n,), slowest first, `wiggles` (t, n) have: the median of the faster half.

    Part of which is the tube's own, so that of wiggly tubes it is too much.
    """
    fast = slice(len(variances) // 2, None)
    return float(np.median(np.mean(wiggles[:, fast] ** 2, axis=0) / variances[fast]))


def best_tau(wiggles: FloatArray, variances: FloatArray) -> float:
    """The tau of greatest marginal likelihood of `wiggles` (t, n) whose noise has `variances` (n,)."""
    total = variances + TAUS_MM[:, None] ** 2  # of each wiggle, at each tau
    misfits = np.sum(wiggles**2, axis=0) / total + len(wiggles) * np.log(total)
    return float(TAUS_MM[int(np.argmin(np.sum(misfits, axis=1)))])
