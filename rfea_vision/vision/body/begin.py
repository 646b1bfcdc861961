"""The body in the first frame, from what a person pointed at."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Hints
from rfea_vision.lines import along, evenly, scaled
from rfea_vision.scatter import scatter
from rfea_vision.vision.body.marks import Mark, find_marks, place_of, row_of
from rfea_vision.vision.body.model import (
    CLEAR,
    NORMAL_BASIS,
    STATIONS,
    Picture,
    SeenBody,
    frame_of,
    lab_of,
    middle,
    with_colours,
)
from rfea_vision.vision.body.sampling import read_strip
from rfea_vision.vision.body.shown import STEPS
from rfea_vision.vision.body.ways import Ways
from rfea_vision.vision.curve import basis_matrix, fit_curve
from rfea_vision.vision.find.begin import Scene

HALF_PX = 12.0  # the picture is scaled until the body is twice as wide: windows in px are for such a body
MOST_ENLARGED, MOST_PIXELS = 4.0, 2_000_000  # of such a picture: more takes longer than it brings
FIRST_COEFFICIENTS = 7
SECTION = np.linspace(-2.2, 2.2, 45)  # half widths across the body,
BESIDE = 1.35  # of which what lies beyond this is around it
PIECES = 5  # of the length, whose cross-sections are read apart
NOISE = (2.0, 1.0, 1.0)  # of L, a and b: of a median along a piece, in a compressed picture
ALIKE = (10.0, 5.0, 5.0)  # of L, a and b: scatter of one rubber's colour in one picture
HINTED_ALIKE = (40.0, 15.0, 15.0)  # of a colour that a person names: light changes it more than its hue
# How well a person points, 1 s.d., chosen: at best, in px of the film; and of the half width, for the middle of a wide body is not
# pointed at to the pixel.
POINTED_PX, POINTED_SHARE = 1.0, 0.05
DRAWN_NEAR = 0.5, 2.0  # half widths, and px of the film: so near a line that was drawn the body is
SQUARE = STATIONS // 8  # from the clamp on: of a body that bends far round, the tip may be on the clamp's other side
ALONG_IT = 7  # stations over which the cross-sections of such a line are averaged
ROUTE_PX = 3.0  # half a body's width in the picture in which a way is sought, which is blurred by half of that
ROUTE_FLOOR = 0.02  # cost of a way where surely the body is, over that where it surely is not
ACROSS_SMOOTH = NORMAL_BASIS @ np.linalg.pinv(NORMAL_BASIS)


@dataclass(frozen=True)
class Pointed:
    """What a person pointed at, in px of the pictures that are looked at, `scale` times as large as the film's.

    `clamp` (2, 2) are the edges of the first visible cross-section, `line` (n, 2) leads from its middle to the tip, `half` is half the
    width there, `length` the tube's by the scale. `enlarged` is by how much a picture was made larger before it is looked at, `allowed`
    (h, w) where the body may be, None where everywhere. It leaves its clamp to the side on which its tip is, or is `turned`: it curls.
    """

    clamp: FloatArray
    line: FloatArray
    half: float
    length: float
    scale: float = 1.0
    enlarged: float = 1.0
    hints: Hints = field(default_factory=Hints)
    allowed: NDArray[np.bool_] | None = None
    turned: bool = False

    @property
    def ahead(self) -> FloatArray:
        """Unit vector (2,) in which the body leaves its clamp."""
        towards = leaving(self.clamp, self.line[:2])
        return -towards if self.turned else towards

    @property
    def colour(self) -> FloatArray | None:
        """Of the body (3,) in CIELAB, where a person named it."""
        return None if self.hints.colour is None else lab_of(self.hints.colour)

    @property
    def marks(self) -> FloatArray | None:
        """Colour (3,) of its marks in CIELAB, where a person named it."""
        return None if self.hints.marks is None else lab_of(self.hints.marks)

    @property
    def drawn(self) -> bool:
        """Whether a person has drawn the line: clamp, tip and two points between."""
        return len(self.line) >= 4

    @property
    def tip(self) -> FloatArray:
        """Its end (2,)."""
        return self.line[-1]

    @property
    def stderr(self) -> float:
        """How well a person points at its middle."""
        return float(np.hypot(POINTED_PX * self.scale, POINTED_SHARE * self.half))

    @property
    def near(self) -> float:
        """How near to a line that was drawn the body is, and to a tip that was pointed at."""
        return DRAWN_NEAR[0] * self.half + DRAWN_NEAR[1] * self.scale

    @property
    def covariance(self) -> FloatArray:
        """Of a body (25, 25) px^2 that is somewhere there: it is sought where its picture says."""
        return np.diag([*np.full(11, self.half**2), *np.full(6, 1e-4), *np.full(8, (0.15 * self.half) ** 2)])


def scale_for(scene: Scene, size: tuple[int, int]) -> float:
    """By how much pictures of a size are made smaller, or larger, for a body whose clamp was pointed at."""
    larger = min(MOST_ENLARGED, (MOST_PIXELS / (size[0] * size[1])) ** 0.5)
    scale = min(max(larger, 1.0), HALF_PX / max(scene.pointed()[2], 1.0))
    return scale if scale < 1.0 else int(STEPS * scale) / STEPS


def hinted_lines(picture: Picture, pointed: Pointed) -> list[FloatArray]:
    """Lines of stations (S, 2) px in a picture (CIELAB) that the hints allow: a route, and a curve of the body's length."""
    if pointed.drawn:
        line = smooth_line(pointed.line)
        return [line, on_ridge(picture, line, pointed.half)]
    own = pointed.colour  # without it, that of its ends is taken
    likeness = _likeness(picture, pointed.line, pointed.ahead, pointed.half) if own is None else like_colour(picture, own)
    if pointed.allowed is not None:
        likeness = np.where(pointed.allowed, likeness, 0.0)
    lines = [_route(likeness, pointed.line, pointed.half)]
    if len(pointed.line) == 2:
        lines.append(smooth_line(_bow(pointed.line, pointed.ahead, pointed.length)))
    return lines


