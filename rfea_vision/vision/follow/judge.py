"""Accept a fitted frame, or say why not."""

from __future__ import annotations

from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.vision.compiled import compiled, lean
from rfea_vision.vision.edges import fitted
from rfea_vision.vision.find.begin import Scene
from rfea_vision.vision.follow.frame import LEAST_CAP_CONTRAST, MOST_BLUR

FloatArray = NDArray[np.float64]

LEAST_USED = 0.45  # share of the edges that must be seen
LONGEST_GAP = 0.2  # of the length, unseen on both sides
WIDTH_OFF = 0.2
LONGEST_END_GAP = 0.06  # the same at the free end: beyond it the curve is only continued
LONGEST_LONE_END = 0.02  # the same seen from one side, or wider or narrower than the tube
LEAST_END_CONTRAST = 0.45  # of the light step at the edges near the free end: less is smeared by motion
RECENT = 9
SETTLED_PX = 1.0  # the last step of a fit that is no longer on its way
FAINT_CAP = 0.1  # of the light step at the edges: there still is an end
SMEARED = 0.5  # of the half width: so far the end went while the shutter was open
LENGTH_JUMP = 0.005  # of the length, against the last frames
LENGTH_OFF = 0.04
GIVEN_LENGTH_OFF = 0.35  # the same against the length that was given
FIRST_LENGTHS_OFF = 0.06  # the same while only a few frames were seen
ROWS, COLUMNS = 11, 8  # of these, one picture row and column each is compared with those of the frame before
LIGHT_ROWS, LIGHT_COLUMNS = 44, 16  # the same to tell how bright the light is


@lean
def _same(picture, other):
    """Whether two pictures are the same wherever they are compared: over all of them first, so that a change is soon met."""
    for first in range(8):
        for i in range(first * ROWS, picture.shape[0], 8 * ROWS):
            for j in range(0, picture.shape[1], COLUMNS):
                if picture[i, j] != other[i, j]:
                    return False
    return True


@compiled
def _gain(picture, first):
    """Median over some of the picture's pixels of their light over that in `first`."""
    ratio = np.empty(first.size)
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            ratio[i * first.shape[1] + j] = (picture[LIGHT_ROWS * i, LIGHT_COLUMNS * j] + 1.0) / first[i, j]
    return np.median(ratio)


