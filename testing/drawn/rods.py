"""Rods: all that is long and bends, painted into a window of linear light: bodies, hoses, strings, fingers, cables."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np

from testing.drawn.light import Light

FINE = 2  # places per pixel and direction at which a rod is looked at
TABLE = 8  # entries of an outline per pixel of length


@dataclass(frozen=True)
class End:
    """An end face: square, rounded by `depth` (half widths), or slanted from one edge to the other by twice `depth`."""

    shape: str = "square"
    depth: float = 0.0

    def behind(self, across: np.ndarray, half_width_px: float) -> tuple[np.ndarray, np.ndarray]:
        """How far (n,) px the face lies behind its middle at `across` (n,) of its half widths, and its slope there."""
        if self.shape == "rounded":
            up = np.sqrt(np.maximum(1 - across**2, 0.02))
            return self.depth * half_width_px * (1 - up), self.depth * across / up
        if self.shape == "slanted":
            return self.depth * half_width_px * across, np.full_like(across, self.depth)
        return np.zeros_like(across), np.zeros_like(across)


@dataclass(frozen=True)
class Surface:
    """How a rod looks: colours and opacity (n, m, 4) from start to end and edge to edge, and how round and shiny it is."""

    paint: np.ndarray
    first: float = 0.0  # where `paint` begins and ends, in lengths, and how far it reaches aside, in half widths
    last: float = 1.0
    aside: float = 1.0
    flatness: float = 1.0  # 1 is round; more is flat with rounded edges
    gloss: float = 0.0
    power: float = 30.0


def plain(colour: np.ndarray, *, flatness: float = 1.0, gloss: float = 0.05, power: float = 30.0) -> Surface:
    """A surface of one colour (3,)."""
    paint = np.ones((2, 2, 4), np.float32)
    paint[..., :3] = colour
    return Surface(paint, flatness=flatness, gloss=gloss, power=power)


@dataclass(frozen=True)
class Rod:
    """A middle line (n + 1, 2) px with headings (n + 1,) and lengths (n + 1,) px from its start; it ends at `length_px`.

    Its outline lies `left` and `right` (k,) px aside, tabled from the first to the last of `along_px`; the line runs on
    beyond the end, as far as the end's face may reach.
    """

    points: np.ndarray
    heading: np.ndarray
    along_px: np.ndarray
    length_px: float
    half_width_px: float
    left: np.ndarray
    right: np.ndarray
    end: End
    surface: Surface
    end_width_px: float | None = None  # half the width of the end's face, where the rod tapers

    @property
    def reach_px(self) -> float:
        return float(max(self.left.max(), self.right.max())) + 1.5


def rod(points: np.ndarray, half_width_px: float, surface: Surface, end: End | None = None) -> Rod:
    """A rod of one width along points (n, 2), as a hose or a finger; it begins with a flat face."""
    points = _resampled(np.asarray(points, float))
    steps = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    heading = np.concatenate([heading[:1], (heading[1:] + heading[:-1]) / 2, heading[-1:]])
    along = np.concatenate([[0], np.cumsum(np.hypot(*steps.T))])
    on = 2.0
    tip = points[-1] + on * np.array([np.cos(heading[-1]), np.sin(heading[-1])])
    outline = np.full(8, half_width_px, np.float32)
    return Rod(
        np.vstack([points, tip]), np.append(heading, heading[-1]), np.append(along, along[-1] + on), float(along[-1]),
        half_width_px, outline, outline, end or End(), surface,
    )  # fmt: skip


def _resampled(points: np.ndarray) -> np.ndarray:
    """The same line in steps of some 4 px."""
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    wanted = np.linspace(0, along[-1], max(int(along[-1] / 4), 2) + 1)
    return np.column_stack([np.interp(wanted, along, points[:, k]) for k in (0, 1)])


@dataclass
class Window:
    """Part of a picture: linear light (h, w, 3) whose first pixel is `corner` (x, y), and how bright it is lit (h, w, 3)."""

    corner: tuple[int, int]
    linear: np.ndarray
    lit: np.ndarray
    cover: np.ndarray | None = field(
        default=None
    )  # (h, w), how much of each pixel a body covers, where it is asked for


def through(view: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Where a view (3, 3) shows points (n, 2)."""
    seen = points @ view[:, :2].T + view[:, 2]
    return seen[..., :2] / seen[..., 2:]


