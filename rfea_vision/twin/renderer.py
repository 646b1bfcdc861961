"""Pictures of the tube, with everything a real camera adds.

The silhouette in the plane of motion is drawn by exact coverage, then blurred, lit unevenly and given sensor noise.
The shutter is instantaneous unless the scene says otherwise. What is left out: the shadow and the depth of the round tube.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.twin.camera import Camera
from rfea_vision.twin.coverage import coverage
from rfea_vision.twin.draw import Posture
from rfea_vision.twin.stress import MAINS_HZ, Stress

Picture = NDArray[np.floating]

SAMPLES = 400  # of each edge of the tube: chords 0.4 mm long, 0.002 px from the arc
NOISE_FRAMES = 31  # pictures of noise, drawn once and shown in random order
HOSE_LEVEL = 95.0  # grey levels of 255
SLEEVE_WIDE = 1.4  # times the tube
BAND_MM = 2.0  # along the tube
SHUTTER_STEPS = 7  # exposures that are added up to a blurred one


@dataclass(frozen=True)
class Scenery:
    """What is in front of the camera, in grey levels, and how the camera blurs and disturbs it.

    Attributes
    ----------
    wall, clamp, tube, highlight : grey levels of the surfaces in full light
    light : (height, width) share of full light in each pixel
    clamp_mm : (k, 2) outline of the clamp block in the plane of motion
    blur_px : standard deviation of the lens's and sensor's blur
    noise : standard deviation of the sensor's noise, grey levels
    pattern : (height, width) grey levels of clutter on the wall, or None
    hose_mm : (k, 2) outline in the plane of motion of what hangs before the tube, or None
    shade : (height, width) share of the light that a shadow leaves while filming, or None
    stress : what else makes the film hard: flicker, brightness, an open shutter, a band or a sleeve on the tube
    """

    wall: float
    clamp: float
    tube: float
    highlight: float
    light: Picture
    clamp_mm: FloatArray
    blur_px: float
    noise: float
    pattern: Picture | None = None
    hose_mm: FloatArray | None = None
    shade: Picture | None = None
    stress: Stress = field(default_factory=Stress)


def draw_scene(
    camera: Camera, outer_radius_mm: float, dark_tube: bool | None, noise: float, generator: np.random.Generator
) -> Scenery:
    """Draw surfaces and light."""
    dark = bool(generator.integers(2)) if dark_tube is None else dark_tube
    jitter = generator.uniform(-8, 8, 4)
    wall, clamp, tube = (208.0, 118.0, 46.0) if dark else (44.0, 122.0, 205.0)
    half, tall = generator.uniform(3.0, 4.0) * outer_radius_mm, generator.uniform(6.0, 8.0) * outer_radius_mm
    return Scenery(
        wall=wall + jitter[0],
        clamp=clamp + jitter[1],
        tube=tube + jitter[2],
        highlight=tube + jitter[2] + (14.0 if dark else -14.0),
        light=_uneven_light(camera.width, camera.height, generator),
        clamp_mm=np.array([[-half, 0.0], [half, 0.0], [half, tall], [-half, tall]]),
        blur_px=generator.uniform(0.7, 1.0),
        noise=noise,
    )


def _uneven_light(width: int, height: int, generator: np.random.Generator) -> Picture:
    """A lamp to one side, the lens's falling off, and slow blotches: 0.8 to 1.05 of full light."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    slope = generator.uniform(-0.06, 0.06, 2)
    light = 1.0 + slope[0] * x + slope[1] * y - generator.uniform(0.03, 0.07) * (x**2 + y**2)
    for _ in range(3):
        kx, ky, phase = generator.uniform(1.0, 4.0), generator.uniform(1.0, 4.0), generator.uniform(0, 2 * np.pi)
        light += 0.008 * np.sin(kx * x + ky * y + phase)
    return light.astype(np.float32)


def tube_outline_mm(posture: Posture, extend_mm: float, inset: float = 1.0, sleeve_mm: float = 0.0) -> FloatArray:
    """Outline of the tube in every frame, (T, 2 SAMPLES + 2, 2) in mm: one edge down, across the tip, the other up.

    Parameters
    ----------
    extend_mm : by how much the outline reaches into the clamp
    inset : distance of the edges from the centre line, in outer radii
    sleeve_mm : length of a wider sleeve on the tube's end
    """
    fraction = np.linspace(0.0, 1.0, SAMPLES)
    on_sleeve = fraction > 1 - sleeve_mm / (1e3 * float(np.sum(posture.lengths)))
    edge = inset * np.where(on_sleeve, SLEEVE_WIDE, 1.0)[None, :, None]
    outer, _ = posture.line(fraction, edge)
    inner, _ = posture.line(fraction, -edge)
    up = np.array([0.0, extend_mm])
    return np.concatenate([outer[:, :1] + up, outer, inner[:, ::-1], inner[:, :1] + up], axis=1)


def _band_mm(posture: Posture, begin_mm: float) -> FloatArray:
    """Outline of a painted band in every frame, (T, 16, 2) in mm."""
    fraction = np.linspace(begin_mm, begin_mm + BAND_MM, 8) / (1e3 * float(np.sum(posture.lengths)))
    outer, _ = posture.line(fraction, 1.0)
    inner, _ = posture.line(fraction, -1.0)
    return np.concatenate([outer, inner[:, ::-1]], axis=1)


