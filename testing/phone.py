"""Films as phones take them, of known truth: the second renderer of the measurement tests.

Every pixel is asked where on the arm it lies (place along the centre line, place across it) and shaded there:
translucent rubber with rims, glare and bubbles, marks, bellows, tape, on ruled paper, through perspective, exposure that
drifts, and H.264. Nothing here is shared with the package, nor with the renderer in `scenes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from testing.encoding import encode

PIECES = 500


@dataclass(frozen=True)
class Arm:
    """The arm and what it looks like; lengths in mm."""

    length: float = 90.0
    half_width: float = 6.0
    taper: float = 0.0  # share of the width that is lost towards the tip
    bellows: int = 0
    opacity: float = 1.0
    rgb: tuple[float, float, float] = (120.0, 140.0, 160.0)
    glare: float = 0.0
    marks: int = 0
    mark_rgb: tuple[float, float, float] = (190.0, 40.0, 40.0)
    tape_end: float = 0.0  # mm of the end under tape
    ragged: float = 0.0  # mm
    swell: float = 0.2  # growth of the width at the greatest bend
    stretch: float = 0.08  # growth of the length
    texture: float = 6.0
    shadow: float = 0.0  # that it throws on the wall beside it
    heading_deg: float = 0.0  # of the arm at its clamp: 0 hangs down, 90 points to the camera's right


@dataclass(frozen=True)
class Room:
    """What is around the arm, the camera, and the file."""

    size: tuple[int, int] = (360, 480)
    px_per_mm: float = 3.0
    clamp: tuple[float, float] = (180.0, 60.0)
    paper: float = 215.0
    ruled: float = 0.0  # mm from line to line; 0: none
    clutter: int = 0  # pins, tape, a cable
    shade: float = 0.15
    noise: float = 4.0
    drift: float = 0.03  # of the exposure
    blur: float = 0.8
    tilt_deg: float = 0.0
    crf: int = 28
    seed: int = 0
    more: Callable[[np.ndarray], None] | None = None  # draws what else hangs on the wall


@dataclass(frozen=True)
class Truth:
    """What the film shows: centre lines (t, 65, 2) px, hints, and the tip (t, 2) mm from the clamp, x right, y up."""

    times_s: np.ndarray
    centre_px: np.ndarray
    tip_mm: np.ndarray
    clamp_px: tuple[tuple[float, float], tuple[float, float]]
    tip_px: tuple[float, float]
    middle_px: tuple[tuple[float, float], ...]
    px_per_mm: float
    arm: Arm = field(default_factory=Arm)

    @property
    def half_width_px(self) -> float:
        """Half the arm's width at rest."""
        return self.arm.half_width * self.px_per_mm

    @property
    def length_mm(self) -> float:
        """Of the arm at rest."""
        return self.arm.length


