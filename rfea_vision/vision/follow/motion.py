"""Where the tube will be in the next frame, from the last three: compiled."""

from __future__ import annotations

import math

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.compiled import compiled, put_rows
from rfea_vision.vision.curve import COEFFICIENTS

FORGET = 0.25  # of what earlier frames said about each order, with every frame
FARTHEST_S = 0.1
ORDERS = 3  # the tube stays, goes on, or goes on and turns


# A tube swings as a whole, from its clamp on. What its edges hardly tell, such as the coefficient that lies before the
# clamp, would run away if it were extrapolated frame by frame: only the slow part of a motion along the tube is.
_ALONG = (np.arange(COEFFICIENTS) - 1.0) / (COEFFICIENTS - 3.0)
_WAYS = _ALONG[:, None] ** np.arange(1, 6)
SLOW = _WAYS @ np.linalg.pinv(_WAYS)


@compiled
def _extrapolated(past, times, order, time_s, out):
    """Newton's polynomial of `order` through the last curves, at `time_s`: how the tube as a whole goes on."""
    ahead = min(max(time_s - times[0], 0.0), FARTHEST_S)
    first = 1.0 / max(times[0] - times[1], 1e-6)
    second = 1.0 / max(times[1] - times[2], 1e-6)
    whole = 1.0 / max(times[0] - times[2], 1e-6)
    put_rows(out, past[0])
    if order == 0:
        return
    for k in range(out.shape[0]):
        for c in range(2):
            pace = (past[0, k, c] - past[1, k, c]) * first
            step = ahead * pace
            if order > 1:
                before = (past[1, k, c] - past[2, k, c]) * second
                step += ahead * (ahead + times[0] - times[1]) * (pace - before) * whole
            for i in range(out.shape[0]):
                out[i, c] += SLOW[i, k] * step


@compiled
def _predict(past, times, missed_by, known, time_s, out):
    """Put the curve expected at `time_s` into `out`, by the order that has missed by least."""
    order = np.int64(0)
    for other in range(1, known):
        if missed_by[other] < missed_by[order]:
            order = other
    _extrapolated(past, times, order, time_s, out)


@compiled
def _pace(past, times):
    """How fast the fastest part of the tube went from the last frame but one to the last, mm/s."""
    fastest = 0.0
    for k in range(past.shape[1]):
        x, y = past[0, k, 0] - past[1, k, 0], past[0, k, 1] - past[1, k, 1]
        fastest = max(fastest, x * x + y * y)
    return math.sqrt(fastest) / max(times[0] - times[1], 1e-6)


@compiled
def _learn(past, times, known, missed_by, coefficients, time_s):
    """Compare each order's prediction with what was seen, and remember the latter."""
    guess = np.empty(coefficients.shape)
    for order in range(min(known, ORDERS)):
        _extrapolated(past, times, order, time_s, guess)
        error = 0.0
        for k in range(guess.shape[0]):
            for c in range(2):
                error += (guess[k, c] - coefficients[k, c]) ** 2
        missed_by[order] = error if known == order + 1 else (1.0 - FORGET) * missed_by[order] + FORGET * error
    for n in range(ORDERS - 1, 0, -1):
        put_rows(past[n], past[n - 1])
        times[n] = times[n - 1]
    put_rows(past[0], coefficients)
    times[0] = time_s


class CurvePredictor:
    """The last curves of the tube, and how well each order of extrapolation has predicted them lately."""

    def __init__(self) -> None:
        self.past = np.zeros((ORDERS, COEFFICIENTS, 2))
        self.times = np.zeros(ORDERS)
        self.missed_by = np.array([0.0, 0.0, np.inf])  # until it is known, a tube goes on as it went
        self.known = 0

    @property
    def last(self) -> FloatArray:
        """Coefficients of the last curve."""
        return self.past[0]

    def begin(self, coefficients: FloatArray) -> None:
        """Start from a first curve, of which nothing but its place is known."""
        self.past[0] = coefficients
        self.known = 0

    def follow(self, coefficients: FloatArray, time_s: float) -> None:
        """Add a curve that was seen."""
        if self.known and time_s - self.times[0] <= 1e-6:
            self.known = 0
        _learn(self.past, self.times, self.known, self.missed_by, coefficients, time_s)
        self.known = min(self.known + 1, ORDERS)

    def forget(self) -> None:
        """What was lost may have gone anywhere: its pace no longer counts."""
        self.known = 0

    def predict(self, time_s: float, out: FloatArray) -> None:
        """Put the curve expected at `time_s` into `out`."""
        _predict(self.past, self.times, self.missed_by, self.known, time_s, out)

    def step_mm(self, time_s: float) -> float:
        """How far the fastest part of the tube goes until `time_s`, at its last pace."""
        if self.known < 2:
            return 0.0
        return _pace(self.past, self.times) * max(time_s - self.times[0], 0.0)
