"""Where the tube will be in the next frame, from the last three."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.curve import COEFFICIENTS

FORGET = 0.25  # of what earlier frames said about each order, with every frame
FARTHEST_S = 0.1
ORDERS = 3  # the tube stays, goes on, or goes on and turns

# A tube swings as a whole, from its clamp on. What its edges hardly tell, such as the coefficient that lies before the
# clamp, would run away if it were extrapolated frame by frame: only the slow part of a motion along the tube is.
_ALONG = (np.arange(COEFFICIENTS) - 1.0) / (COEFFICIENTS - 3.0)
_WAYS = _ALONG[:, None] ** np.arange(1, 6)
SLOW = _WAYS @ np.linalg.pinv(_WAYS)


class CurvePredictor:
    """The last curves of the tube, and how well each order of extrapolation has predicted them lately."""

    def __init__(self) -> None:
        self.last: FloatArray = np.zeros((COEFFICIENTS, 2))
        self.past: list[tuple[float, FloatArray]] = []  # times and curves, the latest first; none after it was lost
        self.foretold: list[FloatArray] = []  # curves at the time that was asked for, by each order
        self.missed_by = [0.0, 0.0, np.inf]  # until it is known, a tube goes on as it went

    def begin(self, coefficients: FloatArray) -> None:
        """Start from a first curve, of which nothing but its place is known."""
        self.last = coefficients.copy()
        self.forget()

    def forget(self) -> None:
        """What was lost may have gone anywhere: its pace no longer counts."""
        self.past, self.foretold = [], []

    def follow(self, coefficients: FloatArray, time_s: float) -> None:
        """Add a curve that was seen, and compare with it what each order has foretold."""
        if self.past and time_s - self.past[0][0] <= 1e-6:
            self.forget()
        for order, guess in enumerate(self.foretold):
            off = guess - coefficients
            before = error = float(np.vdot(off, off))
            if len(self.past) > order + 1:
                before = self.missed_by[order]
            self.missed_by[order] = (1.0 - FORGET) * before + FORGET * error
        self.last = coefficients.copy()
        self.past = [(time_s, self.last), *self.past[: ORDERS - 1]]

    def predict(self, time_s: float, out: FloatArray) -> None:
        """Put the curve expected at `time_s`, by the order that has missed by least, into `out`."""
        self.foretold = self._at(time_s)
        missed_by = self.missed_by[: len(self.foretold)]
        out[:] = self.foretold[missed_by.index(min(missed_by))]

    def step_mm(self, time_s: float) -> float:
        """How far the fastest part of the tube goes until `time_s`, at its last pace."""
        if len(self.past) < 2:
            return 0.0
        (now, here), (then, there) = self.past[:2]
        return float(np.sqrt(((here - there) ** 2).sum(axis=1).max())) / (now - then) * max(time_s - now, 0.0)

    def _at(self, time_s: float) -> list[FloatArray]:
        """The curves at `time_s` by Newton's polynomials of each order through the last ones: how the tube as a whole goes on."""
        if len(self.past) < 2:
            return [self.last] * len(self.past)
        (now, here), (then, there) = self.past[:2]
        ahead = min(max(time_s - now, 0.0), FARTHEST_S)
        pace = (here - there) / (now - then)
        goes = [ahead * pace]
        if len(self.past) > 2:
            first, start = self.past[2]
            turns = (pace - (there - start) / (then - first)) / (now - first)
            goes.append(goes[0] + ahead * (ahead + now - then) * turns)
        return [self.last, *(self.last + SLOW @ way for way in goes)]
