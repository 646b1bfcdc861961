"""What is around a body: whether more of it lies beside its line, or beyond its end."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.body.model import STATIONS, Picture, SeenBody, middle
from rfea_vision.vision.body.sampling import support
from rfea_vision.vision.body.wall import Wall

BESIDE, BEYOND = 1.6, np.arange(0.5, 4.1, 0.5)  # half widths off the line: the middle of what is beside the body; and off its end
SURELY = 2.0  # evidence, odds of 7: what is around a pale body before a pale wall looks like it by a little


def off_beside(body: SeenBody, more: FloatArray) -> float:
    """How far (px) the line may lie off its body's middle, where there is `more` (S, 2) of that on one side of it, over a body width.

    Edges that are blurred, or break up between windings, may be found within the body; what they leave out lies beside the line.
    """
    half = float(middle(body.half))
    apart = np.abs(np.nan_to_num(more[:, 0] - more[:, 1]))
    window = np.ones(body.width_in_stations)
    return float(np.convolve(apart, window / len(window), "same").max()) * 2.0 * (BESIDE - 1.0) * half


def looks_around(picture: Picture, wall: Wall, body: SeenBody) -> tuple[FloatArray, FloatArray]:
    """Share of what is around a body that surely looks like it.

    (S, 2) to either side, from 1.2 to 2 half widths off its line; and (8,) up to four beyond its end. NaN where it has
    rolled up and lies beside itself.
    """
    tangents, normals = body.tangents, body.normals
    behind, beside = wall.behind(picture), np.empty((2, STATIONS))
    for side, sign in enumerate((1.0, -1.0)):
        points = body.points + (sign * BESIDE * body.half)[:, None] * normals
        outside = np.repeat(body.outside[:, side : side + 1], 2, axis=1)
        beside[side] = support(behind, points, normals, (BESIDE - 1) * body.half, body.inside, outside, SURELY)
        beside[side, body.elsewhere_on(points)] = np.nan
    last = np.full(len(BEYOND), body.last)
    half = np.full(len(BEYOND), body.end_half)
    points = body.points[last] + (BEYOND * half)[:, None] * tangents[last]
    # At the very end half of what was read may lie beyond it, and a half width before that discs may have a gap.
    like = (last, np.maximum(last - np.ceil(half / body.length * STATIONS).astype(int), 0))
    shares = [support(behind, points, normals[last], half, body.inside[own], body.outside[own], SURELY) for own in like]
    return beside.T, np.max(shares, axis=0)
