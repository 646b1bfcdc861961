"""A camera that shakes, drifts or breathes: pictures are brought back to the first one by what stands out of the still wall."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.scatter import NORMAL
from rfea_vision.vision.body.held import HeldView, SeenFrom
from rfea_vision.vision.body.levels import Level, sampled, similarity_equations

# A camera that moves is seen all over the picture; what moves before it is in one place, and may show most (an arm before a white
# wall): of each of so many parts of the width and of the height as many of the steepest pixels count at most, if they are steep enough.
PARTS, EACH, STEEP = 8, 20, 4.0  # the last in grey levels per pixel
LEAST_EACH = 8  # with fewer a part tells nothing
AROUND = 2.0  # half widths about the hinted line: what is there is the body's
MARGIN_PX = 12  # of the picture, that may leave it
MOST_PIXELS = 400_000  # of the picture in which this is seen: more takes longer than it brings
BLURS = 4.0, 2.0, 1.0  # px, one after the other
STEPS = 3  # of least squares at each
# What a frame adds, 1 s.d., chosen: px that the view goes, radians that it turns, and the share by which it grows.
FRAME_ADDS = np.array([4.0, 4.0, 0.01, 0.004])
NOISE = 2.0  # grey levels, at least
TOGETHER = 3.0  # px over which what a compressed picture gets wrong is alike
# Where a part would rather have the view moved, or rather not: by so much of a squared scatter for each pixel; so many times as many
# parts must for it to be believed, and so many for pictures to be turned back. Of fifteen drawn films that are shaken at least six of
# seven to sixty-four parts did where the view had moved most; of 105 in which the camera stands two did at most, but in one (six of
# eleven, by two pixels).
RATHER, CLEARLY, LEAST_PARTS = 0.5, 2.0, 6
LEAST_PX = 1.0  # where the view moved most: from then on pictures are turned back, earlier it may be noise
# Light that drifts by a few grey levels pulls along faint lines: what counts is the difference from the mean over so many px.
LEVELLED_PX = 31


class StillView:
    """Sees by how much the view of a wall has moved, turned and grown since the first picture, and takes it back.

    Parameters
    ----------
    line : (n, 2) px in the pictures, from the clamp to the tip in the first frame
    half : px, half the width of the body
    base : sees what holds the body, which stands on the wall: where the wall is said to have moved otherwise, it is other things that
        have (a hose, a second body, all of an arm before a plain wall), and the view is that of the base
    """

    def __init__(self, line: FloatArray, half: float, base: HeldView | None = None) -> None:
        self._line, self._half, self._base = line, half, base
        self._first: list[FloatArray] | None = None  # what the first picture shows at its steepest pixels, at each blur
        self._pose = np.zeros(4)  # px, px, radians and share, about the middle of the picture in which it is seen
        self._drifts = False
        self._stderr = np.zeros(3)  # px, px and rad, of the pose: next to nothing by a wall, by a base as well as that is seen
        self.moved = np.eye(2, 3)  # from a place in the first picture to that in the last one, once that is believed

    def look(self, picture: NDArray[np.uint8]) -> SeenFrom:
        """See in a picture (h, w, 3) by how much the view has moved; a camera whose wall is not seen is taken to stay."""
        self._look(picture)
        return SeenFrom(self.moved, True, self._stderr if self._drifts else np.zeros(3))

    def _look(self, picture: NDArray[np.uint8]) -> None:
        if self._first is None:
            self._begin(picture)
            if self._base is not None:
                self._base.look(picture)
            return
        self._stderr = np.zeros(3)
        parts = len(np.unique(self._part))
        if parts >= LEAST_PARTS:
            claimed = self._by_wall(picture)
        else:
            claimed = self._base is not None and self._by_base(picture, self._base)
        self._drifts |= claimed and self._farthest() > LEAST_PX
        if self._drifts:
            self.moved = self._map()

    def _by_wall(self, picture: NDArray[np.uint8]) -> bool:
        """Take the pose in which most of the wall's parts are as they were, if the base is there; whether enough of them claim one."""
        levels = self._levels(picture)
        pose = self._aligned(levels)
        moved, stays = self._parts_for(levels, pose)
        self._pose = pose if moved >= CLEARLY * stays else np.zeros(4)
        claimed = moved >= LEAST_PARTS and self._farthest() > LEAST_PX
        if self._base is not None and (self._drifts or claimed):
            self._base.look(picture)
            if self._base.elsewhere(self._map()):
                self._pose, self._stderr = self._pose_of(self._base.moved), self._base.stderr
            elif self._base.rests():
                self._pose = np.zeros(4)
        return claimed

    def _by_base(self, picture: NDArray[np.uint8], base: HeldView) -> bool:
        """Take the pose of a base that has surely moved, where the wall shows next to nothing, and that does not speak against it."""
        base.look(picture)
        self._pose = np.zeros(4)
        if base.elsewhere(np.eye(2, 3)):
            pose = self._pose_of(base.moved)
            moved, stays = self._parts_for(self._levels(picture), pose)
            if moved >= CLEARLY * stays:
                self._pose, self._stderr = pose, base.stderr
        return bool(self._pose.any())

    def _begin(self, picture: NDArray[np.uint8]) -> None:
        """Choose the pixels by which the wall is known again."""
        self._size = np.array(picture.shape[1::-1])
        self._halved = max(int(np.ceil(0.5 * np.log2(np.prod(self._size) / MOST_PIXELS))), 0)
        levels = self._levels(picture)
        steep = np.hypot(*(cv2.Scharr(levels[-1], cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1))))
        body = np.round(self._line / 2**self._halved).astype(np.int32)
        cv2.polylines(steep, [body], False, (0.0,), max(round(2.0 * AROUND * self._half / 2**self._halved), 1))
        rows, columns = (np.arange(count) * PARTS // count for count in steep.shape)
        part = np.where(steep > STEEP, PARTS * rows[:, None] + columns, -1)
        for border in (part, part[::-1], part.T, part.T[::-1]):
            border[:MARGIN_PX] = -1
        chosen = []
        for number in range(PARTS**2):
            pixels = np.flatnonzero(part == number)
            chosen.append(pixels[np.argsort(-steep.ravel()[pixels], kind="stable")[:EACH]])
        pixels = np.concatenate([np.empty(0, dtype=int), *(pixels for pixels in chosen if len(pixels) >= LEAST_EACH)])
        self._part = part.ravel()[pixels]
        self._middle = 0.5 * np.array(steep.shape[::-1])
        self._places = np.column_stack([pixels % steep.shape[1], pixels // steep.shape[1]]).astype(float) - self._middle
        self._first = [sampled(level, self._places + self._middle) for level in levels] if len(pixels) else []

    def _levels(self, picture: NDArray[np.uint8]) -> list[Level]:
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        for _ in range(self._halved):
            grey = cv2.pyrDown(grey)  # every second pixel, blurred
        levelled = grey - cv2.boxFilter(grey, cv2.CV_32F, (LEVELLED_PX, LEVELLED_PX))
        return [np.asarray(cv2.GaussianBlur(levelled, (int(6.0 * blur) + 1,) * 2, blur), dtype=np.float32) for blur in BLURS]

    def _aligned(self, levels: list[Level]) -> FloatArray:
        """The similarity by which most of the wall's pixels are as they were: robust least squares, from coarse to fine."""
        assert self._first is not None
        pose, prior = self._pose.copy(), np.diag(FRAME_ADDS**-2.0)
        for level, first in zip(levels, self._first, strict=True):
            for _ in range(STEPS):
                matrix, vector = similarity_equations(level, first, self._places, self._middle, pose, NOISE, TOGETHER)
                step = np.linalg.solve(matrix + prior, vector + prior @ (self._pose - pose))
                pose = pose + step
                if np.abs(step[:2]).max() < 0.02:
                    break
        return pose

    def _parts_for(self, levels: list[Level], pose: FloatArray) -> tuple[int, int]:
        """How many of the wall's parts would rather have the view moved by a pose, and how many rather not."""
        if not self._first:
            return 0, 0
        places = [self._places @ _similarity(to).T + self._middle + to[:2] for to in (np.zeros(4), pose)]
        stayed, off = (self._first[-1] - sampled(levels[-1], there) for there in places)
        scatter = _scatter(off)
        pixels = np.maximum(np.bincount(self._part, minlength=PARTS**2), 1)
        better = np.bincount(self._part, _cost(stayed / scatter) - _cost(off / scatter), PARTS**2) / pixels
        return int(np.sum(better > RATHER)), int(np.sum(better < -RATHER))

    def _farthest(self) -> float:
        """By how many pixels the view has moved where it has most."""
        map_, frame = self._map(), np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * self._size
        return float(np.abs(frame @ map_[:, :2].T + map_[:, 2] - frame).max())

    def _map(self) -> FloatArray:
        """From a place in the first picture to that in the last one (2, 3), by the pose."""
        turn, at = _similarity(self._pose), self._middle * 2**self._halved
        return np.column_stack([turn, self._pose[:2] * 2**self._halved + at - turn @ at])

    def _pose_of(self, map_: FloatArray) -> FloatArray:
        """The pose of such a map, which does not grow."""
        at = self._middle * 2**self._halved
        return np.array([*(map_ @ [*at, 1.0] - at) / 2**self._halved, np.arctan2(map_[1, 0], map_[0, 0]), 0.0])


def _similarity(pose: FloatArray) -> FloatArray:
    """The matrix (2, 2) of a turn and a growth."""
    c, s = (1.0 + pose[3]) * np.cos(pose[2]), (1.0 + pose[3]) * np.sin(pose[2])
    return np.array([[c, -s], [s, c]])


def _scatter(off: FloatArray) -> float:
    """Standard deviation of grey levels that differ by `off`, but for what lies far off."""
    return max(NOISE, float(np.median(np.abs(off))) / NORMAL)


def _cost(off: FloatArray) -> FloatArray:
    """Of differences in standard deviations: what lies far off is something else, and costs no more."""
    return off**2 / (1.0 + off**2 / 9.0)


def at_scale(moved: FloatArray, scale: float) -> FloatArray:
    """A map (2, 3) between pictures as one between those of the film, which they show smaller by `scale`; places are pixel centres."""
    corner = np.full(2, 0.5 * scale - 0.5)
    return np.column_stack([moved[:, :2], (moved[:, :2] @ corner + moved[:, 2] - corner) / scale])
