"""Scenes of known truth for the measurement tests: a small renderer of its own, by exact coverage.

Nothing here is shared with the package: projection by OpenCV, polygons by exact signed area per pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numba import njit


@njit(cache=True)
def _accumulate(edges, area):
    """Signed area to the right of every polygon edge, per pixel cell; pixel (i, j) covers [j, j+1] x [i, i+1]."""
    height, width = area.shape
    for k in range(edges.shape[0]):
        x0, y0, x1, y1 = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if y0 == y1:
            continue
        sign = 1.0
        if y0 > y1:
            x0, y0, x1, y1 = x1, y1, x0, y0
            sign = -1.0
        slope = (x1 - x0) / (y1 - y0)
        top, bottom = max(y0, 0.0), min(y1, float(height))
        row = int(np.floor(top))
        while row < bottom and row < height:
            a, b = max(top, float(row)), min(bottom, row + 1.0)
            if b > a:
                xa, xb = x0 + (a - y0) * slope, x0 + (b - y0) * slope
                # split at every column boundary
                left, right = min(xa, xb), max(xa, xb)
                dy = b - a
                span = right - left
                column = int(np.floor(left))
                x = left
                while True:
                    end = min(right, column + 1.0)
                    part = dy if span < 1e-12 else dy * (end - x) / span
                    if column < 0:
                        area[row, 0] += sign * part
                    elif column < width:
                        mean = 0.5 * (x + end) - column
                        area[row, column] += sign * part * (1.0 - mean)
                        if column + 1 < width:
                            area[row, column + 1] += sign * part * mean
                    if end >= right - 1e-15:
                        break
                    x = end
                    column += 1
            row += 1
    for i in range(height):
        total = 0.0
        for j in range(width):
            total += area[i, j]
            area[i, j] = total


def coverage(polygon_px: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Exact share of every pixel that a polygon covers; pixel centres at whole numbers."""
    points = np.asarray(polygon_px, dtype=float) + 0.5
    edges = np.hstack([points, np.roll(points, -1, axis=0)])
    area = np.zeros((size[1], size[0]))
    _accumulate(edges, area)
    return np.clip(np.abs(area), 0.0, 1.0)


@dataclass(frozen=True)
class Lens:
    size: tuple[int, int] = (720, 1280)
    matrix: np.ndarray = field(default_factory=lambda: np.array([[1400.0, 0, 352.0], [0, 1403.0, 655.0], [0, 0, 1]]))
    distortion: np.ndarray = field(default_factory=lambda: np.array([-0.12, 0.05, 0.0006, -0.0004, 0.0]))
    rotation: np.ndarray = field(default_factory=lambda: cv2.Rodrigues(np.array([0.05, -0.04, 0.02]))[0])
    translation: np.ndarray = field(default_factory=lambda: np.array([60.0, -88.0, 370.0]))

    def scaled(self, factor: float) -> Lens:
        """The same view with fewer pixels."""
        matrix = np.diag([factor, factor, 1.0]) @ self.matrix
        matrix[:2, 2] += 0.5 * factor - 0.5
        return replace(self, size=(round(factor * self.size[0]), round(factor * self.size[1])), matrix=matrix)

    def project(self, plane_mm: np.ndarray, depth_mm: float = 0.0) -> np.ndarray:
        """Rig mm (x right, y up) to pixels; `depth_mm` towards the camera."""
        points = np.asarray(plane_mm, dtype=float).reshape(-1, 2)
        world = np.column_stack([points[:, 0], -points[:, 1], np.full(len(points), -depth_mm)])
        pixels, _ = cv2.projectPoints(
            world, cv2.Rodrigues(self.rotation)[0], self.translation, self.matrix, self.distortion
        )
        return pixels.reshape(-1, 2)