def _while_open(outlines: FloatArray, index: int, shutter: float) -> list[FloatArray]:
    """Outlines (k, 2) while the shutter is open around frame `index`: the motion through the frames beside it."""
    here = outlines[index]
    if not shutter:
        return [here]
    before, after = outlines[max(index - 1, 0)], outlines[min(index + 1, len(outlines) - 1)]
    steps = shutter * ((np.arange(SHUTTER_STEPS) + 0.5) / SHUTTER_STEPS - 0.5)
    return [here + 0.5 * step * (after - before) + 0.5 * step**2 * (after - 2 * here + before) for step in steps]


def _mean_coverage(outlines: list[FloatArray], left: int, top: int, size: tuple[int, int]) -> Picture:
    return np.mean([coverage([outline], left, top, *size) for outline in outlines], axis=0)


def frames(
    camera: Camera, scene: Scenery, posture: Posture, generator: np.random.Generator, times_s: FloatArray
) -> Iterator[NDArray[np.uint8]]:
    """Yield the picture of every posture; `times_s` (frames,) are theirs, for lamps that flicker."""
    width, height = camera.width, camera.height
    block = coverage([camera.project_plane(finely(scene.clamp_mm))], 0, 0, width, height)
    light = scene.light if scene.shade is None else scene.light * scene.shade
    wall = (scene.wall if scene.pattern is None else scene.wall + scene.pattern) * light
    sharp = wall + (scene.clamp * light - wall) * block
    hidden = np.zeros_like(block)
    if scene.hose_mm is not None:
        hidden = coverage([camera.project_plane(finely(scene.hose_mm))], 0, 0, width, height)
    before = HOSE_LEVEL * light
    still = blurred(sharp + hidden * (before - sharp), scene.blur_px)
    gain = 1 + scene.stress.flicker * np.sin(2 * np.pi * MAINS_HZ * times_s + generator.uniform(0, 2 * np.pi))
    gain = gain * scene.stress.bright
    noise = (scene.noise * generator.standard_normal((NOISE_FRAMES, height, width))).astype(np.float32)
    tube = camera.project_plane(tube_outline_mm(posture, 3.0, sleeve_mm=scene.stress.sleeve))
    stripe = camera.project_plane(tube_outline_mm(posture, 3.0, 0.45))
    bands = camera.project_plane(_band_mm(posture, scene.stress.band)) if scene.stress.band else None
    margin = int(np.ceil(5 * scene.blur_px)) + 2
    order = _noise_order(tube.shape[0], generator)
    for index in range(tube.shape[0]):
        seen = _while_open(tube, index, scene.stress.shutter)
        left, top = np.maximum(np.floor(np.min(seen, axis=(0, 1))).astype(int) - margin, 0)
        right, bottom = np.minimum(np.ceil(np.max(seen, axis=(0, 1))).astype(int) + margin, (width, height))
        size = (int(right - left), int(bottom - top))
        body = _mean_coverage(seen, left, top, size)
        shine = _mean_coverage(_while_open(stripe, index, scene.stress.shutter), left, top, size)
        window = (slice(top, bottom), slice(left, right))
        free = 1 - block[window]
        surface = scene.tube + (scene.highlight - scene.tube) * shine
        if bands is not None:
            painted = 0.5 * (scene.tube + scene.wall)
            surface = surface + (painted - surface) * coverage([bands[index]], left, top, *size)
        # Where clamp and tube share a pixel, the tube takes the wall's part of it, not the clamp's.
        patch = sharp[window] + body * free * (surface * light[window] - wall[window])
        patch = patch + hidden[window] * (before[window] - patch)
        # what lies within the blur of the window's rim is still background
        inner = blurred(patch, scene.blur_px)
        yield _develop(still, inner, left, top, noise[order[index]], gain[index])


def _noise_order(count: int, generator: np.random.Generator) -> NDArray[np.int64]:
    """Which stored noise each frame takes: at random, but never the same twice in a row."""
    order = generator.integers(0, NOISE_FRAMES, count)
    for index in range(1, count):
        if order[index] == order[index - 1]:
            order[index] = (order[index] + 1 + index % (NOISE_FRAMES - 1)) % NOISE_FRAMES
    return order


def blurred(picture: Picture, sigma: float) -> Picture:
    """A picture (rows, columns) as a lens with a Gaussian blur of standard deviation `sigma` px shows it."""
    size = 2 * int(np.ceil(4 * sigma)) + 1
    blurred = cv2.GaussianBlur(picture, (size, size), sigma, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, dtype=np.float32)


@njit(cache=True)
def _develop(still: Picture, patch: Picture, left: int, top: int, noise: Picture, gain: float) -> NDArray[np.uint8]:
    """Put the patch on the still background, dim or brighten, add noise, round to grey levels."""
    height, width = still.shape
    out = np.empty((height, width), np.uint8)
    bottom, right = top + patch.shape[0], left + patch.shape[1]
    for row in range(height):
        for column in range(width):
            if top <= row < bottom and left <= column < right:
                value = patch[row - top, column - left]
            else:
                value = still[row, column]
            out[row, column] = np.uint8(min(max(value * gain + noise[row, column] + np.float32(0.5), 0.0), 255.0))
    return out


def finely(outline: FloatArray, pieces: int = 24) -> FloatArray:
    """Cut each side of a polygon (corners, 2) into pieces, because a lens bends straight lines."""
    share = np.arange(pieces)[:, None] / pieces
    ends = np.roll(outline, -1, axis=0)
    return np.concatenate([start + share * (end - start) for start, end in zip(outline, ends, strict=True)])
