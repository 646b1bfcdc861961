"""Bodies: each kind of soft actuator in a few lines: how slender, of which outline, where it bends, what is on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testing.drawn import skins
from testing.drawn.rods import End
from testing.drawn.skins import Mark

Along = Callable[[np.ndarray], np.ndarray]  # of places from 0 (clamp) to 1 (end)

COLOURS = {
    "milky": (0.74, 0.72, 0.67), "beige": (0.66, 0.5, 0.34), "skin": (0.78, 0.55, 0.42), "blue": (0.05, 0.17, 0.52),
    "sky": (0.22, 0.5, 0.75), "teal": (0.03, 0.36, 0.36), "red": (0.62, 0.06, 0.04), "orange": (0.85, 0.28, 0.03),
    "yellow": (0.85, 0.62, 0.06), "green": (0.09, 0.42, 0.1), "pink": (0.82, 0.32, 0.4), "violet": (0.26, 0.1, 0.45),
    "black": (0.02, 0.02, 0.022), "grey": (0.26, 0.26, 0.27), "white": (0.84, 0.84, 0.82), "brown": (0.2, 0.1, 0.05),
    "steel": (0.45, 0.46, 0.48),
}  # fmt: skip
BRIGHT = ("blue", "sky", "teal", "red", "orange", "yellow", "green", "pink", "violet")
CAST = (*("milky", "beige", "white", "black") * 2, "skin", "grey", *BRIGHT)
PRINTED = ("black", "grey", "white", "orange", "blue", "red", "yellow", "green", "teal")

SQUARE = End()


@dataclass(frozen=True)
class Body:
    """A kind of body with its own figures; lengths in half widths where nothing else is said."""

    kind: str
    colours: tuple[str, ...]  # that it comes in
    slender: tuple[float, float]  # length
    half_width_px: tuple[float, float]
    most_turn: float  # rad
    marks: tuple[Mark, ...] = ()
    left: Along = np.ones_like  # outline, of half widths
    right: Along = np.ones_like
    bends: Along = np.ones_like  # curvature, of its mean
    end: End = SQUARE
    flatness: float = 1.0
    gloss: float = 0.15
    power: float = 30.0
    longer: float = 0.0  # by how much it grows when full
    wider: float = 0.0
    both_ways: bool = False  # bends to either side
    bends_to: int = 0  # its left (-1) or right (1) alone, seen along it, or whichever side its maker chose
    opacity: float = 1.0  # roughly: how much of what is behind is not seen through it
    attached: bool = True  # whether something may be fixed to its end
    cap: tuple[float, tuple[str, ...]] | None = (
        None  # a part of another colour before the end's face: how long, and which
    )


Rng = np.random.Generator


def pick(rng: Rng, names: tuple[str, ...]) -> np.ndarray:
    """A colour (3,) of linear light: one of the named, a little off."""
    colour = np.array(COLOURS[str(rng.choice(names))])
    return np.clip(colour * np.exp(rng.normal(0, 0.1, 3)) * np.exp(rng.normal(0, 0.15)), 0.012, 0.9)


def _uneven(rng: Rng) -> Along:
    """A body bends more here than there, and sometimes as in a joint near its clamp."""
    tilt, wave, phase = rng.uniform(-0.6, 0.6), rng.uniform(0, 0.4), rng.uniform(0, 6)
    joint = rng.uniform(1.0, 3.0) if rng.random() < 0.18 else 0.0
    at, wide = rng.uniform(0.08, 0.2), rng.uniform(0.05, 0.1)
    return lambda x: 1 + tilt * (2 * x - 1) + wave * np.sin(6 * x + phase) + joint * np.exp(-(((x - at) / wide) ** 2))


def _taper(to: float) -> Along:
    return lambda x: 1 + (to - 1) * np.clip(x, 0, 1.1)


def _texture(rng: Rng) -> tuple[Mark, ...]:
    """From nearly nothing to strong."""
    marks = [skins.mottle(float(rng.choice([0.012, 0.04, 0.1, 0.2], p=[0.3, 0.4, 0.2, 0.1])), rng.uniform(2.5, 9))]
    if rng.random() < 0.25:
        marks.append(skins.specks(rng.uniform(0.1, 0.6), rng.uniform(0.6, 1.4), bool(rng.random() < 0.6)))
    return tuple(marks)


def _longer(rng: Rng) -> float:
    return rng.uniform(0, 0.25) if rng.random() < 0.7 else 0.0


def _wider(rng: Rng) -> float:
    return 0.4 * rng.random() ** 1.5


def _end(rng: Rng) -> End:
    shape = str(rng.choice(["square", "rounded", "slanted"], p=[0.5, 0.35, 0.15]))
    return End(
        shape,
        {"square": 0.0, "rounded": rng.uniform(0.3, 1.0), "slanted": rng.choice([-1, 1]) * rng.uniform(0.15, 0.5)}[
            shape
        ],
    )


def _cap(rng: Rng, share: float, longest: float) -> tuple[float, tuple[str, ...]] | None:
    """A plug, a fitting, a cap, a tape around the end, in a share of the bodies."""
    return (rng.uniform(0.4, 1) * longest, PRINTED) if rng.random() < share else None


def fibre_reinforced(rng: Rng) -> Body:
    thread = pick(rng, ("white", "black", "red", "steel", "brown"))
    wound = skins.helix(
        rng.uniform(3.5, 8), rng.uniform(1.0, 1.8), thread, rng.uniform(0.35, 0.8), double=rng.random() < 0.7
    )
    return Body(
        "fibre-reinforced tube", ("milky", "beige", "white", "black", "sky", "red"), (9, 20), (5, 24), 3.6, (*_texture(rng), wound),
        bends=_uneven(rng), end=End("rounded", 0.5) if rng.random() < 0.4 else SQUARE, longer=rng.uniform(0, 0.12),
        wider=rng.uniform(0, 0.06), cap=_cap(rng, 0.4, 2.0),
    )  # fmt: skip


def pneunet(rng: Rng) -> Body:
    count, gap, depth = int(rng.integers(7, 14)), rng.uniform(0.14, 0.26), rng.uniform(0.45, 1.1)

    def outer(x: np.ndarray) -> np.ndarray:
        gap_next = np.clip(np.round(x * count), 1, count - 1)
        away = np.maximum(1 - 2 * np.abs(x * count - gap_next), 0)  # 0 in a chamber's middle, 1 in a gap's
        wall = np.clip((away - (1 - gap)) / 0.05, 0, 1)
        return 1 - depth * wall - 0.06 * np.minimum(away, 1 - gap) ** 4

    left, right = (outer, np.ones_like) if rng.random() < 0.5 else (np.ones_like, outer)
    bends_to = 1 if left is outer else -1
    low, high = sorted(bends_to * np.array([rng.uniform(0.65, 0.8), 1.2]))
    base_colour = pick(rng, ("white", "milky", "grey", "black", "blue"))
    base = skins.stripe(low, high, base_colour, rng.choice([0.0, 0.85]))
    return Body(
        "PneuNet", CAST, (7, 16), (7, 28), 4.2, (*_texture(rng), skins.grooves(count, rng.uniform(0.1, 0.4), 0.1), base),
        left, right, _uneven(rng), End("rounded", 0.15) if rng.random() < 0.3 else SQUARE, rng.uniform(3, 6), bends_to=bends_to,
        gloss=rng.uniform(0.05, 0.3), longer=rng.uniform(0, 0.15), wider=rng.uniform(0, 0.15),
    )  # fmt: skip


def bellows(rng: Rng) -> Body:
    count, depth = int(rng.integers(8, 17)), rng.uniform(0.12, 0.34)

    def folds(x: np.ndarray) -> np.ndarray:
        return 1 - depth * (0.5 - 0.5 * np.cos(2 * np.pi * count * x))

    return Body(
        "bellows", (*PRINTED, "milky", "beige"), (6, 15), (6, 30), 2.4,
        (*_texture(rng), skins.grooves(count, rng.uniform(0, 0.25), 0.25)), folds, folds, _uneven(rng),
        gloss=rng.uniform(0.1, 0.4), longer=rng.uniform(0, 0.25), both_ways=rng.random() < 0.4,
    )  # fmt: skip


def disc_arm(rng: Rng) -> Body:
    count = int(rng.integers(8, 18))
    thick, spine = rng.uniform(0.16, 0.38), rng.uniform(0.1, 0.22)
    colour = pick(rng, ("steel", "white", "black", "grey", "brown"))
    tendons = tuple(rng.uniform(0.55, 0.8) * np.array([-1, 1])) if rng.random() < 0.8 else (-0.75, 0.15, 0.75)
    return Body(
        "tendon-driven arm of discs", PRINTED, (12, 24), (8, 20), 3.2,
        (skins.mottle(0.03, 4), skins.discs(count, thick, spine, colour, tendons)), bends=_uneven(rng), flatness=5.0, both_ways=True,
        gloss=rng.uniform(0, 0.15), opacity=0.65,
    )  # fmt: skip


def catheter(rng: Rng) -> Body:
    rings = skins.rings(int(rng.integers(4, 9)), 0.8, pick(rng, ("black", "blue", "white")))
    marks = (rings,) if rng.random() < 0.3 else ()
    return Body(
        "thin catheter", ("white", "blue", "grey", "black", "red", "orange", "sky"), (18, 40), (3, 6), 3.6,
        (skins.mottle(0.02, 3), *marks), bends=_uneven(rng), end=End("rounded", 0.8) if rng.random() < 0.6 else SQUARE, gloss=0.2,
        both_ways=True, attached=False, cap=_cap(rng, 0.5, 4.0),
    )  # fmt: skip


def tapered(rng: Rng) -> Body:
    shape = _taper(rng.uniform(0.35, 0.7))
    return Body(
        "tapered silicone arm", CAST, (7, 18), (8, 30), 4.6, _texture(rng), shape, shape, _uneven(rng),
        End("rounded", rng.uniform(0.2, 0.45)),
        gloss=rng.uniform(0.1, 0.4), both_ways=rng.random() < 0.4, longer=rng.uniform(0, 0.1), cap=_cap(rng, 0.12, 1.2),
    )  # fmt: skip


def translucent(rng: Rng) -> Body:
    hose = pick(rng, ("white", "blue", "red", "black", "yellow", "steel"))
    inside = skins.lumen(rng.uniform(0.2, 0.5), hose, rng.uniform(0.3, 0.97), rng.uniform(0.45, 0.8))
    return Body(
        "translucent silicone tube", ("milky", "white", "sky", "beige", "pink"), (6, 16), (6, 28), 3.2, (*_texture(rng), inside),
        bends=_uneven(rng), end=_end(rng), gloss=rng.uniform(0.25, 0.5), power=45.0, opacity=0.75,
        longer=_longer(rng), wider=_wider(rng),
    )  # fmt: skip


def strip_edge_on(rng: Rng) -> Body:
    layer = (skins.stripe(rng.uniform(-0.2, 0.3), 1.2, pick(rng, CAST), 0.8),) if rng.random() < 0.5 else ()
    return Body(
        "flat strip seen edge-on", CAST, (16, 32), (3.5, 7), 4.0, (*_texture(rng), *layer), bends=_uneven(rng), flatness=8.0,
        gloss=0.08, both_ways=rng.random() < 0.5, attached=False,
    )  # fmt: skip


def strip_aslant(rng: Rng) -> Body:
    return Body(
        "flat strip seen obliquely", CAST, (7, 14), (7, 22), 4.0, _texture(rng), bends=_uneven(rng), flatness=8.0, gloss=0.08,
        end=_end(rng), both_ways=rng.random() < 0.5, attached=False,
    )  # fmt: skip


def jointed(rng: Rng) -> Body:
    count = int(rng.integers(2, 5))
    depth, wide = rng.uniform(0.2, 0.45), rng.uniform(0.018, 0.035)
    places = (np.arange(count) + 0.75) / (count + 0.4)

    def near(x: np.ndarray, width: float) -> np.ndarray:
        return np.exp(-(((x[:, None] - places) / width) ** 4)).sum(axis=1)

    def waist(x: np.ndarray) -> np.ndarray:
        return 1 - depth * near(x, wide)

    return Body(
        "jointed finger", (*PRINTED, "skin", "beige"), (7, 13), (8, 28), 2.0, _texture(rng), waist, waist,
        bends=lambda x: 0.15 + near(x, wide * 1.8), end=End("rounded", rng.uniform(0.3, 1)), flatness=rng.uniform(1.5, 4), gloss=0.1,
        cap=_cap(rng, 0.12, 1.2),
    )  # fmt: skip


def origami(rng: Rng) -> Body:
    count, depth = int(rng.integers(6, 13)), rng.uniform(0.08, 0.22)

    def fold(x: np.ndarray) -> np.ndarray:
        return 1 - depth * 2 * np.abs(x * count - np.round(x * count))

    return Body(
        "origami tube", ("white", "milky", "yellow", "sky", "orange", "green", "brown"), (6, 14), (8, 30), 2.2,
        (skins.mottle(0.03, 5), skins.facets(count, rng.uniform(0.1, 0.28))), fold, fold, bends=_uneven(rng), flatness=2.5, gloss=0.05,
        longer=rng.uniform(0, 0.25), both_ways=rng.random() < 0.5,
    )  # fmt: skip


def ringed(rng: Rng) -> Body:
    colour = pick(rng, ("black", "red", "blue", "white", "green"))
    marks = skins.rings(int(rng.integers(3, 11)), rng.uniform(0.2, 0.6), colour)
    if rng.random() < 0.4:
        marks = skins.dots(int(rng.integers(4, 10)), rng.uniform(0.25, 0.45), colour)
    return Body(
        "tube with printed marks", ("milky", "beige", "white", "sky", "pink", "yellow", "grey"), (8, 18), (6, 26), 3.6,
        (*_texture(rng), marks), bends=_uneven(rng), end=_end(rng),
        gloss=rng.uniform(0.1, 0.4), longer=_longer(rng), wider=_wider(rng), cap=_cap(rng, 0.12, 1.2),
    )  # fmt: skip


def finger(rng: Rng) -> Body:
    return Body(
        "soft finger", CAST, (5, 13), (7, 30), 3.4, _texture(rng), bends=_uneven(rng), end=_end(rng), flatness=rng.uniform(1, 3),
        gloss=rng.uniform(0.1, 0.4), longer=_longer(rng), wider=_wider(rng), cap=_cap(rng, 0.12, 1.2),
    )  # fmt: skip


def muscle(rng: Rng) -> Body:
    return Body(
        "braided muscle", ("black", "grey", "white", "blue", "green"), (8, 18), (6, 20), 2.2,
        (skins.mottle(0.03, 4), skins.sheath()), bends=_uneven(rng), wider=rng.uniform(0, 0.3), gloss=0.1,
        cap=_cap(rng, 0.9, 1.5),
    )  # fmt: skip


KINDS: dict[Callable[[Rng], Body], float] = {
    fibre_reinforced: 1.2, pneunet: 1.3, bellows: 0.9, disc_arm: 0.9, catheter: 0.8, tapered: 1.1, translucent: 1.1,
    strip_edge_on: 0.5, strip_aslant: 0.5,
    jointed: 0.7, origami: 0.7, ringed: 1.0, finger: 1.2, muscle: 0.4,
}  # fmt: skip


def pick_kind(rng: Rng) -> Callable[[Rng], Body]:
    weights = np.array(list(KINDS.values()))
    return list(KINDS)[int(rng.choice(len(weights), p=weights / weights.sum()))]
