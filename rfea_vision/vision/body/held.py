"""What holds the body moves, in a hand or on a robot: pictures are brought back to the first one by what is seen behind the clamp."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along
from rfea_vision.scatter import scatter
from rfea_vision.vision.body.begin import POINTED_PX, POINTED_SHARE, leaving, smooth_line
from rfea_vision.vision.body.levels import Level, sampled, sloping
from rfea_vision.vision.body.wall import window_around

AROUND = 3.0  # half widths about the clamp, behind it: what is seen there is taken for what holds the body,
LOOKED_AT = 6.5  # likewise, about where that may have gone
AXIS = 1.5  # the less the farther it lies beside the body's axis: there may be wall
BLURS = 0.3, 0.15, 0.1  # half widths, one after the other: what has moved by more than its details is found without them
STEPS = 6  # of least squares at each
# What a frame adds, 1 s.d., chosen: half widths that it goes, and radians that it turns. Along a way on which nothing is seen (a
# bracket without a mark) it is taken to stay, and is known by so much less from frame to frame.
GOES, TURNS = 0.5, 0.1
NOISE, SLOPE_NOISE = 2.0, 0.5  # grey levels, and such to a pixel of a blurred picture: slopes that noise makes are no information
EDGE_PX = 0.15  # by how much a pixel of an edge may be off for how it was resampled and compressed
# Correlation with the first picture, below which what holds the body is not seen, and above which it surely is: where a hand passed
# before one it was 0.73 at most, and 0.88 and more in fourteen other drawn films whose view was followed (all seen).
ALIKE, WELL_ALIKE = 0.7, 0.85
# How well a wall says where it is and how it is turned, px and rad; how well a base that rests is to know that of itself; and
# standard errors off these: all chosen, the second by how far views of drawn films (seen) were wrong with 0.002, 0.007 and 0.014.
WALL_PX, WALL_TURN, RESTS_PX, RESTS_TURN, SURELY = 0.5, 0.004, 0.5, 0.01, 3.0
TOGETHER = 3.0  # px over which what a compressed picture gets wrong is alike
AT_CLAMP = 0.5  # of the way between two clicks: so far beside the clamp the first of them may lie, and still stand for it


class SeenFrom(NamedTuple):
    """From where a picture is seen: `moved` (2, 3) maps places of the first picture to those of this one.

    `seen` is False where what tells that is not in it; `stderr` (3,) are standard errors of the view, px, px and rad.
    """

    moved: FloatArray
    seen: bool
    stderr: FloatArray


class HeldView:
    """Sees by how much what holds the body has moved and turned since the first picture, and takes it back; as `StillView`.

    Parameters
    ----------
    clamp : (2, 2) px in the pictures, both edges
    line : (n, 2) px, from the clamp to the tip in the first frame
    half : px, half the width of the body
    """

    def __init__(self, clamp: FloatArray, line: FloatArray, half: float) -> None:
        self._foot, self._half, self._length = clamp.mean(axis=0), half, along(line)[-1]
        reach = np.arange(-round(AROUND * half), round(AROUND * half) + 1.0)
        places = np.stack(np.meshgrid(reach, reach), axis=2).reshape(-1, 2)
        inwards = leaving(clamp, line[:2])
        self._inwards = np.arctan2(inwards[1], inwards[0])
        self._places = places[places @ inwards < 0.0]
        beside = self._places @ np.array([-inwards[1], inwards[0]])
        self._weight = np.exp(-0.5 * (beside / (AXIS * half)) ** 2)
        self._first: list[FloatArray] | None = None  # what is seen there in the first picture, at each blur
        self._pose, self._step = np.zeros(3), np.zeros(3)  # px and radians about the foot, and by how much they changed last
        self.moved = np.eye(2, 3)  # from a place in the first picture to that in the last one
        self.seen, self._alike = True, 1.0  # in the last picture; correlation with the first one
        self._covariance = np.zeros((3, 3))
        self._told = np.zeros((3, 3))  # covariance of the pose from which on it is followed: by clicks, where these told it anew

    def look(self, picture: NDArray[np.uint8], again: FloatArray | None = None) -> SeenFrom:
        """See in a picture (h, w, 3) by how much what holds the body has moved and turned.

        Where a person points at the body `again` in that picture, at places (n, 2) px from the clamp to the tip, it is sought there,
        and where it looks like another thing by now, it is known by what is seen there from then on.
        """
        self._look(picture, None if again is None else self._pointed(again))
        return SeenFrom(self.moved, self.seen, self.stderr)

    def _look(self, picture: NDArray[np.uint8], pointed: tuple[FloatArray, FloatArray] | None) -> None:
        if pointed is not None:
            self._pose, self._step, self._covariance = pointed[0], np.zeros(3), np.diag(pointed[1] ** 2)
        near = self._foot + self._pose[:2] + np.outer([0.0, 1.0], self._step[:2])
        window = window_around(picture.shape, near, LOOKED_AT * self._half)
        self._corner = np.array([window[1].start, window[0].start])
        grey = np.asarray(cv2.cvtColor(picture[window], cv2.COLOR_BGR2GRAY), dtype=np.float32)
        blurred = [np.asarray(cv2.GaussianBlur(grey, (0, 0), blur * self._half), dtype=np.float32) for blur in BLURS]
        if self._first is None:
            self._first = [sampled(level, self._put(np.zeros(3))) for level in blurred]
            return
        if pointed is None:
            self._covariance += np.diag(np.array([GOES * self._half, GOES * self._half, TURNS]) ** 2)
        pose, alike, covariance = self._aligned(blurred, self._pose + self._step)
        if alike <= ALIKE and pointed is None:  # it has not gone on as it went
            pose, alike, covariance = self._aligned(blurred, self._pose)
        elif alike <= ALIKE:  # it has changed: what is seen there now is what it is known by from here on
            self._first = [sampled(level, self._put(self._pose)) for level in blurred]
            self._told, pose, alike, covariance = self._covariance, self._pose, 1.0, np.zeros((3, 3))
        self.seen, self._alike = alike > ALIKE, alike
        if self.seen:
            self._step, self._pose, self._covariance = pose - self._pose, pose, covariance
            turns = _turn(pose[2])
            self.moved = np.column_stack([turns, self._foot + pose[:2] - turns @ self._foot])

    def _pointed(self, clicks: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The pose (3,) and its standard errors by clicks (n, 2) px; None by fewer than three, or such as begin farther on the body.

        How it leaves its clamp is known as well as two clicks say it, and to half of the angle between them and a curve through all.
        """
        ways = np.linalg.norm(np.diff(clicks, axis=0), axis=1)
        if len(clicks) < 3 or self._length - ways.sum() > AT_CLAMP * ways.mean():
            return None
        known = float(np.hypot(POINTED_PX, POINTED_SHARE * self._half))
        leaves, next_one = (np.arctan2(*(line[1] - line[0])[::-1]) for line in (smooth_line(clicks), clicks))
        turn, bends = _wrapped(leaves - self._inwards - self._pose[2]), _wrapped(leaves - next_one)
        pose = np.array([*(clicks[0] - self._foot), self._pose[2] + turn])
        return pose, np.array([known, known, np.hypot(2.0 * known / ways[0], 0.5 * bends)])

    def off(self, view: FloatArray) -> tuple[float, float]:
        """How far the clamp is from where the `view` (2, 3) of the wall has it, px, and by how much it is turned from there, rad."""
        turned = self._pose[2] - np.arctan2(view[1, 0], view[0, 0])
        return float(np.linalg.norm((self.moved - view) @ [*self._foot, 1.0])), abs(float(turned))

    def elsewhere(self, view: FloatArray) -> bool:
        """Whether it is surely not where the `view` (2, 3) of the wall has it."""
        at = (self.moved - view) @ [*self._foot, 1.0]
        turned = self._pose[2] - np.arctan2(view[1, 0], view[0, 0])
        off = np.array([*at, turned])
        known = self._covariance + np.diag([WALL_PX, WALL_PX, WALL_TURN]) ** 2
        return self._alike > WELL_ALIKE and bool(off @ np.linalg.solve(known, off) > SURELY**2)

    def rests(self) -> bool:
        """Whether it is surely where it was."""
        known = bool(np.all(self.stderr < (RESTS_PX, RESTS_PX, RESTS_TURN)))
        return self._alike > WELL_ALIKE and known and bool(self._pose @ np.linalg.solve(self._covariance, self._pose) < SURELY**2)

    @property
    def stderr(self) -> FloatArray:
        """Standard errors (3,) of where it is and how it is turned: px, px, rad."""
        return np.sqrt(np.diag(self._covariance + self._told))

    def _put(self, pose: FloatArray) -> FloatArray:
        """Where (n, 2) px of what is looked at the places behind the clamp are."""
        return self._foot - self._corner + pose[:2] + self._places @ _turn(pose[2]).T

    def _aligned(self, blurred: list[Level], start: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """The pose at which a picture is most like the first one, sought from `start`; how much it is (correlation); its covariance."""
        assert self._first is not None
        pose, prior = start.copy(), np.linalg.inv(self._covariance)
        information = prior
        for level, first in zip(blurred, self._first, strict=True):
            for _ in range(STEPS):
                seen, slopes = sloping(level, self._put(pose))
                gain, offset = _line(first, seen, self._weight)
                off = gain * first + offset - seen
                variance = max(NOISE, float(scatter(off[:, None])[0])) ** 2 + EDGE_PX**2 * np.sum(slopes**2, axis=1)
                weight = self._weight / (1.0 + off**2 / (4.0 * variance)) ** 2 / (variance * TOGETHER**2)
                turned = (self._places @ _turn(pose[2] + 0.5 * np.pi).T * slopes).sum(axis=1)
                rows = np.column_stack([slopes, turned])
                less = SLOPE_NOISE * np.sqrt([weight.sum(), weight.sum(), weight @ np.sum(self._places**2, axis=1)])
                share, ways = np.linalg.eigh((rows * weight[:, None]).T @ rows / np.outer(less, less))
                true = np.maximum(share - 1.0, 0.0)
                information = prior + (ways * true) @ ways.T * np.outer(less, less)
                pull = (ways * true / np.maximum(share, 1e-9)) @ ways.T @ (rows.T @ (weight * off) / less) * less
                step = np.linalg.solve(information, pull + prior @ (self._pose - pose))
                pose += step
                if np.abs(step[:2]).max() + self._half * abs(step[2]) < 0.02:
                    break
        seen = sampled(blurred[-1], self._put(pose))
        return pose, _alike(self._first[-1], seen, self._weight), np.asarray(np.linalg.inv(information), dtype=float)


def _turn(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _wrapped(angle: float) -> float:
    """The same angle between -pi and pi."""
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


def _line(first: FloatArray, seen: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Gain and offset of the light that turn `first` into `seen`."""
    share = weight / weight.sum()
    means = share @ first, share @ seen
    apart = first - means[0]
    gain = float(share @ (apart * (seen - means[1])) / max(float(share @ apart**2), 1e-9))
    return gain, float(means[1] - gain * means[0])


def _alike(first: FloatArray, seen: FloatArray, weight: FloatArray) -> float:
    """Correlation of two pictures of one place."""
    share = weight / weight.sum()
    apart, other = first - share @ first, seen - share @ seen
    return float(share @ (apart * other) / max(float(np.sqrt((share @ apart**2) * (share @ other**2))), 1e-9))