def bounds(items: list[np.ndarray], shape: tuple[int, int], pad: int) -> tuple[int, int, int, int]:
    """The box (x0, y0, x1, y1) around points (n, 2) of a picture, the last exclusive; never empty."""
    points = np.vstack(items)
    low = np.clip(np.floor(points.min(axis=0)).astype(int) - pad, 0, [shape[1] - 2, shape[0] - 2])
    high = np.clip(np.ceil(points.max(axis=0)).astype(int) + pad + 1, low + 2, [shape[1], shape[0]])
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def outline(item: Rod) -> np.ndarray:
    """The polygon (2 n, 2) px around a rod, up to its end."""
    kept = item.along_px <= item.length_px
    aside = np.column_stack([-np.sin(item.heading), np.cos(item.heading)])
    at = entries(item, item.along_px)
    left = item.points - aside * item.left[at][:, None]
    right = item.points + aside * item.right[at][:, None]
    return np.vstack([left[kept], right[kept][::-1]])


def paint(window: Window, item: Rod, view: np.ndarray, light: Light, *, hidden: np.ndarray | None = None) -> None:
    """Paint a rod into a window, part by part, so that an end may lie on the rod's own start.

    `hidden` (h, w) is how much of each pixel something before the rod covers.
    """
    turn = np.abs(item.heading - item.heading[0]).max()
    parts = 1 if turn < 3.4 else 4
    cuts = np.linspace(0, len(item.points) - 1, parts + 1).astype(int)
    for first, last in pairwise(cuts):
        _paint_part(window, item, view, light, hidden, int(first), min(int(last) + 3, len(item.points) - 1))


def _paint_part(
    window: Window, item: Rod, view: np.ndarray, light: Light, hidden: np.ndarray | None, first: int, last: int
) -> None:
    sides = _sides(item, view, first, last)
    corner = np.array(window.corner)
    x0, y0, x1, y1 = bounds([side - corner for side in sides], window.linear.shape[:2], 1)
    box, shape = np.s_[y0:y1, x0:x1], (y1 - y0, x1 - x0)
    index, along, aside, heading = _places(item, view, sides, corner + np.array([x0, y0]), shape, first)
    if not len(index):
        return
    colour, opacity, cover = _looks(item, along, aside, heading, light)
    covered = _summed(index, cover * opacity, shape)
    painted = np.dstack([_summed(index, colour[:, k], shape) for k in range(3)]) * window.lit[box]
    if hidden is not None:
        seen = 1 - hidden[box]
        covered *= seen
        painted *= seen[..., None]
    window.linear[box] *= (1 - covered)[..., None]
    window.linear[box] += painted
    if window.cover is not None:
        geometric = _summed(index, cover, shape)
        window.cover[box] = window.cover[box] * (1 - geometric) + geometric


