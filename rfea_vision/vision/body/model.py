"""The body: where its stations are in the picture, how wide it is, what colour it has inside and around."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along
from rfea_vision.scatter import NORMAL, scatter
from rfea_vision.vision.body.sampling import read_strip
from rfea_vision.vision.curve import basis_matrix

Picture = NDArray[np.uint8]

STATIONS = 65
ACROSS_TEXTURE = np.linspace(-1.05, 1.05, 13)
ACROSS_INSIDE = np.linspace(-0.7, 0.7, 7)
BEYOND_END = np.linspace(0.4, 1.2, 5)  # half widths: nearer to its end it is blurred into what is there
# Chosen, of what is read there: so much is of neither the body's colour nor that of what is around it, where a hose or a lamp begins.
FIXED_SHARE = 0.15
NOWHERE = 1e6  # in each channel: a colour that nothing has
ACROSS_SIDE = np.array([[0.6, 0.7, 0.8], [0.8, 0.9, 1.0]])  # half widths: a layer may be thin, and an outline end at its inner edge
ACROSS_AROUND = np.array([1.5, 1.9, 2.3])
LEAST_VARIANCE = np.array([6.0, 3.0, 3.0]) ** 2  # of L, a and b: noise and compression
AROUND_VARIANCE = np.array([12.0, 4.0, 4.0]) ** 2  # the wall has lines and shadows
LIGHT_GAIN, OWN_GAIN = 0.08, 0.02  # of the colours of the last frame
MARKED = 16.0  # of a or b in 8 bits: so far from the body's own colour is a mark
BACKED = 0.7  # share of a station that looks like the body
ANOTHER_STRETCH = 4.0  # half widths along the body: no bend brings what is nearer beside itself
# Standard deviations of the picture, chosen when all around was asked, and not both sides. Of 24 drawn bodies whose last fifth is the
# wall's or hardly covers it, 9 stations and more are so at the end (of one 3), of 20 other films none but three of clear silicone with
# a taped end (4, 8, 8) and two real ones (6).
SAME_COLOUR = 2.0
BESIDE_TOO = 0.1  # of what is beside a body, chosen: less may be chance. An end of a half striped wall's colour has 0.26 and more
TURNED = 0.3  # of its length, 1 s.d., chosen: an end that cannot be told from the wall may turn, or lie elsewhere
CLEAR = 3.0  # standard deviations between two colours that are never confused
NEIGHBOURS = 4  # stations on either side whose colours are taken together

NEAR = np.clip(np.arange(STATIONS)[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1), 0, STATIONS - 1)
# Stations between which the direction at each is taken: two to either side, at the ends the last three.
BEFORE = np.r_[0, 0, np.arange(STATIONS - 4), STATIONS - 3, STATIONS - 3]
AHEAD = np.r_[2, 2, np.arange(4, STATIONS), STATIONS - 1, STATIONS - 1]
LEFTWARDS = np.array([-1.0, 1.0])  # what turns the coordinates of a tangent, exchanged, into those of its normal
SHARES = np.linspace(0.0, 1.0, STATIONS)
NORMAL_BASIS = basis_matrix(SHARES, 11)  # displacements across the body,
ALONG_BASIS = basis_matrix(SHARES, 6)  # along it,
WIDTH_BASIS = basis_matrix(SHARES, 8)  # and what its half width gains


@dataclass(frozen=True, eq=False)
class SeenBody:
    """Stations are points of the material: `points` (S, 2) px on the centre line from clamp to tip, `half` (S,) px.

    A value: what is seen anew of it is another one, and what follows from it is worked out once.

    `inside` (S, 2, 3) and `outside` (S, 2 sides, 2, 3) hold mean and variance of the colours; `sides`, as `outside`, those next to its
    edges, of a body that has others there: a face in the shade, a layer that does not stretch. `told` (S,) says where it can be told
    from the wall: elsewhere edges, skin and flow are those of the wall, and do not count. `beyond` (2, 3) is the colour of what is
    fixed to its end, a hose or a ball, where it is neither its own nor the wall's.
    """

    points: FloatArray
    half: FloatArray
    inside: FloatArray
    outside: FloatArray
    sides: FloatArray | None = None
    told: NDArray[np.bool_] = field(default_factory=lambda: np.ones(STATIONS, dtype=bool))
    beyond: FloatArray = field(default_factory=lambda: np.stack([np.full(3, NOWHERE), np.ones(3)]))

    @cached_property
    def flanks(self) -> FloatArray:
        """Mean and variance (S, 2 sides, 2, 3) of the colours next to its edges: its own, or those of its `sides`."""
        return np.stack([self.inside] * 2, axis=1) if self.sides is None else self.sides

    @cached_property
    def lengths(self) -> FloatArray:
        """Of the centre line up to each station (S,), px."""
        return along(self.points)

    @property
    def length(self) -> float:
        """Of the centre line in px."""
        return float(self.lengths[-1])

    @cached_property
    def tangents(self) -> FloatArray:
        """Unit vectors (S, 2) along the centre line, smoothed over its neighbours."""
        return frame_of(self.points)[0]

    @cached_property
    def normals(self) -> FloatArray:
        """Unit vectors (S, 2) across it, to its left in the picture."""
        return self.tangents[:, ::-1] * LEFTWARDS

    @cached_property
    def last(self) -> int:
        """Station at which it ends as far as it can be told from the wall: up to it most are, and from there on most are not."""
        return max(int(np.argmax(np.cumsum(np.where(self.told, 1, -1)))), NEIGHBOURS)

    @property
    def untold(self) -> float:
        """Length, px, of an end most of which cannot be told from the wall."""
        return self.length * (STATIONS - 1 - self.last) / STATIONS

    @property
    def strays(self) -> FloatArray:
        """How far (S,) px such an end may lie aside, 1 s.d.: from where it can be told on it may turn."""
        return TURNED * np.clip(self.untold - (1.0 - SHARES) * self.length, 0.0, None)

    @property
    def end_half(self) -> float:
        """Half width, px, of the last stations that can be told from the wall."""
        return float(self.half[self.last - 3 : self.last + 1].mean())

    @property
    def width_in_stations(self) -> int:
        """How many stations a body width is long: three at least, for fewer tell little."""
        return min(max(round(2.0 * float(middle(self.half)) / self.length * STATIONS), 3), STATIONS)

    def elsewhere_on(self, places: FloatArray) -> NDArray[np.bool_]:
        """Which places (S, 2) px, one beside each station, lie on another stretch of the body: it rolls up and touches itself."""
        off = np.linalg.norm(places[:, None] - self.points, axis=2)
        another = np.abs(self.lengths[:, None] - self.lengths) > ANOTHER_STRETCH * self.half
        return np.any((off < self.half) & another, axis=1)


@dataclass
class Sight:
    """The body in a picture: where it was, and its skin there (S, V, 3)."""

    body: SeenBody
    lab: Picture
    skin: FloatArray


def frame_of(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit tangents and normals (..., S, 2) of lines of points, smoothed over their neighbours."""
    chords = points[..., AHEAD, :] - points[..., BEFORE, :]
    tangents = chords / np.maximum(np.sqrt(chords[..., :1] ** 2 + chords[..., 1:] ** 2), 1e-9)
    return tangents, tangents[..., ::-1] * LEFTWARDS


