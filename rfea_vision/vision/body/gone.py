"""Where the body has gone: as the flow tells from frame to frame, or to all that looks like it and hangs together with its clamp."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along, at, scaled
from rfea_vision.vision.body.begin import PIECES, smooth_line
from rfea_vision.vision.body.fit import ALONG, BENDING, NORMAL, TO_ALONG, UNKNOWNS
from rfea_vision.vision.body.look import INNER, WITHIN_HALF, skin_unlike
from rfea_vision.vision.body.model import (
    ALONG_BASIS,
    NORMAL_BASIS,
    SHARES,
    STATIONS,
    Picture,
    SeenBody,
    Sight,
    frame_of,
    robust_displacement,
)
from rfea_vision.vision.body.sampling import look_alike, read_strip
from rfea_vision.vision.body.shown import Shown, Window
from rfea_vision.vision.body.skin import INDEPENDENT, NOISE_SLOPE
from rfea_vision.vision.body.wall import Wall, covered, window_around
from rfea_vision.vision.body.ways import middle_way

FLOW_ACROSS = (-0.5, 0.0, 0.5)  # half widths
FLOW_ALONG = np.arange(0, STATIONS, 2)  # stations: windows about those between hold what these hold
FLOW_WINDOW = (17, 17)
FLOW_BACK_PX = 0.7  # by how much a point may miss its start when it is followed back
FLOW_PX = 0.5  # scatter of the flow about a smooth displacement
FLOW_SCATTER = 4.0  # grey levels: how skin differs from the last picture's
# Of the length, and px, 1 s.d.: chosen wide, bellows filled at once stretch by 5 % from one picture to the next.
FLOW_STRETCH, FLOW_SLIP = 0.05, 0.3
CARRIED = 0.25  # of what slopes along the body tell: in six real films flow carried 0.28 of it and more, but at two cuts (0.03, 0.12)
WINDOW_SHARED = 8.0  # of these tell the same: in one window lie some four of a body of 65 stations, 2 to 8 px apart
GRADUALLY = 0.25 * BENDING + 1e-4 * np.eye(len(BENDING))  # px^-2, information on how a body moves across itself, chosen
EVENLY = np.linalg.pinv(ALONG_BASIS) @ SHARES  # coefficients of a displacement that grows evenly along the body
UNIFORMLY = np.outer(EVENLY, EVENLY)
IN_LENGTH = np.zeros((1, UNKNOWNS))  # what the unknowns change a body's length by
IN_LENGTH[0, ALONG] = ALONG_BASIS[-1] - ALONG_BASIS[0]
COARSE = 2  # times smaller: so small a picture tells where a body of 24 px has gone
REACHED = 1.5  # times as long as it is: what a body may be, so much of a way is looked at
HELD = 2.0  # half widths around the clamp within which what lies behind it is no more of the body


def flown(last: Sight, picture: Picture, wall: Wall) -> tuple[SeenBody, FloatArray, float]:
    """The body of an earlier frame, moved and stretched by flow from its clamp on: near enough for its skin to be recognised.

    And the information (25, 25) px^-2 that this displacement is, and the share that flow has carried of what slopes of the skin tell
    along the body: of its length.
    """
    tangents, normals = last.body.tangents, last.body.normals
    station = np.tile(FLOW_ALONG, len(FLOW_ACROSS))
    beside = np.repeat(FLOW_ACROSS, len(FLOW_ALONG)) * last.body.half[station]
    window = wall.window
    before = last.body.points[station] + beside[:, None] * normals[station] - [window[1].start, window[0].start]
    before = before.astype(np.float32)[:, None]
    options: dict[str, Any] = {"winSize": FLOW_WINDOW, "maxLevel": 3}
    seen, grey = (cv2.extractChannel(wall.cleared(shown)[window], 0) for shown in (last.lab, picture))
    after, there, _ = cv2.calcOpticalFlowPyrLK(seen, grey, before, before.copy(), **options)
    back, again, _ = cv2.calcOpticalFlowPyrLK(grey, seen, after, after.copy(), **options)
    kept = (there[:, 0] > 0) & (again[:, 0] > 0) & (np.linalg.norm(back - before, axis=-1)[:, 0] < FLOW_BACK_PX)
    moved = (after - before)[:, 0].astype(float)
    kept &= last.body.told[station]
    body, told = last.body, np.zeros((UNKNOWNS, UNKNOWNS))
    if kept.sum() < len(station) // 9:
        return body, told, 0.0
    aside = np.sum(moved * normals[station], axis=1)
    variance = np.where(kept, FLOW_PX**2, np.inf)
    across, told[NORMAL, NORMAL] = robust_displacement(
        NORMAL_BASIS[station], aside, variance, WINDOW_SHARED * len(FLOW_ACROSS), GRADUALLY
    )
    n = NORMAL_BASIS @ across
    # Smooth rubber goes where its length lets it, dt/ds = curvature n; what is seen to stretch beyond that has texture along it.
    turns = np.diff(np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0])))
    t = np.concatenate([[0.0], np.cumsum(0.5 * (n[1:] + n[:-1]) * turns)])
    middles = beside == 0.0  # to either side windows hold the wall, which stays
    beyond = np.sum(moved[middles] * tangents[FLOW_ALONG], axis=1) - t[FLOW_ALONG]
    inner = np.abs(body.length - 2.0 * body.lengths) < body.length - FLOW_WINDOW[0]  # nor what holds it, nor what is beyond
    textured = _textured(seen, before[middles, 0], tangents[FLOW_ALONG]) * (inner & last.body.told)[FLOW_ALONG]
    known = textured * kept[middles]
    line = body.points + n[:, None] * normals + t[:, None] * tangents
    # What flow found by chance, as on a body that swells at once, makes its skin no more like what it was.
    gains, stretched = _stretch(beyond, known, body.length)
    ways = [replace(body, points=spaced(line, last.body.lengths, gained)) for gained in (0.0 * gains, gains)]
    shown = wall.cleared(picture)
    skins = (read_strip(shown, way.points, way.normals, way.half, INNER) for way in ways)
    evenly, drawn = (skin_unlike(skin, last.skin[:, WITHIN_HALF]) for skin in skins)
    if drawn < evenly:
        told[ALONG, ALONG] = stretched
    return ways[int(drawn < evenly)], told, float(known.sum() / textured.sum()) if textured.any() else 1.0


def _textured(seen: Any, places: NDArray[np.float32], tangents: FloatArray) -> FloatArray:
    """What flow knows along the body (n,) 1/px^2 in its windows about `places` (n, 2): by slopes beyond those of noise."""
    columns, rows = np.clip(np.round(places), 0, np.array(seen.shape[::-1]) - 1).astype(int).T
    half = FLOW_WINDOW[0] // 2
    around = cv2.copyMakeBorder(seen, half, half, half, half, cv2.BORDER_REFLECT_101)
    slopes = [cv2.Scharr(around, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1))]
    across, down = (sliding_window_view(slope, FLOW_WINDOW)[rows, columns].reshape(len(places), -1) for slope in slopes)
    along = np.sum((tangents[:, :1] * across + tangents[:, 1:] * down) ** 2, axis=1)
    noise = NOISE_SLOPE**2 * FLOW_WINDOW[0] * FLOW_WINDOW[1]
    return np.maximum(along - noise, 0.0) * INDEPENDENT / FLOW_SCATTER**2


def _stretch(off: FloatArray, known: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Gains (S,) px along the body of which flow says `off`, known to `known` px^-2, at `FLOW_ALONG`: none where it is smooth.

    And the information (6, 6) px^-2 that this is.
    """
    slips = UNIFORMLY * (FLOW_STRETCH * length) ** 2 + np.eye(len(UNIFORMLY)) * FLOW_SLIP**2
    prior, variance = np.asarray(np.linalg.inv(slips), dtype=float), FLOW_PX**2 + 1.0 / np.maximum(known, 1e-9)
    gains, information = robust_displacement(ALONG_BASIS[FLOW_ALONG], off, variance, WINDOW_SHARED, prior)
    return ALONG_BASIS @ gains, information


