"""Things at a body: what clamps it, what is fixed to its end, what comes before it for some frames. All are rods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testing.drawn.bodies import PRINTED, pick
from testing.drawn.rods import End, Rod, Surface, plain, rod
from testing.drawn.skins import clouds

Rng = np.random.Generator


@dataclass(frozen=True)
class Place:
    """Where a body begins and where it goes from there."""

    at: np.ndarray  # (2,) px
    heading: float  # rad
    half_width_px: float

    @property
    def ahead(self) -> np.ndarray:
        return np.array([np.cos(self.heading), np.sin(self.heading)])

    @property
    def aside(self) -> np.ndarray:
        return np.array([-np.sin(self.heading), np.cos(self.heading)])

    def point(self, ahead: float, aside: float) -> np.ndarray:
        """A point (2,) px so many half widths ahead and aside of the body's start."""
        return self.at + self.half_width_px * (ahead * self.ahead + aside * self.aside)


FAR = 1500.0  # px, beyond any picture


def _behind(
    place: Place, first: float, half_width: float, surface: Surface, *, sway: float = 0.0, until: float = FAR
) -> Rod:
    """A rod from afar behind the body to `first` half widths from its start, `half_width` of the body's wide."""
    front = place.point(first, 0)
    back = front - place.ahead * until + place.aside * sway
    middle = front - place.ahead * min(until / 3, 120.0)
    return rod(np.array([back, middle, front]), half_width * place.half_width_px, surface)


def _lined(rng: Rng, colour: np.ndarray, length_px: float, line_px: float, strength: float, flatness: float) -> Surface:
    """A surface with lines across, as printers leave them."""
    count = max(int(length_px / line_px), 4)
    paint = np.ones((4 * count, 2, 4), np.float32)
    paint[..., :3] = (
        colour
        * np.exp(strength * np.sin(np.arange(4 * count) * np.pi / 2) + 0.02 * rng.normal(size=4 * count))[:, None, None]
    )
    return Surface(paint, flatness=flatness, gloss=0.1)


def block(rng: Rng, place: Place, widest: float) -> list[Rod]:
    colour = pick(rng, ("steel", "black", "brown", "white", "grey"))
    wide, deep = rng.uniform(1.35, max(1.4, widest)), place.half_width_px * rng.uniform(2, 6)
    post = _behind(
        place, -1, rng.uniform(0.4, 1.0), plain(pick(rng, ("steel", "black", "grey"))), sway=rng.normal(0, 150)
    )
    return [post, _behind(place, 0, wide, plain(colour, flatness=9, gloss=0.08), until=deep)]


def printed_holder(rng: Rng, place: Place, widest: float) -> list[Rod]:
    colour = pick(rng, PRINTED)
    wide, deep = rng.uniform(1.3, max(1.35, min(widest, 2))), place.half_width_px * rng.uniform(3, 7)
    surface = _lined(rng, colour, deep, rng.uniform(2, 3.5), 0.06, 7)
    post = _behind(
        place, -2, rng.uniform(0.6, 1.2), plain(pick(rng, ("steel", "black", "white"))), sway=rng.normal(0, 100)
    )
    flange = _behind(place, 0, wide * 1.25, surface, until=place.half_width_px * rng.uniform(0.5, 0.9))
    screws = [
        rod(
            np.array([place.point(a, b), place.point(a - 0.05, b)]),
            0.22 * place.half_width_px,
            plain(np.array([0.3, 0.3, 0.32])),
            End("rounded", 1),
        )
        for a, b in ((-1.6, 0.8), (-1.6, -0.8))
    ]
    return [post, _behind(place, 0, wide, surface, until=deep), flange, *screws]


def collar(rng: Rng, place: Place, widest: float) -> list[Rod]:
    hose = _behind(
        place,
        -1,
        rng.uniform(0.3, 0.55),
        plain(pick(rng, ("blue", "white", "black", "milky")), gloss=0.2),
        sway=rng.normal(0, 300),
    )
    stand = rod(
        np.array([place.point(-1.1, 0), place.point(-1.1, 0) + FAR * rng.choice([-1, 1]) * place.aside]),
        rng.uniform(0.35, 0.8) * place.half_width_px, plain(pick(rng, ("steel", "black")), gloss=0.3),
    )  # fmt: skip
    metal = plain(pick(rng, ("steel", "brown", "black")), gloss=0.5, power=60)
    return [
        hose,
        stand,
        _behind(place, 0, rng.uniform(1.15, 1.3), metal, until=place.half_width_px * rng.uniform(1.6, 3)),
    ]