def gradual(points: FloatArray, rest: float) -> FloatArray:
    """Stations on a spline whose spans are no shorter than the half width `rest`: no body bends anew within that.

    Those of a slender body are left as they are.
    """
    spans = int(along(points)[-1] / rest)
    if spans >= NORMAL_BASIS.shape[1]:
        return points
    return _onto_spline(3 + max(spans, 1)) @ points


@lru_cache
def _onto_spline(count: int) -> FloatArray:
    """Stations (S, S) on the spline of so many coefficients that is nearest to them."""
    basis = basis_matrix(SHARES, count)
    return basis @ np.linalg.pinv(basis)


def with_colours(picture: Picture, body: SeenBody) -> SeenBody:
    """The body with the colours that are read inside and around it."""
    body = replace(body, inside=_colours(picture, body, ACROSS_INSIDE, LEAST_VARIANCE), outside=_colours_around(picture, body))
    return body if body.sides is None else replace(body, sides=_sides(picture, body))


def _sides(picture: Picture, body: SeenBody) -> FloatArray:
    """Mean and variance (S, 2 sides, 2, 3) of the colours next to the edges.

    The outermost that surely are neither the body's nor the wall's; the body's own where there are none.
    """
    sides = np.stack([body.inside] * 2, axis=1)
    known = np.stack([sides[:, :, 0], body.outside[:, :, 0]])
    for across in ACROSS_SIDE:
        seen = np.stack([_colours(picture, body, sign * across, LEAST_VARIANCE) for sign in (1.0, -1.0)], axis=1)
        apart = np.sum((seen[:, :, 0] - known) ** 2 / seen[:, :, 1], axis=3).min(axis=0)
        sides = np.where((apart > 3.0 * CLEAR**2)[..., None, None], seen, sides)
    return sides


