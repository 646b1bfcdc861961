"""The centre line as a uniform cubic B-spline in mm on the plane of motion, compiled.

A curve is its coefficients (K, 2); its parameter u runs from 0 at the clamp to 1 at the tip, evenly in arc length. The
same basis, with fewer coefficients, carries the half width along the tube.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import evenly
from rfea_vision.vision.compiled import compiled, inlined, lean

COEFFICIENTS = 18
WIDTH_COEFFICIENTS = 8
VERTICES = 257
#: Curvature times half width: no body bends within its own, so a line that does says nothing of how it bends or stretches there.
SHARPEST = 0.9


@inlined
def cubic(u, count):
    """Which of `count` coefficients is the first of four that tell a spline's value at `u`, and the weights of these four."""
    x = u * (count - 3)
    i = min(max(int(np.floor(x)), 0), count - 4)
    t = x - i
    r = 1.0 - t
    return i, r * r * r / 6.0, (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0, (3.0 * r * r * r - 6.0 * r * r + 4.0) / 6.0, t * t * t / 6.0


@lean
def point_and_tangent(coefficients, u):
    """Point and unit tangent at `u`: x, y, tangent x, tangent y, speed."""
    p, q = coefficients, coefficients.shape[0] - 3
    i, a, b, c, d = cubic(u, coefficients.shape[0])
    x = a * p[i, 0] + b * p[i + 1, 0] + c * p[i + 2, 0] + d * p[i + 3, 0]
    y = a * p[i, 1] + b * p[i + 1, 1] + c * p[i + 2, 1] + d * p[i + 3, 1]
    t = u * q - i
    r = 1.0 - t
    a, b, c, d = -0.5 * r * r * q, (1.5 * t * t - 2.0 * t) * q, (2.0 * r - 1.5 * r * r) * q, 0.5 * t * t * q
    dx = a * p[i, 0] + b * p[i + 1, 0] + c * p[i + 2, 0] + d * p[i + 3, 0]
    dy = a * p[i, 1] + b * p[i + 1, 1] + c * p[i + 2, 1] + d * p[i + 3, 1]
    speed = np.sqrt(dx * dx + dy * dy) + 1e-300
    return x, y, dx / speed, dy / speed, speed


@compiled
def points_and_tangents(coefficients, u):
    """Points (n, 2) and unit tangents (n, 2) at all of `u` (n,)."""
    points, tangents = np.empty((len(u), 2)), np.empty((len(u), 2))
    for k in range(len(u)):
        points[k, 0], points[k, 1], tangents[k, 0], tangents[k, 1], _ = point_and_tangent(coefficients, u[k])
    return points, tangents


@lean
def value_at(coefficients, u):
    """A scalar spline at `u`."""
    i, a, b, c, d = cubic(u, coefficients.shape[0])
    return a * coefficients[i] + b * coefficients[i + 1] + c * coefficients[i + 2] + d * coefficients[i + 3]


def basis_matrix(u: FloatArray, count: int, derivative: int = 0) -> FloatArray:
    """Basis (or a derivative of it with respect to u) at each `u`, (len(u), count)."""
    knots = np.arange(-3, count + 1) / (count - 3)
    return np.asarray(BSpline(knots, np.eye(count), 3)(np.asarray(u, dtype=float), derivative), dtype=float)


def points_on(coefficients: FloatArray, u: FloatArray, derivative: int = 0) -> FloatArray:
    """Points (..., len(u), 2) of curves (..., K, 2), or a derivative of these with respect to u."""
    return np.matmul(basis_matrix(u, coefficients.shape[-2], derivative), coefficients)


def tangents(coefficients: FloatArray, u: FloatArray) -> FloatArray:
    """Unit tangents (..., len(u), 2) of curves (..., K, 2)."""
    slope = points_on(coefficients, u, 1)
    return slope / np.linalg.norm(slope, axis=-1, keepdims=True)


def fit_curve(points: FloatArray, count: int = COEFFICIENTS) -> FloatArray:
    """Coefficients (count, 2) of the curve through ordered points (n, 2), parameter even in arc length."""
    places = max(4 * count, len(points))
    return _solver(count, places) @ evenly(points, places)


@lru_cache(maxsize=32)
def _solver(count: int, places: int) -> FloatArray:
    """What turns points at so many even parameters into the coefficients (count, 2) of the curve through them."""
    matrix = basis_matrix(np.linspace(0, 1, places), count)
    return np.asarray(np.linalg.solve(matrix.T @ matrix + 1e-9 * np.eye(count), matrix.T), dtype=float)


VERTEX_U = np.linspace(0.0, 1.0, VERTICES)
REFIT_POINTS = 73
REFIT = np.linalg.pinv(basis_matrix(np.linspace(0, 1, REFIT_POINTS), COEFFICIENTS))  # even points -> coefficients


@lean
def vertices_of(coefficients, width_coefficients, centre, normal, half_width):
    """Fill centre (V, 2), left-hand normal (V, 2) and half width (V,) at the vertices; return the length."""
    count = centre.shape[0]
    length = 0.0
    for v in range(count):
        u = v / (count - 1)
        x, y, tx, ty, speed = point_and_tangent(coefficients, u)
        centre[v, 0], centre[v, 1] = x, y
        normal[v, 0], normal[v, 1] = -ty, tx
        half_width[v] = value_at(width_coefficients, u)
        length += speed * (0.5 if v in (0, count - 1) else 1.0) / (count - 1)
    return length


@compiled
def moved_curve(coefficients, offset, from_mm, beyond_mm, refit):
    """Move a curve along its normals by the scalar spline `offset`, cut or extend its ends, make u even again.

    `from_mm` is where the new curve starts on the old one, `beyond_mm` how far it goes on past the old end. Ends are
    extended by the end pieces of the spline.
    """
    count = refit.shape[1]
    extra = 4  # points beyond either end, to find the arc length there
    total = count + 2 * extra
    length = 0.0
    arc = np.empty(total)
    previous_x = previous_y = 0.0
    start_arc = 0.0
    end_arc = 0.0
    step = 1.0 / (count - 1)
    for k in range(total):
        u = (k - extra) * step
        x, y, tx, ty, _ = point_and_tangent(coefficients, u)
        d = value_at(offset, u)
        px, py = x - d * ty, y + d * tx
        if k > 0:
            length += np.sqrt((px - previous_x) ** 2 + (py - previous_y) ** 2)
        arc[k] = length
        previous_x, previous_y = px, py
        if k == extra:
            start_arc = length
        if k == extra + count - 1:
            end_arc = length
    first, last = start_arc + from_mm, end_arc + beyond_mm
    points = np.empty((count, 2))
    k = 0
    for v in range(count):
        target = first + (last - first) * v * step
        while k < total - 2 and arc[k + 1] < target:
            k += 1
        u = (k - extra + (target - arc[k]) / max(arc[k + 1] - arc[k], 1e-12)) * step
        x, y, tx, ty, _ = point_and_tangent(coefficients, u)
        d = value_at(offset, u)
        points[v, 0], points[v, 1] = x - d * ty, y + d * tx
    return refit @ points


@lean
def turning(normal):
    """Total turning of the curve in rad, counter-clockwise positive."""
    total = 0.0
    for v in range(normal.shape[0] - 1):
        cross = normal[v, 0] * normal[v + 1, 1] - normal[v, 1] * normal[v + 1, 0]
        total += math.asin(min(max(cross, -1.0), 1.0))
    return total
