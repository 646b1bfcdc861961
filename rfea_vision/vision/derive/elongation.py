"""How the tube turns along its length, and how much each part of it is longer than on the inextensible side."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.curve import COEFFICIENTS, basis_matrix

FINE = 129  # places along the tube at which its direction is read: twice as many move an elongation by less than 1e-9


def angles(coefficients: FloatArray, sign: float, u: FloatArray) -> FloatArray:
    """Unwrapped tangent angle at `u` in the plane frame, from straight down, positive towards the bend, (t, len(u))."""
    slope = np.matmul(basis_matrix(u, COEFFICIENTS, 1), coefficients)
    return np.unwrap(np.arctan2(-sign * slope[..., 0], -slope[..., 1]), axis=1)


def elongation_of(segments, coefficients, sign, variance, length, radius, calibrated):
    """Centre-line over hinge-side length minus one, for segments even along the hinge side (PHYSICS 1)."""
    fine = np.linspace(0, 1, FINE)
    slope = np.matmul(basis_matrix(fine, COEFFICIENTS, 1), coefficients)
    x, y = slope[..., 0], slope[..., 1]
    speed = np.hypot(x, y)
    centre = cumulative_trapezoid(speed, fine, axis=1, initial=0.0)
    turns = (x[:, :-1] * y[:, 1:] - y[:, :-1] * x[:, 1:]) / (speed[:, :-1] * speed[:, 1:])
    beside = centre.copy()
    beside[:, 1:] += sign * radius * np.cumsum(np.arcsin(np.clip(turns, -1.0, 1.0)), axis=1)
    hinge = beside[:, -1]
    step = hinge[:, None] / segments
    rising = np.maximum.accumulate(beside, axis=1)
    joints = [np.interp(np.linspace(0, end, segments + 1), *lines) for end, *lines in zip(hinge, rising, centre, strict=True)]
    out = np.diff(joints, axis=1) / step - 1.0
    noise = radius * np.sqrt(variance) / length[:, None] / step
    at = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS), coefficients)
    slope = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS, 1), coefficients)
    tangent = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    turning = np.diff(calibrated.rotation(at, tangent), axis=-1)
    systematic = np.sum((radius * turning / step[None]) ** 2, axis=0)
    return out, noise, np.sqrt(noise**2 + systematic), hinge
