"""Coloured marks on the body: points of the material that their colour finds, also where edges and skin fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along
from rfea_vision.scatter import scatter
from rfea_vision.vision.body.model import MARKED, SHARES, STATIONS, Picture, SeenBody, frame_of, middle
from rfea_vision.vision.body.sampling import EDGE_PX, SEEN
from rfea_vision.vision.body.wall import Wall

LEAST_PX = 12  # of a mark in the picture, or in the film where that is smaller: fewer are noise of a compressed picture's colours
# Of the half width, radius of one of no named colour: smaller ones are the shading of windings and rims of glare; of many one is
# followed. Marks on ten scenes of testing/phone.py have 0.3 and more.
LEAST_RADIUS = 0.25
# Patches of no named colour: more are a pattern, or grain, of which none is told from its neighbours, and each costs time in every
# fit. Fifteen scenes of testing/phone.py and three real arms have 0 to 4, two dithered GIFs 25 and more.
MOST = 16
# Standard deviations of the body's own hue: a patch within comes and goes with the light. Marks on five real arms are 7 and more off;
# patches on seven drawn bodies without marks 0.5 to 4, on an eighth with a hose at its end 11 and 20.
STANDS_OUT = 5.0
LIKE = 0.5  # of the way from the body's colour to the mark's: nearer is the mark
SIZES = (0.5, 1.8)  # area over that of the first frame: less is half covered, more runs into another mark
REACH = 2.0  # half widths around its predicted place; faster than that no skin is recognised either
MARK_SHARE = 0.1  # of its radius, standard error of a mark's middle beside that of an edge: glare and folds take so much
HINTED = 30.0  # of a or b in 8 bits: a mark's colour from the one that is named


@dataclass(frozen=True)
class Mark:
    """Where a mark lies on the body, and what it looks like.

    Attributes
    ----------
    share, across : of the length, and half widths from the centre line
    wide : as wide as the body: a cap, whose colour tells no more of where it is across the body than its edges do
    colour, around : a and b (2,) of the mark, and of the body
    area : px
    """

    share: float
    across: float
    colour: FloatArray
    around: FloatArray
    area: float
    wide: bool


@dataclass(frozen=True)
class SeenMark:
    """A mark in a frame: what it is, the middle (2,) px of its colour, and the standard error of this in px."""

    mark: Mark
    place: FloatArray
    stderr: float


def place_of(mark: Mark, body: SeenBody) -> FloatArray:
    """Pixel (2,) at which the body carries a mark."""
    at = mark.share * (STATIONS - 1)
    low = min(int(at), STATIONS - 2)
    point = body.points[low] + (at - low) * (body.points[low + 1] - body.points[low])
    return point + mark.across * body.half[low] * frame_of(body.points)[1][low]


def place_on(pixel: FloatArray, body: SeenBody) -> tuple[float, float]:
    """Where a pixel (2,) lies on the body: share of its stations, and half widths across from its centre line."""
    near = int(np.argmin(np.linalg.norm(body.points - pixel, axis=1)))
    tangents, normals = frame_of(body.points)
    off = pixel - body.points[near]
    step = float(np.linalg.norm(body.points[min(near + 1, STATIONS - 1)] - body.points[max(near - 1, 0)]))
    step /= min(near + 1, STATIONS - 1) - max(near - 1, 0)
    return (near + float(off @ tangents[near]) / step) / (STATIONS - 1), float(off @ normals[near]) / body.half[near]


def find_marks(picture: Picture, body: SeenBody, hinted: FloatArray | None, enlarged: float = 1.0) -> list[Mark]:
    """Marks of a first frame: patches on the body, within its outline, of another colour than it has.

    Parameters
    ----------
    picture : CIELAB
    body : as fitted
    hinted : (3,) CIELAB of the marks, where they were named; other patches do not count then
    enlarged : how many times, if it was: grain has grown with the picture
    """
    _, normals = frame_of(body.points)
    outline = np.vstack(
        [body.points + body.half[:, None] * normals, (body.points - body.half[:, None] * normals)[::-1]]
    )
    inside = np.zeros(picture.shape[:2], dtype=np.uint8)
    cv2.fillPoly(inside, [np.round(outline).astype(np.int32)], 1)
    hue, there = picture[..., 1:], inside > 0
    seen = hue[there].astype(float)
    own = np.median(seen, axis=0) if len(seen) else np.zeros(2)
    other = np.max(np.abs(seen - own), axis=-1) > MARKED
    if hinted is None and len(seen):
        other &= np.linalg.norm(seen - own, axis=-1) > STANDS_OUT * np.linalg.norm(scatter(seen))
    if hinted is not None:
        other &= np.max(np.abs(seen - hinted[1:]), axis=-1) < HINTED
    inside[there] = other
    count, labels, stats, middles = cv2.connectedComponentsWithStats(inside)
    named = LEAST_PX * enlarged**2
    least = named if hinted is not None else max(named, np.pi * (LEAST_RADIUS * float(middle(body.half))) ** 2)
    marks: dict[tuple[float, float], Mark] = {}  # by their places: what is one mark may be several patches within the outline
    for k in range(1, count):
        left, top, width, height, _ = stats[k]
        window = np.s_[top : top + height, left : left + width]
        colour = np.median(hue[window][labels[window] == k], axis=0)
        # The whole patch counts, also what lies beyond the outline.
        place, area = _middle(hue, own, colour, middles[k], 2.0 * float(body.half.max()))
        if place is None or not least <= area <= (3.0 * float(body.half.max())) ** 2:
            continue
        share, across = place_on(place, body)
        beyond = (share - 1.0) * body.length / body.half[-1]  # half widths: people point at the middle of a mark for the tip.
        if share >= 0.0 and beyond < 1.0 and abs(across) < 1.0:  # what lies beside the body is another thing, or the wall
            marks.setdefault((share, across), Mark(share, across, colour, own, area, area > (2.0 * float(middle(body.half))) ** 2))
    return list(marks.values()) if hinted is not None or len(marks) <= MOST else []


def marks_in(picture: Picture, marks: list[Mark], body: SeenBody, wall: Wall) -> list[SeenMark]:
    """The marks of the first frame that are seen near where the body would carry them."""
    found, reach = [], REACH * float(middle(body.half))
    for mark in marks:
        place, area = _middle(picture[..., 1:], mark.around, mark.colour, place_of(mark, body), reach, wall)
        if place is not None and SIZES[0] < area / mark.area < SIZES[1]:
            found.append(SeenMark(mark, place, EDGE_PX + MARK_SHARE * float(np.sqrt(area / np.pi))))
    return found


def along_line(
    found: Sequence[SeenMark], body: SeenBody, points_mm: FloatArray, px_per_mm: float
) -> dict[float, tuple[float, float]]:
    """Where marks lie along the line of stations `points_mm` (S, 2) on the plane, and the standard error in mm, by their share."""
    lengths = along(points_mm)
    return {
        seen.mark.share: (float(np.interp(place_on(seen.place, body)[0], SHARES, lengths)), seen.stderr / px_per_mm)
        for seen in found
        if seen.mark.share < 1.0
    }


def _middle(
    hue: NDArray[Any], own: FloatArray, colour: FloatArray, at: FloatArray, reach: float, wall: Wall | None = None
) -> tuple[FloatArray | None, float]:
    """Middle (2,) and area of the patch of a colour that is nearest to `at`, within `reach` px; None without any."""
    low = np.maximum(np.floor(at - reach), 0).astype(int)
    high = np.minimum(np.ceil(at + reach) + 1, hue.shape[1::-1]).astype(int)
    if np.any(high <= low):
        return None, 0.0
    window = np.s_[low[1] : high[1], low[0] : high[0]]
    a, b = hue[window].transpose(2, 0, 1).astype(float)
    towards = (colour - own) / float((colour - own) @ (colour - own))
    like = a * towards[0] + b * towards[1] > LIKE + own @ towards
    if wall is not None:  # what hangs on the wall in that colour is no mark
        a, b = (np.abs(wall.colour[window][..., 1 + k] - colour[k]) for k in (0, 1))
        like &= (a >= MARKED) | (b >= MARKED) | (wall.times[window] < SEEN)
    count, _, stats, middles = cv2.connectedComponentsWithStats(like.astype(np.uint8))
    if count < 2:
        return None, 0.0
    left, top, width, height, sizes = stats[1:].T
    # What runs out of the window has no middle in it: a streak of glare follows whatever is expected of it.
    cut = (left == 0) | (top == 0) | (left + width == like.shape[1]) | (top + height == like.shape[0])
    apart = np.linalg.norm(middles[1:] + low - at, axis=1) + np.where(cut | (sizes < LEAST_PX), np.inf, 0.0)
    best = int(np.argmin(apart))
    if not np.isfinite(apart[best]):
        return None, 0.0
    return middles[1 + best] + low, float(sizes[best])