@dataclass(frozen=True)
class Shape:
    """The tube in one moment, from its hinge line; n fine pieces."""

    hinge: np.ndarray
    phi: np.ndarray
    radius_mm: float
    bends: str = "left"

    @property
    def centre(self) -> np.ndarray:
        return self._offset(self.radius_mm)

    @property
    def outer(self) -> np.ndarray:
        return self._offset(2 * self.radius_mm)

    @property
    def inner(self) -> np.ndarray:
        return self._offset(0.0)

    def _offset(self, by: float) -> np.ndarray:
        line = self.hinge + by * np.column_stack([np.cos(self.phi), -np.sin(self.phi)])
        return line if self.bends == "left" else line * [-1, 1]

    @property
    def tip(self) -> np.ndarray:
        return self.centre[-1]

    @property
    def bend_deg(self) -> float:
        return float(np.degrees(self.phi[-1]))


def shape(
    total_deg: float,
    *,
    taper: float = 0.3,
    length_mm: float = 155.0,
    radius_mm: float = 4.0,
    bends: str = "left",
    pieces: int = 1200,
) -> Shape:
    """A tube bent by `total_deg`; `taper` makes the curvature fall towards the tip."""
    s = (np.arange(pieces) + 0.5) / pieces
    curvature = np.radians(total_deg) * (1 + taper * (1 - 2 * s))
    phi_mid = np.cumsum(curvature) / pieces - 0.5 * curvature / pieces
    phi = np.concatenate([[0.0], np.cumsum(curvature) / pieces])
    step = length_mm / pieces
    hinge = np.vstack([[0, 0], np.cumsum(np.column_stack([-np.sin(phi_mid), -np.cos(phi_mid)]) * step, axis=0)])
    return Shape(hinge + np.array([-radius_mm, 0.0]), phi, radius_mm, bends)


@dataclass(frozen=True)
class Look:
    tube: float = 190.0
    background: float = 60.0
    clamp: float | None = 25.0
    clamp_width_mm: float = 40.0
    clamp_height_mm: float = 30.0
    blur_px: float = 0.6
    noise: float = 3.0
    uneven: float = 0.0
    flicker: float = 0.0
    busy: float = 0.0
    hose_mm: float | None = None
    bands: int = 0  # dark bands painted on the tube
    band_mm: tuple[float, float] | None = None  # one more, from and to this far along the tube
    ferrule: tuple[float, float] | None = None  # a sleeve on the tube's end: its length in mm, and its width in tubes
    round_end: bool = False  # a half sphere on the tube's end
    highlight: tuple[float, float, float] | None = None  # a stripe along the tube, from and to in radii; its level
    shadow: float = 0.0  # share of the light that the shadow of a thing in front takes away, with a hard edge