def centre_line(arm: Arm, bend: float, fullness: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) mm with y down and headings (n,) of an arm bent by `bend` rad, filled by `fullness` of 1."""
    s = np.linspace(0, 1, PIECES)
    curvature = bend * (1.2 - 0.4 * s)
    heading = np.radians(arm.heading_deg) + np.concatenate([[0], np.cumsum((curvature[1:] + curvature[:-1]) / 2)]) / (
        PIECES - 1
    )
    step = arm.length * (1 + arm.stretch * fullness) / (PIECES - 1)
    along = np.column_stack([np.sin(heading), np.cos(heading)])
    points = np.vstack([[0, 0], np.cumsum((along[1:] + along[:-1]) / 2 * step, axis=0)])
    return points, heading


def film(
    path: Path,
    arm: Arm,
    room: Room,
    bends_rad: np.ndarray,
    *,
    rate_Hz: float = 30.0,
    hand: tuple[int, int] = (0, 0),
    view: Callable[[int], np.ndarray] | None = None,
) -> Truth:
    """Render and encode one film; bends are positive to the camera's right for an arm that hangs.

    From frame `hand[0]` to before `hand[1]` a hand covers most of the picture below the clamp. A camera that moves
    shows at `view(frame)` (2, 3), an affine map of pixels, what it would have shown, had it stayed.
    """
    rng = np.random.default_rng(room.seed)
    wall = _wall(room, rng)
    skin = cv2.GaussianBlur(rng.normal(0, 1, (64, 512)), (0, 0), 2.0)
    skin *= arm.texture / skin.std()
    notches = rng.uniform(-1, 1, 24)
    warp = _tilted(room)
    fullest = float(np.abs(bends_rad).max())
    fullnesses = [abs(float(bend)) / fullest if fullest else 0.0 for bend in bends_rad]
    shapes = [centre_line(arm, float(bend), full) for bend, full in zip(bends_rad, fullnesses, strict=True)]

    def pictures() -> Iterator[np.ndarray]:
        for number, ((points, heading), fullness) in enumerate(zip(shapes, fullnesses, strict=True)):
            picture = _shaded(arm, room, wall, skin, notches, points, heading, fullness)
            picture = cv2.warpPerspective(
                picture, warp, room.size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            if hand[0] <= number < hand[1]:
                picture[round(room.clamp[1] + 20) :] = (205, 160, 135)
            if view is not None:
                picture = cv2.warpAffine(
                    picture, view(number), room.size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
                )
            picture = cv2.GaussianBlur(picture, (0, 0), room.blur)
            picture = picture * (1 + room.drift * np.sin(0.07 * number)) + rng.normal(0, room.noise, picture.shape)
            yield np.clip(picture, 0, 255).astype(np.uint8)

    encode(path, pictures(), room.size, rate_Hz, room.crf, "fast")
    lines = [_seen(points[np.linspace(0, PIECES - 1, 65).astype(int)], room, warp) for points, _ in shapes]
    heading = shapes[0][1]
    across = np.array([np.cos(heading[0]), -np.sin(heading[0])]) * arm.half_width
    clamp = _seen(np.array([-across, across]), room, warp)
    return Truth(
        np.arange(len(bends_rad)) / rate_Hz,
        np.array(lines),
        np.array([points[-1] * [1, -1] for points, _ in shapes]),
        tuple(map(tuple, clamp)),
        tuple(lines[0][-1]),
        tuple(map(tuple, lines[0][[16, 32, 48]])),
        room.px_per_mm,
        arm,
    )


def _tilted(room: Room) -> np.ndarray:
    """Perspective of a camera that is turned about both axes; the scale at the clamp stays."""
    focal, angle = 1.1 * max(room.size), np.radians(room.tilt_deg)
    middle = np.eye(3)
    middle[:2, 2] = room.clamp
    turn = cv2.Rodrigues(np.array([angle, 0.6 * angle, 0.0]))[0]
    lens = np.diag([focal, focal, 1.0])
    plane = np.column_stack([turn[:, 0], turn[:, 1], [0.0, 0.0, 1.0]])
    return middle @ lens @ plane @ np.linalg.inv(lens) @ np.linalg.inv(middle)


def _seen(points_mm: np.ndarray, room: Room, warp: np.ndarray) -> np.ndarray:
    flat = points_mm * room.px_per_mm + np.array(room.clamp)
    return cv2.perspectiveTransform(flat[None], warp)[0]


def _wall(room: Room, rng: np.random.Generator) -> np.ndarray:
    """The wall (h, w, 3): paper, its ruling, things on it, and uneven light."""
    w, h = room.size
    wall = np.full((h, w, 3), room.paper) * np.array([1.0, 0.99, 0.96])
    if room.ruled:
        step = room.ruled * room.px_per_mm
        for k in range(int(h / step) + 1):
            cv2.line(wall, (0, round(k * step + 7)), (w, round(k * step + 9)), (130, 160, 205), 1, cv2.LINE_AA)
        for k in range(int(w / step) + 1):
            cv2.line(wall, (round(k * step + 5), 0), (round(k * step + 3), h), (150, 175, 210), 1, cv2.LINE_AA)
    for _ in range(room.clutter):
        kind, place = rng.integers(3), rng.uniform([0.0, 0.35 * h], [w, h])
        away = np.array([place[0] + rng.uniform(-120, 120), place[1] + rng.uniform(-120, 120)])
        ends = tuple(place.astype(int)), tuple(away.astype(int))
        if kind == 0:
            cv2.circle(wall, ends[0], 4, (40, 40, 150), -1, cv2.LINE_AA)
        elif kind == 1:
            cv2.line(wall, *ends, (205, 195, 150), 14, cv2.LINE_AA)
        else:
            cv2.line(wall, *ends, (60, 60, 60), 4, cv2.LINE_AA)
    if room.more is not None:
        room.more(wall)
    yy, xx = np.mgrid[0:h, 0:w]
    wall *= (1 + room.shade * (xx / w - 0.5) - 0.5 * room.shade * (yy / h))[..., None]
    return wall + cv2.GaussianBlur(rng.normal(0, 1, (h, w, 1)), (0, 0), 1.5)[..., None] * 6


def _shaded(arm, room, wall, skin, notches, points, heading, fullness) -> np.ndarray:
    """The picture (h, w, 3) before the camera."""
    scale = room.px_per_mm
    line = points * scale + np.array(room.clamp)
    reach = 2.0 * arm.half_width * scale * (1 + arm.swell)
    w, h = room.size
    low = np.maximum(np.floor(line.min(axis=0) - reach), 0).astype(int)
    high = np.minimum(np.ceil(line.max(axis=0) + reach), [w, h]).astype(int)
    yy, xx = np.mgrid[low[1] : high[1], low[0] : high[0]]
    pixels = np.column_stack([xx.ravel(), yy.ravel()]).astype(float)
    away, nearest = cKDTree(line).query(pixels, distance_upper_bound=reach)
    near = np.isfinite(away)
    pixels, nearest = pixels[near], nearest[near]
    tangent = np.column_stack([np.sin(heading), np.cos(heading)])[nearest]
    offset = pixels - line[nearest]
    across = (offset[:, 0] * tangent[:, 1] - offset[:, 1] * tangent[:, 0]) / scale
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    along = nearest / (PIECES - 1) * length + np.sum(offset * tangent, axis=1) / scale
    share = np.clip(along / length, 0, 1)
    half = (
        arm.half_width * (1 - arm.taper * share) * (1 + arm.swell * fullness * np.sin(np.pi * np.clip(share, 0.05, 1)))
    )
    if arm.bellows:
        half = half * (1 + 0.12 * np.cos(2 * np.pi * arm.bellows * share))
    end = length + arm.ragged * np.interp(across / half, np.linspace(-1, 1, len(notches)), notches)
    inside = np.clip((half - np.abs(across)) * scale + 0.5, 0, 1) * np.clip((end - along) * scale + 0.5, 0, 1)
    inside = inside * (along > -2.0)
    v = np.clip(across / half, -1, 1)
    behind = wall[pixels[:, 1].astype(int), np.clip(pixels[:, 0] + 3 * v, 0, w - 1).astype(int)]
    rubber = np.array(arm.rgb) * (1 - 0.35 * np.abs(v) ** 4)[:, None]
    rubber += skin[((v + 1) * 31).astype(int), (share * 511).astype(int)][:, None]
    if arm.bellows:
        rubber *= (1 + 0.15 * np.cos(2 * np.pi * arm.bellows * share))[:, None]
    colour = arm.opacity * rubber + (1 - arm.opacity) * behind * np.array(arm.rgb) / max(arm.rgb) * 0.92
    rim = np.exp(-(((np.abs(v) - 0.95) / 0.06) ** 2))[:, None]
    colour *= 1 - 0.25 * rim
    if arm.glare:
        facing = 0.55 + 0.45 * np.cos(heading[nearest] - 0.6)
        colour += (arm.glare * facing * np.exp(-(((v + 0.35) / 0.12) ** 2)))[:, None] * 255
    for k in range(arm.marks):
        dot = (along - (k + 0.7) / (arm.marks + 0.2) * length) ** 2 + across**2 < (0.3 * arm.half_width) ** 2
        colour[dot] = arm.mark_rgb
    if arm.tape_end:
        colour = np.where(
            (along > length - arm.tape_end)[:, None], 0.75 * np.array([225, 215, 190]) + 0.25 * colour, colour
        )
    out = wall.copy()
    if arm.shadow:
        thrown, beside = np.zeros((h, w), dtype=np.float32), arm.half_width * scale * np.array([0.5, 0.35])
        place = np.round((line[::5] + beside) * 16).astype(np.int32)
        cv2.polylines(thrown, [place], False, 1.0, round(1.8 * arm.half_width * scale), cv2.LINE_AA, 4)
        out *= (1 - arm.shadow * cv2.GaussianBlur(thrown, (0, 0), 0.35 * arm.half_width * scale))[..., None]
    rows, columns = pixels[:, 1].astype(int), pixels[:, 0].astype(int)
    out[rows, columns] += inside[:, None] * (colour - out[rows, columns])
    block = np.array([[-14.0, -16], [14, -16], [14, 0], [-14, 0]])
    turn = np.radians(arm.heading_deg)
    block = block @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    cv2.fillPoly(
        out, [np.round((block * scale + np.array(room.clamp)) * 16).astype(np.int32)], (90, 85, 80), cv2.LINE_AA, 4
    )
    return out


def scene(number: int) -> tuple[Arm, Room, np.ndarray]:
    """Scene `number` of any count: arm, room and bends, from a table of what phones see."""
    rng = np.random.default_rng(1000 + number)
    colours = [(118, 140, 165), (200, 200, 195), (60, 60, 65), (220, 180, 120), (90, 150, 120), (170, 120, 130)]
    heading = float(rng.choice([0.0, 0.0, 0.0, 90.0, -90.0]))
    size, clamp = {
        0.0: ((360, 480), (180.0, 70.0)),
        90.0: ((480, 360), (70.0, 150.0)),
        -90.0: ((480, 360), (410.0, 150.0)),
    }[heading]
    arm = Arm(
        length=float(rng.uniform(70, 95)),
        half_width=float(rng.uniform(4.0, 8.0)),
        taper=float(rng.choice([0.0, 0.0, 0.25, 0.45])),
        bellows=int(rng.choice([0, 0, 0, 8])),
        opacity=float(rng.choice([1.0, 0.85, 0.7, 0.55])),
        rgb=colours[int(rng.integers(len(colours)))],
        glare=float(rng.choice([0.0, 0.25, 0.5])),
        marks=int(rng.choice([0, 0, 1, 4])),
        tape_end=float(rng.choice([0.0, 0.0, 6.0])),
        ragged=float(rng.choice([0.0, 0.5, 1.2])),
        swell=float(rng.uniform(0.0, 0.35)),
        stretch=float(rng.uniform(0.0, 0.15)),
        heading_deg=heading,
    )
    room = Room(
        size=size,
        clamp=clamp,
        paper=float(rng.uniform(150, 230)),
        ruled=float(rng.choice([0.0, 5.0, 8.0])),
        clutter=int(rng.integers(0, 6)),
        shade=float(rng.uniform(0.0, 0.35)),
        noise=float(rng.uniform(2.0, 6.0)),
        drift=float(rng.uniform(0.0, 0.05)),
        blur=float(rng.uniform(0.6, 1.2)),
        tilt_deg=float(rng.uniform(0.0, 2.0)),
        seed=number,
    )
    count = 90
    t = np.arange(count) / (count - 1)
    most = float(rng.uniform(0.6, 2.6)) * float(rng.choice([-1, 1]))
    steps = np.interp(t, [0, 0.1, 0.35, 0.5, 0.62, 0.9, 1.0], [0, 0, 0.5, 0.5, 1.0, 0.15, 0.1])
    wave = np.clip(0.5 - 0.5 * np.cos(2 * np.pi * t * float(rng.choice([1, 2]))), 0, 1)
    course = steps if rng.random() < 0.6 else wave
    return arm, room, 0.03 + most * course


def clear_scene(number: int) -> tuple[Arm, Room, np.ndarray]:
    """Scene `number` of any count: translucent blue-grey silicone on ruled paper of nearly its colour, which swells."""
    rng = np.random.default_rng(7000 + number)
    heading = float(rng.choice([0.0, 0.0, 90.0, -90.0]))
    size, clamp = {
        0.0: ((480, 480), (240.0, 70.0)),
        90.0: ((480, 400), (70.0, 190.0)),
        -90.0: ((480, 400), (410.0, 190.0)),
    }[heading]
    paper = float(rng.uniform(185, 230))
    grey = float(rng.uniform(0.72, 0.97))
    arm = Arm(
        length=float(rng.uniform(55, 90)),
        half_width=float(rng.uniform(4.5, 7.0)),
        taper=float(rng.choice([0.0, 0.0, 0.15])),
        opacity=float(rng.uniform(0.25, 0.65)),
        rgb=(0.9 * grey * paper, 0.97 * grey * paper, 1.03 * grey * paper),
        glare=float(rng.choice([0.15, 0.3, 0.45])),
        marks=int(rng.choice([0, 1, 2, 4])),
        tape_end=float(rng.choice([0.0, 0.0, 5.0, 8.0])),
        ragged=float(rng.choice([0.3, 1.0, 2.0])),
        swell=float(rng.uniform(0.1, 0.5)),
        stretch=float(rng.uniform(0.03, 0.22)),
        texture=float(rng.uniform(2.0, 5.0)),
        shadow=float(rng.choice([0.0, 0.1, 0.2])),
        heading_deg=heading,
    )
    room = Room(
        size=size,
        px_per_mm=3.4,
        clamp=clamp,
        paper=paper,
        ruled=float(rng.choice([0.0, 5.0, 7.0, 8.0])),
        clutter=int(rng.integers(0, 5)),
        shade=float(rng.uniform(0.0, 0.3)),
        noise=float(rng.uniform(2.0, 5.0)),
        drift=float(rng.uniform(0.0, 0.04)),
        blur=float(rng.uniform(0.7, 1.3)),
        tilt_deg=float(rng.uniform(0.0, 2.0)),
        seed=100 + number,
    )
    t = np.linspace(0, 1, 160)
    most = float(rng.uniform(0.5, 2.2)) * float(rng.choice([-1, 1]))
    steps = np.interp(t, [0, 0.06, 0.3, 0.42, 0.6, 0.68, 0.92, 1.0], [0, 0, 0.6, 0.6, 1.0, 1.0, 0.05, 0.0])
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * t * float(rng.choice([1, 2])))
    return arm, room, 0.03 + most * (steps if rng.random() < 0.6 else wave)
