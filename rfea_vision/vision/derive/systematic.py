"""What an uncertain calibration does to everything that is measured: the same in all frames."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration
from rfea_vision.calibration.projection import perturbed_cameras, project, unproject
from rfea_vision.lines import leftwards
from rfea_vision.vision.curve import points_on


class CalibrationError:
    """How the plane moves under one standard error of the calibration, along each of its principal axes.

    Every axis gives a smooth displacement field on the plane, kept as a cubic polynomial, relative to the origin.
    """

    def __init__(
        self, calibration: Calibration, camera: FloatArray, coefficients: FloatArray, origin: FloatArray
    ) -> None:
        points = points_on(coefficients, np.linspace(0, 1, 9)).reshape(-1, 2)
        low, high = points.min(axis=0) - 10, points.max(axis=0) + 10
        self.middle, self.half = (low + high) / 2, (high - low) / 2
        grid = np.stack(np.meshgrid(*np.linspace(low, high, 9).T), axis=-1).reshape(-1, 2)
        pixels = project(camera, grid)
        cameras = perturbed_cameras(calibration)
        fields = [unproject(other, pixels) - grid for other in cameras] or [np.zeros_like(grid)]
        terms = self._terms(grid).T
        # Where a camera that is turned a little no longer sees a place, the others say what it would have been.
        solutions = [
            np.linalg.lstsq(terms[seen], f[seen], rcond=None)[0]
            for f in fields
            for seen in [np.isfinite(f).all(axis=1)]
        ]
        self.fields = np.stack(solutions)  # (axes, 10, 2)
        self.fields[:, 0] -= np.tensordot(self.fields, self._terms(origin), axes=(1, 0))

    def _terms(self, points: FloatArray) -> FloatArray:
        """Terms (10, ...) of the polynomials at points (..., 2)."""
        x, y = (points[..., 0] - self.middle[0]) / self.half[0], (points[..., 1] - self.middle[1]) / self.half[1]
        xx, xy, yy = x * x, x * y, y * y
        return np.stack([np.ones_like(x), x, y, xx, xy, yy, xx * x, xx * y, x * yy, yy * y])

    def _along(self, terms: FloatArray, directions: FloatArray) -> FloatArray:
        parts = np.concatenate([terms * directions[..., 0], terms * directions[..., 1]])
        fields = self.fields.transpose(0, 2, 1).reshape(-1, len(parts))
        return (fields @ parts.reshape(len(parts), -1)).reshape(-1, *terms.shape[1:])

    def displacement(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """How far (axes, ...) mm plane points (..., 2) go along unit `directions` (..., 2), relative to the origin."""
        return self._along(self._terms(points), directions)

    def rotation(self, points: FloatArray, tangents: FloatArray) -> FloatArray:
        """Turning (axes, ...) in rad of short lines at `points` along unit `tangents`."""
        step = 0.5
        change = self._terms(points + step * tangents) - self._terms(points - step * tangents)
        return self._along(change, leftwards(tangents)) / (2 * step)