def with_beyond(picture: Picture, body: SeenBody) -> SeenBody:
    """The body with the colour of what is fixed to its end, where that is neither its own there nor that of what is around it."""
    near, half = slice(body.last - 2, body.last + 1), body.end_half
    tangent, normal = body.tangents[body.last], body.normals[body.last]
    places = body.points[body.last] + (BEYOND_END * half)[:, None] * tangent
    normals, halves = np.tile(normal, (len(places), 1)), np.full(len(places), half)
    colours = read_strip(picture, places, normals, halves, ACROSS_INSIDE).reshape(-1, 3)
    known = np.vstack([body.inside[near, 0].mean(axis=0)[None], body.outside[near, :, 0].mean(axis=0)])
    strange = colours[_apart(colours, known) > 3.0 * CLEAR**2]
    if len(strange) > FIXED_SHARE * len(colours):
        colour = np.median(strange, axis=0)
        if _apart(colour[None], known)[0] > 3.0 * CLEAR**2:  # shades of the body's own colour are not
            return replace(body, beyond=np.stack([colour, scatter(strange) ** 2 + LEAST_VARIANCE]))
    return body


def _apart(colours: FloatArray, known: FloatArray) -> FloatArray:
    """How far (n,) colours (n, 3) are from the nearest of those (m, 3) that are known, in variances of noise, over three channels."""
    return np.asarray(np.min(np.sum((colours[:, None] - known) ** 2 / LEAST_VARIANCE, axis=2), axis=1))


