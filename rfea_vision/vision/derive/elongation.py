"""How the tube turns along its length, and how much each part of it is longer than on the inextensible side."""

from __future__ import annotations

import math

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.compiled import compiled
from rfea_vision.vision.curve import COEFFICIENTS, basis_matrix

FINE = 257


def angles(coefficients: FloatArray, sign: float, u: FloatArray) -> FloatArray:
    """Unwrapped tangent angle at `u` in the plane frame, from straight down, positive towards the bend, (t, len(u))."""
    slope = np.matmul(basis_matrix(u, COEFFICIENTS, 1), coefficients)
    return np.unwrap(np.arctan2(-sign * slope[..., 0], -slope[..., 1]), axis=1)


@compiled
def _centre_over_hinge(slope, signed_radius, segments, out):
    """Fill `out` (t, segments): centre-line over hinge-side length minus one, for parts even along the hinge side.

    `slope` (t, n, 2) is the derivative of the centre line at even steps; `signed_radius` is that of the tube, positive
    where a counter-clockwise turn lengthens the hinge side. Returns the length of the hinge side (t,).
    """
    frames, fine, _ = slope.shape
    centre, hinge, whole = np.zeros(fine), np.zeros(fine), np.empty(frames)
    for t in range(frames):
        x, y = slope[t, 0, 0], slope[t, 0, 1]
        speed = math.sqrt(x * x + y * y)
        for k in range(1, fine):
            x1, y1 = slope[t, k, 0], slope[t, k, 1]
            speed1 = math.sqrt(x1 * x1 + y1 * y1)
            turning = math.asin(min(max((x * y1 - y * x1) / (speed * speed1), -1.0), 1.0))
            centre[k] = centre[k - 1] + 0.5 * (speed + speed1) / (fine - 1)
            hinge[k] = hinge[k - 1] + (centre[k] - centre[k - 1]) + signed_radius * turning
            x, y, speed = x1, y1, speed1
        whole[t] = hinge[fine - 1]
        part = whole[t] / segments
        k, before = 0, 0.0
        for j in range(segments):
            target = part * (j + 1)
            while k < fine - 2 and hinge[k + 1] < target:
                k += 1
            share = (target - hinge[k]) / max(hinge[k + 1] - hinge[k], 1e-12)
            here = centre[k] + share * (centre[k + 1] - centre[k])
            out[t, j] = (here - before) / part - 1.0
            before = here
    return whole


def elongation_of(segments, coefficients, sign, variance, length, radius, calibrated):
    """Centre-line over hinge-side length minus one, for segments even along the hinge side (PHYSICS 1)."""
    slope = np.matmul(basis_matrix(np.linspace(0, 1, FINE), COEFFICIENTS, 1), coefficients)
    out = np.empty((len(slope), segments))
    hinge = _centre_over_hinge(slope, sign * radius, segments, out)
    step = hinge[:, None] / segments
    noise = radius * np.sqrt(variance) / length[:, None] / step
    at = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS), coefficients)
    slope = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS, 1), coefficients)
    tangent = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    turning = np.diff(calibrated.rotation(at, tangent), axis=-1)
    systematic = np.sum((radius * turning / step[None]) ** 2, axis=0)
    return out, noise, np.sqrt(noise**2 + systematic), hinge
