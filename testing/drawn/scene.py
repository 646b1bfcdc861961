"""A scene: everything of one film, drawn from its seed and laid out so that a person sees the body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from testing.drawn import bodies, rooms, skins, things
from testing.drawn.bodies import Body
from testing.drawn.camera import Camera, camera, picture_size
from testing.drawn.light import Light, light, to_srgb
from testing.drawn.motion import Motion, motion, slower
from testing.drawn.rods import Rod, Surface
from testing.drawn.things import Attached, Passing, Place

Rng = np.random.Generator
PIECES = 256  # of a body's middle line
BEFORE, BEYOND = 1.6, 1.3  # half widths by which a line runs on within the clamp and beyond the end
TOLD_APART = 26.0  # in CIE L*a*b*: a person sees at once what is what
LEAST_MOVE_PX = 40.0  # of the end: less is nobody's film
MOST_SLOWED = 2.0
MARGIN_PX = 24  # by which a room is larger than the picture, for a camera that shakes


@dataclass(frozen=True)
class Pose:
    """How a body lies: its middle line (257, 2) px from clamp to end, headings (256,), how full it is."""

    line: np.ndarray
    heading: np.ndarray
    length_px: float
    fullness: float


@dataclass(frozen=True)
class Scene:
    """One film's everything; lengths in px of the body's plane, which is the picture's but for tilt and shake."""

    seed: int
    body: Body
    colour: np.ndarray
    place: Place
    length_px: float
    px_per_mm: float
    turn: float  # rad, when bent most
    rest_turn: float
    motion: Motion
    frames: int
    camera: Camera
    light: Light
    room: str
    clamp: str
    attached: Attached
    passing: Passing | None
    cap_colour: np.ndarray

    def pose(self, frame: float) -> Pose:
        bent, wobble = self.motion.at(frame)
        return _pose(
            self.body, self.place, self.length_px, self.rest_turn, self.turn * bent, wobble, min(abs(bent), 1.0)
        )

    def rod(self, pose: Pose, surface: Surface) -> Rod:
        """The body as it lies, with its skin, its ends run on straight."""
        px = self.place.half_width_px
        step = pose.length_px / PIECES
        before, beyond = int(BEFORE * px / step) + 1, int(BEYOND * px / step) + 1
        first, last = pose.heading[0], pose.heading[-1]
        back = -step * np.arange(before, 0, -1)[:, None] * [np.cos(first), np.sin(first)] + pose.line[0]
        on = step * np.arange(1, beyond + 1)[:, None] * [np.cos(last), np.sin(last)] + pose.line[-1]
        inner = (pose.heading[1:] + pose.heading[:-1]) / 2
        heading = np.concatenate([np.full(before + 1, first), inner, np.full(beyond + 1, last)])
        along = step * np.arange(-before, PIECES + beyond + 1)
        x = np.linspace(along[0], along[-1], int((along[-1] - along[0]) * 8)) / pose.length_px
        swell = 1 + self.body.wider * pose.fullness * (1 - np.exp(-np.clip(x, 0, 1) / 0.05))
        within = np.clip(x, 0, 1)
        left, right = ((px * swell * side(within)).astype(np.float32) for side in (self.body.left, self.body.right))
        wide = px * (1 + self.body.wider * pose.fullness)
        tip_width = wide * float(min(self.body.left(np.ones(1))[0], self.body.right(np.ones(1))[0]))
        return Rod(
            np.vstack([back, pose.line, on]),
            heading,
            along,
            pose.length_px,
            wide,
            left,
            right,
            self.body.end,
            surface,
            tip_width,
        )

    def surface(self) -> Surface:
        """The body's skin, painted."""
        rng = np.random.default_rng([self.seed, 1])
        skin = skins.blank(self.length_px, self.place.half_width_px, self.colour)
        for mark in self.body.marks:
            mark(skin, rng)
        if self.body.cap is not None:
            skins.band(1 - self.body.cap[0] * self.place.half_width_px / self.length_px, 1.3, self.cap_colour)(
                skin, rng
            )
        body = self.body
        return Surface(skin.paint(), skins.FIRST, skins.LAST, skins.ASIDE, body.flatness, body.gloss, body.power)


def summary(scene: Scene) -> str:
    """One line: what the film shows."""
    cam, px = scene.camera, scene.place.half_width_px
    extras = [
        f"{scene.body.end.shape} end",
        *([] if scene.attached.name == "nothing" else [f"{scene.attached.name} at it"]),
        *([] if scene.body.cap is None else ["capped"]),
        *([] if scene.passing is None else [f"{scene.passing.name} passes"]),
        *([] if cam.shake is None else ["shaken"]),
        *([] if not scene.light.flicker else ["flicker"]),
    ]
    return (
        f"{scene.seed}: {scene.body.kind} ({', '.join(extras)}), {scene.clamp}, {_heading_name(scene.place.heading)}, "
        f"before {scene.room}, {scene.motion.name} by {np.degrees(abs(scene.turn)):.0f} deg, "
        f"{cam.size[0]}x{cam.size[1]}, {scene.frames} frames, crf {cam.crf}, "
        f"{px:.0f} px of half width, {scene.length_px / px:.0f} long"
    )