def table_edge(rng: Rng, place: Place, widest: float) -> list[Rod]:
    colour = pick(rng, ("brown", "white", "grey", "beige"))
    noise = np.exp(0.08 * clouds(rng, (300, 120), 6))
    paint = np.dstack([noise[..., None] * colour, np.ones((300, 120))]).astype(np.float32)
    paint[-3:, :, :3] *= 1.3
    return [rod(np.array([place.at - FAR * place.ahead, place.at]), 1400.0, Surface(paint, flatness=60))]


def _skin_of_hands(rng: Rng) -> np.ndarray:
    return np.array([0.55, 0.33, 0.24]) * np.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.05, 3))


def _fingers(rng: Rng, colour: np.ndarray, root: np.ndarray, tips: np.ndarray, half_width_px: float) -> list[Rod]:
    """Bent fingers from near a root (2,) to tips (n, 2) px."""
    out = []
    for tip in tips:
        knuckle = (root + tip) / 2 + rng.normal(0, 0.25, 2) * half_width_px * 2
        t = np.linspace(0, 1, 9)[:, None]
        line = (1 - t) ** 2 * root + 2 * t * (1 - t) * knuckle + t**2 * tip
        out.append(rod(line, half_width_px * rng.uniform(0.9, 1.1), _of_skin(rng, colour), End("rounded", 1)))
    return out


def _of_skin(rng: Rng, colour: np.ndarray) -> Surface:
    paint = np.ones((40, 16, 4), np.float32)
    paint[..., :3] = colour * np.exp(0.07 * clouds(rng, (40, 16), 4))[..., None]
    paint[33:38, 4:12, :3] *= np.array([1.15, 1.2, 1.25])  # a nail
    return Surface(paint, gloss=0.06, flatness=1.3)


def hand(rng: Rng, place: Place, widest: float) -> list[Rod]:
    """A fist behind the body's start, and a finger across whose side the body comes out at."""
    colour, thick = _skin_of_hands(rng), max(0.75 * place.half_width_px, rng.uniform(11, 18))
    side = rng.choice([-1, 1])
    palm = place.point(0, 0) - place.ahead * 3.2 * thick + side * place.aside * 3.0 * thick
    wrist = palm - FAR * (place.ahead * rng.uniform(0.4, 1.0) - side * place.aside * rng.uniform(0.2, 1.0))
    forearm = rod(
        np.array([wrist, palm + 0.6 * thick * place.ahead]), 2.6 * thick, plain(colour, gloss=0.03), End("rounded", 0.8)
    )
    others = _fingers(
        rng,
        colour,
        palm,
        np.array([place.at - place.ahead * k * thick - side * place.aside * 1.6 * thick for k in (4.6, 2.8)]),
        thick,
    )
    tip, knuckle = 1.5 + place.half_width_px / thick, 1.8 + place.half_width_px / thick
    across = [place.at - thick * place.ahead + side * place.aside * k * thick for k in (knuckle, 0, -tip)]
    front = rod(np.array([palm, *across]), thick, _of_skin(rng, colour), End("rounded", 1))
    return [forearm, *others, front]


CLAMPS: dict[str, tuple[Callable[[Rng, Place, float], list[Rod]], float]] = {
    "block": (block, 1.3), "3D-printed holder": (printed_holder, 1.3), "collar on a stand": (collar, 1.0),
    "table edge": (table_edge, 0.6), "hand": (hand, 0.6),
}  # fmt: skip


@dataclass(frozen=True)
class Attached:
    """What is fixed to an end; drawn under it, so that the end face stays seen."""

    name: str
    colour: np.ndarray
    size: float  # half widths
    anchor: np.ndarray  # (2,) px where a hose goes to

    def rods(self, tip: np.ndarray, heading: float, half_width_px: float) -> list[Rod]:
        ahead = np.array([np.cos(heading), np.sin(heading)])
        size = self.size * half_width_px
        if self.name == "ball":
            return [_ball(tip + 0.8 * size * ahead, ahead, size, self.colour)]
        if self.name == "hose":
            t = np.linspace(0, 1, 30)[:, None]
            reach = 0.45 * np.hypot(*(self.anchor - tip))
            knots = (tip - 2 * ahead, tip + ahead * max(reach, 60), self.anchor - np.array([0, reach / 2]), self.anchor)
            line = (
                (1 - t) ** 3 * knots[0]
                + 3 * t * (1 - t) ** 2 * knots[1]
                + 3 * t**2 * (1 - t) * knots[2]
                + t**3 * knots[3]
            )
            return [rod(line, max(0.35 * half_width_px, 1.5), plain(self.colour, gloss=0.2))]
        if self.name == "weight on a string":
            low = tip + np.array([0, 2.5 * size])
            string = rod(np.array([tip - ahead, low]), 0.8, plain(np.array([0.5, 0.48, 0.42]), gloss=0))
            return [
                string,
                rod(np.array([low, low + np.array([0, 1.1 * size])]), 0.7 * size, plain(self.colour, gloss=0.4)),
            ]
        if self.name == "small light":
            return [
                rod(
                    np.array([tip - ahead, tip + 0.5 * half_width_px * ahead]),
                    0.3 * half_width_px,
                    plain(self.colour),
                    End("rounded", 1),
                )
            ]
        return []


