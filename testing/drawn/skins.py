"""Skins: what is on and in a body, painted where it lies along and across it, so that it moves with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

FIRST, LAST, ASIDE = -0.1, 1.25, 1.12  # the part of a body's surface that is painted: lengths, and half widths
FINE = 2  # entries per pixel


@dataclass
class Skin:
    """A sheet of skin: places `along` (n, 1) in lengths, `across` (1, m) in half widths; colours and opacity (n, m)."""

    length_px: float
    half_width_px: float
    along: np.ndarray
    across: np.ndarray
    colour: np.ndarray
    opacity: np.ndarray

    @property
    def along_px(self) -> np.ndarray:
        return self.along * self.length_px

    def tone(self, where: np.ndarray, colour: np.ndarray | float, share: float = 1.0) -> None:
        """Bring colours towards another (3,) where `where` (n, m), 0 to 1, says so."""
        weight = (np.broadcast_to(where, self.opacity.shape) * share)[..., None]
        self.colour += weight * (np.asarray(colour) - self.colour)

    def shade(self, factor: np.ndarray) -> None:
        """Darken or brighten by `factor` (n, m)."""
        self.colour *= np.broadcast_to(factor, self.opacity.shape)[..., None]

    def paint(self) -> np.ndarray:
        return np.dstack([np.clip(self.colour, 0.003, 1.0), np.clip(self.opacity, 0, 1)]).astype(np.float32)


Mark = Callable[[Skin, np.random.Generator], None]


def blank(length_px: float, half_width_px: float, colour: np.ndarray) -> Skin:
    rows = int(length_px * (LAST - FIRST) * FINE) + 2
    columns = int(2 * ASIDE * half_width_px * FINE) + 3
    along = np.linspace(FIRST, LAST, rows)[:, None]
    across = np.linspace(-ASIDE, ASIDE, columns)[None]
    return Skin(length_px, half_width_px, along, across, np.ones((rows, columns, 3)) * colour, np.ones((rows, columns)))


def clouds(rng: np.random.Generator, shape: tuple[int, int], grain_px: float) -> np.ndarray:
    """Smooth noise (h, w) of standard deviation 1 whose spots are some `grain_px` wide."""
    coarse = max(1.0, grain_px / 2)
    small = rng.normal(size=(int(shape[0] / coarse) + 3, int(shape[1] / coarse) + 3)).astype(np.float32)
    small = cv2.GaussianBlur(small, (0, 0), max(grain_px / coarse / 2, 0.5))
    noise = cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return (noise - noise.mean()) / (noise.std() + 1e-9)


def _line(distance_px: np.ndarray, width_px: float) -> np.ndarray:
    """1 within a line of a width, 0 beside it, smooth over a pixel."""
    return np.clip(width_px / 2 - np.abs(distance_px) + 0.5, 0, 1)


def _round(distance: np.ndarray) -> np.ndarray:
    """Distances to the next whole number."""
    return distance - np.round(distance)


def mottle(strength: float, grain_px: float) -> Mark:
    """What no casting is without: dust, bubbles, streaks."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        shape = skin.opacity.shape
        noise = clouds(rng, shape, grain_px * FINE) + 0.5 * clouds(rng, shape, grain_px * FINE / 3)
        skin.shade(np.exp(strength * noise))

    return mark


def specks(per_area: float, size_px: float, dark: bool) -> Mark:
    """Small spots: `per_area` per half width squared."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        count = int(per_area * 2 * skin.length_px / skin.half_width_px)
        rows, columns = skin.opacity.shape
        spots = np.zeros((rows, columns), np.float32)
        for _ in range(count):
            x, y = rng.uniform(0, columns), rng.uniform(0, rows)
            radius = FINE * size_px * rng.uniform(0.5, 1.3)
            cv2.circle(
                spots, (int(x * 16), int(y * 16)), int(radius * 16), float(rng.uniform(0.4, 1)), -1, cv2.LINE_AA, 4
            )
        skin.tone(spots, 0.02 if dark else 0.85)

    return mark


def helix(pitch_px: float, width_px: float, colour: np.ndarray, share: float, *, double: bool = True) -> Mark:
    """Thread wound around a tube, one way or both."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        angle = np.arcsin(np.clip(skin.across, -1.0, 1.0)) / (2 * np.pi)
        for way in (1, -1) if double else (1,):
            phase = skin.along_px / pitch_px + way * angle
            skin.tone(_line(_round(phase) * pitch_px, width_px), colour, share)

    return mark