def _heading_name(heading: float) -> str:
    return ("lies to the right", "hangs", "lies to the left", "stands")[int(np.round(heading / (np.pi / 2))) % 4]


def _pose(body: Body, place: Place, length_px: float, rest: float, turn: float, wobble: float, fullness: float) -> Pose:
    x = (np.arange(PIECES) + 0.5) / PIECES
    weights = body.bends(x)
    per_piece = (rest + turn * weights / weights.mean() + wobble * 3 * np.cos(1.5 * np.pi * x)) / PIECES
    heading = place.heading + np.cumsum(per_piece) - per_piece / 2
    length = length_px * (1 + body.longer * fullness)
    steps = length / PIECES * np.column_stack([np.cos(heading), np.sin(heading)])
    return Pose(np.vstack([place.at, place.at + np.cumsum(steps, axis=0)]), heading, length, fullness)


def draw(seed: int) -> Scene:
    """The scene of a seed."""
    rng = np.random.default_rng([20261128, seed])
    frames = int(rng.integers(40, 121))
    kind, laid_out, tries = bodies.pick_kind(rng), None, 0
    cam, fills = camera(rng, frames), rng.uniform(0.2, 0.42)
    while laid_out is None:
        cam = cam if tries % 25 or not tries else replace(cam, size=picture_size(rng))
        laid_out, tries = _laid_out(rng, kind(rng), cam, frames, fills=fills * 0.99**tries), tries + 1
    body, place, length, turn, rest, moves = laid_out
    room, colour, cap = _seen_well(rng, seed, body, cam, place, length, turn, rest, moves)
    in_mm = rng.uniform(1.0, 2.5) if body.half_width_px[1] <= 7 else rng.uniform(4, 16)
    middle = _pose(body, place, length, rest, 0, 0, 0).line[PIECES // 3 :: 32]
    ahead = _mean_ahead(body, place, length, rest, turn, moves)
    fixed = next(
        f
        for f in (things.attached(rng, cam.shape, ahead) for _ in range(99))
        if _difference(f.colour, cap) > TOLD_APART
    )
    return Scene(
        seed=seed, body=body, colour=colour, place=place, length_px=length, px_per_mm=place.half_width_px / in_mm, turn=turn,
        rest_turn=rest, motion=moves, frames=frames, camera=cam, light=light(rng, close=rooms.ROOMS[room].close), room=room,
        clamp=_clamp(rng, turn + rest), attached=fixed if body.attached else replace(fixed, name="nothing"),
        passing=things.passing(rng, cam.shape, middle, frames, place.half_width_px) if rng.random() < 0.05 else None, cap_colour=cap,
    )  # fmt: skip


def _mean_ahead(body: Body, place: Place, length: float, rest: float, turn: float, moves: Motion) -> float:
    """How far to the right (-1 to 1) the end points, on average."""
    return float(
        np.mean([np.cos(_pose(body, place, length, rest, turn * b, 0, 0).heading[-1]) for b in moves.bent[8::32]])
    )


def _clamp(rng: Rng, turn: float) -> str:
    """A body that bends far is not held by a table, which it would go through."""
    names = [name for name in things.CLAMPS if name != "table edge" or abs(turn) < 1.3]
    weights = np.array([things.CLAMPS[name][1] for name in names])
    return str(rng.choice(names, p=weights / weights.sum()))


def _laid_out(rng: Rng, body: Body, cam: Camera, frames: int, fills: float):
    """Where a body is held, how large it is and how it moves, all of it in the picture, of which it `fills` so much of
    the longer side; or None, if it does not fit."""
    slender = rng.uniform(*body.slender)
    moves = motion(rng, frames, both_ways=body.both_ways)
    turn = body.most_turn * (rng.uniform(0.8, 1.5) if moves.name == "curls" else rng.uniform(0.25, 0.9))
    if body.both_ways and moves.bent.min() < -0.2:
        turn *= 0.5
    weights = body.bends(np.linspace(0, 1, 200))
    turn = min(turn, 6.1, 0.6 * slender / (1 + body.wider) / (weights.max() / weights.mean())) * (
        body.bends_to or rng.choice([-1, 1])
    )
    rest = rng.normal(0, 0.12)
    heading = rng.choice([0.5, 0.0, 1.0, 1.5], p=[0.46, 0.19, 0.19, 0.16]) * np.pi + rng.normal(0, 0.12)
    unit = Place(np.zeros(2), float(heading), 1.0)
    lines = [_pose(body, unit, slender, rest, turn * b, 0, min(abs(b), 1)).line for b in moves.bent[::24]]
    points = np.vstack(lines)
    low, high = points.min(axis=0) - 1.2, points.max(axis=0) + 1.2
    size = np.array(cam.size)
    fits = float(((size * rng.uniform(0.6, 0.93)) / (high - low)).min())
    half_width = min(float(np.exp(rng.uniform(*np.log(body.half_width_px)))), fits)
    if half_width < body.half_width_px[0] or half_width * (high - low).max() < fills * size.max():
        return None
    free = size - half_width * (high - low)
    at = free * rng.uniform(0.04, 0.96, 2) - half_width * low
    if rng.random() < 0.04:  # framed badly: for some frames the end is out of the picture
        far = points[np.argmax(np.hypot(*(points - lines[0][-1]).T))] - lines[0][-1]
        at = at + np.sign(far) * (free * 0.5 + 2 * half_width) * (np.abs(far) > np.abs(far).max() * 0.6)
    place = Place(at, float(heading), half_width)
    length = slender * half_width
    if not _within(lines[0][-1] * half_width + at, size, 2 * half_width) or not _within(at, size, half_width):
        return None
    tips = np.array([_pose(body, place, length, rest, turn * b, 0, min(abs(b), 1)).line[-1] for b in moves.bent[8::8]])
    if np.ptp(tips, axis=0).max() < max(3 * half_width, LEAST_MOVE_PX):
        return None
    quickest = np.percentile(np.hypot(*np.diff(tips, axis=0).T), 97)
    allowed = 2 * half_width * rng.uniform(0.3, 1.2)
    by = max(1.0, quickest / allowed)
    if by > MOST_SLOWED:
        return None
    return body, place, length, turn, rest, slower(moves, by)


def _within(point: np.ndarray, size: np.ndarray, margin: float) -> bool:
    return bool(np.all(point > margin) and np.all(point < size - margin))


def _seen_well(
    rng: Rng, seed: int, body: Body, cam: Camera, place: Place, length: float, turn: float, rest: float, moves: Motion
):
    """A room, and colours of the body and its cap that a person tells apart wherever the body goes."""
    poses = [_pose(body, place, length, rest, turn * b, 0, min(abs(b), 1)).line for b in moves.bent[8::32]]
    best = (-1.0, "", np.zeros(3), np.zeros(3))
    for _ in range(5):
        room = rooms.pick(rng)
        picture = rooms.painted(room, seed, cam.shape[0] + 2 * MARGIN_PX, cam.shape[1] + 2 * MARGIN_PX)
        picture = picture[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]
        apart, colour = _apart(rng, body.colours, _behind(picture, poses, place.half_width_px), body.opacity)
        cap_apart, cap = 99.0, colour
        if body.cap is not None:
            cap_apart, cap = _apart(
                rng, body.cap[1], _behind(picture, [p[-40:] for p in poses], place.half_width_px), 1.0
            )
        best = max(best, (min(apart, cap_apart), room, colour, cap), key=lambda b: b[0])
        if best[0] > TOLD_APART:
            break
    return best[1:]


def _apart(rng: Rng, names: tuple[str, ...], behind: np.ndarray, opacity: float) -> tuple[float, np.ndarray]:
    """A colour that stands out from what is behind (n, 3), if any does, and by how much in CIE L*a*b* for most of it."""
    best = (-1.0, np.zeros(3))
    for _ in range(10):
        colour = bodies.pick(rng, names)
        own = 0.8 * colour * opacity + (1 - opacity) * behind
        best = max(
            best,
            (float(np.percentile(np.linalg.norm(_lab(own) - _lab(behind), axis=1), 15)), colour),
            key=lambda b: b[0],
        )
        if best[0] > TOLD_APART:
            break
    return best


def _behind(picture: np.ndarray, lines: list[np.ndarray], half_width_px: float) -> np.ndarray:
    """What of a room (n, 3) lies behind a body or close beside it in any of its poses."""
    swept = np.zeros(picture.shape[:2], np.uint8)
    for line in lines:
        cv2.polylines(swept, [np.round(line[::8]).astype(np.int32)], False, 1, int(3 * half_width_px) + 3)
    return picture[swept > 0][::23]


def _difference(one: np.ndarray, other: np.ndarray) -> float:
    """How far two colours (3,) are apart in CIE L*a*b*."""
    return float(np.linalg.norm(_lab(one[None]) - _lab(other[None])))


def _lab(linear: np.ndarray) -> np.ndarray:
    return cv2.cvtColor((to_srgb(linear) / 255)[None].astype(np.float32), cv2.COLOR_RGB2Lab)[0]
