"""The still wall behind the body: learnt wherever the body is not, and how much of it shows through the body."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.vision.body.model import ACROSS_INSIDE, STATIONS, Picture, SeenBody, frame_of
from rfea_vision.vision.body.sampling import SEEN, learn_wall, read_strip

AROUND = 1.15, 2.5  # half widths, and px beyond: what may still be the body
RENEWED = 4  # frames after which what shows through is worked out anew
SLOW_PX = 3.0  # of the smaller picture in which it is blurred: by so much it is as good as blurred in the large one
NOTHING = 3000.0  # grey levels squared: a wall without lines, whose noise tells nothing of what shines through


class Wall:
    """Mean colour (h, w, 3) of the wall, how often each pixel was seen (h, w), and what shows through the body.

    `relief` (h, w, 3) is the wall without its slow part, times the share of it that the body lets through: lines, tape
    and cables behind translucent rubber. The share is learnt from the pixels where the body lies before a known wall.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.colour = np.zeros(shape, dtype=np.float32)
        self.times = np.zeros(shape[:2], dtype=np.int32)
        self.relief = np.zeros(shape, dtype=np.float32)
        self._lines = np.zeros(shape, dtype=np.float32)
        self._together, self._alone, self._frames = 0.0, NOTHING, 0
        self._seen: Picture | None = None  # the picture that was cleared last, and what it is then
        self._clear: Picture = np.empty((0, 0, 3), dtype=np.uint8)

    def cleared(self, picture: Picture) -> Picture:
        """The picture without what shows through the body."""
        if self._seen is not picture:
            self._seen = picture
            self._clear = np.asarray(cv2.subtract(picture, self.relief, dtype=cv2.CV_8U), dtype=np.uint8)
        return self._clear

    def learn(self, picture: Picture, body: SeenBody) -> None:
        """Take from a picture what is beside the body, and what shows through it."""
        tangents, normals = frame_of(body.points)
        lines, seen = (np.empty((STATIONS, len(ACROSS_INSIDE), 3)) for _ in range(2))
        read_strip(self._lines, body.points, normals, body.half, ACROSS_INSIDE, lines)
        read_strip(picture, body.points, normals, body.half, ACROSS_INSIDE, seen)
        lines -= lines.mean(axis=1, keepdims=True)
        self._together = max(self._together + float(np.sum(lines * (seen - seen.mean(axis=1, keepdims=True)))), 0.0)
        self._alone += float(np.sum(lines**2))
        mask = np.zeros(picture.shape[:2], dtype=np.uint8)
        reach = (AROUND[0] * body.half + AROUND[1])[:, None]
        beyond = body.points[-1:] + tangents[-1:] * (body.half[-1] + 3.0)
        outline = np.vstack([body.points + reach * normals, beyond, (body.points - reach * normals)[::-1]])
        cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 1)
        learn_wall(picture, mask, self.colour, self.times)
        if self._frames % RENEWED == 0:
            known = (self.times >= SEEN).astype(np.float32)[..., None]
            near, share = slow_part(self.colour * known, known[..., 0], float(np.median(body.half)))
            self._lines = (self.colour - near / np.maximum(share, 1e-3)[..., None]) * known
            self.relief = (min(self._together / self._alone, 1.0) * self._lines).astype(np.float32)
            self._seen = None
        self._frames += 1


def slow_part(
    colour: NDArray[np.float32], known: NDArray[np.float32], sigma: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What of a wall (h, w, 3) and of where it is known (h, w) is left of a blur of `sigma` px, worked out in a smaller picture."""
    less = max(int(sigma / SLOW_PX), 1)
    size = colour.shape[1::-1]
    small = max(size[0] // less, 1), max(size[1] // less, 1)

    def blurred(part: NDArray[np.float32]) -> NDArray[np.float32]:
        slow = cv2.GaussianBlur(cv2.resize(part, small, interpolation=cv2.INTER_AREA), (0, 0), sigma / less)
        return np.asarray(cv2.resize(slow, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)

    return blurred(colour), blurred(known)
