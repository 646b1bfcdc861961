"""Centre line and width of one slender body in a mask: `midline_from_mask`."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import splev, splprep
from scipy.ndimage import map_coordinates

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along, evenly, leftwards
from rfea_vision.vision.body.ways import Ways, thinned

LEAST_SLENDER = 4.0  # length over width
WIDEST = 1.75  # widest place over the median width: more is a body that touches itself
LONGEST_BRANCH = 1.6  # of the width: a longer side branch means that more than one body is seen


@dataclass(frozen=True)
class Midline:
    """Centre line (n, 2) px evenly spaced from end to end, and the full width (n,) px there."""

    points: FloatArray
    width: FloatArray

    @property
    def length(self) -> float:
        """Arc length in px."""
        return float(along(self.points)[-1])


@dataclass(frozen=True)
class Refusal:
    """Why there is no midline."""

    reason: str


def midline_from_mask(mask: NDArray[np.bool_], *, nodes: int = 50) -> Midline | Refusal:
    """Find the centre line of the largest body in a mask.

    Parameters
    ----------
    mask : (h, w), true on the body
    nodes : number of points

    Returns
    -------
    Midline or Refusal
        A refusal where no answer is possible: nothing there, not slender, closed on itself, folded, or branched.
    """
    body = _largest(np.asarray(mask, dtype=bool))
    if body is None:
        return Refusal("no_body: the mask is empty")
    hole = _largest_hole(body)
    distance = cv2.distanceTransform(np.pad(body, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    skeleton = thinned(body)
    if skeleton.sum() < 5:
        return Refusal("not_slender: the body has no axis")
    path, branch = _longest_path(skeleton)
    half = float(np.median(distance[path[:, 0], path[:, 1]]))
    if hole > max(6.0, 0.5 * half * half):
        return Refusal("closed: the body encloses a hole, it touches itself")
    if branch > LONGEST_BRANCH * 2 * half:
        return Refusal("branched: more than one axis, the body touches itself or another")
    if distance.max() > WIDEST * half + 0.7:
        return Refusal("folded: far wider in one place than elsewhere, the body touches itself")
    points = _smooth(path[:, ::-1].astype(float))
    points = _to_ends(points, body, half)
    length = float(along(points)[-1])
    if length < LEAST_SLENDER * 2 * half:
        return Refusal("not_slender: its length is less than four widths")
    area_length = float(body.sum()) / (2 * half)
    if not 0.6 < length / area_length < 1.5:
        return Refusal("folded: area, width and length do not belong to one slender body")
    return _centred(points, body, half, nodes)


def _largest(mask: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    if count < 2:
        return None
    return labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))


def _largest_hole(body: NDArray[np.bool_]) -> int:
    outside = np.pad(~body, 1, constant_values=True).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(outside, connectivity=4)
    areas = [int(stats[k, cv2.CC_STAT_AREA]) for k in range(1, count) if k != labels[0, 0]]
    return max(areas, default=0)


def _longest_path(skeleton: NDArray[np.bool_]) -> tuple[NDArray[np.int64], float]:
    """Longest shortest path along the skeleton (row, column), and the length of the longest branch off it."""
    places = np.argwhere(skeleton)
    cost = np.where(skeleton, 1.0, np.inf)

    def farthest(start: tuple[int, int]) -> tuple[tuple[int, int], Ways]:
        ways = Ways(cost, [start])
        end = np.unravel_index(int(np.argmax(np.where(np.isfinite(ways.total), ways.total, -1.0))), cost.shape)
        return (int(end[0]), int(end[1])), ways

    first, _ = farthest((int(places[0, 0]), int(places[0, 1])))
    last, ways = farthest(first)
    path = ways.to(last)
    away = Ways(cost, path).total
    branch = float(np.max(np.where(np.isfinite(away), away, 0.0)))
    return path, branch


def _smooth(points: FloatArray, count: int = 200) -> FloatArray:
    """A smoothing spline that takes out the pixel steps of the skeleton."""
    if len(points) < 6:
        return points
    spline, _ = splprep(points.T, s=0.25 * len(points), k=3)
    return np.column_stack(splev(np.linspace(0, 1, count), spline))


def _to_ends(points: FloatArray, body: NDArray[np.bool_], half: float) -> FloatArray:
    """Cut the last half width, where a skeleton bends to a corner, and go on straight to the outline."""
    soft = cv2.GaussianBlur(body.astype(np.float64), (0, 0), 0.7)
    arc = along(points)
    cut = min(0.7 * half, 0.1 * arc[-1])
    keep = (arc >= cut) & (arc <= arc[-1] - cut)
    points = points[keep]
    for _ in range(2):
        n = max(len(points) // 12, 2)
        heading = points[-1] - points[-1 - n]
        heading /= np.linalg.norm(heading) + 1e-12
        steps = np.arange(0.0, 4 * half + 4, 0.1)
        ray = points[-1] + steps[:, None] * heading
        light = map_coordinates(soft, ray.T[::-1], order=1, mode="constant")
        out = int(np.argmax(light < 0.5)) if np.any(light < 0.5) else 0
        reach = steps[out]
        if reach > 0:
            extra = np.arange(0.25, reach, 0.25)[:, None] * heading + points[-1]
            points = np.vstack([points, extra, ray[out]])
        points = points[::-1]
    return points


def _centred(points: FloatArray, body: NDArray[np.bool_], half: float, nodes: int) -> Midline:
    """Move every point to the middle of its cross-section; both crossings from the softened mask."""
    soft = cv2.GaussianBlur(body.astype(np.float64), (0, 0), 0.7)
    width = np.zeros(nodes)
    for _ in range(2):
        step = along(points)[-1] / (nodes - 1)
        points = evenly(points, nodes)
        tangent = np.gradient(points, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-12
        normal = leftwards(tangent)
        reach = np.arange(0.0, 1.8 * half + 1.5, 0.1)
        sides = []
        for sign in (1, -1):
            places = points[:, None] + sign * reach[None, :, None] * normal[:, None]
            light = map_coordinates(soft, [places[..., 1], places[..., 0]], order=1, mode="constant")
            below = light < 0.5
            first = np.where(below.any(axis=1), below.argmax(axis=1), len(reach) - 1)
            sides.append(reach[first])
        width = sides[0] + sides[1]
        middle = 0.5 * (sides[0] - sides[1])
        # Near the ends the cross-section is the cap, not the body.
        trust = np.minimum(np.arange(nodes), np.arange(nodes)[::-1]) * step > half
        middle = np.where(trust, np.clip(middle, -0.6 * half, 0.6 * half), 0.0)
        kernel = np.array([1.0, 2, 3, 2, 1]) / 9
        middle = np.convolve(np.pad(middle, 2, mode="edge"), kernel, "valid")
        points = points + middle[:, None] * normal
    return Midline(points, width)
