"""Accept a fitted frame, or say why not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rfea_vision.vision import follow
from rfea_vision.vision.begin import Scene

FloatArray = NDArray[np.float64]

LEAST_USED = 0.45  # share of the edges that must be seen
LONGEST_GAP = 0.2  # of the length, unseen on both sides
WIDTH_OFF = 0.2
LENGTH_OFF = 0.06


class Judge:
    """Compares each fit with what a tube can do; learns the length of this one from its first frames."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.hinge_lengths: list[float] = []
        self.expected_mm = scene.length_mm
        self._sample: NDArray[np.uint8] | None = None
        self._identical = 0

    def __call__(self, luma: NDArray[np.uint8], numbers: FloatArray) -> str:
        """Empty if good, else a reason of FORMATS: no_tube, occluded, blurred, width_off, length_off, touches_border."""
        height, width = luma.shape
        x, y = numbers[follow.TIP_X], numbers[follow.TIP_Y]
        half_px = self.scene.half_mm * self.scene.px_per_mm
        margin = 0.6 * half_px
        if numbers[follow.LENGTH] > 0 and not (
            margin <= x <= width - 1 - margin and margin <= y <= height - 1 - margin
        ):
            return "touches_border"
        used = numbers[follow.USED]
        if numbers[follow.BLUR] > 0.27 * half_px:
            return "blurred"
        if used < LEAST_USED or numbers[follow.LENGTH] == 0:
            return "no_tube" if used < 0.2 else "occluded"
        if numbers[follow.LONGEST_GAP] > LONGEST_GAP:
            return "occluded"
        if abs(numbers[follow.WIDTH] / (2 * self.scene.half_mm) - 1) > WIDTH_OFF:
            return "width_off"
        if numbers[follow.CAP_USED] < 0.3:
            return "tip_hidden"
        if numbers[follow.LAST_STEP] > 3.0:
            return "no_fit"
        return self._length(numbers)

    def _length(self, numbers: FloatArray) -> str:
        """The inextensible side keeps its length: centre line minus half width times the bend."""
        # Walking down the tube, a bend to the camera's left turns clockwise.
        sign = -1.0 if self.scene.actuator.bends == "left" else 1.0
        hinge = float(numbers[follow.LENGTH] - self.scene.half_mm * sign * numbers[follow.BEND])
        if len(self.hinge_lengths) >= 5:
            expected = self.expected_mm
            if abs(hinge / expected - 1) > LENGTH_OFF:
                return "length_off"
        elif abs(hinge / self.scene.length_mm - 1) > 0.35:
            return "length_off"
        if len(self.hinge_lengths) < 200:
            self.hinge_lengths.append(hinge)
            self.expected_mm = float(np.median(self.hinge_lengths))
        return ""

    def duplicate(self, luma: NDArray[np.uint8], expected_px: float) -> str:
        """A frame identical to the last one although the tube is moving is a copy written by the recorder."""
        sample = np.ascontiguousarray(luma[::7, ::5])
        same = self._sample is not None and np.array_equal(sample, self._sample)
        self._sample = sample
        return "duplicate" if same and expected_px > 0.5 else ""