def on_ridge(picture: Picture, line: FloatArray, half_px: float) -> FloatArray:
    """A line of stations (S, 2) px moved across itself to where most stands out on both sides: people click beside a thin body.

    Of all ways along the line within 12 px of it the one that is cheapest where what is clear costs little.
    """
    steps = np.arange(-HALF_PX, HALF_PX + 0.5)  # off the line,
    section = np.arange(-HALF_PX - 2.2 * half_px, HALF_PX + 2.2 * half_px + 0.5, 0.5)  # and of what is read around it
    normals = frame_of(line)[1]
    strip = read_strip(picture, line, normals, np.ones(STATIONS), section)
    strip = np.asarray(cv2.blur(strip, (1, ALONG_IT), borderType=cv2.BORDER_REPLICATE), dtype=float)
    clear = np.zeros((STATIONS, len(steps)))
    for k, step in enumerate(steps):
        off = (section - step) / half_px
        inside, left, right = (
            strip[:, (off > low) & (off < high)].mean(axis=1) for low, high in ((-0.6, 0.6), (-2.2, -1.3), (1.3, 2.2))
        )
        one, other = (inside - left) / NOISE, (inside - right) / NOISE
        clear[:, k] = np.max(np.where(one * other > 0, np.minimum(np.abs(one), np.abs(other)), 0.0), axis=1)
    clear = np.minimum(clear / max(float(np.median(clear.max(axis=1))), 1e-6), 1.0)
    ways = Ways(1.0 / (clear + ROUTE_FLOOR), [(0, k) for k in range(len(steps))])
    stations, taken = ways.to((STATIONS - 1, int(np.argmin(ways.total[-1])))).T
    off = ACROSS_SMOOTH @ np.interp(np.arange(STATIONS), stations, steps[taken])
    return line + off[:, None] * normals


