"""The body in the first frame, from what a person pointed at."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along, evenly, scaled
from rfea_vision.scatter import NORMAL as QUARTILE
from rfea_vision.scatter import scatter
from rfea_vision.vision.body.fit import END_LEVEL
from rfea_vision.vision.body.marks import Mark, find_marks, place_of, row_of
from rfea_vision.vision.body.model import (
    CLEAR,
    NORMAL_BASIS,
    SHARES,
    STATIONS,
    Picture,
    SeenBody,
    frame_of,
    learn_colours,
    middle,
)
from rfea_vision.vision.body.sampling import read_strip
from rfea_vision.vision.body.shown import STEPS
from rfea_vision.vision.body.ways import Ways
from rfea_vision.vision.curve import basis_matrix, fit_curve
from rfea_vision.vision.find.begin import Scene, beside

HALF_PX = 12.0  # the picture is scaled until the body is twice as wide: windows in px are for such a body
MOST_ENLARGED, MOST_PIXELS = 4.0, 2_000_000  # of such a picture: more takes longer than it brings
FIRST_COEFFICIENTS = 7
SECTION = np.linspace(-2.2, 2.2, 45)  # half widths across the body,
BESIDE = 1.35  # of which what lies beyond this is around it
PIECES = 5  # of the length, whose cross-sections are read apart
NOISE = (2.0, 1.0, 1.0)  # of L, a and b: of a median along a piece, in a compressed picture
ALIKE = (10.0, 5.0, 5.0)  # of L, a and b: scatter of one rubber's colour in one picture
HINTED_ALIKE = (40.0, 15.0, 15.0)  # of a colour that a person names: light changes it more than its hue
END_NEAR = 0.45  # half widths off the hint: an end farther off is a line behind the body, or a shadow
# Half widths, 1 s.d.: so far beside it rays that agree found the end of 129 first frames that were drawn by two hands (seen; 1 px).
END_PLACED = 0.06
RANGE = 2.7  # standard deviations from the least to the most of seven rays
TIP_MISSED = 0.2  # half widths, or POINTING_PX: so far beside a mark's middle people click for it
SQUARE = STATIONS // 8  # from the clamp on: of a body that bends far round, the tip may be on the clamp's other side
DRAWN_NEAR = 0.5, 2.0  # half widths, and px of the film: so near a line that was drawn the body is
ALONG_IT = 7  # stations over which the cross-sections of such a line are averaged
ROUTE_PX = 3.0  # half a body's width in the picture in which a way is sought, which is blurred by half of that
ROUTE_FLOOR = 0.02  # cost of a way where surely the body is, over that where it surely is not
ACROSS_SMOOTH = NORMAL_BASIS @ np.linalg.pinv(NORMAL_BASIS)


def scale_for(scene: Scene, size: tuple[int, int]) -> float:
    """By how much pictures of a size are made smaller, or larger, for a body whose clamp was pointed at."""
    larger = min(MOST_ENLARGED, (MOST_PIXELS / (size[0] * size[1])) ** 0.5)
    scale = min(max(larger, 1.0), HALF_PX / max(scene.pointed()[2], 1.0))
    return scale if scale < 1.0 else int(STEPS * scale) / STEPS


def hinted_lines(
    picture: Picture,
    clamp_px: FloatArray,
    line_px: FloatArray,
    half_px: float,
    length_px: float,
    *,
    colour: FloatArray | None = None,
    allowed: NDArray[np.bool_] | None = None,
) -> list[FloatArray]:
    """Lines of stations (S, 2) px that the hints allow: a route, and a curve of the body's length.

    Parameters
    ----------
    picture : CIELAB
    clamp_px : (2, 2) across the first visible cross-section
    line_px : what is known of the centre line (n, 2), from clamp to tip
    half_px, length_px : half the body's width, and its length
    colour : (3,) of the body in CIELAB, where it is known; without it, that of its ends is taken
    allowed : (h, w) where the body may be
    """
    if len(line_px) >= 4:  # clamp, tip and two between: the person has drawn it
        line = smooth_line(line_px)
        return [line, on_ridge(picture, line, half_px)]
    inwards = leaving(clamp_px, line_px[:2])
    likeness = _likeness(picture, line_px, inwards, half_px) if colour is None else like_colour(picture, colour)
    if allowed is not None:
        likeness = np.where(allowed, likeness, 0.0)
    lines = [_route(likeness, line_px, half_px)]
    if len(line_px) == 2:
        lines.append(smooth_line(_bow(line_px, inwards, length_px)))
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


def held_near(points: FloatArray, line: FloatArray, half_px: float, scale: float, *, drawn: bool) -> FloatArray:
    """Stations (S, 2) px held near a line at its end alone, or all along where a person has `drawn` it.

    A short body's round end draws an outline aside, and so do gaps between discs, and what lies beside the body.
    """
    off = points - line if drawn else SHARES[:, None] ** 2 * (points[-1] - line[-1])
    apart = np.linalg.norm(off if drawn else off[-1:], axis=1, keepdims=True)
    near = (DRAWN_NEAR[0] * half_px + DRAWN_NEAR[1] * scale) / np.maximum(apart, 1e-9)
    return points - off * (1.0 - np.minimum(1.0, near))


def missed_by(clicks: FloatArray, body: SeenBody, clamped_px: float, *, believed: bool) -> FloatArray:
    """What `clicks` (n, 2) px miss that a first frame shows, px: the clamp's width (`clamped_px` is half of it), the line, and the tip.

    Across the body, and along it where its end is `believed`.
    """
    tangents, normals = frame_of(body.points)
    tip = clicks[-1] - body.points[-1]
    missed = [2.0**0.5 * (float(middle(body.half[: SQUARE + 1])) - clamped_px), tip @ normals[-1]]
    return np.array(missed + [beside(body.points, point) for point in clicks[1:-1]] + [tip @ tangents[-1]] * believed)


def pointing(missed: FloatArray, least_px: float, doubt_px: float) -> float:
    """How well a person points, px (1 s.d.), `least_px` at best, by what clicks missed; of that `doubt_px` is the outline's own.

    By the median of it: people point alike everywhere, and an outline is led astray in one place.
    """
    return max(least_px, float(np.sqrt(max((np.median(np.abs(missed)) / QUARTILE) ** 2 - doubt_px**2, 0.0))))


def end_among(rays: FloatArray, half_px: float) -> tuple[float, float]:
    """How far (px) beyond a line rays (RAYS,), NaN where they see none, find its body's end, and how well that is known (1 s.d.).

    0, and `END_NEAR`, where fewer than half find one, or find it elsewhere.
    """
    seen = rays[np.isfinite(rays)]
    stderr = float(np.hypot(END_PLACED * half_px, np.ptp(seen) / RANGE)) if 2 * len(seen) > len(rays) else np.inf
    clear = stderr < END_NEAR * half_px and abs(np.median(seen)) < END_NEAR * half_px
    return (float(np.median(seen)), stderr) if clear else (0.0, END_NEAR * half_px)


def on_mark(clicks: FloatArray, marks: list[Mark], body: SeenBody, within_px: float) -> FloatArray:
    """The `clicks` (n, 2) px, their tip at the middle of the mark that was clicked for it, if one is nearer than so many px."""
    places = [place_of(mark, body) for mark in marks]
    apart = [float(np.linalg.norm(place - clicks[-1])) for place in places]
    return np.vstack([clicks[:-1], places[int(np.argmin(apart))]]) if min(apart, default=np.inf) < within_px else clicks


def learnt_end(rays: FloatArray, half_px: float, pointed_px: float, variance: float) -> FloatArray | None:
    """What rays (RAYS,) px are to say of an end that was unseen when it was pointed at, once all see it; None until then.

    It was pointed at beside its end, or its line has slipped since, by so much (1 s.d., and the variance, px^2): as either is likely.
    """
    clear = np.ptp(rays) < END_LEVEL * half_px and abs(np.median(rays)) < END_NEAR * half_px  # not so where a ray is NaN
    return rays - variance / (pointed_px**2 + variance) * np.median(rays) if clear else None


def as_pointed(
    points: FloatArray, clicks: FloatArray, half_px: float, clicked_px: float, aside_px: FloatArray, end_px: float
) -> FloatArray:
    """Stations (S, 2) px between an outline and the `clicks` (n, 2) px, from the clamp's middle to the tip, by what both are worth.

    The middle of an outline errs by `aside_px` (S,) (1 s.d.), alike within a body width, and by `end_px` where it ends; a click
    by `clicked_px`. Kriging: Rasmussen and Williams, Gaussian Processes for Machine Learning, eq. 2.23.
    """
    tangents, normals = frame_of(points)
    places = along(points)
    near = np.array([0, *np.argmin(np.linalg.norm(points[:, None] - clicks[1:-1], axis=2), axis=0), STATIONS - 1], dtype=int)
    missed = np.sum((clicks - points[near]) * normals[near], axis=1)
    alike = np.exp(-0.5 * ((places[:, None] - places[near]) / (2.0 * half_px)) ** 2)
    doubt = np.outer(aside_px, aside_px[near]) * alike
    across = np.linalg.solve(doubt[near] + clicked_px**2 * np.eye(len(near)), missed)
    beyond = (clicks[-1] - points[-1]) @ tangents[-1] / (1.0 + (clicked_px / end_px) ** 2)
    points = points + (doubt * across) @ normals[near] + beyond * alike[:, -1:] * tangents[-1]
    return even(points)


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
    strip = read_strip(picture, body.points, frame_of(body.points)[1], np.full(STATIONS, half_px), SECTION)
    profile = middle(strip.reshape(PIECES, -1, *strip.shape[1:]).transpose(0, 2, 3, 1))
    around = profile[:, np.abs(SECTION) > BESIDE]
    own = np.median(around, axis=1, keepdims=True)
    around_it = scatter(np.swapaxes(around, 0, 1))[:, None] + np.array(NOISE)
    clear = np.max(np.abs(profile - own) / around_it, axis=2) > CLEAR
    return float(np.mean(clear[:, np.abs(SECTION) < 1.0]))


def first_body(picture: Picture, line: FloatArray, half_px: float | FloatArray) -> SeenBody:
    """A body on a line of stations, with the colours that it has there."""
    body = SeenBody(line, np.full(STATIONS, half_px), np.zeros((STATIONS, 2, 3)), np.zeros((STATIONS, 2, 2, 3)))
    learn_colours(picture, body)
    return body
