"""A camera that drifts or breathes: pictures are brought back to the first one by the corners of the still wall."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.body.wall import window_around

LEAST_QUALITY = 0.03  # of the strongest corner
# A camera that moves is seen all over the picture; what moves before it is in one place, and may have most corners (an arm before a
# white wall): of each of so many parts of the width and of the height the strongest corner counts.
PARTS = 8
AROUND = 4.0  # half widths about the hinted line: corners there are the body's
LEAST_CORNERS = 16
STILL_SHARE = 0.4  # of the corners: with fewer that agree, what moves may be something else, and the last view is kept
RENEWED_SHARE = 0.7  # with fewer new ones are taken: compression wears them
AGREE_PX = 1.0
CLEARLY = 2.0  # times as many corners agree on a move as are where they were in the first picture
# Where the view moved most, in pictures in which the body is 24 px wide. From then on pictures are turned back; earlier it would be
# noise, which harms. Of 34 films that is so in the two whose camera is in a hand, and in none of the others.
LEAST_PX = 2.5
# Light that drifts by a few grey levels pulls corners along faint lines, by a whole ruling at once: what counts is the difference from
# the mean over so many px, twice the flow's window.
LEVELLED_PX = 31


class StillView:
    """Sees by how much the view of a wall has moved, turned and grown since the first picture, and takes it back.

    Parameters
    ----------
    line : (n, 2) px in the pictures, from the clamp to the tip in the first frame
    half : px, half the width of the body
    """

    def __init__(self, line: FloatArray, half: float) -> None:
        self._line, self._half = line, half
        self._seen: NDArray[np.uint8] | None = None  # the picture in which the corners were taken,
        self._there = self._first = np.empty((0, 1, 2), dtype=np.float32)  # where they are in it, and in the first one
        self._drifts = False
        self.moved = np.eye(2, 3)  # from a place in the first picture to that in the last one
        self.seen, self.stderr = True, np.zeros(3)  # a camera whose wall is not seen is taken to stay

    def __call__(self, picture: NDArray[np.uint8], places: FloatArray | None = None, reach: float = np.inf) -> NDArray[np.uint8]:
        """The picture (h, w, 3) as it would be, had the camera stayed; nothing of it farther than `reach` px from `places` (n, 2)."""
        if self._seen is not None and len(self._first) < LEAST_CORNERS:
            return picture
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        grey = np.asarray(cv2.addWeighted(grey, 1.0, cv2.blur(grey, (LEVELLED_PX, LEVELLED_PX)), -1.0, 128.0), dtype=np.uint8)
        if self._seen is None:
            self._renew(grey)
            return picture
        self._look(grey)
        frame = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * grey.shape[::-1]
        self._drifts |= bool(np.abs(frame @ self.moved[:, :2].T + self.moved[:, 2] - frame).max() > LEAST_PX)
        if not self._drifts:
            return picture
        return turned_back(picture, self.moved, places, reach)

    def view(self, scale: float) -> FloatArray:
        """Similarity (2, 3) from a place in the film's first picture to that in the last one, of pictures seen smaller by `scale`."""
        if not self._drifts:
            return np.eye(2, 3)
        return at_scale(self.moved, scale)

    def _renew(self, grey: NDArray[np.uint8]) -> None:
        """Take new corners from a picture whose view is known."""
        wall = np.full(grey.shape, 255, dtype=np.uint8)
        cv2.polylines(wall, [np.round(self._line).astype(np.int32)], False, (0,), round(AROUND * self._half))
        found = cv2.goodFeaturesToTrack(grey, 0, LEAST_QUALITY, 0.0, mask=wall)  # the strongest first
        found = np.empty((0, 1, 2), dtype=np.float32) if found is None else found
        parts = (PARTS * found[:, 0] / grey.shape[::-1]).astype(int)
        found = found[np.sort(np.unique(parts, axis=0, return_index=True)[1])]
        if self._seen is None or len(found) >= LEAST_CORNERS:
            self._seen, self._there = grey, found
            self._first = cv2.transform(found, cv2.invertAffineTransform(self.moved)).astype(np.float32) if len(found) else found

    def _look(self, grey: NDArray[np.uint8]) -> None:
        """Find the corners again, and the similarity that most of them agree on."""
        assert self._seen is not None
        guess = cv2.transform(self._first, self.moved).astype(np.float32)
        options = {"winSize": (15, 15), "maxLevel": 2, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
        now, there, _ = cv2.calcOpticalFlowPyrLK(self._seen, grey, self._there, guess, **options)  # pyright: ignore
        kept = there[:, 0] > 0
        if kept.sum() < LEAST_CORNERS:
            return
        moved, agree = cv2.estimateAffinePartial2D(self._first[kept], now[kept], ransacReprojThreshold=AGREE_PX)
        if moved is None or agree.sum() < max(STILL_SHARE * kept.sum(), LEAST_CORNERS):
            return
        # A camera that moves leaves nothing in its place, where a turn that is small there may still fit all that rests, and more.
        stays = np.linalg.norm(now[kept] - self._first[kept], axis=2) < AGREE_PX
        self.moved = np.asarray(moved, dtype=float) if agree.sum() > CLEARLY * stays.sum() else np.eye(2, 3)
        if agree.sum() < RENEWED_SHARE * len(self._first):
            self._renew(grey)


def turned_back(picture: NDArray[np.uint8], moved: FloatArray, places: FloatArray | None, reach: float) -> NDArray[np.uint8]:
    """A picture (h, w, 3) from which a map (2, 3) of the first one's places to its own is taken back, within `reach` px of `places`."""
    window = window_around(picture.shape, np.zeros((1, 2)) if places is None else places, reach)
    corner = np.array([window[1].start, window[0].start])
    moved = np.column_stack([moved[:, :2], moved[:, 2] + moved[:, :2] @ corner])
    turned = np.zeros_like(picture)
    size = turned[window].shape[1::-1]
    back = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    turned[window] = cv2.warpAffine(picture, moved, size, flags=back, borderMode=cv2.BORDER_REPLICATE)
    return turned


def at_scale(moved: FloatArray, scale: float) -> FloatArray:
    """A map (2, 3) between pictures as one between those of the film, which they show smaller by `scale`; places are pixel centres."""
    corner = np.full(2, 0.5 * scale - 0.5)
    return np.column_stack([moved[:, :2], (moved[:, :2] @ corner + moved[:, 2] - corner) / scale])
