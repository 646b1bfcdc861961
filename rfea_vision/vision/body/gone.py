"""Where the body has gone: as the flow tells from frame to frame, or to all that looks like it and hangs together with its clamp."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.body.begin import PIECES, smooth_line
from rfea_vision.vision.body.fit import TO_ALONG
from rfea_vision.vision.body.model import (
    ALONG_BASIS,
    NORMAL_BASIS,
    STATIONS,
    Picture,
    SeenBody,
    Sight,
    frame_of,
    robust_displacement,
)
from rfea_vision.vision.body.sampling import SEEN, WALL_SCATTER
from rfea_vision.vision.body.wall import Wall

FLOW_ACROSS = (-0.5, 0.0, 0.5)  # half widths
FLOW_WINDOW = (17, 17)
FLOW_BACK_PX = 0.7  # by how much a point may miss its start when it is followed back
FLOW_PX = 0.5  # scatter of the flow about a smooth displacement
COARSE = 2  # px: every second pixel tells where a body of 24 px has gone
REACHED = 1.25  # times as long as it was: chosen, between what rubber gains while it is not seen and what another body adds
DEEP = 0.9  # of the half width that the way has in the median: chosen, rounded and blunt ends are shallower
HELD = 2.0  # half widths around the clamp within which what lies behind it is no more of the body


def flown(last: Sight, picture: Picture, wall: Wall, foot: FloatArray) -> SeenBody:
    """The body of an earlier frame, moved by sparse flow from `foot` (2,) on: near enough for its skin to be recognised."""
    tangents, normals = frame_of(last.body.points)
    places = [last.body.points + v * last.body.half[:, None] * normals for v in FLOW_ACROSS]
    window = wall.window
    before = (np.vstack(places) - [window[1].start, window[0].start]).astype(np.float32)[:, None]
    options: dict[str, Any] = {"winSize": FLOW_WINDOW, "maxLevel": 3}
    seen, grey = (cv2.extractChannel(wall.cleared(shown)[window], 0) for shown in (last.lab, picture))
    after, there, _ = cv2.calcOpticalFlowPyrLK(seen, grey, before, before.copy(), **options)
    back, again, _ = cv2.calcOpticalFlowPyrLK(grey, seen, after, after.copy(), **options)
    kept = (there[:, 0] > 0) & (again[:, 0] > 0) & (np.linalg.norm(back - before, axis=-1)[:, 0] < FLOW_BACK_PX)
    moved = (after - before)[:, 0].astype(float)
    station = np.tile(np.arange(STATIONS), len(FLOW_ACROSS))
    body = last.body.copy()
    if kept.sum() < STATIONS // 3:
        return body
    across = np.sum(moved * normals[station], axis=1)
    n = NORMAL_BASIS @ robust_displacement(NORMAL_BASIS[station], across, kept, FLOW_PX)
    # What smooth rubber shows along itself is the wall, or nothing: it goes where its length lets it, dt/ds = curvature n.
    turns = np.diff(np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0])))
    t = np.concatenate([[0.0], np.cumsum(0.5 * (n[1:] + n[:-1]) * turns)])
    moved_line = body.points + n[:, None] * normals + t[:, None] * tangents
    body.points = spaced(np.vstack([foot, moved_line[1:]]), last.body.points)
    return body


def spaced(line: FloatArray, like: FloatArray) -> FloatArray:
    """Stations on a line with the distances of `like`, without what gathers there: rubber stretches gradually, and little in a frame.

    The flow of smooth rubber tells little along it, and what it tells is that of the wall behind.
    """
    beyond = line[-1] + 3.0 * (line[-1] - line[-4])
    line = np.vstack([line, beyond])
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    stations = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(like, axis=0), axis=1))])
    wanted = ALONG_BASIS @ (TO_ALONG @ stations)
    wanted -= wanted[0]
    return np.column_stack([np.interp(wanted, steps, line[:, c]) for c in (0, 1)])


def reached(picture: Picture, wall: Wall, body: SeenBody, foot: FloatArray, half_px: float) -> FloatArray | None:
    """Stations (S, 2) px on the way through the middle of all that looks like a body, from its clamp to what is farthest from it.

    `foot` (2, 2) is where the body begins, and the direction in which it leaves. A way that is much longer than the body was
    goes on into something else, and is cut to that length. None where nothing that looks like it hangs together with the clamp.
    """
    reach, size = REACHED * body.length, np.array(picture.shape[1::-1])
    (left, top), (right, bottom) = (np.clip(foot[0] + sign * reach, 0, size).astype(int) for sign in (-1, 1))
    window = slice(top, bottom, COARSE), slice(left, right, COARSE)
    off = np.stack(np.meshgrid(np.arange(left, right, COARSE), np.arange(top, bottom, COARSE)), axis=2) - foot[0]
    behind = (off @ foot[1] < 0.0) & (np.linalg.norm(off, axis=2) < HELD * half_px)
    alike = np.asarray(_look_alike(picture[window], wall, window, body) & ~behind, dtype=np.uint8)
    depth = cv2.distanceTransform(cv2.medianBlur(alike, 3), cv2.DIST_L2, 3) * (COARSE / half_px)
    column, row = np.round((foot[0] + 0.5 * half_px * foot[1] - (left, top)) / COARSE).astype(int)
    if not (0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]) or depth[row, column] == 0.0:
        return None
    search = MCP_Geometric(np.where(depth > 0.0, np.maximum(depth, 0.01) ** -2.0, np.inf))
    cost = search.find_costs([(row, column)])[0]
    end = np.unravel_index(int(np.argmax(np.where(np.isfinite(cost), cost, -1.0))), cost.shape)
    found = np.array(search.traceback(end))
    deep = depth[found[:, 0], found[:, 1]]
    # It runs into a corner of the end from half a width before that on, and would go straight.
    found = found[: int(np.flatnonzero(deep >= DEEP * np.median(deep))[-1]) + 1]
    way = np.vstack([foot[:1], COARSE * found[:, ::-1] + (left, top)])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    if along[-1] < half_px:
        return None
    way = way if along[-1] < reach else way[along < body.length]
    ahead = way[-1] - way[int(np.searchsorted(along, along[len(way) - 1] - half_px))]
    end_px = way[-1] + float(np.median(deep)) * half_px * ahead / np.linalg.norm(ahead)
    return smooth_line(np.vstack([way[:: max(len(way) // 60, 1)], end_px]))


def _look_alike(picture: Picture, wall: Wall, window: tuple[slice, slice], body: SeenBody) -> NDArray[np.bool_]:
    """Where (h, w) a window of a picture looks like the body rather than like what is around it, or the wall where that was seen."""
    colours, apart = picture.astype(np.float32), []
    for known in (body.inside, body.outside.reshape(-1, 2, 3)):
        offs = []
        for mean, variance in known[:: len(known) // PIECES].astype(np.float32):
            offs.append(np.sum((colours - mean) ** 2 / variance, axis=2) + np.log(variance).sum())
        apart.append(np.min(offs, axis=0))
    behind = np.sum((colours - wall.colour[window]) ** 2, axis=2) / WALL_SCATTER**2 + 6.0 * np.log(WALL_SCATTER)
    return apart[0] < np.where(wall.times[window] >= SEEN, behind, apart[1])
