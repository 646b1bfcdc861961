"""A camera that is bumped and stays where it then is: seen at the clamp, which does not move."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.scatter import scatter

LEAST_PX, LEAST_MM = 0.5, 0.15  # less than either is no bump: a clamp may give way a little
UNLIKELY = 6.0  # times the scatter of the clamp's place in the first frames
AGREEING = 3  # looks running that must find the clamp at one new place
ENOUGH = 30  # looks of which the place is the median; and frames in which the shape of the tube's end is learned fast
NOW_AND_THEN = 48  # frames between looks at a clamp from which the tube still comes; a look costs as much as two frames
FARTHEST_MM = 12.0


class CameraWatch:
    """Where the clamp is now, in the plane of motion as the camera saw it at first.

    Parameters
    ----------
    places : (n, 2) mm, the clamp in the first frames
    px_per_mm : scale of the picture
    """

    def __init__(self, places: FloatArray, px_per_mm: float) -> None:
        self.first = np.median(places, axis=0)
        self.now = self.first.copy()
        self.limit_mm = max(LEAST_PX / px_per_mm, LEAST_MM, UNLIKELY * float(scatter(places).max()))
        self._pending: list[FloatArray] = []
        self._seen: list[FloatArray] = []  # since it moved

    @property
    def moved_mm(self) -> FloatArray:
        """By how much everything seems to have moved (2,)."""
        return self.now - self.first

    def due(self, start_mm: FloatArray, axis: FloatArray, frame: int) -> bool:
        """Whether to look at the clamp in this frame, in which the tube begins at `start_mm`, along `axis`."""
        off = start_mm - self.now
        across = abs(float(off[0] * axis[1] - off[1] * axis[0]))
        unsure = bool(self._pending) or 0 < len(self._seen) < ENOUGH
        return across > self.limit_mm or unsure or frame % NOW_AND_THEN == 0

    def see(self, place: FloatArray | None) -> bool:
        """Take in where the clamp was found, or that it was not; whether `now` has changed."""
        if place is None or float(np.linalg.norm(place - self.first)) > FARTHEST_MM:
            self._pending.clear()
            return False
        if float(np.linalg.norm(place - self.now)) <= self.limit_mm:
            self._pending.clear()
            if not 0 < len(self._seen) < ENOUGH:
                return False
            self._seen.append(place)
        else:
            self._pending.append(place)
            latest = np.array(self._pending[-AGREEING:])
            if len(latest) < AGREEING or float(np.ptp(latest, axis=0).max()) > self.limit_mm:
                return False
            self._seen, self._pending = [*latest], []
        self.now = np.median(self._seen, axis=0)
        return True
