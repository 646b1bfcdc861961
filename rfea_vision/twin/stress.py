"""What makes a scene hard: `--scene NAME[=VALUE]` of `rfea simulate`, and the pictures' disturbances themselves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.errors import InputError

MAINS_HZ = 100.0  # lamps on 50 Hz mains
SLOW_MOTION_HZ = 30.0  # at which phones play 240 frames/s back
VFR_JITTER = 0.3  # of the time between frames


@dataclass(frozen=True)
class Stress:
    """A hard scene; every default is harmless.

    Attributes
    ----------
    light, dark : the tube before a wall of the other kind (drawn where neither is asked for)
    busy : standard deviation of a pattern on the wall, grey levels
    uneven : by how much the light falls off across the picture, as a share
    flicker : amplitude of the lamps' brightness at 100 Hz, as a share
    hose : a hose of this width in mm hangs before the tube
    landscape : pictures wider than high
    vfr : frames at uneven times, as phones take them
    slow_motion : a container that plays at 30 frames/s what was recorded faster
    dropped, duplicated : share of frames that are missing, or show the frame before
    highlight : grey levels by which a stripe along the tube is lighter (of a dark tube) or darker
    shadow : share of the light that the shadow of a thing in front takes away, with a hard edge
    bright : factor of the light when filming; beyond about 1.2 the camera cannot tell the lightest surfaces apart
    shutter : share of the time between frames for which the shutter is open
    band : a band 2 mm wide is painted on the tube this many mm below the clamp
    sleeve : a sleeve of this length in mm, 1.4 times as wide as the tube, sits on its end
    """

    light: bool = False
    dark: bool = False
    busy: float = 0.0
    uneven: float = 0.0
    flicker: float = 0.0
    hose: float = 0.0
    landscape: bool = False
    vfr: bool = False
    slow_motion: bool = False
    dropped: float = 0.0
    duplicated: float = 0.0
    highlight: float = 0.0
    shadow: float = 0.0
    bright: float = 1.0
    shutter: float = 0.0
    band: float = 0.0
    sleeve: float = 0.0


#: What a word alone stands for.
_USUAL = {"busy": 12.0, "uneven": 0.3, "flicker": 0.05, "hose": 6.0, "dropped": 0.02, "duplicated": 0.02}
_USUAL |= {"highlight": 60.0, "shadow": 0.5, "bright": 1.5, "shutter": 0.5, "band": 1.0, "sleeve": 8.0}
_MOST: dict[str, float] = {"uneven": 0.5, "flicker": 0.5, "dropped": 0.5, "duplicated": 0.5}
_MOST |= {"highlight": 150.0, "shadow": 0.9, "bright": 4.0, "shutter": 1.0}


def parse_scene(items: Iterable[str]) -> Stress:
    """Read ``busy``, ``busy=12``, ``vfr``, ``dropped=0.05``.

    Raises
    ------
    InputError
        If a name is unknown, or its value is not a number that makes sense.
    """
    scene = Stress()
    kinds = {item.name: type(item.default) for item in fields(Stress)}
    for item in items:
        name, separator, text = (part.strip() for part in item.partition("="))
        name = name.replace("-", "_")
        if name not in kinds:
            raise InputError(f"--scene {item}: '{name}' is unknown; there are {', '.join(kinds)}")
        if kinds[name] is bool:
            if separator:
                raise InputError(f"--scene {item}: '{name}' takes no value; write --scene {name}")
            scene = replace(scene, **{name: True})
            continue
        try:
            value = float(text) if separator else _USUAL[name]
        except ValueError:
            value = float("nan")
        most = _MOST.get(name, 60.0)
        if not 0 <= value <= most:
            raise InputError(
                f"--scene {item}: '{text}' is not a number from 0 to {most:g}; write --scene {name}={_USUAL[name]:g}"
            )
        scene = replace(scene, **{name: value})
    if scene.light and scene.dark:
        raise InputError("--scene light and --scene dark exclude each other; keep one")
    return scene


def frame_times(count: int, rate_Hz: float, scene: Stress, seed: int) -> FloatArray:
    """Time stamps (frames,) in s, the first at 0: uneven and with gaps where the scene asks for it."""
    generator = np.random.default_rng([seed, 5])
    times = np.arange(count) / rate_Hz
    if scene.vfr:
        times[1:] += generator.uniform(-VFR_JITTER, VFR_JITTER, count - 1) / rate_Hz
    if scene.dropped:
        keep = generator.uniform(size=count) >= scene.dropped
        keep[:3] = True
        times = times[keep]
    return times


def shown_frames(count: int, scene: Stress, seed: int) -> NDArray[np.int64]:
    """Which picture every frame (frames,) shows: its own, or the one before where the camera repeated itself."""
    shown = np.arange(count)
    if scene.duplicated:
        again = np.random.default_rng([seed, 6]).uniform(size=count) < scene.duplicated
        again[:3] = False
        shown[again] -= 1
    return shown


def wall_pattern(width: int, height: int, busy: float, generator: np.random.Generator) -> FloatArray:
    """Grey levels (rows, columns) of a wall with clutter: soft patches of two sizes, and lines."""
    pattern = np.zeros((height, width), np.float32)
    for size in (4.0, 25.0):
        patch = cv2.GaussianBlur(generator.standard_normal((height, width)).astype(np.float32), (0, 0), size)
        pattern += np.asarray(patch / patch.std(), dtype=np.float32)
    for _ in range(6):
        ends = generator.uniform([0, 0], [width, height], (2, 2)).astype(int)
        cv2.line(pattern, ends[0].tolist(), ends[1].tolist(), float(generator.choice([-2.5, 2.5])), 2, cv2.LINE_AA)
    return busy * (pattern - pattern.mean()) / pattern.std()


def hose_mm(width: float, lower: FloatArray, upper: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Outline (4, 2) mm of a hose that crosses the picture in front of the tube, below its upper third."""
    span = upper - lower
    level = lower[1] + span[1] * generator.uniform(0.5, 0.6)
    slope = generator.uniform(-0.25, 0.25)
    left, right = lower[0] - span[0], upper[0] + span[0]
    low = [level + slope * left, level + slope * right]
    return np.array([[left, low[0]], [right, low[1]], [right, low[1] + width], [left, low[0] + width]])


def shadow_of(share: float, width: int, height: int) -> NDArray[np.float32]:
    """Share of the light that is left, (height, width): a slanting stripe of the picture lies in the shadow."""
    x, y = np.meshgrid(np.arange(width) / width, np.arange(height) / height)
    shaded = np.abs(y + 0.2 * x - 0.5) < 0.09
    return np.where(shaded, 1.0 - share, 1.0).astype(np.float32)