def _ball(middle: np.ndarray, ahead: np.ndarray, radius_px: float, colour: np.ndarray) -> Rod:
    item = rod(
        np.array([middle - radius_px * ahead, middle + radius_px * ahead]),
        radius_px,
        plain(colour, gloss=0.4),
        End("rounded", 1),
    )
    along = np.linspace(-1, item.along_px[-1] / radius_px - 1, 200)
    side = (radius_px * np.sqrt(np.maximum(1 - np.minimum(along, 0) ** 2, 0))).astype(np.float32)
    return replace(item, left=side, right=side)


ATTACHED = {"nothing": 8.0, "hose": 0.8, "ball": 0.6, "weight on a string": 0.5, "small light": 0.4}


LEDS = np.array([(0.9, 0.85, 0.8), (0.95, 0.1, 0.06), (0.1, 0.9, 0.2), (0.1, 0.25, 0.95)])


def attached(rng: Rng, shape: tuple[int, int], ahead: float) -> Attached:
    """What is at the end of a body that points `ahead` (x, -1 to 1) on average: a hose leads on from there."""
    weights = np.array(list(ATTACHED.values()))
    name = str(rng.choice(list(ATTACHED), p=weights / weights.sum()))
    colour = pick(rng, ("red", "black", "steel", "blue", "green", "yellow"))
    if name == "small light":
        colour = LEDS[int(rng.integers(len(LEDS)))]
    side = np.sign(ahead) if abs(ahead) > 0.15 else rng.choice([-1, 1])
    anchor = np.array([(0.5 + 0.6 * side) * shape[1], rng.uniform(0.3, 1.1) * shape[0]])
    return Attached(name, colour, rng.uniform(0.9, 1.6), anchor)


@dataclass(frozen=True)
class Passing:
    """A hand or a cable that comes before the body between two frames, on its way to `target` and back."""

    name: str
    first: int
    last: int
    start: np.ndarray
    target: np.ndarray
    thick_px: float
    colour: np.ndarray
    seed: int

    def rods(self, frame: float) -> list[Rod]:
        if not self.first <= frame <= self.last:
            return []
        share = max(0.0, np.sin(np.pi * (frame - self.first) / (self.last - self.first))) ** 0.6
        at = self.start + share * (self.target - self.start)
        on = (self.target - self.start) / np.hypot(*(self.target - self.start))
        rng = np.random.default_rng(self.seed)
        if self.name == "cable":
            aside = np.array([-on[1], on[0]])
            t = np.linspace(-1, 1, 40)[:, None]
            return [rod(at + aside * t * 900 - on * 160 * t**2, self.thick_px, plain(self.colour, gloss=0.2))]
        palm = at - on * 5 * self.thick_px
        aside = np.array([-on[1], on[0]])
        tips = np.array([at + aside * k * 1.9 * self.thick_px - on * abs(k) * self.thick_px for k in (-1, 0, 1)])
        return [
            rod(
                np.array([palm - on * FAR, palm + on * self.thick_px]),
                2.7 * self.thick_px,
                plain(self.colour, gloss=0.03),
                End("rounded", 0.7),
            ),
            *_fingers(rng, self.colour, palm, tips, self.thick_px),
        ]


def passing(rng: Rng, shape: tuple[int, int], along: np.ndarray, count: int, half_width_px: float) -> Passing:
    """Something that passes before one of the points `along` (n, 2) of a body, for a sixth of the film or so."""
    first = int(rng.uniform(0.3, 0.75) * count)
    start = np.array([rng.choice([-0.35, 1.35]) * shape[1], rng.uniform(0.2, 0.8) * shape[0]])
    name = str(rng.choice(["hand", "cable"]))
    thick = rng.uniform(11, 18) if name == "hand" else max(2.5, rng.uniform(0.2, 0.5) * half_width_px)
    colour = _skin_of_hands(rng) if name == "hand" else pick(rng, ("black", "red", "grey"))
    return Passing(
        name,
        first,
        first + int(rng.uniform(9, 24)),
        start,
        along[int(rng.integers(len(along)))],
        thick,
        colour,
        int(rng.integers(2**31)),
    )