def spaced(line: FloatArray, lengths: FloatArray, gains: FloatArray) -> FloatArray:
    """Stations on a line at `lengths` (S,) px, and what they gain (S,) px along it, without what gathers there."""
    beyond = line[-1] + 3.0 * (line[-1] - line[-4])
    line = np.vstack([line, beyond])
    wanted = ALONG_BASIS @ (TO_ALONG @ (lengths + gains))
    return at(line, wanted - wanted[0])


def held_to_length(body: SeenBody, covariance: FloatArray, length: float, stderr: float) -> tuple[SeenBody, FloatArray]:
    """A body foretold to a `covariance` (25, 25) px^2, and what it is if its length is `length` px to `stderr`: Kalman's update.

    The end of a smooth body has little to hold it: unseen, it stayed behind where a cable crossed it.
    """
    variance = float((IN_LENGTH @ covariance @ IN_LENGTH.T)[0, 0])
    share = variance / (variance + stderr**2)
    return led_to(body, covariance, IN_LENGTH, np.array([share * (length - body.length)]), np.array([[share * stderr**2]]))


def led_to(
    body: SeenBody, covariance: FloatArray, rows: FloatArray, moved: FloatArray, known: FloatArray
) -> tuple[SeenBody, FloatArray]:
    """A body foretold to a `covariance` (25, 25) px^2, and what it is if what `rows` (n, 25) make of its unknowns has `moved` (n,) px.

    As far as that is `known` (n, n), px^2; the rest of it is led along.
    """
    together = rows @ covariance
    foretold = together @ rows.T
    gain = np.linalg.solve(foretold, together).T
    step = gain @ moved
    shift = (ALONG_BASIS @ step[ALONG])[:, None] * body.tangents + (NORMAL_BASIS @ step[NORMAL])[:, None] * body.normals
    return replace(body, points=body.points + shift), covariance + gain @ (known - foretold) @ gain.T