def through_rungs(
    picture: Picture, lines: list[FloatArray], half_px: float, hinted: FloatArray | None
) -> tuple[FloatArray, list[Mark]] | None:
    """Stations (S, 2) px through the discs of an arm, and these as its marks: between them is wall, which leads outlines astray.

    They are sought along `lines` of stations; `hinted` is the colour (3,) of marks in CIELAB, if it was named. None where no line
    has a row of them.
    """
    bodies = [first_body(picture, line, half_px) for line in lines]
    body, row = max(((body, row_of(find_marks(picture, body, hinted))) for body in bodies), key=lambda found: len(found[1]))
    if not row:
        return None
    line, places = body.points, np.array([place_of(rung, body) for rung in row])
    apart = float(np.linalg.norm(places[-1] - places[-2]))
    ahead = (places[-1] - places[-2]) / apart
    left = float((line[-1] - places[-1]) @ ahead)
    end = places[-1] + max(left, 0.0) * ahead if left < apart else line[-1]  # nobody clicks on the middle of the last disc
    first = int(np.linalg.norm(places[0] - line[0]) < half_px)
    line = even(smooth_line(np.vstack([line[:1], places[first:], end])))
    return line, row_of(find_marks(picture, first_body(picture, line, half_px), hinted))


def leaving(clamp_px: FloatArray, line_px: FloatArray) -> FloatArray:
    """Unit vector (2,) square to a clamp's edges (2, 2), to the side on which the line (n, 2) ends."""
    across = clamp_px[1] - clamp_px[0]
    inwards = np.array([-across[1], across[0]]) / max(float(np.linalg.norm(across)), 1e-9)
    return inwards if inwards @ (line_px[-1] - line_px[0]) >= 0 else -inwards


def _bow(line_px: FloatArray, inwards: FloatArray, length_px: float) -> FloatArray:
    """The parabola that leaves the clamp squarely and reaches the tip, as nearly of the body's length as there is one."""
    t = np.linspace(0, 1, 60)[:, None]
    chord = float(np.linalg.norm(line_px[1] - line_px[0]))
    curves = [
        (1 - t) ** 2 * line_px[0] + 2 * t * (1 - t) * (line_px[0] + reach * chord * inwards) + t**2 * line_px[1]
        for reach in np.linspace(0.2, 2.0, 19)
    ]
    return curves[int(np.argmin(np.abs(along(curves)[:, -1] - length_px)))]


def like_colour(colours: NDArray[Any], hinted: FloatArray) -> FloatArray:
    """How much colours (..., 3) are like the one that a person named, 0 to 1; all in CIELAB."""
    return np.exp(-0.5 * np.sum(((colours - hinted) / np.array(HINTED_ALIKE)) ** 2, axis=-1))


def _likeness(picture: Picture, line_px: FloatArray, inwards: FloatArray, half_px: float) -> FloatArray:
    """How much every pixel (h, w) looks like the body's ends."""
    back = line_px[-2] - line_px[-1]
    back = back / np.linalg.norm(back)
    seeds = [line_px[0] + k * half_px * inwards for k in (0.7, 1.2)]
    seeds += [line_px[-1] + k * half_px * back for k in (0.6, 1.0)]
    planes = [channel / np.float32(spread) for channel, spread in zip(cv2.split(picture), ALIKE, strict=True)]
    apart = np.full(picture.shape[:2], np.inf, dtype=np.float32)
    for seed in [*seeds, *line_px[1:-1]]:
        disc = np.zeros(picture.shape[:2], dtype=np.uint8)
        cv2.circle(disc, (round(seed[0]), round(seed[1])), max(round(0.5 * half_px), 1), 1, -1)
        colours = picture[disc > 0]
        if len(colours):
            own = (np.median(colours, axis=0) / ALIKE).astype(np.float32)
            apart = np.minimum(apart, sum((plane - there) ** 2 for plane, there in zip(planes, own, strict=True)))
    return np.exp(-0.5 * apart)


