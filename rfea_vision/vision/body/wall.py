"""The still wall behind the body: learnt wherever the body is not, and how much of it shows through the body."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.body.model import ACROSS_INSIDE, Picture, SeenBody, middle
from rfea_vision.vision.body.sampling import SEEN, Behind, learn_wall, read_strip
from rfea_vision.vision.body.shown import Shown

AROUND = 1.15, 2.5  # half widths, and px beyond: what may still be the body
RENEWED = 4  # frames after which what shows through is worked out anew
SLOW_PX = 3.0  # of the smaller picture in which it is blurred: by so much it is as good as blurred in the large one
NOTHING = 3000.0  # grey levels squared: a wall without lines, whose noise tells nothing of what shines through


class Wall:
    """Mean colour (h, w, 3) of the wall, how often each pixel was seen (h, w), and what shows through the body.

    `relief` (h, w, 3) is the wall without its slow part, times the share of it that the body lets through: lines, tape
    and cables behind translucent rubber. The share is learnt from the pixels where the body lies before a known wall. Of one that
    is not `still`, nothing is learnt.
    """

    def __init__(self, shape: tuple[int, ...], *, still: bool = True) -> None:
        self._still = still
        self.window = slice(0, shape[0]), slice(0, shape[1])  # rows and columns of pictures that are looked at
        self.colour = np.zeros(shape, dtype=np.float32)
        self.times = np.zeros(shape[:2], dtype=np.int32)
        self.relief = np.zeros(shape, dtype=np.float32)
        self._lines = np.zeros(shape, dtype=np.float32)
        self._together, self._alone, self._frames = 0.0, NOTHING, 0
        self._seen: Picture | None = None  # the picture that was cleared last, and what it is then
        self._clear: Picture = np.empty((0, 0, 3), dtype=np.uint8)

    def behind(self, picture: Picture) -> Behind:
        """A picture and what is known of the wall in it."""
        return Behind(picture, self.colour, self.times, self.relief)

    def look(self, shown: Shown, places: FloatArray, reach: float) -> Picture:
        """CIELAB of a picture, in a window that holds all within `reach` px of `places` (n, 2); nothing elsewhere."""
        self.window = window_around(shown.shape, places, reach)
        lab = np.zeros(shown.shape, dtype=np.uint8)
        lab[self.window] = shown.lab(self.window)
        return lab

    def cleared(self, picture: Picture) -> Picture:
        """The picture without what shows through the body."""
        if self._seen is not picture:
            self._seen = picture
            self._clear = np.zeros_like(picture)
            self._clear[self.window] = cv2.subtract(picture[self.window], self.relief[self.window], dtype=cv2.CV_8U)
        return self._clear

    def learn(self, picture: Picture, body: SeenBody) -> None:
        """Take from a picture what is beside the body, and what shows through it."""
        if not self._still:
            return
        normals = body.normals
        lines, seen = (read_strip(shown, body.points, normals, body.half, ACROSS_INSIDE) for shown in (self._lines, picture))
        lines -= lines.mean(axis=1, keepdims=True)
        self._together = max(self._together + float(np.sum(lines * (seen - seen.mean(axis=1, keepdims=True)))), 0.0)
        self._alone += float(np.sum(lines**2))
        rows, columns = within = self.window
        learn_wall(picture, covered(picture.shape, body), self.colour, self.times, rows.start, rows.stop, columns.start, columns.stop)
        if self._frames % RENEWED == 0:
            known = np.asarray(self.times[within] >= SEEN, dtype=np.uint8)
            slow = slow_part(self.colour[within], known, float(middle(body.half)))
            self._lines[within] = cv2.subtract(self.colour[within], slow, mask=known)
            self.relief[within] = min(self._together / self._alone, 1.0) * self._lines[within]
            self._seen = None
        self._frames += 1


def covered(shape: tuple[int, ...], body: SeenBody, around: float = 0.0) -> NDArray[np.uint8]:
    """1 where (h, w) of a picture of `shape` a body may be, or within `around` px of that, 0 where it is not."""
    mask = np.zeros(shape[:2], dtype=np.uint8)
    tangents, normals = body.tangents, body.normals
    reach = (AROUND[0] * body.half + AROUND[1] + around)[:, None]
    beyond = body.points[-1:] + tangents[-1:] * (body.half[-1] + 3.0 + around)
    outline = np.vstack([body.points + reach * normals, beyond, (body.points - reach * normals)[::-1]])
    return np.asarray(cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 1), dtype=np.uint8)


def window_around(shape: tuple[int, ...], places: FloatArray, reach: float) -> tuple[slice, slice]:
    """Rows and columns of a picture of `shape` that hold all within `reach` px of `places` (n, 2)."""
    size = shape[1::-1]
    left, top = np.clip(places.min(axis=0) - reach, 0, size).astype(int).tolist()
    right, bottom = np.clip(places.max(axis=0) + reach, 0, size).astype(int).tolist()
    return slice(top, bottom), slice(left, right)


def slow_part(colour: NDArray[np.float32], known: NDArray[np.uint8], sigma: float) -> NDArray[np.float32]:
    """What is left of a wall (h, w, 3) by a blur of `sigma` px over where it is `known` (h, w), worked out in a smaller picture."""
    less = max(int(sigma / SLOW_PX), 1)
    size = colour.shape[1::-1]
    small = max(size[0] // less, 1), max(size[1] // less, 1)

    there, share = (
        cv2.GaussianBlur(cv2.resize(part, small, interpolation=cv2.INTER_AREA), (0, 0), sigma / less)
        for part in (cv2.copyTo(colour, known), known.astype(np.float32))
    )
    slow = there / np.maximum(share, 1e-3)[..., None]
    return np.asarray(cv2.resize(slow, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
