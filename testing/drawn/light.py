"""Light: lamps that shade what is round, how they fill a room, what changes in time; and the sRGB of screens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

STEPS = 4096  # of linear light, of which a table makes sRGB


@lru_cache
def _table(contrast: float) -> np.ndarray:
    linear = np.linspace(0, 1, STEPS)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (255 * (srgb + contrast * (3 * srgb**2 - 2 * srgb**3 - srgb))).astype(np.float32)


def to_srgb(linear: np.ndarray, contrast: float = 0.0) -> np.ndarray:
    """What a screen is told, 0 to 255 (float), of linear light 0 to 1 (more is white), by a camera that adds contrast."""
    return _table(contrast)[np.clip(linear * (STEPS - 1) + 0.5, 0, STEPS - 1).astype(np.uint16)]


def to_linear(srgb: np.ndarray) -> np.ndarray:
    """Linear light of sRGB, both 0 to 1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


@dataclass(frozen=True)
class Lamp:
    """Light from a direction (3,): x right, y down, z to the camera."""

    direction: np.ndarray
    strength: float

    @property
    def between(self) -> np.ndarray:
        """The direction (3,) half-way to the camera: a skin that faces it shines."""
        half = self.direction + np.array([0, 0, 1])
        return half / np.linalg.norm(half)


@dataclass(frozen=True)
class Light:
    """Lamps, what comes from everywhere, the pools they make on the wall, and how all of it changes with time."""

    lamps: tuple[Lamp, ...]
    ambient: float
    tint: np.ndarray  # (3,)
    pools: tuple[tuple[float, float, float, float], ...]  # x, y, reach, of the picture's size, and strength
    drift: float  # of the exposure, slowly, to either side
    drift_s: float  # period
    flicker: float  # of lamps on 50 Hz mains: bands that a rolling shutter sees
    shadow_px: tuple[float, float] | None  # where the body's shadow falls, where the wall is close
    shadow_blur_px: float
    shadow_depth: float

    def on(self, normals: np.ndarray, gloss: float, power: float) -> tuple[np.ndarray, np.ndarray]:
        """Light (n,) that skin throws back in all directions, and (n,) that it mirrors, for normals (n, 3)."""
        diffuse = np.full(len(normals), self.ambient, np.float32)
        mirrored = np.zeros(len(normals), np.float32)
        for lamp in self.lamps:
            facing = normals @ lamp.direction.astype(np.float32)
            diffuse += lamp.strength * np.maximum(0, (facing + 0.25) / 1.25)
            if gloss:
                shine = np.maximum(0, normals @ lamp.between.astype(np.float32))
                mirrored += gloss * lamp.strength * np.exp(power * (shine - 1))
        return diffuse, mirrored

    def field(self, shape: tuple[int, int]) -> np.ndarray:
        """How bright the lamps make each place of a picture (h, w, 3), around 1."""
        small = (max(shape[0] // 8, 8), max(shape[1] // 8, 8))
        y, x = np.meshgrid(np.linspace(0, 1, small[0]), np.linspace(0, 1, small[1]), indexing="ij")
        bright = np.ones(small)
        for px, py, reach, strength in self.pools:
            bright += strength * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * reach**2))
        bright /= bright.mean()
        bright *= 1 - 0.22 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)  # a lens is darker towards its corners
        bright = cv2.resize(bright.astype(np.float32), shape[::-1], interpolation=cv2.INTER_CUBIC)
        return bright[..., None] * self.tint.astype(np.float32)

    def exposure(self, time_s: float) -> float:
        return 1 + self.drift * np.sin(2 * np.pi * time_s / self.drift_s + 1.0)

    def bands(self, time_s: float, rows: int) -> np.ndarray:
        """What flicker makes of each row (rows, 1, 1) in sRGB, read over 16 ms, twice brightest in a period of 20 ms."""
        when_s = time_s + 0.016 * np.arange(rows) / rows
        return (1 + self.flicker * np.sin(2 * np.pi * 100 * when_s)).astype(np.float32)[:, None, None] ** (1 / 2.2)


def _lamp(rng: np.random.Generator, strength: float) -> Lamp:
    """Mostly from above and before the body, somewhat to one side."""
    direction = np.array([rng.normal(0, 0.55), -abs(rng.normal(0.5, 0.35)), rng.uniform(0.55, 1.1)])
    return Lamp(direction / np.linalg.norm(direction), strength)


def light(rng: np.random.Generator, *, close: bool) -> Light:
    """Some light: one lamp or two and a pool of each on the wall; a shadow, mostly, of what hangs close before it."""
    count = int(rng.choice([1, 2], p=[0.6, 0.4]))
    lamps = tuple(_lamp(rng, s) for s in rng.dirichlet([4] * count) * rng.uniform(0.45, 0.75))
    warm = rng.normal(0, 0.05)
    first = lamps[0].direction
    away = rng.uniform(4, 40) * np.array([-first[0], -first[1]]) / first[2]
    return Light(
        lamps=lamps,
        ambient=1.0 - sum(lamp.strength * max(0.0, (lamp.direction[2] + 0.25) / 1.25) for lamp in lamps),
        tint=np.array([1 + warm, 1.0, 1 - 1.3 * warm]),
        pools=tuple(
            (
                0.5 + 0.9 * lamp.direction[0],
                0.5 + 0.7 * lamp.direction[1],
                rng.uniform(0.3, 0.8),
                rng.uniform(0.15, 0.9),
            )
            for lamp in lamps
        ),
        drift=float(rng.choice([0.005, 0.02, 0.07], p=[0.5, 0.35, 0.15])),
        drift_s=rng.uniform(2, 9),
        flicker=float(rng.choice([0, rng.uniform(0.01, 0.05)], p=[0.87, 0.13])),
        shadow_px=(float(away[0]), float(away[1])) if close and rng.random() < 0.6 else None,
        shadow_blur_px=float(np.hypot(*away) * rng.uniform(0.08, 0.3) + 1.5),
        shadow_depth=rng.uniform(0.12, 0.5),
    )
