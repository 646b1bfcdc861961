"""A rolling shutter: rows of a picture are read one after the other, and the tube moves meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from rfea_vision.arrays import FloatArray
from rfea_vision.calibration.projection import project
from rfea_vision.vision.curve import REFIT, REFIT_POINTS, basis_matrix

LONGEST_GAP = 2.5  # times the usual time between frames: across more of it the velocity is not known
FEWEST = 4  # frames through which a spline goes
PLACES = np.linspace(0, 1, REFIT_POINTS)


@dataclass(frozen=True)
class Shutter:
    """How a camera reads its rows.

    Attributes
    ----------
    line_delay_s : from one row of the file's pictures to the next; negative where the lowest is read first
    at : (x, y) px of the pictures as displayed; what is seen in its row is of the instant that a frame's time names
    quarter_turns, size : from the file's pictures to those that are displayed, counter-clockwise, and these in px
    """

    line_delay_s: float
    at: tuple[float, float]
    quarter_turns: int
    size: tuple[int, int]

    def rows(self, pixels: FloatArray) -> FloatArray:
        """Row of the file's pictures (...) in which pixels (..., 2) of the displayed ones were read."""
        x, y = pixels[..., 0], pixels[..., 1]
        width, height = self.size
        return (y, x, height - 1 - y, width - 1 - x)[self.quarter_turns % 4]

    def late_s(self, pixels: FloatArray) -> FloatArray:
        """How much later (...) than a frame's time its pixels (..., 2) were read, in s."""
        return self.line_delay_s * (self.rows(pixels) - self.rows(np.asarray(self.at, dtype=float)))


def at_one_instant(coefficients: FloatArray, time_s: FloatArray, camera: FloatArray, shutter: Shutter) -> FloatArray:
    """Curves (t, K, 2) mm on the plane as they were at the frames' times (t,), each place moved back along its own way.

    To second order in the delay, by a cubic spline over the frames; of those that are cut off by gaps of more than `LONGEST_GAP`
    times the usual step, fewer than `FEWEST` stay as they were read.
    """
    moved = coefficients.copy()
    steps = np.diff(time_s)
    if len(steps) == 0:
        return moved
    breaks = np.flatnonzero(steps > LONGEST_GAP * np.median(steps)) + 1
    basis = basis_matrix(PLACES, coefficients.shape[1])
    for part in np.split(np.arange(len(time_s)), breaks):
        if len(part) < FEWEST:
            continue
        way = CubicSpline(time_s[part], coefficients[part])
        velocity, change = way(time_s[part], 1), way(time_s[part], 2)
        for k, frame in enumerate(part):
            late = shutter.late_s(project(camera, basis @ coefficients[frame]))[:, None]
            moved[frame] -= REFIT @ (late * (basis @ velocity[k]) - 0.5 * late**2 * (basis @ change[k]))
    return moved
