"""What a body looks like, and where that is seen again: its end, with what lies beyond it, and its skin, as in the first frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import at
from rfea_vision.vision.body.fit import ALONG, NORMAL, UNKNOWNS
from rfea_vision.vision.body.model import (
    ACROSS_TEXTURE,
    ALONG_BASIS,
    NORMAL_BASIS,
    SHARES,
    STATIONS,
    Picture,
    SeenBody,
    frame_of,
    middle,
)
from rfea_vision.vision.body.rules import LENGTHS
from rfea_vision.vision.body.sampling import ALIKE, GRAIN, read_strip, unlikeness

STEPS = 6  # places per half width at which it is looked at, along the body and across
# Places before the end, beyond it, and to either side of the line, to just beyond the edges, so that a cap shows. Of seven windows one
# narrower by two places tells as much to a thirtieth of where people see the ends of 26 real bodies in later frames (all seen); with
# nothing beyond the end, or twice as much, they tell less by an eighth and more.
BEFORE, BEYOND, BESIDE = 12, 6, 7
AHEAD, ASIDE = 15, 3  # places by which it is looked for farther along the line, and across it, to either side
# Pieces of it that differ independently, each half a half width long and wide; 20 to 30 tell most of the same ends. As many of a skin.
PIECES = 20.0
# How often a body is not where it was foretold, but anywhere within reach: 0.05 at first, until an end before a plate of its colour
# went astray by the plate's edge (tests/measurement/test_ends.py).
STRAYS = 0.01
AT_END = np.zeros((2, UNKNOWNS))  # what the unknowns move the end by, across the body and along it
AT_END[0, NORMAL], AT_END[1, ALONG] = NORMAL_BASIS[-1], ALONG_BASIS[-1]
WITHIN_HALF = np.abs(ACROSS_TEXTURE) < 0.5
INNER = ACROSS_TEXTURE[WITHIN_HALF]  # half widths: by these skins are compared, rims change with the outline
# Lengths that are compared; by how much others differ from one; and how much better it fits than these: of ribbed bellows the skin
# differed by 0.64 to 0.72 of that where they stretched at once by eye, and by 0.98 and more where they had turned out of the plane.
LENGTHS_TRIED, ANOTHER_LENGTH, CLEARLY = 31, 0.08, 0.8
SURELY = 2.0  # log of odds, as elsewhere (odds of 7): skin that says so that a body has another length disagrees with what was fitted
_OFF = np.stack(np.meshgrid(np.arange(-ASIDE, ASIDE + 1), np.arange(-AHEAD, AHEAD + 1)), axis=-1).reshape(-1, 2) / STEPS


@dataclass(frozen=True)
class EndLook:
    """Colours (BEFORE + 1 + BEYOND, 2 BESIDE + 1, 3) of a body's end and around it, in half widths along its line and across."""

    colours: FloatArray

    @classmethod
    def of(cls, picture: Picture, body: SeenBody) -> EndLook:
        """That of a body in a picture (h, w, 3) in CIELAB."""
        return cls(_around_end(picture, body, 0, 0))

    def found(self, picture: Picture, body: SeenBody, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far (2,) px across the body and along it its end lies off where it was foretold, and the covariance (2, 2) of that, px^2.

        Foretold to a `covariance` (2, 2). What sets a place off from its looks scatters as where it is least (Laplace's law of unknown
        scale). Unless it is likelier to have strayed, both are moments of what was foretold and the picture together; one that looks
        alike in several places, or all along, is where it was foretold.
        """
        unlike = GRAIN + unlikeness(_around_end(picture, body, AHEAD, ASIDE), self.colours).ravel()
        like, off = (unlike.min() / unlike) ** PIECES, _OFF * body.end_half
        foretold = np.exp(-0.5 * np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off))
        foretold /= foretold.sum()
        strayed = STRAYS * like.mean() > (1.0 - STRAYS) * float(foretold @ like)
        likely = like if strayed else foretold * like
        likely = likely / likely.sum()
        mean = likely @ off
        between = (body.end_half / STEPS) ** 2 / 12.0  # places is nothing looked at
        known = (likely[:, None] * (off - mean)).T @ (off - mean) + between * np.eye(2)
        return (mean, known) if strayed or np.trace(known) < np.trace(covariance) else (np.zeros(2), covariance)


def _around_end(picture: Picture, body: SeenBody, ahead: int, aside: int) -> FloatArray:
    """Colours of a body's end, and of so many places more before and beyond it, and to either side; the line goes straight on."""
    half = body.end_half
    step = half / STEPS
    lengths = np.maximum(body.length + step * np.arange(-BEFORE - ahead, BEYOND + ahead + 1), 0.0)
    line = np.vstack([body.points, body.points[-1] + step * (BEYOND + ahead + 1) * body.tangents[-1]])
    normals = np.column_stack([np.interp(lengths, body.lengths, part) for part in body.normals.T])
    across = np.arange(-BESIDE - aside, BESIDE + aside + 1) / STEPS
    return read_strip(picture, at(line, lengths), normals, np.full(len(lengths), half), across)


class AsLong(NamedTuple):
    """How long a body is by its skin.

    Attributes
    ----------
    likeliest : the body, stretched to where its skin looks clearly more like what it was than at all lengths that are not near to that;
        as it is where none stands out so, for ribs look alike, and smooth skin does
    told : its own length stands out so
    another : px, how much longer it is by its skin, where that surely is another length than its own; else 0
    """

    likeliest: SeenBody
    told: bool
    another: float


def as_long(cleared: Picture, body: SeenBody, skin: FloatArray, length: float) -> AsLong:
    """How long a body is by a skin (S, V, 3) of before, of any of `LENGTHS` of its `length` px then, and its own.

    It is stretched evenly along its line, or straight on beyond it.
    """
    tried = np.append(length * np.linspace(*LENGTHS, LENGTHS_TRIED), body.length)
    line = np.vstack([body.points, body.points[-1] + tried.max() * body.tangents[-1]])
    ways = at(line, np.outer(tried, SHARES).ravel()).reshape(len(tried), STATIONS, 2)
    normals, halves = frame_of(ways)[1].reshape(-1, 2), np.tile(body.half, len(ways))
    skin = skin[:, WITHIN_HALF]
    skins = read_strip(cleared, ways.reshape(-1, 2), normals, halves, INNER)
    unlike = GRAIN + skin_unlike(skins.reshape(len(ways), *skin.shape)[:, body.told], skin[body.told])

    def stands_out(one: int) -> bool:
        return bool(unlike[one] < CLEARLY * unlike[np.abs(tried / tried[one] - 1.0) > ANOTHER_LENGTH].min())

    best = int(np.argmin(unlike))
    surely = PIECES * float(np.log(unlike[-1] / unlike[best])) > SURELY
    likeliest = replace(body, points=ways[best]) if stands_out(best) else body
    return AsLong(likeliest, stands_out(LENGTHS_TRIED), float(tried[best]) - body.length if surely else 0.0)


def skin_unlike(skins: FloatArray, before: FloatArray) -> FloatArray:
    """How little (...) skins (..., S, V, 3) are like what they were: grey levels, without a change of light."""
    off = skins - before
    off = np.ascontiguousarray(np.moveaxis(off, -1, -3)).reshape(*off.shape[:-3], 3, -1)
    return np.asarray(np.minimum(np.abs(off - middle(off)[..., None]), ALIKE).mean(axis=(-1, -2)))