def picture(
    shape_: Shape, lens: Lens, look: Look, rng: np.random.Generator, gain: float = 1.0, *, rounded: bool = True
) -> np.ndarray:
    """One grey picture (height, width) uint8 of the tube."""
    w, h = lens.size
    image = np.full((h, w), float(look.background))
    if look.busy:
        texture = np.random.default_rng(1).normal(0, 1, (h, w))
        texture = cv2.GaussianBlur(texture, (0, 0), 4)
        image += look.busy * texture / texture.std()
    outline = np.vstack([shape_.inner[::4], shape_.outer[::-4]])
    if look.ferrule is not None:
        outline = _with_sleeve(shape_, *look.ferrule)
    if look.round_end:
        outline = np.vstack([shape_.inner[::4], _half_circle(shape_), shape_.outer[::-4]])
    if look.clamp is not None:  # the tube goes on inside the clamp
        outline = np.vstack([shape_.inner[0] + [0, 5.0], outline, shape_.outer[0] + [0, 5.0]])
    tube = coverage(lens.project(outline), lens.size)
    image += tube * (look.tube - image)
    bands = [(k + 0.5) / look.bands + np.array([-0.006, 0.006]) for k in range(look.bands)]
    if look.band_mm is not None:
        bands.append(np.array(look.band_mm) / 155.0)
    for at in bands:
        band = _stripe(shape_, at, (-1.0, 1.0))
        image += coverage(lens.project(band), lens.size) * 0.35 * (20.0 - look.tube)
    if look.highlight is not None:
        stripe = _stripe(shape_, np.array([0.0, 1.0]), look.highlight[:2], 300)
        image += coverage(lens.project(stripe), lens.size) * (look.highlight[2] - look.tube)
    if look.clamp is not None:
        a, b = look.clamp_width_mm / 2, look.clamp_height_mm
        corners = np.array([[-a, 0], [a, 0], [a, b], [-a, b]])
        dense = np.vstack([np.linspace(corners[i], corners[(i + 1) % 4], 20, endpoint=False) for i in range(4)])
        image += coverage(lens.project(dense), lens.size) * (look.clamp - image)
    if look.hose_mm is not None:
        y = look.hose_mm
        hose = np.array([[-200.0, y - 30], [200.0, y + 30], [200.0, y + 36], [-200.0, y - 24]])
        image += coverage(lens.project(hose), lens.size) * (110 - image)
    if look.uneven:
        yy, xx = np.mgrid[0:h, 0:w]
        image *= 1 + look.uneven * (xx / w - 0.5) + 0.5 * look.uneven * np.sin(3 * yy / h)
    if look.shadow:  # as wide as a hand, across tube and wall alike
        yy, xx = np.mgrid[0:h, 0:w]
        image[(yy + 0.3 * xx > 0.45 * h) & (yy + 0.3 * xx < 0.62 * h)] *= 1 - look.shadow
    image *= gain
    if look.blur_px:
        image = cv2.GaussianBlur(image, (0, 0), look.blur_px)
    if not rounded:
        return image
    return np.clip(np.round(image + rng.normal(0, look.noise, image.shape)), 0, 255).astype(np.uint8)


def _stripe(shape_: Shape, along: np.ndarray, across: tuple[float, float], count: int = 8) -> np.ndarray:
    """Outline of the part of the tube between two shares of its length and two offsets in radii."""
    i = np.linspace(along[0], along[1], count) * (len(shape_.phi) - 1)
    sides = [
        np.column_stack([np.interp(i, np.arange(len(line)), line[:, c]) for c in (0, 1)])
        for line in (shape_.inner, shape_.outer)
    ]
    low, high = (sides[0] + 0.5 * (q + 1) * (sides[1] - sides[0]) for q in across)
    return np.vstack([low, high[::-1]])


def _with_sleeve(shape_: Shape, length_mm: float, wide: float) -> np.ndarray:
    """Outline of a tube that is `wide` times as wide over the last `length_mm`."""
    n = len(shape_.phi)
    extra = np.where(np.arange(n) >= n * (1 - length_mm / 155.0), wide - 1, 0.0)[:, None]
    across = shape_.outer - shape_.inner
    return np.vstack([(shape_.inner - 0.5 * extra * across)[::2], (shape_.outer + 0.5 * extra * across)[::-2]])