def _summed(index: np.ndarray, what: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The mean over each pixel's fine places, of pixels (h, w)."""
    sums = np.bincount(index, weights=what, minlength=shape[0] * shape[1])
    return (sums / FINE**2).astype(np.float32).reshape(shape)


def _sides(item: Rod, view: np.ndarray, first: int, last: int) -> list[np.ndarray]:
    """Two lines (n, 2) px in the picture, to the left and right of pieces `first` to `last` and of all they cover."""
    part = slice(first, last + 1)
    aside = item.reach_px * np.column_stack([-np.sin(item.heading[part]), np.cos(item.heading[part])])
    return [through(view, item.points[part] + way * aside) for way in (-1, 1)]


def _places(
    item: Rod, view: np.ndarray, sides: list[np.ndarray], corner: np.ndarray, shape: tuple[int, int], first: int
):
    """For all fine places on or beside a part of the rod: their pixel's index in a box, where along and aside they lie
    (px), and the heading there."""
    # a place (column, row) of the fine grid lies at corner + (column + 1/2) / FINE - 1/2
    left, right = ((side - corner + 0.5) * FINE - 0.5 for side in sides)
    fine = np.zeros((shape[0] * FINE, shape[1] * FINE), np.int16)
    quads = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
    quads = np.round(np.clip(quads, -4000, 8000) * 16).astype(np.int32)
    for k, quad in enumerate(quads):
        cv2.fillConvexPoly(fine, quad, first + k + 1, shift=4)
    where = np.flatnonzero(fine != 0)
    segment = fine.ravel()[where].astype(np.intp) - 1
    row, column = np.divmod(where, fine.shape[1])
    index = (row // FINE) * shape[1] + column // FINE
    seen = np.column_stack([column, row]).astype(np.float32)
    seen = (seen + 0.5) / FINE - 0.5 + corner.astype(np.float32)
    world = through(np.linalg.inv(view).astype(np.float32), seen)
    there = _pieces(item)[segment]
    from_middle = world - there[:, 0:2]
    forward = from_middle[:, 0] * there[:, 2] + from_middle[:, 1] * there[:, 3]
    lateral = from_middle[:, 1] * there[:, 2] - from_middle[:, 0] * there[:, 3]
    forward /= np.maximum(1 - there[:, 4] * lateral, 0.2)
    return index, there[:, 5] + forward, lateral, there[:, 6] + there[:, 4] * forward


def _pieces(item: Rod) -> np.ndarray:
    """Of each piece of a rod (n, 7): its middle (x, y), its direction (x, y), curvature (1/px), where along it lies, its heading."""
    step = np.diff(item.points, axis=0)
    chord = np.hypot(*step.T)[:, None]
    middle, along, heading = ((a[1:] + a[:-1]) / 2 for a in (item.points, item.along_px, item.heading))
    return np.column_stack([middle, step / chord, np.diff(item.heading)[:, None] / chord, along, heading]).astype(
        np.float32
    )


def entries(item: Rod, along: np.ndarray) -> np.ndarray:
    """Which entry of the outline's tables belongs to places along the rod (px)."""
    start, stop = item.along_px[0], item.along_px[-1]
    last = len(item.left) - 1
    return np.clip((along - start) * (last / (stop - start)) + 0.5, 0, last).astype(np.intp)


def _looks(item: Rod, along: np.ndarray, aside: np.ndarray, heading: np.ndarray, light: Light):
    """Light (n, 3) thrown back by covered shares of places, their opacity (n,) and the share that is covered (n,)."""
    at = entries(item, along)
    on_left = aside < 0
    wide = np.where(on_left, item.left[at], item.right[at])
    per_entry = (item.along_px[-1] - item.along_px[0]) / (len(item.left) - 1)
    slope = np.where(on_left, np.gradient(item.left)[at], np.gradient(item.right)[at]) / per_entry
    across = np.clip(aside / np.maximum(wide, 0.05), -1, 1)
    cover = np.clip((wide - np.abs(aside)) * FINE / np.sqrt(1 + slope**2) + 0.5, 0, 1)
    behind, tilt = item.end.behind(across, item.end_width_px or item.half_width_px)
    cover *= np.clip((item.length_px - behind - along) * FINE / np.sqrt(1 + tilt**2) + 0.5, 0, 1)
    cover *= np.clip((along - item.along_px[0]) * FINE + 0.5, 0, 1)
    paint = _sampled(item, along, aside)
    diffuse, mirrored = light.on(_normals(item, along, across, slope, heading), item.surface.gloss, item.surface.power)
    colour = (
        paint[:, :3] * (diffuse * paint[:, 3] * cover)[:, None]
        + (mirrored * cover * np.minimum(1, 4 * paint[:, 3]))[:, None]
    )
    return colour, paint[:, 3], cover


def _normals(item: Rod, along: np.ndarray, across: np.ndarray, slope: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Which way (n, 3) the skin faces at its places."""
    flat = item.surface.flatness
    side = across if flat == 1 else np.sign(across) * np.abs(across) ** flat
    front = np.sqrt(np.maximum(1 - side**2, 0.0))
    on = -np.clip(slope, -2, 2) * np.abs(side if flat == 1 else 1.0) * 0.6
    if item.end.shape == "rounded" and item.end.depth > 0.2:
        depth = item.end.depth * (item.end_width_px or item.half_width_px)
        on = on + np.clip((along - item.length_px + depth) / depth, 0, 1) ** 2
    sine, cosine = np.sin(heading), np.cos(heading)
    size = 1 / np.sqrt(side**2 + on**2 + front**2 + 1e-6)
    return np.column_stack([(cosine * on - sine * side) * size, (cosine * side + sine * on) * size, front * size])


def _sampled(item: Rod, along: np.ndarray, aside: np.ndarray) -> np.ndarray:
    """Paint (n, 4) at places along and aside (px)."""
    surface = item.surface
    rows, columns = surface.paint.shape[:2]
    row = (along / item.length_px - surface.first) / (surface.last - surface.first) * (rows - 1)
    column = (aside / item.half_width_px / surface.aside + 1) / 2 * (columns - 1)
    padding = -len(row) % 512  # maps of OpenCV are no longer than 32767
    maps = [np.pad(m.astype(np.float32), (0, padding)).reshape(-1, 512) for m in (column, row)]
    painted = [
        cv2.remap(
            surface.paint,
            maps[0][k : k + 16384],
            maps[1][k : k + 16384],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        for k in range(0, len(maps[0]), 16384)
    ]
    return np.vstack([p.reshape(-1, 4) for p in painted])[: len(row)]
