"""One frame: the displacement of the body that its edges, its end and its texture agree on, with its covariance.

Unknowns are three splines along the body: how far it moves across itself, how far along itself, and what its half width
gains. Each piece of evidence is a normal equation with its own variance; the frame before is a prior that loosens with
every frame. Texture is that of the first frame, so that nothing drifts; where it is not to be recognised, the flow from
the last frame stays as the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.scatter import NORMAL as QUARTILE
from rfea_vision.vision.body.around import BEYOND
from rfea_vision.vision.body.equations import add_edges, add_row, add_skin, at_stations
from rfea_vision.vision.body.marks import SeenMark, carried_by, ends_marked, place_of
from rfea_vision.vision.body.model import (
    ALONG_BASIS,
    NORMAL_BASIS,
    SHARES,
    STATIONS,
    WIDTH_BASIS,
    Picture,
    SeenBody,
    gradual,
    middle,
)
from rfea_vision.vision.body.sampling import RAY_REACH, RAYS, measure_edges, measure_end, support
from rfea_vision.vision.body.skin import Skin
from rfea_vision.vision.body.wall import Wall
from rfea_vision.vision.curve import basis_matrix

NORMAL, ALONG, WIDTH = slice(0, 11), slice(11, 17), slice(17, 25)
UNKNOWNS = 25
TURNS = 3
CORRELATED = 3.0  # edges of so many neighbouring stations err alike
AS_BEFORE = 0.5  # of what an edge lay off the first frame's outline, 1 s.d., chosen: it may as well lie where that is
EDGE_REACH = 0.4  # half widths to either side in which the first frame's edges are looked for, as in later turns; and ends after marks
CLAMP_PX = 0.4  # along the body, where it begins stays where it was pointed at,
# Share of the half width to which it stays there across the body: people point beside it, and rubber gives way in a clamp.
# Four films of silicone are read at 0.05 and at 0.1; at 0.1 a photographed tube and worms had left the clamp.
CLAMP_SHARE = 0.05
CLAMP_TURNS = 0.2  # rad, 1 s.d.: it leaves squarely; in films of silicone held by tape it turned by 0.3 there
CLAMP_SWELLS = 0.05  # of the half width, 1 s.d.: what holds the body keeps its width
# Second differences of what is moved across the body beyond what was pointed at, or what its skin predicted, px, 1 s.d. Of 60 drawn
# films (seen) ends lie a fifth less far to the side at 2 than at 0.6. Near its clamp, where edges count less, rims and glare folded
# silicone that swells in 4 of 64 runs of real films at 3; there it stays at 0.6 after the first frame,
# and along all of a body that was lost: one that was found again bent to a cover of the colour of the wall.
SHAPE_PX, HELD_SHAPE_PX = 1.5, 0.6
NEAR_CLAMP = 4  # of nine second differences: those in the first three eighths of the length
BENDS_GRADUALLY = 0.06  # third differences of the line, over the spacing of its coefficients
LEAST_HELD = 0.05  # chosen: of an edge at the clamp itself, so that no station is without any
SWELLS = 0.15  # of the half width, 1 s.d.: edges that are seen easily outweigh it
STRETCHES_GRADUALLY = 0.02  # second differences of the places along it, likewise
TURN_ROWS = basis_matrix(SHARES, NORMAL_BASIS.shape[1], 1)  # slope of the displacement at each station, over the length
RAYS_AT = RAY_REACH * np.linspace(-1.0, 1.0, RAYS)  # half widths off the line
STRAIGHT = 0.1  # half widths, chosen: an end whose middle stands out by more is round, and looks the same wherever the line turns
END_TURNS = 0.1  # rad, 1 s.d., chosen: an end turns with the line
THIRD, SECOND = np.diff(np.eye(11), n=3, axis=0), np.diff(np.eye(6), n=2, axis=0)
TO_NORMAL, TO_ALONG, TO_WIDTH = (np.linalg.pinv(basis) for basis in (NORMAL_BASIS, ALONG_BASIS, WIDTH_BASIS))
THIRD_OF, THIRD_TWICE = THIRD @ TO_NORMAL, THIRD.T @ THIRD
SECOND_OF, SECOND_TWICE = SECOND.T @ SECOND @ TO_ALONG, SECOND.T @ SECOND
BENDS = np.diff(np.eye(11), n=2, axis=0)
FORETOLD_BENDS = BENDS / np.where(np.arange(9) < NEAR_CLAMP, HELD_SHAPE_PX, SHAPE_PX)[:, None]
BENDING = BENDS.T @ BENDS
POINTED_SHAPE, FORETOLD_SHAPE = BENDING / SHAPE_PX**2, FORETOLD_BENDS.T @ FORETOLD_BENDS
MIDDLES = np.round(np.linspace(0, STATIONS - 1, NORMAL_BASIS.shape[1] - 3)).astype(int)
# Share of what flow says along the body that is to be believed, and marks, by which the material is known, are held to as much more:
# on silicone glare stays where the light comes from. Of 31 runs of silicone arms 24 end within 2 % of the mark's way with either at
# this, 20 with marks at 1; over eleven clear scenes of testing/phone.py the end was off by 5.4 standard errors (median).
TRUSTED = 1.0 / 5.4**2
# Of the half width: rims, glare and shadows move an edge alike in many frames, and rubber that swells to one side moves the middle of
# its edges off its material. Over eleven clear scenes of testing/phone.py the line was off by 0.04 to 0.27 of it, most where the body
# was found wider than it was pointed at, which counts besides; in films of silicone with a mark near its end the middle went 0.4 off.
SYSTEMATIC = 0.1
LEANING = NORMAL_BASIS.shape[1]  # splines along the body: with fewer, the edges beside a mark held the line off it
LEANS_AT = np.arange(UNKNOWNS, UNKNOWNS + LEANING)
SKIN_FIRST, SKIN_VALUE = at_stations(SHARES, ((0, 11), (11, 6), (17, 8)))
EDGE_FIRST, EDGE_VALUE = at_stations(SHARES, ((0, 11), (17, 8), (UNKNOWNS, LEANING)))
END_LEVEL = 0.2  # half widths: chosen, rays that differ by less have all found one end, and a round one at that
# Standard errors of a mark by which its material lies off it, along the body, chosen: in nine films of silicone arms 2.9 at most.
PULLED_OFF = 3.0
END_PX = 0.3  # scatter of a ray's end at full contrast
HUBER = 2.0  # standard errors


@dataclass
class Fit:
    """Result of a frame.

    Attributes
    ----------
    body : where it is now
    covariance : (25, 25) px^2 of the displacement's coefficients
    seen : (S, 2) whether each side's edge was found, or neighbouring marks tell where it is
    backing : (S,) share of the inside that looks like the body; all of it between neighbouring marks
    end : (RAYS,) px how far the end lies beyond where the rays had it, NaN where it was not found
    material : the coloured marks that it was held by

    and when it is judged

    beside : (S, 2) share of what is beside it, to either side, that surely looks like the body; NaN on another stretch of it
    beyond : (8,) share of what is beyond its end that does, ever farther
    reason : why it is no measurement; empty where it is one
    off : px by which its line may lie off its middle, where it does most: by its edges, and by what lies beside it
    length_told : whether its skin tells how long it is: no other length looks nearly as much like the first frame's
    another : px, how much longer it is by its skin, where that surely is another length; else 0
    shown : px^-2, what its skin tells of how far its end has gone along the body, if that stretches evenly
    more : px by which it may go on beyond its line, where rays find no end
    """

    body: SeenBody
    covariance: FloatArray
    seen: NDArray[np.bool_]
    backing: FloatArray
    end: FloatArray
    material: Sequence[SeenMark]
    beside: FloatArray = field(default_factory=lambda: np.zeros((STATIONS, 2)))
    beyond: FloatArray = field(default_factory=lambda: np.zeros(len(BEYOND)))
    reason: str = ""
    off: float = 0.0
    length_told: bool = False
    another: float = 0.0
    shown: float = 0.0
    more: float = 0.0

    @property
    def likeness(self) -> float:
        """How much of it is seen: its inside, and its edges."""
        return float(np.mean(self.backing) + np.mean(self.seen))

    @property
    def unseen(self) -> float:
        """Share of its edges that is not seen."""
        return 1.0 - float(np.mean(self.seen))


@dataclass(frozen=True)
class Evidence:
    """What a body is fitted to; each piece is added to the normal equations of a displacement from where the body is.

    Attributes
    ----------
    clamp : (2, 2) px where the body begins, and the unit vector in which it leaves
    rest_half : (S,) px half width in the first frame
    skin : of the first frame; None while unknown
    edge_offsets : (S, 2) px how far beyond the half width the edges were in the first frame: ends are cut aslant, and ribs are finer
        than splines, NaN where there are none; None while unknown
    end_offsets : (RAYS,) px how far beyond the last station the body ends, ray by ray; None while unknown
    marks : points of the material that their colour has found
    lost : since the last frame that was measured others were not
    """

    picture: Picture
    wall: Wall
    clamp: FloatArray
    rest_half: FloatArray
    skin: Skin | None
    edge_offsets: FloatArray | None = None
    end_offsets: FloatArray | None = None
    marks: Sequence[SeenMark] = ()
    lost: bool = False

    def add_outline(self, matrix: FloatArray, vector: FloatArray, body: SeenBody, span: float) -> tuple[FloatArray, FloatArray]:
        """Both edges (S, 2, 2), looked for within `span` px, with their variances; how much (S,) of the inside looks like the body.

        After the first frame edges count less within a half width of the clamp, where rubber swells beside what holds it.
        """
        seen, around = (self.wall.behind(self.picture), body.points, body.normals, body.half, body.inside), body.outside
        backing, edges = support(*seen, around, 0.0), measure_edges(*seen, body.flanks, around, span)
        if self.edge_offsets is not None:
            edges[:, :, 0] -= self.edge_offsets
            edges[:, :, 1] += (AS_BEFORE * self.edge_offsets) ** 2
        held = np.clip(body.lengths / float(middle(self.rest_half)), LEAST_HELD, 1.0) if self.skin is not None else 1.0
        leans = SYSTEMATIC * float(middle(body.half)) if self.marks else 0.0
        _add_edges(matrix, vector, edges, np.clip(2.0 * backing, 0.1, 1.0) * held * body.told, leans)
        return edges, backing

    def add_skin(self, matrix: FloatArray, vector: FloatArray, body: SeenBody, slips: FloatArray) -> float:
        """The skin of an earlier frame, which counts where enough of it is recognised, `slips` (S,) px along the body at most.

        Returns what it tells, px^-2, of the end of a body that stretches evenly.
        """
        if self.skin is None:
            return 0.0
        information, pull, alike = self.skin.matched(self.wall.cleared(self.picture), body, slips)
        counts = body.told * np.clip((alike - 0.4) / 0.4, 0.0, 1.0)
        add_skin(matrix, vector, information, pull, counts, SKIN_FIRST, SKIN_VALUE)
        return float(counts @ (information[:, 2] * SHARES**2))

    def add_end(self, matrix: FloatArray, vector: FloatArray, body: SeenBody, span: float) -> FloatArray:
        """Where the body ends, along (RAYS,) rays: px beyond where it was expected."""
        if self.end_offsets is None:
            return np.full(RAYS, np.nan)
        end = end_rays(self.picture, self.wall, body, 2.0 * span) - self.end_offsets
        if carried_by(self.marks, body)[-1]:  # between discs is wall: a ray may see the end of the last but one
            end[np.abs(end) > EDGE_REACH * body.end_half] = np.nan
        _add_end(matrix, vector, end, body.last, TRUSTED**0.5 if self.marks else 1.0)
        half, shape = body.end_half, self.end_offsets
        if abs(shape[2:5].mean() - shape[[0, -1]].mean()) < STRAIGHT * half:
            _add_end_turn(matrix, vector, end, body, half)
        return end


def fit_body(evidence: Evidence, predicted: SeenBody, covariance: FloatArray, reach: float) -> Fit:
    """Fit the body to a picture.

    Parameters
    ----------
    predicted : where the flow has put it
    covariance : (25, 25) px^2 of the prediction
    reach : px to either side in which edges are looked for
    """
    body, total = predicted, np.zeros(UNKNOWNS)
    prior: FloatArray = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    shape = POINTED_SHAPE if evidence.skin is None else BENDING / HELD_SHAPE_PX**2 if evidence.lost else FORETOLD_SHAPE
    slips = np.sqrt(np.sum((ALONG_BASIS @ covariance[ALONG, ALONG]) * ALONG_BASIS, axis=1))  # px, along itself
    for turn in range(TURNS):
        span = reach if turn == 0 else max(0.5 * reach, 4.0)
        matrix, vector = prior.copy(), -prior @ total
        matrix[NORMAL, NORMAL] += shape
        vector[NORMAL] -= shape @ total[NORMAL]
        _add_shape(matrix, vector, body, evidence.rest_half)
        edges, backing = evidence.add_outline(matrix, vector, body, span)
        shown = evidence.add_skin(matrix, vector, body, slips)
        _add_clamp(matrix, vector, body, evidence.clamp, evidence.rest_half)
        _add_marks(matrix, vector, body, evidence.marks)
        before = matrix.copy(), vector.copy()
        end = evidence.add_end(matrix, vector, body, reach)
        step = np.asarray(np.linalg.solve(matrix, vector), dtype=float)
        if _pulled_off(evidence.marks, body, step, end):
            matrix, step = before[0], np.asarray(np.linalg.solve(*before), dtype=float)
        total += step
        shift = (NORMAL_BASIS @ step[NORMAL])[:, None] * body.normals + (ALONG_BASIS @ step[ALONG])[:, None] * body.tangents
        limit = np.minimum(1.0, 1.5 * span / np.maximum(np.linalg.norm(shift, axis=1, keepdims=True), 1e-9))
        half = np.maximum(body.half + WIDTH_BASIS @ step[WIDTH], 0.4 * predicted.half)
        body = replace(body, points=body.points + shift * limit, half=half)
        if turn + 1 == TURNS or (turn and np.abs(shift).max() < 0.05):
            break
    body = replace(body, points=gradual(body.points, float(middle(evidence.rest_half))))
    inverse = np.asarray(np.linalg.inv(matrix), dtype=float)
    seen, off = np.isfinite(edges[:, :, 1]), off_middle(body, edges, NORMAL_BASIS @ step[NORMAL])
    carried = carried_by(evidence.marks, body)
    return Fit(body, inverse, seen | carried[:, None], np.maximum(backing, carried), end, evidence.marks, off=off, shown=shown)


def beyond_half(picture: Picture, wall: Wall, body: SeenBody) -> FloatArray:
    """How far (S, 2) px the edges of a body lie beyond its half width, by more than the pixel to which they are found; else 0.

    NaN where none is seen within a half width of its end: that is round, and in later frames its face would be taken for one.
    """
    half = float(middle(body.half))
    seen = wall.behind(picture), body.points, body.normals, body.half, body.inside, body.flanks, body.outside
    offsets, variance = np.moveaxis(measure_edges(*seen, EDGE_REACH * half), 2, 0)
    offsets = np.where(np.isfinite(variance), offsets - np.clip(offsets, -1.0, 1.0), 0.0)
    return np.where(np.isinf(variance) & (body.length - body.lengths < half)[:, None], np.nan, offsets)


def off_middle(body: SeenBody, edges: FloatArray, moved: FloatArray) -> float:
    """How far (px) the middle between both edges lies off the line when it has `moved` (S,) px, where it does most over a body width.

    What was carried into the frame may outweigh them: it errs alike in many frames, at an end most, and its covariance does not say so.
    """
    both = np.isfinite(edges[:, :, 1]).all(axis=1) & body.told
    left, right = np.where(both[:, None], edges[:, :, 0], 0.0).T
    off = np.where(both, 0.5 * (left - right) - moved, 0.0)
    window = np.ones(body.width_in_stations)
    seen = np.maximum(np.convolve(both, window, "same"), 0.5 * len(window))  # a few alone tell little
    return float(np.abs(np.convolve(off, window, "same") / seen).max())


def end_rays(picture: Picture, wall: Wall, body: SeenBody, reach: float) -> FloatArray:
    """How far (RAYS,) px beyond the last station that is told from the wall the body ends, along rays through it; NaN: not seen."""
    last, near = body.last, slice(body.last - 2, body.last + 1)
    inside, outside = body.inside[near].mean(axis=0), body.outside[near].mean(axis=(0, 1))
    return measure_end(wall.behind(picture), body.points[last], body.tangents[last], body.end_half, inside, outside, body.beyond, reach)


def _add_shape(matrix: FloatArray, vector: FloatArray, body: SeenBody, rest_half: FloatArray) -> None:
    """Rubber bends and stretches gradually, and swells within limits, from `rest_half` (S,) px on.

    Third differences across and second differences along are small, and so is what the half width has gained.
    """
    rest, length = float(middle(rest_half)), body.length
    swells = SWELLS * rest
    matrix[WIDTH, WIDTH] += np.eye(8) / swells**2
    vector[WIDTH] -= TO_WIDTH @ (body.half - rest_half) / swells**2
    spacing = length / (NORMAL_BASIS.shape[1] - 3)
    # No body bends anew within its own half width: in a short one the splines lie closer than that.
    sigma = BENDS_GRADUALLY * spacing * min(1.0, spacing / rest) ** 3
    wiggle = np.sum((THIRD_OF @ body.points) * body.normals[MIDDLES], axis=1)
    matrix[NORMAL, NORMAL] += THIRD_TWICE / sigma**2
    vector[NORMAL] -= THIRD.T @ wiggle / sigma**2
    sigma = STRETCHES_GRADUALLY * length / (ALONG_BASIS.shape[1] - 3)
    matrix[ALONG, ALONG] += SECOND_TWICE / sigma**2
    vector[ALONG] -= SECOND_OF @ body.lengths / sigma**2


def _add_clamp(matrix: FloatArray, vector: FloatArray, body: SeenBody, clamp: FloatArray, rest_half: FloatArray) -> None:
    """The body begins where it was pointed at, squarely and as wide as it was: around a clamp there is tape, and a bracket."""
    tangent, normal = body.tangents[0], body.normals[0]
    off = clamp[0] - body.points[0]
    turn = float(np.arctan2(normal @ clamp[1], tangent @ clamp[1]))
    gains = rest_half[0] - body.half[0]
    add_row(matrix, vector, NORMAL.start, NORMAL_BASIS[0], off @ normal, CLAMP_SHARE * rest_half[0])
    add_row(matrix, vector, ALONG.start, ALONG_BASIS[0], off @ tangent, CLAMP_PX)
    add_row(matrix, vector, NORMAL.start, TURN_ROWS[0], turn * body.length, CLAMP_TURNS * body.length)
    add_row(matrix, vector, WIDTH.start, WIDTH_BASIS[0], gains, CLAMP_SWELLS * rest_half[0])


def _add_marks(matrix: FloatArray, vector: FloatArray, body: SeenBody, marks: Sequence[SeenMark]) -> None:
    """Marks hold the material where they are seen: on the scale of flow, which claims too much, along the body and across.

    Beyond one that is near its end a body goes straight on, to 0.1 rad on that scale: ends are closed by glue, and hardly bend.
    """
    tangents, normals = body.tangents, body.normals
    for seen in marks:
        near = min(round(seen.mark.share * (STATIONS - 1)), STATIONS - 1)
        off, stderr = seen.place - place_of(seen.mark, body), TRUSTED**0.5 * seen.stderr
        if not seen.mark.wide:
            add_row(matrix, vector, NORMAL.start, NORMAL_BASIS[near], off @ normals[near], stderr)
        add_row(matrix, vector, ALONG.start, ALONG_BASIS[near], off @ tangents[near], stderr)
    if ends_marked(marks, body):
        near, ahead = round(marks[-1].mark.share * (STATIONS - 1)), tangents[-1]
        turned = float(np.arctan2(ahead @ normals[near], ahead @ tangents[near]))
        stderr = TRUSTED**0.5 * END_TURNS * body.length
        add_row(matrix, vector, NORMAL.start, TURN_ROWS[-1] - TURN_ROWS[near], -turned * body.length, stderr)


def _pulled_off(marks: Sequence[SeenMark], body: SeenBody, step: FloatArray, end: FloatArray) -> bool:
    """Whether an `end` (RAYS,) that is seen off the line takes the material off a mark, by a step (25,): then it is another one."""
    found = end[np.isfinite(end)]
    if len(found) == 0 or abs(np.median(found)) < END_LEVEL * body.end_half:
        return False
    for seen in marks:
        near = min(round(seen.mark.share * (STATIONS - 1)), STATIONS - 1)
        off = (seen.place - place_of(seen.mark, body)) @ body.tangents[near] - ALONG_BASIS[near] @ step[ALONG]
        if abs(off) > PULLED_OFF * seen.stderr:
            return True
    return False


def _add_edges(matrix: FloatArray, vector: FloatArray, edges: FloatArray, share_seen: FloatArray, leans: float) -> None:
    """Both sides of every station: the left one moves with n + w, the right one with -n + w.

    Where something else holds the material, the middle between the edges may lie `leans` px (1 s.d.) off it.
    """
    if leans == 0.0:
        add_edges(matrix, vector, edges, share_seen, CORRELATED, 3.0 * HUBER, EDGE_FIRST[:2], EDGE_VALUE[:2])
        return
    size = UNKNOWNS + LEANING
    full, pull = np.zeros((size, size)), np.zeros(size)
    full[LEANS_AT, LEANS_AT] = 1.0 / leans**2
    add_edges(full, pull, edges, share_seen, CORRELATED, 3.0 * HUBER, EDGE_FIRST, EDGE_VALUE)
    carried = np.linalg.solve(full[UNKNOWNS:, UNKNOWNS:], full[UNKNOWNS:, :UNKNOWNS]).T
    matrix += full[:UNKNOWNS, :UNKNOWNS] - carried @ full[UNKNOWNS:, :UNKNOWNS]
    vector += pull[:UNKNOWNS] - carried @ pull[UNKNOWNS:]


def _add_end_turn(matrix: FloatArray, vector: FloatArray, end: FloatArray, body: SeenBody, half: float) -> None:
    """An end that is cut straight, and seen so by most rays, turns with the body: where it is aslant to the line, this has turned.

    Edges alone let a line turn in its last half width, where the body's corners, and what has swollen to one side, lead them astray.
    """
    known = np.isfinite(end)
    if known.sum() < RAYS - 1:
        return
    places, found = half * RAYS_AT[known], end[known]
    places = places - places.mean()
    spread = places @ places
    slope = float(places @ found / spread)
    off = found - found.mean() - slope * places
    if np.ptp(off) < 2.0 * STRAIGHT * half:
        stderr = float(np.hypot(END_TURNS, np.sqrt(off @ off / (len(found) - 2) / spread)))
        add_row(matrix, vector, NORMAL.start, TURN_ROWS[body.last], -slope * body.length, stderr * body.length)


def _add_end(matrix: FloatArray, vector: FloatArray, end: FloatArray, last: int, share: float) -> None:
    """The end of the body moves with the station at which it is."""
    found = end[np.isfinite(end)].tolist()
    if len(found) < RAYS // 2:
        return
    place = median(found)
    spread = median(abs(ray - place) for ray in found) / QUARTILE + END_PX
    sigma = share * 1.25 * spread * (2.0 / len(found)) ** 0.5  # of the median; two rays next to each other see the same
    add_row(matrix, vector, ALONG.start, ALONG_BASIS[last], place, sigma)
