"""Coloured marks on the body: points of the material that their colour finds, also where edges and skin fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along
from rfea_vision.scatter import scatter
from rfea_vision.vision.body.model import MARKED, SHARES, STATIONS, Picture, SeenBody, middle
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
# Area over that of the first frame: less is half covered, more runs into another mark; a thin disc is blurred by its way, and fades.
SIZES = (0.3, 2.5)
REACH = 3.0  # half widths around its predicted place: flow may slip by a disc of an arm
# Between two marks, 1 s.d., chosen: rad by which a predicted line may be turned, share by which it may stretch from frame to frame; and
# standard deviations that a mark which is not seen costs. In a row of discs the next one is off by all of their distance.
TURNED, STRETCHED, UNSEEN = 0.2, 0.1, 3.0
# px^-2: of patches that may be a mark without neighbours the nearest is. And how much their distance from the next one tells of that
# of neighbours, chosen: a body may bend between.
FAR, FARTHER = 1e-4, 0.1
NEIGHBOURING = 4.0  # half widths, chosen: marks no farther from one another tell where all between them is
ENDING = 1.5  # half widths, chosen: from a mark no farther from the end on the line is straight
# A row of rungs, chosen: how many at least, over how much of the length, and by how much of it distances may differ.
LEAST_RUNGS, ROW_LENGTH, EVENLY = 5, 0.6, 0.3
SPANS = 1.4, 3.0  # half widths: how long a patch is that goes from edge to edge
# Half widths: nearer to one another are the windings of a thread, of which no prediction tells one from the next (0.64 in one drawn
# film; discs and bands of 34 others 0.90 and more, all seen).
MARKS_APART = 0.75
SAME = 0.5  # of a mark's radius: patches nearer than that are one mark
MARK_SHARE = 0.1  # of its radius, standard error of a mark's middle beside that of an edge: glare and folds take so much
HINTED = 30.0  # of a or b in 8 bits: a mark's colour from the one that is named


class Patch(NamedTuple):
    """A patch of a colour: its middle (2,) and area in px, and how far it goes across, px."""

    place: FloatArray
    area: float
    across: float


@dataclass(frozen=True)
class Mark:
    """Where a mark lies on the body, and what it looks like.

    Attributes
    ----------
    share, across : of the length, and half widths from the centre line
    wide : as wide as the body: a cap, whose colour tells no more of where it is across the body than its edges do
    spans : from edge to edge, as discs and bands do
    colour, around : a and b (2,) of the mark, and of the body
    area : px
    """

    share: float
    across: float
    colour: FloatArray
    around: FloatArray
    area: float
    wide: bool
    spans: bool


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
    return point + mark.across * body.half[low] * body.normals[low]


def place_on(pixel: FloatArray, body: SeenBody) -> tuple[float, float]:
    """Where a pixel (2,) lies on the body: share of its stations, and half widths across from its centre line."""
    near = int(np.argmin(np.linalg.norm(body.points - pixel, axis=1)))
    tangents, normals = body.tangents, body.normals
    off = pixel - body.points[near]
    step = float(np.linalg.norm(body.points[min(near + 1, STATIONS - 1)] - body.points[max(near - 1, 0)]))
    step /= min(near + 1, STATIONS - 1) - max(near - 1, 0)
    return (near + float(off @ tangents[near]) / step) / (STATIONS - 1), float(off @ normals[near]) / body.half[near]


def pointed_tip(place: FloatArray, stderr: float) -> SeenMark:
    """The body's end where a person points at it (2,) px, as a mark of the material; across it, its edges tell more."""
    none = np.zeros(2)
    return SeenMark(Mark(1.0, 0.0, none, none, 0.0, wide=True, spans=False), place, stderr)


def find_marks(picture: Picture, body: SeenBody, hinted: FloatArray | None, enlarged: float = 1.0) -> list[Mark]:
    """Marks of a first frame: a row of rungs, or else patches on the body, within its outline, of another colour than it has.

    Parameters
    ----------
    picture : CIELAB
    body : as fitted
    hinted : (3,) CIELAB of the marks, where they were named; other patches do not count then
    enlarged : how many times, if it was: grain has grown with the picture
    """
    normals = body.normals
    outline = np.vstack([body.points + body.half[:, None] * normals, (body.points - body.half[:, None] * normals)[::-1]])
    inside = np.zeros(picture.shape[:2], dtype=np.uint8)
    cv2.fillPoly(inside, [np.round(outline).astype(np.int32)], 1)
    seen = picture[..., 1:][inside > 0].astype(float)
    if len(seen) == 0:
        return []
    own, named = np.median(seen, axis=0), LEAST_PX * enlarged**2
    off = np.max(np.abs(seen - own), axis=-1)
    if hinted is not None:
        return _patches_on(picture, body, own, inside, (off > MARKED) & (np.max(np.abs(seen - hinted[1:]), axis=-1) < HINTED), named)
    least = max(named, np.pi * (LEAST_RADIUS * float(middle(body.half))) ** 2)
    # The discs of an arm are as frequent as what is between them: no scatter tells them.
    if rungs := row_of(_patches_on(picture, body, own, inside, off > MARKED, least)):
        return [] if _are_windings(rungs, body) else rungs
    clear = np.linalg.norm(seen - own, axis=-1) > STANDS_OUT * np.linalg.norm(scatter(seen))
    marks = _patches_on(picture, body, own, inside, clear & (off > MARKED), least)
    return marks if len(marks) <= MOST and not _are_windings(marks, body) else []