def _route(likeness: FloatArray, line_px: FloatArray, half_px: float) -> FloatArray:
    """From hint to hint by way of pixels that look like the body."""
    less = max(int(half_px / ROUTE_PX), 1)
    size = np.array(likeness.shape[::-1]) // less
    small = cv2.resize(likeness, size.tolist(), interpolation=cv2.INTER_AREA)
    likeness = np.asarray(cv2.GaussianBlur(small, (0, 0), max(0.5 * half_px / less, 0.5)), dtype=np.float64)
    cost = 1.0 / (likeness / max(float(likeness.max()), 1e-6) + ROUTE_FLOOR)
    route: list[FloatArray] = []
    for start, end in pairwise(scaled(line_px, 1.0 / less)):
        a, b = (np.clip(np.round(p), 0, size - 1).astype(int) for p in (start, end))
        steps = Ways(cost, [(a[1], a[0])]).to((b[1], b[0]))
        route.append(scaled(np.asarray(steps[:, ::-1], dtype=np.float64), less))
    return smooth_way(np.vstack([line_px[:1], *route, line_px[-1:]]))


def smooth_way(points: FloatArray) -> FloatArray:
    """A smooth line of stations along the pixels (n, 2) of a way; of many some sixty are enough."""
    return smooth_line(points[:: max(len(points) // 60, 1)] if len(points) > 120 else points)


def smooth_line(points: FloatArray) -> FloatArray:
    """A smooth line of stations through points, with its ends where theirs are."""
    coefficients = fit_curve(points, min(FIRST_COEFFICIENTS, 4 + len(points) // 2))
    share = np.linspace(0, 1, STATIONS)
    line = basis_matrix(share, len(coefficients)) @ coefficients
    first, last = points[[0, -1]] - line[[0, -1]]
    moved: FloatArray = (1 - share)[:, None] * first + share[:, None] * last
    return line + moved


def onwards(line: FloatArray, clamp: FloatArray) -> FloatArray | None:
    """Stations (S, 2) on a line (n, 2) from the clamp's middle (2,) on: a mask may reach back into it. None where nothing is left."""
    near = int(np.argmin(np.linalg.norm(line - clamp, axis=1)))
    return even(smooth_line(np.vstack([clamp, line[near + 1 :]]))) if near < len(line) - 2 else None


def even(points: FloatArray) -> FloatArray:
    """The same line with its stations at even distances."""
    return evenly(points, STATIONS)


def standing_out(picture: Picture, body: SeenBody, half_px: float) -> float:
    """Share of the body that stands out from what is around it: its colour, rims, or light on it.

    Its cross-section is read in pieces of the length, each by the median along it, so that weak contrast counts and lines
    that cross it do not. What is measured against is the scatter around the body.
    """
    strip = read_strip(picture, body.points, body.normals, np.full(STATIONS, half_px), SECTION)
    profile = middle(strip.reshape(PIECES, -1, *strip.shape[1:]).transpose(0, 2, 3, 1))
    around = profile[:, np.abs(SECTION) > BESIDE]
    own = np.median(around, axis=1, keepdims=True)
    around_it = scatter(np.swapaxes(around, 0, 1))[:, None] + np.array(NOISE)
    clear = np.max(np.abs(profile - own) / around_it, axis=2) > CLEAR
    return float(np.mean(clear[:, np.abs(SECTION) < 1.0]))


def first_body(picture: Picture, line: FloatArray, half_px: float | FloatArray) -> SeenBody:
    """A body on a line of stations, with the colours that it has there."""
    body = SeenBody(line, np.full(STATIONS, half_px), np.zeros((STATIONS, 2, 3)), np.zeros((STATIONS, 2, 2, 3)))
    return with_colours(picture, body)
