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
from numpy.typing import NDArray

from rfea_vision.vision import fitted
from rfea_vision.vision.curve import basis_matrix
from rfea_vision.vision.rows import Rows

FloatArray = NDArray[np.float64]

TAUS_MM = np.geomspace(3e-3, 10.0, 36)
SAMPLE = 400


@dataclass(frozen=True)
class Smoothed:
    """Coefficients (t, K, 2) after smoothing, variances (t, rows of `Rows.shift_rows`), and tau."""

    coefficients: FloatArray
    variance: FloatArray
    tau_mm: float


def smooth(rows: Rows, valid: NDArray[np.bool_], inflation: float) -> Smoothed:
    """Smooth all valid frames; `inflation` is how much neighbouring edge stations agree beyond chance."""
    coefficients = rows["coefficients"][valid]
    noise = np.maximum(rows["numbers"][valid, fitted.NOISE], 1e-3)
    covariance = float(np.median(noise)) ** 2 * inflation * rows.covariance_sum / max(rows.good, 1)
    count = covariance.shape[0]
    third = np.diff(np.eye(count), n=3, axis=0)
    middles = (np.arange(count - 3) + 0.5) / (count - 3)
    wiggles = np.sum(np.matmul(third, coefficients) * _normals(coefficients, middles), axis=-1)
    tau = best_tau(wiggles, third @ covariance @ third.T)
    posterior = np.linalg.inv(np.linalg.inv(covariance) + third.T @ third / tau**2)
    shift = -wiggles @ (third @ posterior) / tau**2
    places = np.clip((np.arange(count) - 1) / (count - 3), 0, 1)
    moved = coefficients + shift[..., None] * _normals(coefficients, places)
    before = np.einsum("ri,ij,rj->r", rows.shift_rows, covariance, rows.shift_rows)
    after = np.einsum("ri,ij,rj->r", rows.shift_rows, posterior, rows.shift_rows)
    variance = inflation * rows["shift_variance"][valid].astype(float) * (after / before)[None, :]
    return Smoothed(moved, variance, tau)


def _normals(coefficients: FloatArray, u: FloatArray) -> FloatArray:
    """Left-hand unit normals (t, len(u), 2)."""
    slope = np.matmul(basis_matrix(u, coefficients.shape[1], 1), coefficients)
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    return np.stack([-slope[..., 1], slope[..., 0]], axis=-1)


def best_tau(wiggles: FloatArray, scatter: FloatArray) -> float:
    """The tau of greatest marginal likelihood of `wiggles` (t, n) whose noise has covariance `scatter` (n, n)."""
    sample = wiggles[:: max(len(wiggles) // SAMPLE, 1)]
    scores = []
    for tau in TAUS_MM:
        total = scatter + tau**2 * np.eye(len(scatter))
        _, logarithm = np.linalg.slogdet(total)
        squares = np.einsum("ti,ij,tj->t", sample, np.linalg.inv(total), sample)
        scores.append(float(np.sum(-0.5 * squares - 0.5 * logarithm)))
    return float(TAUS_MM[int(np.argmax(scores))])