def told_from_wall(picture: Picture, body: SeenBody) -> NDArray[np.bool_]:
    """All stations (S,) but those of an end, of a tenth and more, that have a colour of the wall and of no other fifth of the body.

    Of the wall to both sides: one edge tells where an end is. Where these are a fifth, what is before and of one colour with them, too:
    a longer end looks like itself.
    """
    scatter = np.sqrt(LEAST_VARIANCE)
    inside, alike = body.inside[:, 0] / scatter, []
    for sign in (1.0, -1.0):
        beside = read_strip(picture, body.points, body.normals, body.half, sign * ACROSS_AROUND).reshape(-1, 3) / scatter
        alike.append(np.mean(np.linalg.norm(inside[:, None] - beside, axis=2) < SAME_COLOUR, axis=1))
    own = np.linalg.norm(inside[:, None] - inside, axis=2)
    own[np.abs(np.arange(STATIONS)[:, None] - np.arange(STATIONS)) < STATIONS // 5] = np.inf
    walls = (own.min(axis=1) > CLEAR) & (np.min(alike, axis=0) > BESIDE_TOO)
    if (count := end_of(walls)) <= STATIONS // 10:
        return np.ones(STATIONS, dtype=bool)
    walls &= np.arange(STATIONS) >= STATIONS - count
    if walls[: STATIONS - STATIONS // 5 + 1].any():
        walls = np.linalg.norm(inside[:, None] - inside[walls], axis=2).min(axis=1) < SAME_COLOUR
    return ~walls | (np.arange(STATIONS) < STATIONS - end_of(walls))


def end_of(where: NDArray[np.bool_]) -> int:
    """How many stations the longest end has in most of which something holds."""
    return int(np.max(np.flatnonzero(np.cumsum(where[::-1]) > 0.5 * np.arange(1, STATIONS + 1)), initial=-1)) + 1


def in_light(cleared: Picture, picture: Picture, body: SeenBody, backing: FloatArray) -> SeenBody:
    """The body with colours that follow the light: around it freely, inside it alike at all stations.

    One that has left the body would else take the wall's colour for its own; where `backing` (S,) says that it has not,
    its own colour counts a little.
    """
    off = middle(_near(cleared, body, ACROSS_INSIDE)) - body.inside[:, 0]
    alike, inside = backing >= BACKED, body.inside.copy()
    if np.any(alike):
        light = np.median(off[alike], axis=0)
        inside[:, 0] += LIGHT_GAIN * light + np.where(alike[:, None], OWN_GAIN * (off - light), 0.0)
    sides = None if body.sides is None else body.sides + np.stack([inside - body.inside] * 2, axis=1)
    outside = body.outside + LIGHT_GAIN * (_colours_around(picture, body) - body.outside)
    return replace(body, inside=inside, sides=sides, outside=outside)


def skin_of(picture: Picture, body: SeenBody) -> FloatArray:
    """The skin (S, V, 3) of a body."""
    return read_strip(picture, body.points, body.normals, body.half, ACROSS_TEXTURE)


def _colours_around(picture: Picture, body: SeenBody) -> FloatArray:
    """Mean and variance (S, 2 sides, 2, 3) of the colours beside the body."""
    return np.stack([_colours(picture, body, sign * ACROSS_AROUND, AROUND_VARIANCE) for sign in (1.0, -1.0)], axis=1)


def _colours(picture: Picture, body: SeenBody, across: FloatArray, least: FloatArray) -> FloatArray:
    """Mean and variance (S, 2, 3) of the colours at `across` half widths, neighbouring stations taken together."""
    near = _near(picture, body, across)
    colour = middle(near)  # glare and marks are few
    spread = middle(np.abs(near - colour[..., None])) / NORMAL
    return np.stack([colour, spread**2 + least], axis=1)


def _near(picture: Picture, body: SeenBody, across: FloatArray) -> FloatArray:
    """Colours (S, 3, V) at `across` half widths of every station and its neighbours."""
    strip = read_strip(picture, body.points, body.normals, body.half, across)
    return strip[NEAR].transpose(0, 3, 1, 2).reshape(STATIONS, 3, -1)


def middle(values: FloatArray) -> FloatArray:
    """Median over the last axis, of an odd number of values: NumPy's takes five times as long for a few, in every frame."""
    half = values.shape[-1] // 2
    return np.partition(values, half, axis=-1)[..., half]


def lab_of(colour: tuple[int, int, int]) -> FloatArray:
    """Red, green and blue of 255 as the pictures have them: (3,) of CIELAB in 8 bits."""
    pixel = np.array([[colour]], dtype=np.uint8)
    return np.asarray(cv2.cvtColor(pixel, cv2.COLOR_RGB2LAB)[0, 0], dtype=float)


def robust_displacement(
    rows: FloatArray, values: FloatArray, variance: FloatArray, shared: float, prior: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coefficients of a displacement through `values` (n,), of which some may be anything, and the information that these are.

    The others scatter by `variance` (n,), `shared` of them alike; `prior` is the information on the coefficients before.
    """
    known = 1.0 / (shared * variance)
    weight, solution, information = known, np.zeros(len(prior)), 0.0 * prior
    for scale in (8.0, 4.0, 2.0, 1.0, 1.0):
        information = rows.T @ (weight[:, None] * rows)
        solution = np.asarray(np.linalg.solve(prior + information, rows.T @ (weight * values)), dtype=float)
        weight = known / (1.0 + (values - rows @ solution) ** 2 / (scale**2 * variance)) ** 2
    return solution, information