class Judge:
    """Compares each fit with what a tube can do; learns the length of this one from its first frames."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.hinge_lengths: list[float] = []
        self.expected_mm = scene.length_mm
        self._last: NDArray[np.uint8] | None = None
        self.recent: list[float] = []
        self._jumped = 0
        self._first: NDArray[np.float64] | None = None
        self._gain = 1.0

    def __call__(self, luma: NDArray[np.uint8], measured: FloatArray) -> str:
        """Empty if good, else a reason: no_tube, edge_lost, blurred, width_off, length_off, tip_hidden, touches_border."""
        numbers: list[float] = measured.tolist()
        height, width = luma.shape
        x, y = numbers[fitted.TIP_X], numbers[fitted.TIP_Y]
        half_px = self.scene.half_mm * self.scene.px_per_mm
        margin = 0.6 * half_px
        if numbers[fitted.LENGTH] > 0 and not (
            margin <= x <= width - 1 - margin and margin <= y <= height - 1 - margin
        ):
            return "touches_border"
        used = numbers[fitted.USED]
        if max(numbers[fitted.BLUR], numbers[fitted.END_BLUR]) > 0.9 * MOST_BLUR * half_px:
            return "blurred"
        if used < LEAST_USED or numbers[fitted.LENGTH] == 0:
            return "no_tube" if used < 0.2 else "edge_lost"
        unseen = numbers[fitted.END_GAP] > LONGEST_END_GAP or numbers[fitted.CAP_CONTRAST] < LEAST_CAP_CONTRAST
        if unseen and numbers[fitted.SMEAR] > SMEARED * half_px and numbers[fitted.CAP_CONTRAST] > FAINT_CAP:
            return "blurred"  # towards the end, where the tube is fastest, it fades; where it is hidden it is gone
        if numbers[fitted.LONGEST_GAP] > LONGEST_GAP or numbers[fitted.END_GAP] > LONGEST_END_GAP:
            return "edge_lost"
        if numbers[fitted.LAST_STEP] > SETTLED_PX:
            return "no_fit"
        strange = numbers[fitted.END_ODD] > 0
        if max(numbers[fitted.END_LONE], strange * numbers[fitted.END_GAP]) > LONGEST_LONE_END:
            # One edge alone draws the end to its side. Of a tube that was seen well before, something hides the end.
            return "width_off" if strange and len(self.recent) < RECENT else "edge_lost"
        if numbers[fitted.CONTRAST] < LEAST_END_CONTRAST:
            return "blurred"
        if abs(numbers[fitted.WIDTH] / (2 * self.scene.half_mm) - 1) > WIDTH_OFF:
            return "width_off"
        if numbers[fitted.CAP_USED] < 0.3 or numbers[fitted.CAP_CONTRAST] < LEAST_CAP_CONTRAST:
            return "tip_hidden"
        if numbers[fitted.ONE_SIDED] > 0.5 and numbers[fitted.INFLATION] > 4.0:
            return "edge_lost"  # one edge is seen, and what is taken for it is not an edge of a tube
        return self._length(numbers)

    def _length(self, numbers: list[float]) -> str:
        """The inextensible side keeps its length: centre line minus half width times the bend."""
        hinge = numbers[fitted.LENGTH] - self.scene.half_mm * self.bend_sign * numbers[fitted.BEND]
        seen = len(self.hinge_lengths)
        limit = LENGTH_OFF if seen >= 5 else FIRST_LENGTHS_OFF if seen else GIVEN_LENGTH_OFF
        if abs(hinge / self.expected_mm - 1) > limit:
            return "length_off"
        if self._jumps(hinge):
            return "length_off"
        if len(self.hinge_lengths) < 200:
            self.hinge_lengths.append(hinge)
            self.expected_mm = median(self.hinge_lengths)
        self.recent = [*self.recent[1 - RECENT :], hinge]
        self._jumped = 0
        return ""

    def _jumps(self, hinge: float) -> bool:
        """A length unlike that of the last frames: something stands before the end; thrice running it is the tube."""
        if len(self.recent) < RECENT or self._jumped >= 3:
            return False
        middle = median(self.recent)
        scatter = 1.4826 * median(abs(value - middle) for value in self.recent)
        limit = max(LENGTH_JUMP * middle, 8.0 * scatter)
        # A tube may stretch by and by; what hides its end makes it shorter.
        jumps = abs(hinge - middle) > limit and not middle < hinge < self.recent[-1] + limit
        self._jumped += jumps
        return jumps

    @property
    def bend_sign(self) -> float:
        """Of the turning towards the actuator's side: walking down, a bend to the camera's left turns clockwise."""
        return -1.0 if self.scene.actuator.bends == "left" else 1.0

    @property
    def hinge_mm(self) -> float:
        """Length of the inextensible side as seen so far; 0 before it is known."""
        return self.expected_mm if len(self.hinge_lengths) >= 5 else 0.0

    def memory(self) -> dict[str, Any]:
        """Everything that the next judgement depends on."""
        plain = {"hinge_lengths": self.hinge_lengths, "expected_mm": self.expected_mm, "gain": self._gain}
        plain |= {"recent": self.recent, "jumped": int(self._jumped)}
        nothing = np.zeros((0, 0), np.uint8)
        return plain | {
            "last": self._last if self._last is not None else nothing,
            "first": self._first if self._first is not None else nothing,
        }

    def recall(self, plain: dict[str, Any], last: NDArray[np.uint8], first: FloatArray) -> None:
        """Go on from what `memory` gave."""
        self.hinge_lengths, self.expected_mm = list(plain["hinge_lengths"]), plain["expected_mm"]
        self._gain = plain["gain"]
        self._last, self._first = last if last.size else None, first if first.size else None
        self.recent, self._jumped = list(plain["recent"]), plain["jumped"]

    def repeated(self, luma: NDArray[np.uint8]) -> bool:
        """Whether a picture is identical to the one seen last."""
        return self._last is not None and bool(_same(luma, self._last))

    def brightening(self, luma: NDArray[np.uint8]) -> float:
        """How much brighter a picture is than the one before: lamps flicker, exposure drifts."""
        self._last = luma
        if self._first is None:
            self._first = luma[::LIGHT_ROWS, ::LIGHT_COLUMNS].astype(np.float64) + 1.0
        # Pixel by pixel, and the middle of all: what moves through the picture is no change of the light.
        gain = min(max(_gain(luma, self._first), 0.05), 20.0)
        ratio, self._gain = gain / self._gain, gain
        return ratio
