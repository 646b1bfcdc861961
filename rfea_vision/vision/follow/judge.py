"""Accept a fitted frame, or say why not."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfea_vision.scatter import NORMAL
from rfea_vision.vision.compiled import compiled, lean
from rfea_vision.vision.edges.fitted import FrameFit, Shot
from rfea_vision.vision.find.begin import Scene
from rfea_vision.vision.follow.frame import LEAST_CAP_CONTRAST, MOST_BLUR

RECENT = 9
SETTLED_PX = 1.0  # the last step of a fit that is no longer on its way
LENGTH_JUMP = 0.005  # of the length, against the last frames
LENGTH_OFF = 0.04
GIVEN_LENGTH_OFF = 0.35  # the same against the length that was given
ROWS, COLUMNS = 11, 8  # of these, one picture row and column each is compared with those of the frame before
LIGHT_PLACES = 20  # rows, and columns, whose pixels tell how bright the light is


@lean
def _same(shot, other):
    """Whether two pictures are the same wherever they are compared: over all of them first, so that a change is soon met."""
    for first in range(8):
        for i in range(first * ROWS, shot.rows.shape[0], 8 * ROWS):
            for j in range(0, shot.width, COLUMNS):
                if shot.rows[i, j] != other.rows[i, j]:
                    return False
    return True


@compiled
def _gain(picture, first):
    """Median over pixels of their light over that in `first`."""
    ratio = np.empty(first.shape)
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            ratio[i, j] = (picture[i, j] + 1.0) / first[i, j]
    return np.median(ratio)


class Tube(NamedTuple):
    """What a fit is held against: the tube's half width, the picture's size, and whether it was seen well before."""

    half_px: float
    half_mm: float
    picture_px: tuple[int, int]  # width and height
    well_seen: bool


class EdgeRule(NamedTuple):
    """Refuses a fitted frame for `reason` where `broken`; `limit` says in words what it is held to."""

    reason: str
    broken: Callable[[FrameFit, Tube], bool]
    limit: str


def _outside(fit: FrameFit, tube: Tube) -> bool:
    margin = 0.6 * tube.half_px
    width, height = tube.picture_px
    return not (margin <= fit.tip_x <= width - 1 - margin and margin <= fit.tip_y <= height - 1 - margin)


def _end_unseen(fit: FrameFit) -> bool:
    return fit.end_gap > 0.06 or fit.cap_contrast < LEAST_CAP_CONTRAST


def _end_strange(fit: FrameFit) -> bool:
    """One edge alone draws the end to its side."""
    return max(fit.end_lone, fit.end_gap if fit.end_odd > 0 else 0.0) > 0.02


# The first rule that is broken gives the reason. Their order and their limits were set on rendered films of known truth:
# blur and smear on tests/measurement/test_doubts.py, what covers or resembles the tube on test_stress.py and test_unlike.py.
RULES = (
    EdgeRule(
        "touches_border", lambda f, t: f.length > 0 and _outside(f, t), "the tip, 0.6 half widths from the border"
    ),
    EdgeRule(
        "blurred",
        lambda f, t: max(f.blur, f.end_blur) > 0.9 * MOST_BLUR * t.half_px,
        "the widest blur that can be fitted",
    ),
    EdgeRule("no_tube", lambda f, t: f.used < 0.2, "20 % of the edges are seen"),
    EdgeRule("edge_lost", lambda f, t: f.used < 0.45 or f.length == 0, "45 % of the edges are seen"),
    # Towards the end, where the tube is fastest, it fades; where it is hidden it is gone.
    EdgeRule(
        "blurred",
        lambda f, t: _end_unseen(f) and f.smear > 0.5 * t.half_px and f.cap_contrast > 0.1,
        "the end goes half a half width while the shutter is open",
    ),
    EdgeRule("edge_lost", lambda f, t: f.longest_gap > 0.2, "20 % of the length unseen on both sides"),
    EdgeRule(
        "edge_lost",
        lambda f, t: f.end_gap > 0.06,
        "6 % of the length at the free end: beyond it the curve is only continued",
    ),
    EdgeRule("no_fit", lambda f, t: f.last_step > SETTLED_PX, "the last step of the fit, 1 px"),
    EdgeRule(
        "width_off",
        lambda f, t: _end_strange(f) and f.end_odd > 0 and not t.well_seen,
        "2 % of the length at the end wider or narrower than the tube",
    ),
    EdgeRule("edge_lost", lambda f, t: _end_strange(f), "2 % of the length at the end seen from one side"),
    EdgeRule("width_off", lambda f, t: abs(f.width / (2 * t.half_mm) - 1) > 0.2, "20 % of actuator.outer_radius"),
    EdgeRule(
        "tip_hidden",
        lambda f, t: f.cap_used < 0.3 or f.cap_contrast < LEAST_CAP_CONTRAST,
        "30 % of the end's edge is seen",
    ),
)


class Judge:
    """Compares each fit with what a tube can do; learns the length of this one from its first frames."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.hinge_lengths: list[float] = []
        self.expected_mm = scene.length_mm
        self._last: Shot | None = None
        self.recent: list[float] = []
        self._jumped = 0
        self._first: NDArray[np.float64] | None = None
        self._gain = 1.0

    def __call__(self, shot: Shot, measured: np.void) -> str:
        """Empty if good, else the reason of the first rule that is broken, or length_off."""
        fit = FrameFit(*measured.tolist())
        half_px = self.scene.half_mm * self.scene.px_per_mm
        tube = Tube(half_px, self.scene.half_mm, (shot.width, shot.rows.shape[0]), len(self.recent) >= RECENT)
        reason = next((rule.reason for rule in RULES if rule.broken(fit, tube)), "")
        return reason or self._length(fit)

    def _length(self, fit: FrameFit) -> str:
        """The inextensible side keeps its length, centre line minus half width times the bend; of a beam the centre line does."""
        hinge = fit.length - self.scene.hinge_mm * self.scene.turn_sign * fit.bend
        limit = LENGTH_OFF if self.hinge_lengths else GIVEN_LENGTH_OFF
        if abs(hinge / self.expected_mm - 1) > limit or self._jumps(hinge):
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
        scatter = median(abs(value - middle) for value in self.recent) / NORMAL
        limit = max(LENGTH_JUMP * middle, 8.0 * scatter)
        # A tube may stretch by and by; what hides its end makes it shorter.
        jumps = abs(hinge - middle) > limit and not middle < hinge < self.recent[-1] + limit
        self._jumped += jumps
        return jumps

    def repeated(self, shot: Shot) -> bool:
        """Whether a picture is identical to the one seen last."""
        return self._last is not None and bool(_same(shot, self._last))

    def brightening(self, shot: Shot) -> float:
        """How much brighter a picture is than the one before: lamps flicker, exposure drifts."""
        self._last = shot
        down, right = max(shot.rows.shape[0] // LIGHT_PLACES, 1), max(shot.width // LIGHT_PLACES, 1)
        seen = shot.rows[::down, : shot.width : right]
        if self._first is None:
            self._first = seen.astype(np.float64) + 1.0
        # Pixel by pixel, and the middle of all: what moves through the picture is no change of the light.
        gain = min(max(_gain(seen, self._first), 0.05), 20.0)
        ratio, self._gain = gain / self._gain, gain
        return ratio