def _are_windings(marks: Sequence[Mark], body: SeenBody) -> bool:
    """Whether marks lie so near to their neighbours that no prediction tells one from the next."""
    apart = np.diff(sorted(mark.share for mark in marks)) * body.length
    return len(marks) >= LEAST_RUNGS and bool(np.median(apart) < MARKS_APART * float(middle(body.half)))


def row_of(marks: Sequence[Mark]) -> list[Mark]:
    """Those that are rungs, as an arm's discs are, from its clamp on: alike, from edge to edge, evenly apart along most of the body.

    Empty where there is no such row; one here and there may be missing.
    """
    spanning = [mark for mark in marks if mark.spans]
    area = median([mark.area for mark in spanning] or [0.0])
    rungs = sorted((mark for mark in spanning if SIZES[0] < mark.area / area < SIZES[1]), key=lambda mark: mark.share)
    if len(rungs) < LEAST_RUNGS:
        return []
    apart = np.diff([rung.share for rung in rungs])
    steps = apart / np.median(apart)
    evenly = np.all((steps > 1.0 - EVENLY) & (np.abs(steps - np.round(steps)) < EVENLY))
    return rungs if evenly and apart.sum() > ROW_LENGTH else []


def _patches_on(
    picture: Picture, body: SeenBody, own: FloatArray, inside: NDArray[np.uint8], other: NDArray[np.bool_], least: float
) -> list[Mark]:
    """Patches of `least` px and more among the pixels `inside` (h, w) a body that are of an `other` colour than its `own`."""
    hue, there, marks = picture[..., 1:], inside.copy(), list[Mark]()
    there[inside > 0] = other
    count, labels, stats, middles = cv2.connectedComponentsWithStats(there)
    half = float(middle(body.half))
    for k in range(1, count):
        left, top, width, height, _ = stats[k]
        window = np.s_[top : top + height, left : left + width]
        colour = np.median(hue[window][labels[window] == k], axis=0)
        if np.abs(colour - own).max() <= MARKED:  # of two colours, to either side of its own
            continue
        # The whole patch counts, also what lies beyond the outline.
        patch = next(iter(_patches(hue, own, colour, middles[k], 2.0 * float(body.half.max()))), None)
        if patch is None or not least <= patch.area <= (3.0 * float(body.half.max())) ** 2:
            continue
        share, across = place_on(patch.place, body)
        beyond = (share - 1.0) * body.length / body.half[-1]  # half widths: people point at the middle of a mark for the tip.
        if share < 0.0 or beyond >= 1.0 or abs(across) >= 1.0:  # what lies beside the body is another thing, or the wall
            continue
        # What is one mark may be several patches within the outline.
        if all(np.linalg.norm(patch.place - place_of(mark, body)) > SAME * np.sqrt(patch.area / np.pi) for mark in marks):
            wide, spans = patch.area > (2.0 * half) ** 2, SPANS[0] * half < patch.across < SPANS[1] * half
            marks.append(Mark(share, across, colour, own, patch.area, wide, spans))
    return marks


def put_on(found: Sequence[SeenMark], body: SeenBody) -> list[Mark]:
    """The marks that are seen, where they lie on a body that was fitted since they were found."""
    return [replace(seen.mark, share=share, across=across) for seen in found for share, across in [place_on(seen.place, body)]]


def marks_in(picture: Picture, marks: list[Mark], body: SeenBody, last: SeenBody, wall: Wall) -> list[SeenMark]:
    """The marks of the first frame that are seen near where a predicted body carries them: neighbours as far apart as on the `last`."""
    half, marks = float(middle(body.half)), sorted(marks, key=lambda mark: mark.share)
    numbers, places, found = [0], [body.points[0]], list[SeenMark]()
    for number, mark in enumerate(marks, 1):
        for patch in _patches(picture[..., 1:], mark.around, mark.colour, place_of(mark, body), REACH * half, wall):
            if SIZES[0] < patch.area / mark.area < SIZES[1]:
                found.append(SeenMark(mark, patch.place, EDGE_PX + MARK_SHARE * float(np.sqrt(patch.area / np.pi))))
                numbers, places = [*numbers, number], [*places, patch.place]
    expected, known = (np.array([on.points[0], *(place_of(mark, on) for mark in marks)])[numbers] for on in (body, last))
    lengths = body.length / half * np.array([0.0, *(mark.share for mark in marks)])[numbers]
    return [found[k - 1] for k in _row(np.array(numbers), np.array(places), expected, known, lengths)]