def reached(
    shown: Shown, before: Shown | None, wall: Wall, body: SeenBody, foot: FloatArray, half_px: float, length: float
) -> list[FloatArray]:
    """Stations (S, 2) px of a body of `length` px on the way through the middle of all that looks like it, from its clamp on.

    `before` is the picture in which the `body` was found. `foot` (2, 2) is where it begins, and the direction in which it leaves.
    Beyond the end of the way, which falls short of a round cap, or ends where an arm of discs does not hang together, it goes straight
    on; and then those of one that is as long as the way, where that is longer. Empty where nothing that looks like it hangs together
    with the clamp.
    """
    small, (start, middle) = shown.smaller(COARSE), scaled(foot[0] + np.array([[0.5 * half_px], [0.0]]) * foot[1], 1.0 / COARSE)
    reach = REACHED * length
    rows, columns = window_around(small.shape, middle[None], reach / COARSE)
    corner = np.array([columns.start, rows.start])
    asked = np.ones((rows.stop - rows.start, columns.stop - columns.start), dtype=np.uint8)
    column, row = np.round(start - corner).astype(int).tolist()
    if not (0 <= row < asked.shape[0] and 0 <= column < asked.shape[1]):
        return []
    back = float(np.rad2deg(np.arctan2(-foot[1, 1], -foot[1, 0])))
    axes = (round(HELD * half_px / COARSE),) * 2
    cv2.ellipse(asked, np.round(middle - corner).astype(int).tolist(), axes, back, -90.0, 90.0, (0,), -1)
    alike = cv2.medianBlur(_look_alike(small, wall, (rows, columns), body, asked), 3)
    if not alike[row, column]:
        return []
    _, alike, _, (left, top, width, height) = cv2.floodFill(alike, None, (column, row), (2,), flags=8)
    alike = np.asarray(alike[top : top + height, left : left + width] == 2, dtype=np.uint8)
    corner += left, top
    if before is not None:
        # What looked like it in the last picture, where it was not, is another thing: the arm that holds it, of the same discs.
        # What is that near to it is its own: a line that lags leaves some of it out.
        window = slice(corner[1], corner[1] + height), slice(corner[0], corner[0] + width)
        own = covered(shown.shape, body, 0.5 * half_px)[_larger(window)]
        another = _look_alike(before.smaller(COARSE), wall, window, body, alike & ~own)
        alike = np.asarray(cv2.medianBlur(alike & ~another, 3), dtype=np.uint8)
    way = middle_way(alike, (row - top, column - left), half_px / COARSE)
    if way is None:
        return []
    way = np.vstack([foot[:1], scaled(way + corner, COARSE)])
    longer = length < along(way)[-1] < reach
    way = way[along(way) < reach]
    line = smooth_line(np.vstack([way[: -1 : max(len(way) // 60, 1)], way[-1:]]))
    known = at(np.vstack([line, line[-1] + length * frame_of(line)[0][-1]]), SHARES * length)
    return [known, at(line, SHARES * along(line)[-1])] if longer else [known]


def _look_alike(small: Shown, wall: Wall, window: Window, body: SeenBody, asked: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """1 where (h, w) a window of a smaller picture looks like the body rather than like the wall.

    Only where that is `asked` (h, w); else 0.
    """
    inside, outside = (known[:: len(known) // PIECES] for known in (body.inside, body.outside.reshape(-1, 2, 3)))
    alike, large = np.empty(asked.shape, dtype=np.uint8), _larger(window)
    look_alike(small.lab(window), wall.colour[large], wall.times[large], inside, outside, asked, alike)
    return alike


def _larger(window: Window) -> Window:
    """As many pixels of a picture as a window of a smaller one of it has."""
    rows, columns = (slice(COARSE * part.start, COARSE * part.stop, COARSE) for part in window)
    return rows, columns
