"""The first frame: outlines along the lines that hints allow, and what the best of them and the clicks tell of the body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along
from rfea_vision.scatter import NORMAL as QUARTILE
from rfea_vision.vision.body.begin import (
    SQUARE,
    Pointed,
    even,
    first_body,
    leaving,
    like_colour,
    standing_out,
    through_rungs,
)
from rfea_vision.vision.body.fit import ALONG, END_LEVEL, SYSTEMATIC, WIDTH, Evidence, end_rays, fit_body
from rfea_vision.vision.body.marks import Mark, find_marks, marks_in, place_of, put_on
from rfea_vision.vision.body.model import (
    SHARES,
    STATIONS,
    Picture,
    SeenBody,
    frame_of,
    middle,
    told_from_wall,
    with_beyond,
    with_colours,
)
from rfea_vision.vision.body.rules import elsewhere
from rfea_vision.vision.body.sampling import RAYS
from rfea_vision.vision.body.skin import Skin
from rfea_vision.vision.body.wall import Wall
from rfea_vision.vision.find.begin import POINTING_PX, beside

FIRST_TURNS, FREE_TURNS = 8, 2  # of an outline; in the last ones its width is free, and its end, if that was held
# The outline is sought from ones that narrow or widen to these shares, too. Another is taken where so much of its edges is seen, and
# where it leaves at most so much unseen of what the first does: in no film of 20 bodies that keep their width, nor in 12 drawn ones.
OTHER_ENDS, WELL_SEEN, LEFT_UNSEEN = (0.5, 0.25, 2.0), 0.9, 0.5
# Of the edges, at most, by another beginning in place of one that is refused: of 163 real first frames pointed at three half widths
# beside their bodies (seen) 21 more were found where it had only to leave fewer than the refused one, and two with this.
ELSE_UNSEEN = 0.25  # and by that of a body with sides of another colour: on one side of a row of ribs there are gaps
AS_POINTED = 0.25  # and at its clamp it is as wide as that, within so much: a gap between two bodies may be wider, a rim narrower
LENGTH_SPREAD = 0.1  # how well the length is known when the first frame is searched, and while nothing tells it: rubber grows
END_NEAR = 0.45  # half widths off the hint: an end farther off is a line behind the body, or a shadow
# Half widths, 1 s.d.: so far beside it rays that agree found the end of 129 first frames that were drawn by two hands (seen; 1 px).
END_PLACED = 0.06
RANGE = 2.7  # standard deviations from the least to the most of seven rays
TIP_MISSED = 0.2  # half widths, or POINTING_PX: so far beside a mark's middle people click for it


@dataclass
class Begun:
    """What the first frame tells.

    Attributes
    ----------
    body : as its outline and the clicks have it
    covariance : (25, 25) px^2 of the displacement from there
    foot : (2, 2) px and 1, where it leaves its clamp, and the direction in which
    marks : coloured patches of it
    skin : its texture
    end_offsets : (RAYS,) px how far rays have its end beyond the last station, NaN where unseen; None where it is not believed
    tip_marked : whether the tip was pointed at on a mark
    pointed_px : how well the person points, 1 s.d., px of these pictures
    """

    body: SeenBody
    covariance: FloatArray
    foot: FloatArray
    marks: list[Mark]
    skin: Skin
    end_offsets: FloatArray | None
    tip_marked: bool
    pointed_px: float


class FirstFrame:
    """A picture in which a body is sought where it was pointed at."""

    def __init__(self, lab: Picture, wall: Wall, pointed: Pointed) -> None:
        self.lab, self.wall, self.pointed = lab, wall, pointed

    def begin(self, lines: list[FloatArray], before: Begun | None = None, *, end_held: bool = False) -> Begun:
        """Outline, colours, texture and end, sought along lines of stations (S, 2) px; by clamp and marks as found `before`."""
        lab, pointed, half = self.lab, self.pointed, self.pointed.half
        base, rungs = (before.foot[0], before.marks) if before else (pointed.clamp.mean(axis=0), [])
        if through := through_rungs(lab, lines, half, pointed.marks):
            lines, rungs = [through[0]], through[1]
        body = self._outline(lines, base, rungs, end_held)
        beyond, end_px = end_among(self._end_of(body), half)
        clear = end_px < END_NEAR * half
        end = body.points[-1] + beyond * body.tangents[-1]
        marks = [] if through else find_marks(lab, body, pointed.marks, pointed.enlarged)
        # A click that is nearer to a mark's middle than to the end that rays see is on the mark.
        nearer = float(np.linalg.norm(end - pointed.tip)) if clear else np.inf
        clicks = on_mark(pointed.line, marks, body, min(nearer, max(POINTING_PX * pointed.scale, TIP_MISSED * half)))
        if marked := clicks is not pointed.line:
            clear, end_px, end = False, END_NEAR * half, body.points[-1]
        body = replace(body, points=np.vstack([body.points[:-1], end]))
        # People point beside the body; its outline is led astray by shadows, gaps and what lies behind it.
        doubt, least = SYSTEMATIC * half, pointed.stderr
        clicked = pointing(missed_by(clicks, body, half, believed=clear), least, doubt)
        body = replace(body, told=told_from_wall(lab, body))
        points = as_pointed(body.points, clicks, half, least if marked else clicked, doubt + body.strays, end_px)
        body = with_beyond(lab, with_colours(lab, replace(body, points=points)))
        offsets = self._end_of(body)
        body = replace(body, told=told_from_wall(lab, body))
        if body.untold:  # then the end that is seen is that of the rest, if all rays see one
            offsets = self._end_of(body)
            offsets = np.where(np.ptp(offsets) < END_LEVEL * half, offsets, np.nan)
        believed = bool(np.isfinite(offsets).sum() > RAYS // 2 and abs(np.nanmedian(offsets)) < END_NEAR * half)
        covariance = pointed.covariance
        covariance[ALONG, ALONG] = np.eye(6) * 0.01
        covariance[WIDTH, WIDTH] = np.eye(8) * (0.05 * half) ** 2
        rungs = put_on(marks_in(lab, rungs, body, body, self.wall), body)
        missed = np.array([clicked, *missed_by(clicks, body, half, believed=believed)])
        return Begun(
            body, covariance, foot=np.array([body.points[0], leaving(pointed.clamp, body.points[:SQUARE])]),
            marks=rungs or find_marks(lab, body, pointed.marks, pointed.enlarged), skin=Skin.of(lab, body),
            end_offsets=offsets if believed else None, tip_marked=marked,
            pointed_px=max(clicked, float(np.sqrt(np.mean(missed**2)))),
        )  # fmt: skip

    def _outline(self, lines: list[FloatArray], base: FloatArray, rungs: list[Mark], end_held: bool) -> SeenBody:
        """The best outline along these lines, of those that are as wide all along and, where less is seen, of others.

        Of bodies with sides of another colour, and of such that narrow or widen.
        """
        body, unseen = None, np.inf
        for end, sided in ((1.0, False), (1.0, True), *((end, False) for end in OTHER_ENDS)):
            if sided and unseen <= 1.0 - WELL_SEEN:
                continue
            drawn = (self._drawn(line, base, rungs, end, end_held=end_held, sided=sided) for line in lines)
            found, _, left = max(drawn, key=lambda way: way[1])
            wider = abs(float(middle(found.half[: SQUARE + 1])) / self.pointed.half - 1.0)
            most = min(ELSE_UNSEEN if sided else 1.0 - WELL_SEEN, LEFT_UNSEEN * unseen)
            if body is None or (left < most and wider < AS_POINTED):
                body, unseen = found, left
            if unseen == 0.0:
                break
        assert body is not None
        return body

    def _drawn(
        self, line: FloatArray, base: FloatArray, rungs: list[Mark], end: float, *, end_held: bool, sided: bool
    ) -> tuple[SeenBody, float, float]:
        """The outline along a line, sought from one that narrows to a share `end`, or is `sided`; how well it is seen, how much not."""
        lab, pointed, half = self.lab, self.pointed, self.pointed.half
        width = half * (1.0 - (1.0 - end) * SHARES)
        body, fit = first_body(lab, line, width), None
        body = replace(body, sides=body.flanks) if sided else body
        foot = np.array([base, leaving(pointed.clamp, line[:SQUARE])])
        for turn in range(FIRST_TURNS):
            if turn < FIRST_TURNS - FREE_TURNS:
                body = replace(body, half=width)
            evidence = Evidence(lab, self.wall, foot, body.half, None, marks=marks_in(lab, rungs, body, body, self.wall))
            fit = fit_body(evidence, body, pointed.covariance, max(0.45 * float(middle(body.half)), 5.0))
            points = even(fit.body.points)
            if pointed.drawn or (end_held and turn < FIRST_TURNS - FREE_TURNS):
                points = held_near(points, line, pointed.near, drawn=pointed.drawn)
            body = with_colours(lab, replace(fit.body, points=points))
        assert fit is not None
        known = np.exp(-0.5 * ((body.length / pointed.length - 1.0) / LENGTH_SPREAD) ** 2)
        alike = 1.0 if pointed.colour is None else float(np.mean(like_colour(body.inside[:, 0], pointed.colour)))
        seen_here = (1.0 - fit.unseen) * (1.0 - elsewhere(pointed.allowed, body.points))
        return body, seen_here * (0.2 + standing_out(lab, body, half)) * (0.2 + known) * alike, fit.unseen

    def _end_of(self, body: SeenBody) -> FloatArray:
        return end_seen(self.lab, self.wall, body, self.pointed.half)


def end_seen(picture: Picture, wall: Wall, body: SeenBody, half_px: float) -> FloatArray:
    """How far (RAYS,) px beyond the last station the body ends, along rays through its end; NaN where unseen."""
    offsets = end_rays(picture, wall, body, 2.0 * half_px)
    return np.where(np.abs(offsets) < 2.0 * half_px, offsets, np.nan)


def held_near(points: FloatArray, line: FloatArray, near_px: float, *, drawn: bool) -> FloatArray:
    """Stations (S, 2) px held so near to a line at its end alone, or all along where a person has `drawn` it.

    A short body's round end draws an outline aside, and so do gaps between discs, and what lies beside the body.
    """
    off = points - line if drawn else SHARES[:, None] ** 2 * (points[-1] - line[-1])
    apart = np.linalg.norm(off if drawn else off[-1:], axis=1, keepdims=True)
    return points - off * (1.0 - np.minimum(1.0, near_px / np.maximum(apart, 1e-9)))


def missed_by(clicks: FloatArray, body: SeenBody, clamped_px: float, *, believed: bool) -> FloatArray:
    """What `clicks` (n, 2) px miss that a first frame shows, px: the clamp's width (`clamped_px` is half of it), the line, and the tip.

    Across the body, and along it where its end is `believed`.
    """
    tip = clicks[-1] - body.points[-1]
    missed = [2.0**0.5 * (float(middle(body.half[: SQUARE + 1])) - clamped_px), tip @ body.normals[-1]]
    return np.array(missed + [beside(body.points, point) for point in clicks[1:-1]] + [tip @ body.tangents[-1]] * believed)


def pointing(missed: FloatArray, least_px: float, doubt_px: float) -> float:
    """How well a person points, px (1 s.d.), `least_px` at best, by what clicks missed; of that `doubt_px` is the outline's own.

    By the median of it: people point alike everywhere, and an outline is led astray in one place.
    """
    return max(least_px, float(np.sqrt(max((np.median(np.abs(missed)) / QUARTILE) ** 2 - doubt_px**2, 0.0))))


def end_among(rays: FloatArray, half_px: float) -> tuple[float, float]:
    """How far (px) beyond a line rays (RAYS,), NaN where they see none, find its body's end, and how well that is known (1 s.d.).

    0, and `END_NEAR`, where fewer than half find one, or find it elsewhere.
    """
    seen = rays[np.isfinite(rays)]
    stderr = float(np.hypot(END_PLACED * half_px, np.ptp(seen) / RANGE)) if 2 * len(seen) > len(rays) else np.inf
    clear = stderr < END_NEAR * half_px and abs(np.median(seen)) < END_NEAR * half_px
    return (float(np.median(seen)), stderr) if clear else (0.0, END_NEAR * half_px)


def on_mark(clicks: FloatArray, marks: list[Mark], body: SeenBody, within_px: float) -> FloatArray:
    """The `clicks` (n, 2) px, their tip at the middle of the mark that was clicked for it, if one is nearer than so many px."""
    places = [place_of(mark, body) for mark in marks]
    apart = [float(np.linalg.norm(place - clicks[-1])) for place in places]
    return np.vstack([clicks[:-1], places[int(np.argmin(apart))]]) if min(apart, default=np.inf) < within_px else clicks


def learnt_end(rays: FloatArray, half_px: float, pointed_px: float, variance: float) -> FloatArray | None:
    """What rays (RAYS,) px are to say of an end that was unseen when it was pointed at, once all see it; None until then.

    It was pointed at beside its end, or its line has slipped since, by so much (1 s.d., and the variance, px^2): as either is likely.
    """
    return rays - variance / (pointed_px**2 + variance) * np.median(rays) if clear_end(rays, half_px) else None


def clear_end(rays: FloatArray, half_px: float) -> bool:
    """Whether all rays (RAYS,) px see one end, and near where it was expected."""
    return bool(np.ptp(rays) < END_LEVEL * half_px and abs(np.median(rays)) < END_NEAR * half_px)  # not so where a ray is NaN


def as_pointed(
    points: FloatArray, clicks: FloatArray, half_px: float, clicked_px: float, aside_px: FloatArray, end_px: float
) -> FloatArray:
    """Stations (S, 2) px between an outline and the `clicks` (n, 2) px, from the clamp's middle to the tip, by what both are worth.

    The middle of an outline errs by `aside_px` (S,) (1 s.d.), alike within a body width, and by `end_px` where it ends; a click
    by `clicked_px`. Kriging: Rasmussen and Williams, Gaussian Processes for Machine Learning, eq. 2.23.
    """
    tangents, normals = frame_of(points)
    places = along(points)
    near = np.array([0, *np.argmin(np.linalg.norm(points[:, None] - clicks[1:-1], axis=2), axis=0), STATIONS - 1], dtype=int)
    missed = np.sum((clicks - points[near]) * normals[near], axis=1)
    alike = np.exp(-0.5 * ((places[:, None] - places[near]) / (2.0 * half_px)) ** 2)
    doubt = np.outer(aside_px, aside_px[near]) * alike
    across = np.linalg.solve(doubt[near] + clicked_px**2 * np.eye(len(near)), missed)
    beyond = (clicks[-1] - points[-1]) @ tangents[-1] / (1.0 + (clicked_px / end_px) ** 2)
    points = points + (doubt * across) @ normals[near] + beyond * alike[:, -1:] * tangents[-1]
    return even(points)
