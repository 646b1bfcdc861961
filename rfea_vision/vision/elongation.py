"""How the tube turns along its length, and how much each part of it is longer than on the inextensible side."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.vision.curve import COEFFICIENTS, basis_matrix

FloatArray = NDArray[np.float64]

FINE = 257


def angles(coefficients: FloatArray, sign: float, u: FloatArray) -> FloatArray:
    """Unwrapped tangent angle at `u` in the plane frame, from straight down, positive towards the bend, (t, len(u))."""
    slope = np.matmul(basis_matrix(u, COEFFICIENTS, 1), coefficients)
    return np.unwrap(np.arctan2(-sign * slope[..., 0], -slope[..., 1]), axis=1)


@njit(cache=True, nogil=True)
def _centre_over_hinge(hinge, centre, segments):
    """Centre-line length over hinge-side length minus one, (t, segments), for parts even along the hinge side."""
    frames, fine = hinge.shape
    out = np.empty((frames, segments))
    for t in range(frames):
        k = 0
        before = 0.0
        part = hinge[t, fine - 1] / segments
        for j in range(segments):
            target = part * (j + 1)
            while k < fine - 2 and hinge[t, k + 1] < target:
                k += 1
            share = (target - hinge[t, k]) / max(hinge[t, k + 1] - hinge[t, k], 1e-12)
            here = centre[t, k] + share * (centre[t, k + 1] - centre[t, k])
            out[t, j] = (here - before) / part - 1.0
            before = here
    return out


def elongation_of(segments, coefficients, sign, variance, length, radius, calibrated):
    """Centre-line over hinge-side length minus one, for segments even along the hinge side (PHYSICS 1)."""
    u = np.linspace(0, 1, FINE)
    speed = np.linalg.norm(np.matmul(basis_matrix(u, COEFFICIENTS, 1), coefficients), axis=-1)
    centre = np.concatenate(
        [np.zeros((len(speed), 1)), np.cumsum(0.5 * (speed[:, 1:] + speed[:, :-1]), axis=1) / (FINE - 1)], axis=1
    )
    angle = angles(coefficients, sign, u)
    hinge = centre - radius * (angle - angle[:, :1])
    out = _centre_over_hinge(hinge, centre, segments)
    step = hinge[:, -1:] / segments
    noise = radius * np.sqrt(variance) / length[:, None] / step
    at = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS), coefficients)
    slope = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS, 1), coefficients)
    tangent = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    turning = np.diff(calibrated.rotation(at, tangent), axis=-1)
    systematic = np.sum((radius * turning / step[None]) ** 2, axis=0)
    return out, noise, np.sqrt(noise**2 + systematic), hinge[:, -1]
