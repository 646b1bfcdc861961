"""Find the tube in a picture without knowing where it is.

A tube of known width is two parallel edges of opposite direction, one width apart. For a set of orientations the
picture is searched for such pairs (both the lighter and the darker tube), the strongest are followed in both
directions, and the path whose length is that of the tube wins. Wide bodies, single edges and textures have no partner
edge at the right distance, so uneven light and busy backgrounds matter little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along, evenly, scaled

WIDTH_SCALED_PX = 9.0  # the picture is scaled until the tube is this wide
ORIENTATIONS = 36
SEEDS = 40


@dataclass(frozen=True)
class Path:
    """A candidate: ordered points (n, 2) px, `polarity` +1 where the tube is lighter, and score.

    `strength` is the response over the picture's usual contrast, as it counts in the score.
    """

    points: FloatArray
    polarity: int
    score: float
    strength: float = 1.0


def ribbons(picture: NDArray[np.uint8], width_px: float) -> tuple[NDArray[np.float32], float, float]:
    """Pairs of opposite edges one width apart, for every orientation of the ribbon's axis.

    Response (2, orientations, h, w) to a lighter and a darker ribbon, the scale from picture to its px, and the usual contrast.
    """
    scale = min(WIDTH_SCALED_PX / width_px, 1.0)
    size = (max(round(picture.shape[1] * scale), 16), max(round(picture.shape[0] * scale), 16))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    small = cv2.GaussianBlur(small, (0, 0), 1.0)
    width = width_px * scale
    gx = cv2.Sobel(small, cv2.CV_32F, 1, 0, ksize=3) / 8
    gy = cv2.Sobel(small, cv2.CV_32F, 0, 1, ksize=3) / 8
    contrast = float(np.percentile(np.hypot(gx, gy), 98)) + 0.2
    response = np.zeros((2, ORIENTATIONS, size[1], size[0]), dtype=np.float32)

    def seen_from(values: NDArray[Any], right: float, down: float) -> NDArray[Any]:
        row, column = margin + round(down), margin + round(right)
        return np.pad(values, margin)[row : row + size[1], column : column + size[0]]

    margin = int(np.ceil(width))
    for k, angle in enumerate(np.pi * np.arange(ORIENTATIONS) / ORIENTATIONS):
        tx, ty = width * np.cos(angle), width * np.sin(angle)
        slope = np.float32(tx / (3.0 * width)) * gy - np.float32(ty / (3.0 * width)) * gx
        # Averaged along one width of the axis; then the weaker of two opposite edges.
        slope = slope + seen_from(slope, 0.33 * tx, 0.33 * ty) + seen_from(slope, -0.33 * tx, -0.33 * ty)
        rising, falling = seen_from(slope, 0.5 * ty, -0.5 * tx), -seen_from(slope, -0.5 * ty, 0.5 * tx)
        response[0, k] = np.maximum(np.minimum(rising, falling), 0.0)
        response[1, k] = np.maximum(np.minimum(-rising, -falling), 0.0)
    return response, size[0] / picture.shape[1], contrast


def find_paths(
    picture: NDArray[np.uint8],
    width_px: float,
    length_px: float,
    *,
    near_px: FloatArray | None = None,
    allowed: NDArray[np.bool_] | None = None,
) -> list[Path]:
    """Candidate centre lines, best first.

    Parameters
    ----------
    picture : (h, w) luma
    width_px, length_px : expected width and length of the tube
    near_px : points (n, 2) that the path must pass within three widths (a clamp or tip that is known)
    allowed : (h, w) where the tube may be
    """
    response, scale, contrast = ribbons(picture, width_px)
    if allowed is not None:
        small = cv2.resize(allowed.astype(np.uint8), response.shape[:1:-1], interpolation=cv2.INTER_NEAREST)
        response[:, :, small == 0] = 0.0
    step, longest = 0.35 * width_px * scale, 1.5 * length_px * scale
    paths: list[Path] = []
    for stack, polarity in zip(response, (1, -1), strict=True):
        best = stack.max(axis=0)
        taken = np.zeros(best.shape, dtype=bool)
        for y, x in _seeds(best, round(0.8 * width_px * scale)):
            if taken[y, x]:
                continue
            strength = float(best[y, x])
            direction = np.pi * int(stack[:, y, x].argmax()) / ORIENTATIONS
            ahead, behind = (
                _follow(stack, float(x), float(y), direction + turn, step, 0.3 * strength, longest) for turn in (0.0, np.pi)
            )
            found = np.vstack([behind[::-1], [[x, y, strength]], ahead])
            for px, py in found[:, :2].round().astype(int):
                taken[max(py - 2, 0) : py + 3, max(px - 2, 0) : px + 3] = True
            points = scaled(found[:, :2], 1.0 / scale)
            gaps = [] if near_px is None else [np.linalg.norm(points - place, axis=1).min() for place in near_px]
            if len(points) < 5 or max(gaps, default=0.0) >= 3 * width_px:
                continue
            ratio = float(along(points)[-1]) / length_px
            clear = float(np.sqrt(min(float(np.median(found[:, 2])) / contrast, 3.0)))
            paths.append(Path(points, polarity, length_score(ratio) * clear + 0.02 * min(ratio, 1.0), clear))
    return sorted(paths, key=lambda path: -path.score)


def cut_at(path: Path, ends_px: FloatArray, length_px: float) -> Path:
    """The part of a path between the points that are nearest to `ends_px` (2, 2), scored anew; it ends at those."""
    gaps = np.linalg.norm(path.points[:, None] - ends_px[None], axis=-1)
    i, j = (int(k) for k in gaps.argmin(axis=0))
    part = path.points[i : j + 1] if i <= j else path.points[j : i + 1][::-1]
    middle = part[1:-1] if len(part) > 4 else part[:0]
    points = np.vstack([ends_px[0], middle, ends_px[1]])
    length = float(along(points)[-1])
    score = path.score if len(middle) == 0 else length_score(length / length_px) * path.strength
    return Path(points, path.polarity, score, path.strength)


def hinted_paths(line_px: FloatArray) -> list[Path]:
    """The line through the hints (n, 2) itself, as a lighter and as a darker tube."""
    return [Path(evenly(line_px, 40), polarity, 1.0) for polarity in (1, -1)]


def length_score(ratio: float) -> float:
    """How well a length fits, `ratio` to that of the tube: it may be partly hidden, and grows a little when bent."""
    misfit = np.log(ratio) / (0.25 if ratio < 1 else 0.18)
    return float(np.exp(-0.5 * misfit**2))


def _seeds(best: NDArray[np.float32], spacing: int) -> list[tuple[int, int]]:
    kernel = np.ones((2 * max(spacing, 1) + 1,) * 2, dtype=np.uint8)
    peaks = (best >= cv2.dilate(best, kernel) - 1e-6) & (best > 0.05 * best.max()) & (best > 0.3)
    places = np.argwhere(peaks)
    order = np.argsort(-best[peaks])
    return [(int(y), int(x)) for y, x in places[order][:SEEDS]]


@njit(cache=True, nogil=True)
def _follow(stack, x, y, direction, step, floor, longest):
    """Walk along the ridge; rows (x, y, response). A gap of up to three widths is crossed straight on."""
    count, height, width = stack.shape
    rows = np.empty((int(longest / step) + 2, 3))
    kept = walked = 0  # rows up to the last one on the ridge, and with those across a gap
    travelled = 0.0
    while travelled < longest:
        travelled += step
        best, best_x, best_y, best_heading = -1.0, x, y, direction
        widest = 2 if walked == kept else 1
        for turns in range(-widest, widest + 1):
            turn = math.radians(10.0 * turns)
            heading = direction + turn
            cx, cy = x + step * math.cos(heading), y + step * math.sin(heading)
            k = round(heading / math.pi * count) % count
            for sideways in range(-2, 3):
                shift = 0.5 * sideways
                px, py = cx - shift * math.sin(heading), cy + shift * math.cos(heading)
                i, j = round(py), round(px)
                if 0 <= i < height and 0 <= j < width:
                    value = float(stack[k, i, j]) * (1 - 0.05 * abs(shift) - 0.1 * abs(turn))
                    if value > best:
                        best, best_x, best_y, best_heading = value, px, py, heading
        if best < 0:
            break
        if best >= floor:
            x, y, direction = best_x, best_y, best_heading
            rows[walked, 0], rows[walked, 1], rows[walked, 2] = x, y, best
            walked += 1
            kept = walked
        else:
            x, y = x + step * math.cos(direction), y + step * math.sin(direction)
            rows[walked, 0], rows[walked, 1], rows[walked, 2] = x, y, 0.0
            walked += 1
            if (walked - kept) * step > 1.6 * WIDTH_SCALED_PX:
                break
    return rows[:kept]
