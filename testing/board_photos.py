"""Photos of any board through any lens, by looking up every ray: an independent check of corners and lens models.

The flat board is a picture of its own; each of 5 x 5 rays per pixel meets it somewhere. Blur acts on the fine grid, as a
lens does, before the pixels sample it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.printing import board_picture

FINE = 5
TEXTURE_PX_PER_SQUARE = 84


@dataclass
class RayCamera:
    """A lens given by OpenCV's coefficients; `fisheye` uses cv2.fisheye's."""

    size: tuple[int, int]
    matrix: np.ndarray
    distortion: np.ndarray
    fisheye: bool = False
    _rays: np.ndarray | None = field(default=None, repr=False)

    def rays(self) -> np.ndarray:
        """Normalised directions (h FINE, w FINE, 2) of the fine grid."""
        if self._rays is None:
            w, h = self.size
            step = (np.arange(FINE) - (FINE - 1) / 2) / FINE
            x = (np.arange(w)[:, None] + step).ravel()
            y = (np.arange(h)[:, None] + step).ravel()
            grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2)
            if self.fisheye:
                found = cv2.fisheye.undistortPoints(grid, self.matrix, self.distortion.reshape(-1, 1))
            else:
                found = cv2.undistortPoints(grid, self.matrix, self.distortion)
            self._rays = np.asarray(found).reshape(len(y), len(x), 2)
        return self._rays

    def project(self, points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
        """Pixels of board points (n, 2) mm."""
        world = np.column_stack([points, np.zeros(len(points))]).reshape(-1, 1, 3)
        vector = cv2.Rodrigues(rotation)[0]
        if self.fisheye:
            found, _ = cv2.fisheye.projectPoints(world, vector, translation.reshape(3, 1), self.matrix, self.distortion)
        else:
            found, _ = cv2.projectPoints(world, vector, translation, self.matrix, self.distortion)
        return np.asarray(found).reshape(-1, 2)


def texture_of(board: Board) -> np.ndarray:
    """The flat board with a white margin of one square."""
    factor = TEXTURE_PX_PER_SQUARE / 840
    flat = cv2.resize(board_picture(board), None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    m = TEXTURE_PX_PER_SQUARE
    return cv2.copyMakeBorder(flat, m, m, m, m, cv2.BORDER_CONSTANT, value=255).astype(np.float32)


def photo(
    camera: RayCamera,
    board: Board,
    texture: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    rng: np.random.Generator,
    *,
    noise: float = 2.0,
    blur_px: float = 0.6,
) -> np.ndarray:
    """One grey picture; the board's origin is its first inner corner."""
    rays = camera.rays()
    # board point (u, v): depth * (a, b, 1) = u r1 + v r2 + t
    inverse = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], translation]))
    a, b = rays[..., 0], rays[..., 1]
    scale = inverse[2, 0] * a + inverse[2, 1] * b + inverse[2, 2]
    u = (inverse[0, 0] * a + inverse[0, 1] * b + inverse[0, 2]) / scale
    v = (inverse[1, 0] * a + inverse[1, 1] * b + inverse[1, 2]) / scale
    px = TEXTURE_PX_PER_SQUARE / board.square_mm
    to = lambda mm: ((mm + 2 * board.square_mm) * px - 0.5).astype(np.float32)  # noqa: E731
    flat = cv2.remap(texture, to(u), to(v), cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=130)
    flat[scale <= 0] = 130
    fine = cv2.GaussianBlur(30 + 0.77 * flat, (0, 0), blur_px * FINE)
    h, w = fine.shape[0] // FINE, fine.shape[1] // FINE
    image = fine.reshape(h, FINE, w, FINE).mean(axis=(1, 3))
    return np.clip(np.round(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def poses(
    camera: RayCamera,
    board: Board,
    count: int,
    seed: int,
    *,
    distance: tuple[float, float],
    turn_rad: float = 0.5,
    margin_px: float = 8.0,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses with the whole board in the picture, all over it."""
    rng = np.random.default_rng(seed)
    w, h = camera.size
    middle = board.corners_mm.mean(axis=0)
    far = board.corners_mm.max(axis=0) + board.square_mm
    near = np.full(2, -board.square_mm)
    outline = np.array([near, [far[0], near[1]], far, [near[0], far[1]]])
    rays = camera.rays()
    found = []
    while len(found) < count:
        rotation = cv2.Rodrigues(np.array([*rng.uniform(-turn_rad, turn_rad, 2), rng.uniform(-0.4, 0.4)]))[0]
        x, y = rng.uniform(0.1, 0.9, 2)
        ray = rays[int(y * h) * FINE, int(x * w) * FINE]
        translation = rng.uniform(*distance) * np.array([*ray, 1.0]) - rotation[:, :2] @ middle
        depth = outline @ rotation[2, :2] + translation[2]
        if depth.min() < 0.2 * distance[0]:
            continue
        pixels = camera.project(outline, rotation, translation)
        if pixels.min() > margin_px and np.all(pixels.max(axis=0) < np.array([w, h]) - margin_px):
            found.append((rotation, translation))
    return found
