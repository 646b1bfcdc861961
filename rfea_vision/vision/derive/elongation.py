"""How the tube turns along its length, and how much each part of it is longer than on the inextensible side."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import from_down
from rfea_vision.vision.curve import SHARPEST, VERTEX_U, points_on, tangents


def angles(coefficients: FloatArray, sign: float, u: FloatArray) -> FloatArray:
    """Unwrapped tangent angle at `u` in the plane frame, from straight down, positive towards the bend, (t, len(u))."""
    return np.unwrap(from_down(points_on(coefficients, u, 1), sign), axis=1)


def _centre_over_hinge(slope: FloatArray, signed_radius: float, segments: int) -> tuple[FloatArray, FloatArray]:
    """Centre-line over hinge-side length minus one (t, segments), for parts even along the hinge side, whose length (t,) comes with it.

    `slope` (t, n, 2) is the derivative of the centre line at even steps; `signed_radius` is that of the tube, positive
    where a counter-clockwise turn lengthens the hinge side.
    """
    speed = np.linalg.norm(slope, axis=-1)
    cross = slope[:, :-1, 0] * slope[:, 1:, 1] - slope[:, :-1, 1] * slope[:, 1:, 0]
    turning = np.arcsin(np.clip(cross / (speed[:, :-1] * speed[:, 1:]), -1.0, 1.0))
    centre, hinge = np.zeros(speed.shape), np.zeros(speed.shape)
    np.cumsum(0.5 * (speed[:, :-1] + speed[:, 1:]) / (speed.shape[1] - 1), axis=1, out=centre[:, 1:])
    np.cumsum(np.diff(centre, axis=1) + signed_radius * turning, axis=1, out=hinge[:, 1:])
    whole = hinge[:, -1]
    joints = whole[:, None] * np.linspace(0, 1, segments + 1)
    reached = np.maximum.accumulate(hinge, axis=1)  # a body that was followed may bend within its own width
    there = np.array([np.interp(*frame) for frame in zip(joints, reached, centre, strict=True)]).reshape(joints.shape)
    return np.diff(there, axis=1) * segments / whole[:, None] - 1.0, whole


def elongation_of(segments, coefficients, sign, variance, length, radius, calibrated, from_picture):
    """Centre-line over hinge-side length minus one, for segments even along the hinge side (PHYSICS 1)."""
    out, hinge = _centre_over_hinge(points_on(coefficients, VERTEX_U, 1), sign * radius, segments)
    step = hinge[:, None] / segments
    noise = radius * np.sqrt(variance) / length[:, None] / step
    joints = np.linspace(0, 1, segments + 1)
    turning = np.diff(calibrated.rotation(points_on(coefficients, joints), tangents(coefficients, joints)), axis=-1)
    wavers = from_picture.turned_over(step)
    systematic = (radius / step) ** 2 * (np.sum(turning**2, axis=0) + wavers**2)
    bends = out / np.maximum(1.0 + out, 1e-6)  # curvature of the centre line times half width
    kinked = beside_kinks(bends, np.abs(out), int(np.ceil(radius * segments / float(np.median(hinge)))))
    return out, noise, np.sqrt(noise**2 + systematic + kinked**2), hinge


def beside_kinks(bends: FloatArray, size: FloatArray, reach: int) -> FloatArray:
    """How far off what is as large as `size` (t, n) may be where a line bends within its own half width, and `reach` places around.

    `bends` (t, n) are curvatures times half width. A clamp that lets the body turn does that to a line that leaves it squarely: it
    bends to one side there, and back to the other.
    """
    kinked = np.where(np.abs(bends) > SHARPEST, size, 0.0)
    return maximum_filter1d(kinked, 2 * reach + 1, axis=1, mode="constant")