def _row(numbers: NDArray[np.int64], places: FloatArray, expected: FloatArray, known: FloatArray, lengths: FloatArray) -> list[int]:
    """Which of the `places` (n, 2) px are those of the marks of these `numbers` (n,): one each at most, in their order along the body.

    The first place is the clamp's, number 0. A mark is as far from its neighbour as was `known` (n, 2), and about in the direction that
    was `expected` (n, 2); one without, by `lengths` (n,) in half widths, is where it was expected. Dynamic programming.
    """
    best, before = np.zeros(len(places)), np.zeros(len(places), dtype=int)
    for k in range(1, len(places)):
        earlier = np.flatnonzero(numbers < numbers[k])
        way, foretold, apart = (where[k] - where[earlier] for where in (places, expected, known))
        apart = np.linalg.norm(apart, axis=1)
        turned = np.angle((way[:, 0] + 1j * way[:, 1]) * (foretold[:, 0] - 1j * foretold[:, 1]))
        off = (np.linalg.norm(way, axis=1) - apart) / np.hypot(EDGE_PX, STRETCHED * apart)
        near = lengths[k] - lengths[earlier] < NEIGHBOURING
        costs = np.where(near, off**2 + (turned / TURNED) ** 2, FARTHER * off**2 + FAR * np.sum((places[k] - expected[k]) ** 2))
        costs += best[earlier] + UNSEEN**2 * (numbers[k] - numbers[earlier] - 1)
        best[k], before[k] = costs.min(), earlier[int(np.argmin(costs))]
    last, row = int(np.argmin(best + UNSEEN**2 * (numbers.max() - numbers))), list[int]()
    while last:
        row.append(last)
        last = int(before[last])
    return row[::-1]


def carried_by(found: Sequence[SeenMark], body: SeenBody) -> NDArray[np.bool_]:
    """Which stations (S,) lie between neighbours of a row of marks, from the clamp on, or up to the end, where the last is near."""
    carried = np.zeros(STATIONS, dtype=bool)
    if len(found) < LEAST_RUNGS:
        return carried
    near = NEIGHBOURING * float(middle(body.half)) / body.length
    shares = [0.0, *(seen.mark.share for seen in found)]
    for low, high in zip(shares, [*shares[1:], 1.0], strict=True):
        carried |= (low <= SHARES) & (high >= SHARES) & (high - low <= near)
    return carried


def ends_marked(found: Sequence[SeenMark], body: SeenBody) -> bool:
    """Whether the last of the marks that are seen lies before a body's end, and near it."""
    return bool(found) and 0.0 < (1.0 - found[-1].mark.share) * body.length < ENDING * float(middle(body.half))


def row_apart(found: Sequence[SeenMark]) -> float:
    """Share of the length by which the marks of a row of three and more lie apart, any of which may be taken for the next; else 0."""
    pairs = [(one.mark, other.mark) for one, other in pairwise(found)]
    apart = [other.share - one.share for one, other in pairs if np.abs(one.colour - other.colour).max() <= MARKED]
    return median(apart) if len(apart) > 1 else 0.0


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


def _patches(
    hue: NDArray[Any], own: FloatArray, colour: FloatArray, at: FloatArray, reach: float, wall: Wall | None = None
) -> list[Patch]:
    """The patches of a colour that lie within `reach` px of `at`; the nearest first."""
    low = np.maximum(np.floor(at - reach), 0).astype(int)
    high = np.minimum(np.ceil(at + reach) + 1, hue.shape[1::-1]).astype(int)
    if np.any(high <= low):
        return []
    window = np.s_[low[1] : high[1], low[0] : high[0]]
    a, b = hue[window].transpose(2, 0, 1).astype(float)
    towards = (colour - own) / float((colour - own) @ (colour - own))
    like = a * towards[0] + b * towards[1] > LIKE + own @ towards
    if wall is not None:  # what hangs on the wall in that colour is no mark
        a, b = (np.abs(wall.colour[window][..., 1 + k] - colour[k]) for k in (0, 1))
        like &= (a >= MARKED) | (b >= MARKED) | (wall.times[window] < SEEN)
    _, _, stats, middles = cv2.connectedComponentsWithStats(like.astype(np.uint8))
    left, top, width, height, sizes = stats[1:].T
    # What runs out of the window has no middle in it: a streak of glare follows whatever is expected of it.
    cut = (left == 0) | (top == 0) | (left + width == like.shape[1]) | (top + height == like.shape[0])
    whole = np.flatnonzero(~cut & (sizes >= LEAST_PX))
    nearest = whole[np.argsort(np.linalg.norm(middles[1 + whole] + low - at, axis=1), kind="stable")]
    return [Patch(middles[1 + k] + low, float(sizes[k]), float(np.hypot(width[k], height[k]))) for k in nearest]