def rings(count: int, width: float, colour: np.ndarray, *, first: float = 0.1, last: float = 0.97) -> Mark:
    """Printed or taped rings; `width` in half widths."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        for at in np.linspace(first, last, count) + rng.normal(0, 0.004, count):
            skin.tone(_line((skin.along - at) * skin.length_px, width * skin.half_width_px), colour, 0.92)

    return mark


def dots(count: int, size: float, colour: np.ndarray) -> Mark:
    """Round marks along the middle, for somebody's own tracking."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        for at in np.linspace(0.12, 0.93, count):
            away = np.hypot(skin.along_px - at * skin.length_px, skin.across * skin.half_width_px)
            skin.tone(np.clip(size * skin.half_width_px - away + 0.5, 0, 1), colour)

    return mark


def stripe(low: float, high: float, colour: np.ndarray, share: float = 1.0) -> Mark:
    """A layer or seam between two places across (half widths)."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        middle, width = (low + high) / 2, (high - low) * skin.half_width_px
        skin.tone(_line((skin.across - middle) * skin.half_width_px, width), colour, share)

    return mark


def band(first: float, last: float, colour: np.ndarray) -> Mark:
    """A collar, cap or tape from one place along to another (lengths)."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        middle, width = (first + last) / 2, (last - first) * skin.length_px
        skin.tone(_line(skin.along_px - middle * skin.length_px, width), colour, 0.97)

    return mark


def grooves(count: int, depth: float, share: float) -> Mark:
    """Dark lines between chambers or folds, softest in their middles."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        skin.shade(1 - depth * np.exp(-((_round(skin.along * count) / share) ** 2)))

    return mark


def facets(count: int, depth: float) -> Mark:
    """Folded triangles, of which each faces the light by itself."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        zigzag = np.abs(_round(skin.across * 0.75 + 0.25)) * 2
        phase = skin.along * count + zigzag * 0.5
        level = np.mod(phase, 1.0)
        skin.shade(1 + depth * np.where(level < 0.5, 1, -1) * np.clip(8 * np.abs(_round(level * 2)), 0, 1))
        crease = _line(_round(phase * 2) * skin.length_px / count / 2, 1.2)
        skin.shade(1 - 0.35 * crease)

    return mark


def lumen(width: float, colour: np.ndarray, until: float, opacity: float) -> Mark:
    """Skin that light goes through: brighter rims, and an inner hose or channel in another colour up to a place."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        rim = np.clip(np.abs(skin.across), 0, 1) ** 5
        skin.opacity *= opacity + (0.97 - opacity) * rim
        skin.shade(1 + 0.45 * rim)
        inside = _line(skin.across * skin.half_width_px, 2 * width * skin.half_width_px)
        inside = inside * np.clip((until - skin.along) * skin.length_px + 0.5, 0, 1)
        skin.tone(inside, colour, 0.6)
        skin.opacity += inside * 0.35 * (1 - skin.opacity)
        front = np.exp(-(((skin.along - 1) * skin.length_px / 2.5) ** 2)) * (skin.along < 1.05)
        skin.opacity += front * 0.5 * (1 - skin.opacity)

    return mark


def discs(count: int, thick: float, spine: float, spine_colour: np.ndarray, tendons: tuple[float, ...]) -> Mark:
    """Discs on a spine with tendons, and air between them; `thick` of their pitch, the first at the clamp, one at the end."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        pitch = (1 - thick / count) / (count - 1)
        half = thick / count / 2
        place = (skin.along - half) / pitch
        near = np.clip(np.round(place), 0, count - 1)
        distance = (place - near) * pitch * skin.length_px
        distance = np.where(skin.along > 1 - half, 0, distance)  # the last one goes on to its face, wherever that lies
        disc = _line(distance, 2 * half * skin.length_px)
        thread = _line(skin.across * skin.half_width_px, 2 * spine * skin.half_width_px)
        lines = sum(0.8 * _line((skin.across - at) * skin.half_width_px, 0.9) for at in tendons)
        air = 1 - disc
        skin.tone(air * thread, spine_colour)
        skin.tone(air * np.clip(lines, 0, 1) * (1 - thread), np.array([0.35, 0.35, 0.33]))
        skin.opacity *= np.clip(disc + thread + np.clip(lines, 0, 1), 0, 1)
        skin.shade(1 - 0.25 * disc * (np.abs(distance) > half * skin.length_px * 0.6))

    return mark


def sheath() -> Mark:
    """A braid's fine crossing."""

    def mark(skin: Skin, rng: np.random.Generator) -> None:
        angle = np.arcsin(np.clip(skin.across, -1, 1)) / np.pi
        period = max(2.2 * skin.half_width_px, 7) / 2
        one = np.sin(2 * np.pi * (skin.along_px / period + angle))
        two = np.sin(2 * np.pi * (skin.along_px / period - angle))
        skin.shade(1 + 0.22 * np.sign(one * two) * np.minimum(1, np.abs(one * two) * 3))

    return mark
