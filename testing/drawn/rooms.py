"""Rooms: what is seen behind a body, in linear light before any lamp: paper, walls, benches, tables, laboratories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from testing.drawn.skins import clouds

Rng = np.random.Generator
Painter = Callable[[Rng, int, int], np.ndarray]


Colour = tuple[float, float, float]


def _one_of(rng: Rng, colours: tuple[Colour, ...]) -> Colour:
    return colours[int(rng.integers(len(colours)))]


def _flat(h: int, w: int, colour: np.ndarray | tuple[float, ...]) -> np.ndarray:
    return np.ones((h, w, 3), np.float32) * np.asarray(colour, np.float32)


def _grainy(rng: Rng, picture: np.ndarray, strength: float, grain_px: float) -> np.ndarray:
    return picture * np.exp(strength * clouds(rng, picture.shape[:2], grain_px))[..., None]


def _laid(rng: Rng, under: np.ndarray, sheet: np.ndarray, turn_deg: float, scale: float = 1.0) -> np.ndarray:
    """A sheet as large as the picture, laid somewhat askew on what is under it, or filling it all."""
    h, w = under.shape[:2]
    move = cv2.getRotationMatrix2D((w / 2, h / 2), turn_deg, scale)
    move[:, 2] += rng.normal(0, 0.02, 2) * (w, h)
    flags = cv2.INTER_AREA
    cover = cv2.warpAffine(np.ones((h, w), np.float32), move, (w, h), flags=flags)[..., None]
    return cv2.warpAffine(sheet, move, (w, h), flags=flags) * cover + under * (1 - cover)


def _strokes(
    picture: np.ndarray, lines: list[np.ndarray], colour: tuple[float, ...], width_px: float, share: float
) -> None:
    """Lines (n, 2) px drawn smoothly, `width_px` wide."""
    cover = np.zeros(picture.shape[:2], np.float32)
    whole = max(1, round(width_px))
    for line in lines:
        cv2.polylines(cover, [np.round(np.asarray(line) * 16).astype(np.int32)], False, 1.0, whole, cv2.LINE_AA, 4)
    cover = (cover * share * min(1.0, width_px / whole))[..., None]
    picture[:] = picture * (1 - cover) + cover * np.asarray(colour, np.float32)


def _written(
    picture: np.ndarray, text: str, at: tuple[int, int], size: float, colour: tuple[float, ...], width: int
) -> None:
    cover = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(cover, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, 255, width, cv2.LINE_AA)
    share = (cover / np.float32(255))[..., None]
    picture[:] = picture * (1 - share) + share * np.asarray(colour, np.float32)


def _raster(h: int, w: int, pitch: float, start: float, upright: bool, level: bool) -> list[np.ndarray]:
    """Upright and level lines over a picture, so far beyond its edges as a small turn needs."""
    lines = []
    if upright:
        lines += [np.array([[x, -9], [x, h + 9]]) for x in np.arange(start, w, pitch)]
    if level:
        lines += [np.array([[-9, y], [w + 9, y]]) for y in np.arange(start, h, pitch)]
    return lines


def paper(rng: Rng, h: int, w: int) -> np.ndarray:
    sheet = _grainy(rng, _flat(h, w, rng.uniform(0.62, 0.85) * np.array([1, 0.99, 0.96])), 0.008, 3)
    if rng.random() < 0.6:
        return _grainy(rng, sheet, 0.015, 120)
    return _laid(rng, bench(rng, h, w), sheet, rng.normal(0, 2), rng.uniform(0.9, 1.05))


WALLS = (
    (0.6, 0.58, 0.52), (0.32, 0.42, 0.5), (0.5, 0.36, 0.26), (0.3, 0.42, 0.3), (0.2, 0.2, 0.21), (0.62, 0.5, 0.25), (0.12, 0.2, 0.36),
    (0.45, 0.45, 0.46),
)  # fmt: skip


def wall(rng: Rng, h: int, w: int) -> np.ndarray:
    picture = _grainy(rng, _flat(h, w, _one_of(rng, WALLS)), rng.uniform(0.01, 0.05), rng.uniform(2, 5))
    if rng.random() < 0.3:  # a skirting or the edge of a cupboard
        y = int(h * rng.uniform(0.75, 0.95))
        picture[y:] *= rng.uniform(0.3, 1.3)
        picture[y : y + 3] *= 0.5
    return picture


def graph_paper(rng: Rng, h: int, w: int) -> np.ndarray:
    sheet = _grainy(rng, _flat(h, w, rng.uniform(0.65, 0.82) * np.array([1, 1, 0.97])), 0.008, 4)
    pitch, major = rng.uniform(9, 22), int(rng.choice([5, 10]))
    ink = _one_of(rng, ((0.3, 0.5, 0.75), (0.35, 0.6, 0.35), (0.75, 0.4, 0.3), (0.4, 0.4, 0.4)))
    _strokes(sheet, _raster(h, w, pitch, 3.0, True, True), ink, 1.0, rng.uniform(0.2, 0.5))
    _strokes(sheet, _raster(h, w, pitch * major, 3.0, True, True), ink, 1.6, 0.7)
    return _laid(rng, _flat(h, w, (0.5, 0.5, 0.5)), sheet, rng.normal(0, 1.5), 1.1)


def ruled_paper(rng: Rng, h: int, w: int) -> np.ndarray:
    sheet = _grainy(rng, _flat(h, w, (0.78, 0.78, 0.74)), 0.008, 4)
    _strokes(sheet, _raster(h, w, rng.uniform(20, 40), 8.0, False, True), (0.3, 0.45, 0.75), 1.3, 0.5)
    _strokes(sheet, [np.array([[w * 0.12, 0], [w * 0.12, h]])], (0.8, 0.25, 0.25), 1.5, 0.6)
    return _laid(rng, bench(rng, h, w), sheet, rng.choice([0, 90]) + rng.normal(0, 3), 1.35)


def bench(rng: Rng, h: int, w: int) -> np.ndarray:
    tone = _one_of(rng, ((0.45, 0.27, 0.13), (0.6, 0.43, 0.26), (0.25, 0.14, 0.07), (0.5, 0.38, 0.28)))
    n = max(h, w)
    fibres = cv2.resize(clouds(rng, (n, n // 16), 2.0), (n, n), interpolation=cv2.INTER_CUBIC)
    rows = np.arange(n)[:, None] + 14 * clouds(rng, (n, n), 160)
    growth = np.sin(rows / rng.uniform(4, 9) + 2 * clouds(rng, (n, n), 90))
    picture = _flat(n, n, tone) * np.exp(0.09 * fibres + 0.07 * growth)[..., None]
    plank, at = rng.uniform(70, 200), rng.uniform(0, 60)
    while at < n:
        picture[int(at) : int(at) + 2] *= 0.45
        picture[int(at) :] *= np.exp(rng.normal(0, 0.08))
        at += plank
    if rng.random() < 0.5:
        picture = picture.transpose(1, 0, 2)
    return np.ascontiguousarray(picture[:h, :w], np.float32)


def optical_table(rng: Rng, h: int, w: int) -> np.ndarray:
    base = rng.choice([0.06, 0.3, 0.42])
    picture = _grainy(rng, _flat(h, w, (base, base, base * 1.04)), 0.03, 3)
    picture *= np.exp(0.03 * cv2.resize(clouds(rng, (h, 24), 2), (w, h)))[..., None]
    pitch = rng.uniform(48, 95)
    radius, start = pitch * rng.uniform(0.1, 0.14), rng.uniform(0, pitch, 2)
    for y in np.arange(start[1], h, pitch):
        for x in np.arange(start[0], w, pitch):
            for size, shift, factor in ((1.25, 0.6, 1.35), (1.0, 0.0, 0.12)):
                centre = (round((x + shift) * 16), round((y + shift) * 16))
                colour = tuple(float(min(base * factor, 0.8)) for _ in range(3))
                cv2.circle(picture, centre, round(radius * size * 16), colour, -1, cv2.LINE_AA, 4)
    return picture


def cloth(rng: Rng, h: int, w: int) -> np.ndarray:
    tone = _one_of(rng, ((0.012, 0.012, 0.014), (0.02, 0.02, 0.035), (0.05, 0.012, 0.015), (0.012, 0.012, 0.012)))
    folds = cv2.resize(clouds(rng, (h // 5, w // 2), 40), (w, h), interpolation=cv2.INTER_CUBIC)
    picture = _flat(h, w, tone) * np.exp(rng.uniform(0.08, 0.3) * folds)[..., None]
    return _grainy(rng, picture, 0.1, 1.6)


MATS = (
    ((0.02, 0.16, 0.1), (0.65, 0.65, 0.25)),
    ((0.03, 0.08, 0.25), (0.6, 0.65, 0.7)),
    ((0.04, 0.04, 0.045), (0.5, 0.5, 0.5)),
)


def cutting_mat(rng: Rng, h: int, w: int) -> np.ndarray:
    tone, ink = MATS[int(rng.choice(3, p=[0.6, 0.2, 0.2]))]
    mat = _grainy(rng, _flat(h, w, tone), 0.05, 2)
    pitch = rng.uniform(22, 48)
    _strokes(mat, _raster(h, w, pitch, 5.0, True, True), ink, 1.2, 0.45)
    _strokes(mat, _raster(h, w, 5 * pitch, 5.0, True, True), ink, 1.8, 0.6)
    if rng.random() < 0.5:
        _strokes(mat, [np.array([[5, h], [5 + h * 1.0, 0]]), np.array([[5, h], [5 + h * 0.577, 0]])], ink, 1.2, 0.5)
    for k, x in enumerate(np.arange(5.0, w, pitch)):
        _written(mat, str(k), (int(x) + 2, h - 8), 0.35, tuple(0.6 * c for c in ink), 1)
    return _laid(rng, bench(rng, h, w), mat, rng.normal(0, 2), rng.uniform(0.95, 1.2))


def backdrop(rng: Rng, h: int, w: int) -> np.ndarray:
    """A photographer's: nothing but a tone that changes slowly."""
    tone = rng.uniform(0.06, 0.6) * np.array([1, rng.uniform(0.92, 1.05), rng.uniform(0.85, 1.15)])
    fall = np.linspace(1, rng.uniform(0.4, 0.9), h)[:, None]
    return (_flat(h, w, tone) * fall[..., None]).astype(np.float32)


