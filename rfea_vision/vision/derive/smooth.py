"""The smoothing spline: how strongly a recording's centre lines are smoothed follows from their measured noise.

A tube's curvature changes slowly along it. The prior says so: across the tube, the third differences w of the spline's
coefficients (spacing cubed times the change of curvature; zero for any arc) have one standard deviation tau for the
whole recording. With C the covariance from the edges and D the third difference, each frame is moved along its normals
by

    d = -(C^-1 + D'D / tau^2)^-1 D'w / tau^2,

and tau is where the marginal likelihood of all frames is greatest. Precise pictures are left as they are; noisy ones
are smoothed as much as the tube's own shapes allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.curve import basis_matrix
from rfea_vision.vision.derive.rows import Rows

TAUS_MM = np.geomspace(3e-3, 10.0, 36)
SAMPLE = 400
PART = 1024


@dataclass(frozen=True)
class Smoothed:
    """Coefficients (t, K, 2) after smoothing, what variances of `Rows.shift_rows` are to be multiplied by, and tau."""

    coefficients: FloatArray
    variance_factor: FloatArray
    tau_mm: float


def smooth(rows: Rows, inflation: float) -> Smoothed:
    """Smooth all good frames; `inflation` is how much neighbouring edge stations agree beyond chance."""
    coefficients = rows.good_ones("coefficients")
    noise = np.maximum(rows.good_ones("numbers")["noise"], 1e-3)
    covariance = float(np.median(noise)) ** 2 * inflation * rows.covariance_sum / max(rows.good, 1)
    count = covariance.shape[0]
    third = np.diff(np.eye(count), n=3, axis=0)
    tau = best_tau(_wiggles(coefficients[:: max(len(coefficients) // SAMPLE, 1)], third), third @ covariance @ third.T)
    posterior = np.linalg.inv(np.linalg.inv(covariance) + third.T @ third / tau**2)
    pull = third @ posterior / tau**2
    places = np.clip((np.arange(count) - 1) / (count - 3), 0, 1)
    for start in range(0, len(coefficients), PART):  # in parts, which need little memory
        part = coefficients[start : start + PART]
        part -= (_wiggles(part, third) @ pull)[..., None] * _normals(part, places)
    before = np.einsum("ri,ij,rj->r", rows.shift_rows, covariance, rows.shift_rows)
    after = np.einsum("ri,ij,rj->r", rows.shift_rows, posterior, rows.shift_rows)
    return Smoothed(coefficients, inflation * after / before, tau)


def _wiggles(coefficients: FloatArray, third: FloatArray) -> FloatArray:
    """Third differences across the tube, (t, K - 3)."""
    count = coefficients.shape[1]
    middles = (np.arange(count - 3) + 0.5) / (count - 3)
    return np.sum(np.matmul(third, coefficients) * _normals(coefficients, middles), axis=-1)


def _normals(coefficients: FloatArray, u: FloatArray) -> FloatArray:
    """Left-hand unit normals (t, len(u), 2)."""
    slope = np.matmul(basis_matrix(u, coefficients.shape[1], 1), coefficients)
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    return np.stack([-slope[..., 1], slope[..., 0]], axis=-1)


def best_tau(wiggles: FloatArray, scatter: FloatArray) -> float:
    """The tau of greatest marginal likelihood of `wiggles` (t, n) whose noise has covariance `scatter` (n, n)."""
    variances, axes = np.linalg.eigh(scatter)
    total = variances + TAUS_MM[:, None] ** 2  # along each axis, at each tau
    misfits = np.sum((wiggles @ axes) ** 2, axis=0) / total + len(wiggles) * np.log(total)
    return float(TAUS_MM[int(np.argmin(np.sum(misfits, axis=1)))])