def _half_circle(shape_: Shape) -> np.ndarray:
    """From the inner to the outer edge around the end of the tube."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 41)[1:-1, None]
    middle, across = shape_.centre[-1], shape_.outer[-1] - shape_.centre[-1]
    along = shape_.centre[-1] - shape_.centre[-2]
    along *= shape_.radius_mm / np.linalg.norm(along)
    return middle + np.sin(angle) * across + np.cos(angle) * along


def smeared_film(lens: Lens, look: Look, angle_of, times, exposure_s: float, *, seed: int = 0, steps: int = 8):
    """Render what a shutter that is open for `exposure_s` around each time sees; returns pictures, times, shapes."""
    rng = np.random.default_rng(seed)
    quiet = replace(look, noise=0.0)
    pictures, shapes = [], []
    for t in times:
        open_at = t + exposure_s * ((np.arange(steps) + 0.5) / steps - 0.5)
        mean = np.mean([picture(shape(a), lens, quiet, rng, rounded=False) for a in angle_of(open_at)], axis=0)
        pictures.append(np.clip(np.round(mean + rng.normal(0, look.noise, mean.shape)), 0, 255).astype(np.uint8))
        shapes.append(shape(float(angle_of(np.array([t]))[0])))
    return pictures, np.asarray(times), shapes


def board_picture(
    lens: Lens,
    rotation: np.ndarray,
    translation: np.ndarray,
    rng: np.random.Generator,
    *,
    grid=(9, 6),
    square_mm: float = 12.0,
    noise: float = 2.0,
    blur_px: float = 0.6,
) -> np.ndarray:
    """A checkerboard photo; the board's frame has its first inner corner at the origin, x along rows, y down."""
    columns, rows = grid
    posed = replace(lens, rotation=rotation, translation=translation)
    image = np.full((lens.size[1], lens.size[0]), 120.0)

    def fill(x0, y0, x1, y1, level):
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float) * square_mm
        dense = np.vstack([np.linspace(corners[i], corners[(i + 1) % 4], 8, endpoint=False) for i in range(4)])
        image[...] += coverage(posed.project(dense * [1, -1]), lens.size) * (level - image)

    fill(-1.6, -1.6, columns + 0.6, rows + 0.6, 225.0)
    for i in range(-1, rows):
        for j in range(-1, columns):
            if (i + j) % 2 == 0:
                fill(j, i, j + 1, i + 1, 30.0)
    image = cv2.GaussianBlur(image, (0, 0), blur_px)
    return np.clip(np.round(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def board_pictures(lens: Lens, count: int, seed: int = 0) -> list[np.ndarray]:
    """Varied board photos."""
    rng = np.random.default_rng(seed)
    out = []
    inverse = np.linalg.inv(lens.matrix)
    while len(out) < count:
        rotation = cv2.Rodrigues(np.array([*rng.uniform(-0.55, 0.55, 2), rng.uniform(-0.5, 0.5)]))[0]
        distance = rng.uniform(190, 380)
        place = np.array([rng.uniform(0.25, 0.75) * lens.size[0], rng.uniform(0.2, 0.8) * lens.size[1], 1.0])
        middle = inverse @ place * distance
        translation = middle - rotation @ np.array([48.0, 30.0, 0.0])
        posed = replace(lens, rotation=rotation, translation=translation)
        corners = posed.project(np.array([[-18, 18], [114, 18], [114, -78], [-18, -78.0]]))
        if corners.min() < 0 or corners[:, 0].max() > lens.size[0] - 1 or corners[:, 1].max() > lens.size[1] - 1:
            continue
        out.append(board_picture(lens, rotation, translation, rng))
    return out


def plane_picture(lens: Lens, seed: int = 0, at_mm: tuple[float, float] = (-100.0, -45.0)) -> np.ndarray:
    """The board in the plane of motion, its first corner at `at_mm` of the rig frame."""
    offset = lens.rotation @ np.array([at_mm[0], -at_mm[1], 0.0])
    return board_picture(lens, lens.rotation, lens.translation + offset, np.random.default_rng(seed))


def bending(t: np.ndarray, *, swing_deg: float = 70.0, rest_deg: float = 2.0) -> np.ndarray:
    """A bend over time in deg: rest, a quick rise with ringing, a fall."""
    rise = 1 / (1 + np.exp(-(t - 0.15) / 0.02))
    ring = 0.08 * np.exp(-np.clip(t - 0.15, 0, None) / 0.1) * np.sin(2 * np.pi * 6 * np.clip(t - 0.15, 0, None))
    return rest_deg + swing_deg * (rise + ring)


def film(lens: Lens, look: Look, angles_deg, *, rate_Hz: float = 240.0, seed: int = 0, **kind):
    """Render one picture per angle; returns pictures, times, shapes."""
    rng = np.random.default_rng(seed)
    shapes = [shape(a, **kind) for a in angles_deg]
    gains = [1 + look.flicker * np.sin(2 * np.pi * 100 * k / rate_Hz) for k in range(len(shapes))]
    pictures = [picture(s, lens, look, rng, g) for s, g in zip(shapes, gains, strict=True)]
    return pictures, np.arange(len(shapes)) / rate_Hz, shapes