def laboratory(rng: Rng, h: int, w: int) -> np.ndarray:
    """Shelves with boxes and instruments, a bench with a screen, cables in loops; far behind, and so out of focus."""
    picture = _flat(h, w, rng.uniform(0.3, 0.6) * np.array([1, 0.97, 0.9]))
    y = h * rng.uniform(0.05, 0.2)
    while y < h * 0.7:
        deep = h * rng.uniform(0.12, 0.24)
        x = -rng.uniform(0, 60)
        while x < w:
            wide, tall = w * rng.uniform(0.04, 0.2), deep * rng.uniform(0.3, 0.9)
            if rng.random() < 0.75:
                colour = np.array([rng.uniform(0.05, 0.6)] * 3) * np.exp(
                    rng.normal(0, rng.choice([0.08, 0.4], p=[0.75, 0.25]), 3)
                )
                box = picture[max(0, int(y + deep - tall)) : int(y + deep), max(0, int(x)) : max(0, int(x + wide))]
                box[:] = np.clip(colour, 0.01, 0.85)
                box[: max(2, int(tall * 0.08))] *= 1.25
                if rng.random() < 0.4 and box.size:
                    box[box.shape[0] // 3 : box.shape[0] * 2 // 3, box.shape[1] // 5 : box.shape[1] * 4 // 5] = (
                        rng.uniform(0.3, 0.8)
                    )
            x += wide + w * rng.uniform(0, 0.05)
        picture[int(y + deep) : int(y + deep) + max(4, h // 90)] = rng.uniform(0.1, 0.6)
        y += deep + h * rng.uniform(0.02, 0.07)
    picture[int(h * 0.82) :] = rng.uniform(0.1, 0.5) * np.array([1, 0.9, 0.8])
    if rng.random() < 0.6:
        x, y = int(w * rng.uniform(0.0, 0.6)), int(h * rng.uniform(0.45, 0.6))
        wide, tall = int(w * 0.33), int(h * 0.2)
        cv2.rectangle(picture, (x - 6, y - 6), (x + wide + 6, y + tall + 6), (0.015, 0.015, 0.015), -1)
        cv2.rectangle(
            picture, (x, y), (x + wide, y + tall), tuple(rng.uniform(0.3, 0.6) * np.exp(rng.normal(0, 0.2, 3))), -1
        )
        for k in range(5):
            row, until = y + 12 + k * tall // 6, x + 8 + int(wide * rng.uniform(0.3, 0.9))
            cv2.line(picture, (x + 8, row), (until, row), (0.1, 0.12, 0.2), 3)
    for _ in range(int(rng.integers(2, 7))):
        t = np.linspace(0, 1, 40)[:, None]
        ends = rng.uniform(-0.1, 1.1, (2, 2)) * (w, h)
        sag = ends.mean(axis=0) + np.array([rng.normal(0, 0.1) * w, rng.uniform(0.1, 0.5) * h])
        cable = (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * sag + t**2 * ends[1]
        _strokes(
            picture,
            [cable],
            tuple(rng.choice([0.015, 0.3, 0.6]) * np.exp(rng.normal(0, 0.35, 3))),
            rng.uniform(3, 7),
            0.95,
        )
    return np.clip(picture, 0.005, 1)


@dataclass(frozen=True)
class Room:
    painter: Painter
    weight: float
    close: bool  # near enough to the body for its shadow
    out_of_focus_px: tuple[float, float] = (0.0, 0.8)


ROOMS: dict[str, Room] = {
    "plain paper": Room(paper, 1.5, True),
    "coloured wall": Room(wall, 1.3, True, (0, 3)),
    "graph paper": Room(graph_paper, 1.0, True),
    "ruled paper": Room(ruled_paper, 0.4, True),
    "wooden bench": Room(bench, 1.0, True),
    "optical table": Room(optical_table, 0.9, True),
    "laboratory": Room(laboratory, 1.4, False, (1.5, 6.0)),
    "black cloth": Room(cloth, 0.9, False),
    "cutting mat": Room(cutting_mat, 0.8, True),
    "backdrop": Room(backdrop, 0.6, False),
}


def pick(rng: Rng) -> str:
    weights = np.array([room.weight for room in ROOMS.values()])
    return str(rng.choice(list(ROOMS), p=weights / weights.sum()))


@lru_cache(maxsize=4)
def painted(name: str, seed: int, h: int, w: int) -> np.ndarray:
    """The room (h, w, 3) in linear light, as sharp as the camera sees it; read only."""
    rng = np.random.default_rng([seed, 4711])
    room = ROOMS[name]
    picture = np.asarray(room.painter(rng, h, w), np.float32)
    blur = rng.uniform(*room.out_of_focus_px)
    if name not in ("laboratory", "backdrop") and rng.random() < 0.45:
        _things(rng, picture)
    if blur > 0.3:
        picture = cv2.GaussianBlur(picture, (0, 0), blur)
    picture = np.clip(picture, 0.003, 0.95)
    picture.flags.writeable = False
    return picture


def _things(rng: Rng, picture: np.ndarray) -> None:
    """What lies or hangs about near the edges: a ruler, a label, a square mark, a pen, a rail, a cable."""
    h, w = picture.shape[:2]
    for kind in rng.choice(list(THINGS), size=int(rng.integers(1, 3)), replace=False):
        THINGS[str(kind)](rng, picture, h, w)


def _ruler(rng: Rng, picture: np.ndarray, h: int, w: int) -> None:
    """Along an edge of the picture, with a stroke per millimetre or so."""
    upright = rng.random() < 0.5
    target = picture if not upright else picture.transpose(1, 0, 2)
    long, wide = target.shape[1], int(rng.uniform(22, 40))
    at = int((target.shape[0] - wide) * rng.choice([0.01, 0.99]))
    bar = _flat(
        target[at : at + wide].shape[0], long, _one_of(rng, ((0.7, 0.68, 0.6), (0.5, 0.5, 0.52), (0.7, 0.5, 0.1)))
    )
    pitch = rng.uniform(4, 8)
    for k, x in enumerate(np.arange(4, long, pitch)):
        deep = wide // (2 if k % 10 == 0 else 3 if k % 5 == 0 else 4)
        cv2.line(bar, (int(x * 16), 0), (int(x * 16), deep * 16), (0.03, 0.03, 0.03), 1, cv2.LINE_AA, 4)
    target[at : at + wide] = bar


def _label(rng: Rng, picture: np.ndarray, h: int, w: int) -> None:
    x, y = int(rng.choice([0.02, 0.72]) * w), int(rng.choice([0.03, 0.85]) * h)
    cv2.rectangle(picture, (x, y), (x + int(0.24 * w), y + 34), (0.8, 0.8, 0.76), -1)
    _written(
        picture,
        f"{rng.choice(['P', 'run', 'test', 'S'])} {rng.integers(1, 40)}",
        (x + 6, y + 25),
        0.7,
        (0.02, 0.02, 0.05),
        2,
    )


def _mark(rng: Rng, picture: np.ndarray, h: int, w: int) -> None:
    """A square of black and white cells, as machines read them."""
    cell, x, y = int(rng.integers(5, 9)), int(rng.choice([0.04, 0.8]) * w), int(rng.choice([0.05, 0.8]) * h)
    cells = np.pad(rng.integers(0, 2, (4, 4)), 1).astype(np.float32)
    cells = np.kron(np.pad(cells, 1, constant_values=1), np.ones((cell, cell)))[..., None] * 0.75 + 0.02
    part = picture[y : y + len(cells), x : x + len(cells)]
    part[:] = cells[: part.shape[0], : part.shape[1]]


def _pen(rng: Rng, picture: np.ndarray, h: int, w: int) -> None:
    start = np.array([rng.choice([0.05, 0.85]) * w, rng.uniform(0.1, 0.9) * h])
    turn, long = rng.normal(np.pi / 2, 0.4), rng.uniform(60, 120)
    on = start + long * np.array([np.cos(turn), np.sin(turn)])
    _strokes(
        picture, [np.array([start, on])], _one_of(rng, ((0.02, 0.02, 0.02), (0.05, 0.1, 0.5), (0.7, 0.1, 0.05))), 7, 1.0
    )


def _rail(rng: Rng, picture: np.ndarray, h: int, w: int) -> None:
    """A grooved profile of aluminium, as frames are built of."""
    wide = rng.uniform(18, 36)
    x = rng.choice([0.04, 0.12, 0.9]) * w
    ends = np.array([[x, -20], [x + rng.normal(0, 0.02) * w, h + 20]])
    for share, tone in ((1.0, 0.45), (0.8, 0.6), (0.3, 0.12), (0.16, 0.3)):
        _strokes(picture, [ends], (tone, tone, tone * 1.03), wide * share, 1.0)


def _cable(rng: Rng, picture: np.ndarray, h: int, w: int) -> None:
    """A cable or hose that lies or hangs about along an edge."""
    t = np.linspace(0, 1, 60)
    x = (rng.choice([0.07, 0.93]) + 0.04 * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t + rng.uniform(0, 6))) * w
    colour = _one_of(rng, ((0.02, 0.02, 0.02), (0.5, 0.05, 0.04), (0.05, 0.15, 0.5), (0.7, 0.7, 0.66)))
    _strokes(picture, [np.column_stack([x, t * (h + 40) - 20])], colour, rng.uniform(4, 9), 0.95)


THINGS = {"rail": _rail, "cable": _cable, "ruler": _ruler, "label": _label, "mark": _mark, "pen": _pen}
