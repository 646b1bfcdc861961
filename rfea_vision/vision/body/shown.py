"""How a film's picture is looked at: enlarged where the body is thin, and as it would be had the camera stayed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import scaled
from rfea_vision.vision.body.model import Picture

SOME = 8  # every so many rows are compared first: most pictures differ in these
STEPS = 8  # pictures are enlarged by eighths, and looked at half as large:
EVEN_PX = 2 * STEPS  # then after every so many of their pixels one of the other ends there, too
KERNEL_PX = 3  # around what is enlarged, that its pixels are worked out from
Window = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True)
class Shown:
    """A picture (h, w, 3) of a film in BGR, and by how much it is `enlarged` to be looked at.

    `moved` (2, 3) maps places of the film's first picture to those of this one. Only what is looked at is worked out.
    """

    picture: NDArray[np.uint8]
    enlarged: float = 1.0
    moved: FloatArray = field(default_factory=lambda: np.eye(2, 3))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of all of it, as it is looked at."""
        height, width = self.picture.shape[:2]
        return int(self.enlarged * height), int(self.enlarged * width), 3

    @property
    def whole(self) -> Window:
        """All of it."""
        return slice(0, self.shape[0]), slice(0, self.shape[1])

    def lab(self, window: Window) -> Picture:
        """CIELAB of a window, as it is looked at."""
        return np.asarray(cv2.cvtColor(self.colours(window), cv2.COLOR_BGR2LAB), dtype=np.uint8)

    def colours(self, window: Window) -> NDArray[np.uint8]:
        """The same in BGR."""
        if np.array_equal(self.moved, np.eye(2, 3)):
            return self.picture[window] if self.enlarged == 1.0 else self._resized(window)
        rows, columns = window
        corner = scaled(np.array([columns.start, rows.start]), 1.0 / self.enlarged)
        turns = self.moved[:, :2]
        to_picture = np.column_stack([turns / self.enlarged, turns @ corner + self.moved[:, 2]])
        back = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        size = columns.stop - columns.start, rows.stop - rows.start
        return np.asarray(cv2.warpAffine(self.picture, to_picture, size, flags=back, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)

    def smaller(self, by: int) -> Shown:
        """The same, looked at so much smaller."""
        return replace(self, enlarged=self.enlarged / by)

    def _resized(self, window: Window) -> NDArray[np.uint8]:
        """Window of a picture that is only enlarged: fifteen times as fast as one that is also turned."""
        around, within = [], []
        for part in window:
            first = max(int(part.start / self.enlarged - KERNEL_PX) // EVEN_PX * EVEN_PX, 0)
            around.append(slice(first, int(part.stop / self.enlarged) + 1 + KERNEL_PX))
            off = int(first * self.enlarged)
            within.append(slice(part.start - off, part.stop - off))
        large = cv2.resize(self.picture[tuple(around)], None, fx=self.enlarged, fy=self.enlarged, interpolation=cv2.INTER_CUBIC)
        return np.asarray(large, dtype=np.uint8)[tuple(within)]


def written_twice(picture: NDArray[np.uint8], before: NDArray[np.uint8]) -> bool:
    """Whether a picture is the one before once more."""
    return np.array_equal(picture[::SOME], before[::SOME]) and np.array_equal(picture, before)
