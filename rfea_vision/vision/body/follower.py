"""The body from frame to frame: flow foretells, the fit measures, rules accept; the wall and the light are learnt on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.calibration.projection import unproject
from rfea_vision.lines import scaled
from rfea_vision.vision.body.around import looks_around, off_beside
from rfea_vision.vision.body.begin import (
    END_NEAR,
    SQUARE,
    TIP_MISSED,
    as_pointed,
    end_among,
    even,
    first_body,
    held_near,
    hinted_lines,
    learnt_end,
    leaving,
    like_colour,
    missed_by,
    on_mark,
    onwards,
    pointing,
    standing_out,
    through_rungs,
)
from rfea_vision.vision.body.cut import through_cut_out
from rfea_vision.vision.body.fit import (
    ALONG,
    END_LEVEL,
    NORMAL,
    SYSTEMATIC,
    TO_NORMAL,
    TRUSTED,
    UNKNOWNS,
    WIDTH,
    Evidence,
    Fit,
    beyond_half,
    end_rays,
    fit_body,
)
from rfea_vision.vision.body.gone import CARRIED, UNIFORMLY, as_long, flown, held_to_length, reached
from rfea_vision.vision.body.guide import guide_of
from rfea_vision.vision.body.held import HeldView
from rfea_vision.vision.body.known import LAGS, POINTED_PX, as_state, end_variance, fill_numbers
from rfea_vision.vision.body.marks import Mark, along_line, find_marks, marks_in, put_on
from rfea_vision.vision.body.model import (
    SHARES,
    STATIONS,
    Picture,
    SeenBody,
    Sight,
    Skin,
    follow_colours,
    frame_of,
    lab_of,
    learn_beyond,
    learn_colours,
    middle,
    skin_of,
    told_from_wall,
)
from rfea_vision.vision.body.rules import First, elsewhere, in_front, refused
from rfea_vision.vision.body.sampling import RAYS
from rfea_vision.vision.body.shown import Shown
from rfea_vision.vision.body.still import StillView, at_scale
from rfea_vision.vision.body.wall import Wall
from rfea_vision.vision.edges import fitted
from rfea_vision.vision.find.begin import FIRST_TRIES, POINTING_PX, Initialisation, Scene, allowed_pixels, off_hints
from rfea_vision.vision.find.ends import End

FIRST_TURNS, FREE_TURNS = 8, 2  # of an outline; in the last ones its width is free, and its end, if that was held
# The outline is sought from ones that narrow or widen to these shares, too. Another is taken where so much of its edges is seen, and
# where it leaves at most so much unseen of what the first does: in no film of 20 bodies that keep their width, nor in 12 drawn ones.
OTHER_ENDS, WELL_SEEN, LEFT_UNSEEN = (0.5, 0.25, 2.0), 0.9, 0.5
AS_POINTED = 0.25  # and at its clamp it is as wide as that, within so much: a gap between two bodies may be wider, a rim narrower
NORMAL_SPREAD, SLIP_PX, GAIN_SHARE = 3.0, 0.1, 0.02  # what one frame adds: px across and along, share of the half width
STRETCH_SHARE = 0.006  # of the length: by how much all of it stretches from one frame to the next
GROWS = 0.2  # of the way that an end has gone since it was pointed at, 1 s.d., chosen: so much a body that bends may have grown unseen
SNAPS = 1.0  # half widths from one frame to the next, chosen: what has gone so far is sought anew as well
# Half widths around where it was: within four are skin and edges, it moves by less than the rest; as far as flow may have lost it.
LOOKED_AT = 8.0, 16.0
EVERYWHERE = np.zeros((1, 2)), np.inf
# Share of a way across the body that flow may miss, 1 s.d., chosen: glare and shadows stay behind where a body turns, and
# a line that was carried by them from frame to frame lagged behind both edges.
FLOW_MISSES = 0.05
POINTED_SHARE = 0.05  # of the half width, 1 s.d., chosen: the middle of a wide body is not pointed at to the pixel
MOVING_PX = 0.5  # from frame to frame: a body that moves so and then not at all was written twice
LENGTH_SPREAD = 0.1  # how well the length is known when the first frame is searched, and while nothing tells it: rubber grows


class BodyFollower:
    """Carries the body from frame to frame; the same outside as `Follower`, but its pictures are in colour.

    Parameters
    ----------
    scene : with clamp and tip pointed at
    scale : of the pictures in which it is followed over those of the film, in which the hints were given
    held : by something that moves, so that the wall does in the pictures
    """

    def __init__(self, scene: Scene, scale: float, *, held: bool = False) -> None:
        self.scene, self.scale, self.held = scene, scale, held
        self.px_per_mm = scene.px_per_mm * scale
        self.camera = scene.camera.copy()
        self.camera[1:3] *= scale
        self.camera[3:5] = scaled(self.camera[3:5], scale)
        self.clamp, self.line, self.pointed_half = scene.pointed(scale)
        self.foot = np.array([self.clamp.mean(axis=0), leaving(self.clamp, self.line[:2])])
        self.enlarged, self.picture_scale = max(scale, 1.0), min(scale, 1.0)  # before it is looked at, and as it is read, over the film
        clamp, line, half = scene.pointed(self.picture_scale)
        self.seen_from = HeldView(clamp, line, half) if held else StillView(line, half)
        self.state: fitted.State | None = None
        self.work = fitted.new_buffers()
        self.start: Initialisation | None = None
        self.good, self.missed, self.guessed, self.frame = 0, 0, 0, -1  # guessed: in which nothing has told how long it is
        self.lengths = np.inf, 0.0  # px: the shortest and the longest that it was where its end was seen
        self.refusal, self.moved_px = "", 0.0  # by the last frame, where it moved most
        self.lost, self.unseen, self.known_length = False, False, 0.0  # since rays saw its end; px, how long it was then
        self.edge_offsets: FloatArray | None = None
        self.guide = guide_of(scene.hints, scene.pointed()[0])
        self.marked, self.profile, self.moved_mm = False, None, np.zeros(2)
        self.marks: list[Mark] = []
        self.material: dict[float, tuple[float, float]] = {}  # mm along the line, and standard error, by a mark's share
        self.colour = None if scene.hints.colour is None else lab_of(scene.hints.colour)
        self.first = First(1.0, np.ones(STATIONS), (0, 0), scene.length_mm, self.px_per_mm, None)

    def next(self, picture: NDArray[np.uint8], time_s: float) -> str:
        """Fit one frame (h, w, 3) BGR; returns an empty string, or the reason why it is refused."""
        self.frame += 1
        if self.hopeless():
            return self.refusal
        if self.good and self.missed == 0 and np.array_equal(picture, self.shown.picture):
            copied = self.moved_px > MOVING_PX  # of a body at rest pictures may be alike, too
            self.good += not copied
            return "duplicate" if copied else ""
        self.seen_from.look(picture)
        if not self.seen_from.seen:
            self.missed, self.refusal = self.missed + 1, "off_hints: what holds the tube is not seen"
            return self.refusal
        shown = Shown(picture, self.enlarged, self.seen_from.moved)
        if self.good == 0:
            self.wall = Wall(shown.shape, still=not self.held)
        lab = self.wall.look(shown, *self.looked_at())
        guided = self._guided()
        if self.good == 0:
            fits = [self._first_fit(lab)]
        else:
            fits = [self._judged(lab, self._fit(lab, *self._predicted(lab), 0.8 if self.missed == 0 else 1.5))]
            if guided is not None:
                fits.append(self._judged(lab, self._fit(lab, replace(self.body, points=guided), self._spread(), 0.8)))
        fit = max(fits, key=lambda found: (not found.reason, found.likeness))
        snapped = self.good and float(np.abs(fit.body.points - self.body.points).max()) > SNAPS * self.pointed_half
        if self.good and (fit.reason or snapped) and not fit.reason.startswith("touches_border"):
            lines = self._reached(shown)  # it may have gone farther than was looked at
            lab = self.wall.look(shown, *self.looked_at(fit.body.points, *lines))
            found = (self._judged(lab, self._fit(lab, *self._outlined(lab, line), 0.8)) for line in lines)
            anew = next((anew for anew in found if not anew.reason), fit)
            fit = anew if fit.reason or anew.likeness > fit.likeness else fit
        reason = fit.reason
        if reason and self.good and self.refusal.startswith("touches_border") and not reason.startswith("touches_border"):
            reason = "touches_border: the tip has left the picture, and is not found again"
        if reason and self.good and not reason.startswith("touches_border"):
            seen = [in_front(self.first, lab, self.wall, body) for body in (self.body, fit.body)]
            reason = seen[1] if all(seen) else reason  # where it was, and where it is found: it may have gone away
        self.refusal = reason
        self.missed += bool(reason)
        if not reason:
            self._accept(lab, fit)
            self.shown = shown
        return reason

    @property
    def view(self) -> FloatArray:
        """Map (2, 3) from a place in the film's first picture to that in the last one."""
        return at_scale(self.seen_from.moved, self.picture_scale)

    def looked_at(self, *lines: FloatArray) -> tuple[FloatArray, float]:
        """Places (n, 2) px, and how far around them a picture is looked at: where the body was, and on such lines; or all of it."""
        if self.good == 0 or self.guide is not None:
            return EVERYWHERE
        return np.vstack([self.body.points, *lines]), LOOKED_AT[self.missed > 0] * float(middle(self.body.half))

    def _judged(self, lab: Picture, fit: Fit) -> Fit:
        """A fit with the reason for which it is no measurement: it leaves the hints, or breaks a rule."""
        fit.beside, fit.beyond = looks_around(lab, self.wall, fit.body)
        if self.first.fit is not None:
            fit.off = float(np.hypot(fit.off, off_beside(fit.body, fit.beside - self.first.fit.beside)))
        line_mm = unproject(self.camera, fit.body.points)
        lost = self.good > 0 and self.missed > 0 and not self.refusal.startswith("touches_border")
        fit.reason = refused(self.first, fit, lost=lost) or off_hints(line_mm, self.scene, first=self.good == 0)
        return fit

    def hopeless(self) -> bool:
        """Whether it was not where it was pointed at, in any frame in which it is looked for there."""
        return self.good == 0 and self.missed >= FIRST_TRIES

    def clamp_stderr_mm(self) -> tuple[float, float | None]:
        """Standard error of the origin along the tube: it is where it was pointed at."""
        return self.pointed_px / self.scene.px_per_mm, None

    def _guided(self) -> FloatArray | None:
        """Stations where another program saw the body in this frame, from the clamp on."""
        line = None if self.guide is None else self.guide(self.frame)
        return None if line is None else onwards(scaled(line, self.scale), self.clamp.mean(axis=0))

    def _first_fit(self, lab: Picture) -> Fit:
        """The first frame's fit along lines that the hints allow; refused, or a tenth of its edges unseen, by what is cut out."""
        self.first.shape, self.first.allowed = lab.shape[:2], allowed_pixels(lab.shape, self.scene.hints, self.scale)
        size, allowed = (self.pointed_half, self.scene.length_mm * self.px_per_mm), self.first.allowed
        lines = hinted_lines(lab, self.clamp, self.line, *size, colour=self.colour, allowed=allowed)
        before, fit = (self.foot.copy(), self.marks), self._begin(lab, lines)
        doubted = bool(fit.reason) or fit.unseen > 1.0 - WELL_SEEN
        if not doubted or len(self.line) > 2 or (cut := through_cut_out(lab, self.clamp, self.line[-1], *size, allowed)) is None:
            return fit
        for again in (lines, [cut]):
            anew = self._begin(lab, again, end_held=True)
            if not anew.reason and (fit.reason or anew.unseen < min(1.0 - WELL_SEEN, LEFT_UNSEEN * fit.unseen)):
                return anew
        self.foot, self.marks = before
        return self._begin(lab, lines)

    def _begin(self, lab: Picture, lines: list[FloatArray], *, end_held: bool = False) -> Fit:
        """Outline, colours, texture and end in the first frame, sought along lines of stations (S, 2) px; and its fit."""
        half = self.pointed_half
        self.covariance = self.pointed = np.diag([*np.full(11, half**2), *np.full(6, 1e-4), *np.full(8, (0.15 * half) ** 2)])
        hinted = None if self.scene.hints.marks is None else lab_of(self.scene.hints.marks)
        if through := through_rungs(lab, lines, half, hinted):
            lines, self.marks = [through[0]], through[1]
        unseen = np.inf
        for end in (1.0, *OTHER_ENDS):
            body, _, left = max((self._drawn(lab, line, end, end_held) for line in lines), key=lambda way: way[1])
            wider = abs(float(middle(body.half[: SQUARE + 1])) / half - 1.0)
            if end == 1.0 or (left < min(1.0 - WELL_SEEN, LEFT_UNSEEN * unseen) and wider < AS_POINTED):
                self.body, unseen = body, left
            if unseen == 0.0:
                break
        beyond, end_px = end_among(self._end_seen(lab, half), half)
        clear = end_px < END_NEAR * half
        end = self.body.points[-1] + beyond * frame_of(self.body.points)[0][-1]
        marks = [] if through else find_marks(lab, self.body, hinted, self.enlarged)
        # A click that is nearer to a mark's middle than to the end that rays see is on the mark.
        nearer = float(np.linalg.norm(end - self.line[-1])) if clear else np.inf
        clicks = on_mark(self.line, marks, self.body, min(nearer, max(POINTING_PX * self.scale, TIP_MISSED * half)))
        if marked := clicks is not self.line:
            clear, end_px, end = False, END_NEAR * half, self.body.points[-1]
        self.body.points[-1] = end
        # People point beside the body; its outline is led astray by shadows, gaps and what lies behind it.
        doubt, least = SYSTEMATIC * half, float(np.hypot(POINTED_PX * self.scale, POINTED_SHARE * half))
        clicked = pointing(missed_by(clicks, self.body, half, believed=clear), least, doubt)
        self.body.told = told_from_wall(self.body)
        self.body.points = as_pointed(self.body.points, clicks, half, least if marked else clicked, doubt + self.body.strays, end_px)
        learn_colours(lab, self.body)
        learn_beyond(lab, self.body)
        offsets = self._end_seen(lab, half)
        self.body.told = told_from_wall(self.body)
        if self.body.untold:  # then the end that is seen is that of the rest, if all rays see one
            offsets = self._end_seen(lab, half)
            offsets = np.where(np.ptp(offsets) < END_LEVEL * half, offsets, np.nan)
        believed = np.isfinite(offsets).sum() > RAYS // 2 and abs(np.nanmedian(offsets)) < END_NEAR * half
        self.end_offsets, self.tip_marked = offsets if believed else None, marked
        self.skin = Skin.of(lab, self.body)
        self.covariance = self.covariance.copy()
        self.covariance[ALONG, ALONG] = np.eye(6) * 0.01
        self.covariance[WIDTH, WIDTH] = np.eye(8) * (0.05 * half) ** 2
        rungs = put_on(marks_in(lab, self.marks, self.body, self.body, self.wall), self.body)
        self.marks = rungs or find_marks(lab, self.body, hinted, self.enlarged)
        self.foot[:] = self.body.points[0], leaving(self.clamp, self.body.points[:SQUARE])
        self.first_tip = self.body.points[-1].copy()
        self.first.length, self.first.half = self.body.length, self.body.half.copy()
        missed = np.array([clicked, *missed_by(clicks, self.body, half, believed=bool(believed))])
        self.pointed_px = max(clicked, float(np.sqrt(np.mean(missed**2)))) / self.scale
        pointed = End(0.0, self.pointed_px / self.scene.px_per_mm, "hint")
        self.start = Initialisation(as_state(self.camera, self.body, self.work), pointed, 0, 1.0)
        return self._judged(lab, self._fit(lab, self.body, self._spread(), 0.8))

    def _drawn(self, lab: Picture, line: FloatArray, end: float, end_held: bool) -> tuple[SeenBody, float, float]:
        """The outline along a line, sought from one that narrows to a share `end`; how well it is seen, how much of its edges not."""
        half, length = self.pointed_half, self.scene.length_mm * self.px_per_mm
        width = half * (1.0 - (1.0 - end) * SHARES)
        body, drawn, fit = first_body(lab, line, width), len(self.line) >= 4, None
        self.foot[1] = leaving(self.clamp, line[:SQUARE])
        for turn in range(FIRST_TURNS):
            if turn < FIRST_TURNS - FREE_TURNS:
                body.half[:] = width
            self.first.half = body.half
            fit = self._fit(lab, body, np.zeros((UNKNOWNS, UNKNOWNS)), 0.45, skin=False)
            body = fit.body
            body.points = even(body.points)
            if drawn or (end_held and turn < FIRST_TURNS - FREE_TURNS):
                body.points = held_near(body.points, line, half, self.scale, drawn=drawn)
            learn_colours(lab, body)
        assert fit is not None
        known = np.exp(-0.5 * ((body.length / length - 1.0) / LENGTH_SPREAD) ** 2)
        alike = 1.0 if self.colour is None else float(np.mean(like_colour(body.inside[:, 0], self.colour)))
        seen_here = (1.0 - fit.unseen) * (1.0 - elsewhere(self.first, body.points))
        return body, seen_here * (0.2 + standing_out(lab, body, half)) * (0.2 + known) * alike, fit.unseen

    def _end_seen(self, lab: Picture, half: float) -> FloatArray:
        """How far (RAYS,) px beyond the last station the body ends, along rays through its end; NaN where unseen."""
        offsets = end_rays(lab, self.wall, self.body, 2.0 * half)
        return np.where(np.abs(offsets) < 2.0 * half, offsets, np.nan)

    def _spread(self, unknown: float = 0.0) -> FloatArray:
        """Covariance (25, 25) px^2 of what the body may have moved since it was last seen; `unknown` is a share of its length."""
        half, frames = float(middle(self.body.half)), 1.0 + self.missed
        spread = np.zeros((UNKNOWNS, UNKNOWNS))
        for part, sigma in ((NORMAL, NORMAL_SPREAD), (ALONG, SLIP_PX), (WIDTH, GAIN_SHARE * half)):
            spread[part, part] += frames * sigma**2 * np.eye(part.stop - part.start)
        spread[ALONG, ALONG] += (frames * STRETCH_SHARE**2 + unknown**2) * self.body.length**2 * UNIFORMLY
        return spread

    def _fit(
        self, lab: Picture, predicted: SeenBody, spread: FloatArray, reach: float, *, skin: bool = True,
        covariance: FloatArray | None = None,
    ) -> Fit:  # fmt: skip
        half = float(middle(predicted.half))
        evidence = Evidence(lab, self.wall, self.foot, self.first.half, None, lost=self.missed > 0)
        evidence = replace(evidence, marks=marks_in(lab, self.marks, predicted, self.body if self.good else predicted, self.wall))
        if skin:
            evidence = replace(evidence, skin=self.skin, edge_offsets=self.edge_offsets, end_offsets=self.end_offsets)
        return fit_body(evidence, predicted, (self.covariance if covariance is None else covariance) + spread, max(reach * half, 5.0))

    def _predicted(self, lab: Picture) -> tuple[SeenBody, FloatArray]:
        """The body of the last frame that was measured, moved as flow tells, and the covariance of this movement."""
        last, spread = self.last.body, self._spread()
        near, told, carried = flown(self.last, lab, self.wall, self.foot[0])
        told[ALONG, ALONG] *= TRUSTED
        if self.end_offsets is None and carried < CARRIED:  # nothing else measures how long it is
            near, _ = as_long(lab, self.wall, near, self.skin.colours, self.first.length)
            spread, told[ALONG, ALONG] = self._spread(LENGTH_SPREAD), 0.0
        covariance = np.asarray(np.linalg.inv(np.linalg.inv(spread) + told), dtype=float)
        gone = TO_NORMAL @ np.sum((near.points - last.points) * frame_of(last.points)[1], axis=1)
        covariance[NORMAL, NORMAL] += np.diag((FLOW_MISSES * gone) ** 2)
        if self.unseen:
            # Its end: it is as long as when that was last seen, within the lengths that it has had.
            stderr = self.lengths[1] - self.lengths[0] + STRETCH_SHARE * self.known_length
            return held_to_length(near, covariance, self.known_length, stderr)
        return near, covariance

    def _reached(self, shown: Shown) -> list[FloatArray]:
        """Where all is that looks like the body: stations as long as when its end was last seen, and as that is."""
        known = self.body, self.foot, self.pointed_half, self.known_length
        return [] if self.body.untold else reached(shown, self.shown, self.wall, *known)

    def _outlined(self, lab: Picture, line: FloatArray) -> tuple[SeenBody, FloatArray]:
        """The outline along such a line, and what that leaves open."""
        near = self._fit(lab, replace(self.body, points=line), 0.0 * self.pointed, 1.2, skin=False, covariance=self.pointed)
        return near.body, self._spread((near.body.length - self.body.length) / self.known_length)

    def _accept(self, lab: Picture, fit: Fit) -> None:
        end = fit.end[np.isfinite(fit.end)]
        level = self.end_offsets is not None and len(end) > RAYS // 2 and bool(np.ptp(end) < END_LEVEL * self.pointed_half)
        self.unseen = self.end_offsets is not None and not level
        # Found again, it may lie off by a disc: until most rays see its end alike, it may as well be as long as when they last did.
        self.lost = (self.lost or self.missed > 0) and not level
        self.known_length = self.known_length if self.good and not level else fit.body.length
        beyond = 1.0 - max((min(seen.mark.share, 1.0) for seen in fit.material), default=0.0)  # the last mark that is seen
        slipped = (beyond * (fit.body.length - self.known_length)) ** 2 if self.lost or self.unseen else 0.0
        if self.good and self.end_offsets is None:
            _, told = as_long(lab, self.wall, fit.body, self.skin.colours, self.first.length)
            self.guessed += not told and not fit.material
            grown = GROWS * float(np.linalg.norm(fit.body.points[-1] - self.first_tip))
            grown = float(np.hypot(grown, 0.0 if told else LENGTH_SPREAD * fit.body.length))
            slipped += 1.0 / (told * fit.shown + 1.0 / max(beyond * grown, 1e-3) ** 2)
        slipped += float(np.median(end)) ** 2 if len(end) >= RAYS // 2 else 0.0  # rays, or what was carried, are off by that
        if self.good == 0 or self.end_offsets is None or len(end) > RAYS // 2:
            self.lengths = min(self.lengths[0], fit.body.length), max(self.lengths[1], fit.body.length)
        if self.good:
            self.moved_px = float(np.abs(fit.body.points - self.body.points).max())
        self.body, self.covariance = fit.body, fit.covariance
        if self.good == 0:
            self.first.fit, self.edge_offsets = fit, beyond_half(lab, self.wall, fit.body)
        self.good, self.missed = self.good + 1, 0
        lags = LAGS * (self.lengths[1] - self.lengths[0])
        if self.end_offsets is None and not self.body.untold:
            slips = 0.0 if self.tip_marked else end_variance(self.covariance, lags)
            known = self.pointed_half, self.pointed_px * self.scale, slips
            self.end_offsets = learnt_end(self._end_seen(lab, self.pointed_half), *known)
        cleared = self.wall.cleared(lab)
        follow_colours(cleared, lab, self.body, fit.backing)
        self.last = Sight(self.body, lab, skin_of(cleared, self.body))
        self.skin.follow(self.last.skin)
        self.wall.learn(lab, self.body)
        self.state = as_state(self.camera, self.body, self.work)
        pointed = float(np.hypot(self.pointed_px, np.linalg.norm(self.seen_from.stderr[:2]) / self.picture_scale))
        fill_numbers(
            self.work, self.state, fit, self.px_per_mm, self.scale, lags=lags, pointed=pointed, slipped=slipped,
            mistaken=float(middle(self.first.half)) - self.pointed_half, turned=float(self.seen_from.stderr[2]),
        )  # fmt: skip
        self.work.numbers["width"][0] = 2.0 * self.scene.half_mm  # that of this body, not a doubt about it
        self.material = along_line(fit.material, self.body, unproject(self.camera, self.body.points), self.px_per_mm)
