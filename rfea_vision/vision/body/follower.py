"""The body from frame to frame: flow foretells, the fit measures, rules accept; the wall and the light are learnt on the way."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from contextlib import closing
from copy import copy, deepcopy
from dataclasses import replace
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.calibration.projection import unproject
from rfea_vision.lines import scaled
from rfea_vision.vision.body.around import looks_around, off_beside
from rfea_vision.vision.body.begin import Pointed, hinted_lines, onwards
from rfea_vision.vision.body.cut import through_cut_out
from rfea_vision.vision.body.first import (
    ELSE_UNSEEN,
    LEFT_UNSEEN,
    LENGTH_SPREAD,
    WELL_SEEN,
    Begun,
    FirstFrame,
    clear_end,
    end_seen,
    held_near,
    learnt_end,
)
from rfea_vision.vision.body.fit import (
    ALONG,
    END_LEVEL,
    NORMAL,
    TO_NORMAL,
    TRUSTED,
    UNKNOWNS,
    WIDTH,
    Evidence,
    Fit,
    beyond_half,
    fit_body,
)
from rfea_vision.vision.body.gone import CARRIED, UNIFORMLY, flown, held_to_length, led_to, reached
from rfea_vision.vision.body.guide import guide_of
from rfea_vision.vision.body.held import HeldView, SeenFrom
from rfea_vision.vision.body.known import LAGS, as_state, end_variance, fill_numbers
from rfea_vision.vision.body.look import AT_END, EndLook, as_long
from rfea_vision.vision.body.marks import along_line, marks_in, pointed_tip, row_apart
from rfea_vision.vision.body.model import Picture, SeenBody, Sight, in_light, middle, skin_of
from rfea_vision.vision.body.rules import First, in_front, may_go_on, refused
from rfea_vision.vision.body.sampling import RAYS
from rfea_vision.vision.body.shown import Shown, written_twice
from rfea_vision.vision.body.still import StillView, at_scale
from rfea_vision.vision.body.wall import Wall
from rfea_vision.vision.edges import fitted
from rfea_vision.vision.find.begin import FIRST_TRIES, Initialisation, Scene, allowed_pixels, off_hints
from rfea_vision.vision.find.ends import End

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
MOVING_PX = 0.5  # from frame to frame: a body that moves so and then not at all was written twice


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
        self.enlarged, self.picture_scale = max(scale, 1.0), min(scale, 1.0)  # before it is looked at, and as it is read, over the film
        self.pointed = Pointed(*scene.pointed(scale), scene.length_mm * self.px_per_mm, scale, self.enlarged, scene.hints)
        clamp, line, half = scene.pointed(self.picture_scale)
        self._view = HeldView(clamp, line, half) if held else StillView(line, half, HeldView(clamp, line, half))
        self._views: deque[SeenFrom] = deque()  # of pictures that are still to come
        self.seen_from = SeenFrom(np.eye(2, 3), seen=True, stderr=np.zeros(3))
        self.first_look = self  # as it was after the first frame, when there was one
        self.state: fitted.State | None = None
        self.work = fitted.new_buffers()
        self.start: Initialisation | None = None
        self.good, self.missed, self.guessed, self.frame = 0, 0, 0, -1  # guessed: in which nothing has told how long it is
        self.lengths = np.inf, 0.0  # px: the shortest and the longest that it was where its end was seen
        self.refusal, self.moved_px = "", 0.0  # by the last frame, where it moved most
        self.lost, self.unseen, self.known_length = False, False, 0.0  # since rays saw its end; px, how long it was then
        self.edge_offsets: FloatArray | None = None
        self.guide = guide_of(scene.hints, scene.pointed()[0])
        self.corrections = {later.frame: np.array(later.points) for later in scene.hints.corrections}
        self.again: FloatArray | None = None  # (n, 2) px of the film's first picture: where it was pointed at in this frame
        self.astray: list[int] = []  # frames in which a line that broke no other rule was not there
        self.marked, self.profile, self.moved_mm = False, None, np.zeros(2)
        self.material: dict[float, tuple[float, float]] = {}  # mm along the line, and standard error, by a mark's share

    def ahead(
        self, frames: Generator[tuple[float, NDArray[np.uint8]], None, None]
    ) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        """The same frames, all of which are to be followed: from where they are seen is found as they are read, maybe in a thread."""
        before, view = np.empty(0, dtype=np.uint8), None
        with closing(frames):
            for frame, (time_s, picture) in enumerate(frames):
                if view is None or frame in self.corrections or not written_twice(picture, before):
                    before, view = picture, self._look(picture, frame)
                self._views.append(view)
                yield time_s, picture

    def _look(self, picture: NDArray[np.uint8], frame: int) -> SeenFrom:
        """From where the picture of a frame is seen."""
        again = self.corrections.get(frame)
        if again is None or isinstance(self._view, StillView):
            return self._view.look(picture)
        return self._view.look(picture, scaled(again, self.picture_scale))

    def next(self, picture: NDArray[np.uint8], time_s: float) -> str:
        """Fit one frame (h, w, 3) BGR; returns an empty string, or the reason why it is refused."""
        self.frame += 1
        view = self._views.popleft() if self._views else None
        if self.hopeless():
            return self.refusal
        if self.good and self.missed == 0 and self.frame not in self.corrections and written_twice(picture, self.shown.picture):
            copied = self.moved_px > MOVING_PX  # of a body at rest pictures may be alike, too
            self.good += not copied
            return "duplicate" if copied else ""
        self.seen_from = view or self._look(picture, self.frame)
        if not self.seen_from.seen:
            self.missed, self.refusal = self.missed + 1, "off_hints: what holds the tube is not seen"
            return self.refusal
        self.again, again = None, self._pointed_again()
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
            if again is not None:
                fits = self._corrected(lab, again, fits)
        fit = max(fits, key=lambda found: (not found.reason, found.likeness))
        snapped = self.good and float(np.abs(fit.body.points - self.body.points).max()) > SNAPS * self.pointed.half
        if self.good and (fit.reason or snapped or fit.more) and not fit.reason.startswith("touches_border"):
            lines = self._reached(shown)  # it may have gone farther than was looked at
            lab = self.wall.look(shown, *self.looked_at(fit.body.points, *lines))
            found = (self._judged(lab, self._fit(lab, *self._ended(lab, *self._outlined(lab, line)), 0.8)) for line in lines)
            anew = next((anew for anew in found if not (anew.reason or anew.more)), fit)
            fit = anew if fit.reason or fit.more or anew.likeness > fit.likeness else fit
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
        if not reason or self.frame == 0:
            self.shown = shown
        if self.frame == 0:
            self.first_look = copy(self)
            self.first_look.wall = deepcopy(self.wall)
        return reason

    @property
    def view(self) -> FloatArray:
        """Map (2, 3) from a place in the film's first picture to that in the last one."""
        return at_scale(self.seen_from.moved, self.picture_scale)

    def looked_at(self, *lines: FloatArray) -> tuple[FloatArray, float]:
        """Places (n, 2) px, and how far around them a picture is looked at: where the body was, and on such lines; or all of it."""
        if self.good == 0 or self.guide is not None or self.frame in self.corrections:
            return EVERYWHERE
        return np.vstack([self.body.points, *lines]), LOOKED_AT[self.missed > 0] * float(middle(self.body.half))

    def _judged(self, lab: Picture, fit: Fit) -> Fit:
        """A fit with the reason for which it is no measurement: it leaves the hints, or breaks a rule."""
        fit.beside, fit.beyond = looks_around(lab, self.wall, fit.body)
        if self.first.fit is not None:
            fit.off = float(np.hypot(fit.off, off_beside(fit.body, fit.beside - self.first.fit.beside)))
        if self.good:
            fit.length_told, fit.another = as_long(self.wall.cleared(lab), fit.body, self.skin.colours, self.first.length)[1:]
        fit.more = may_go_on(self.first, fit)
        line_mm = unproject(self.camera, fit.body.points)
        lost = self.good > 0 and self.missed > 0 and not self.refusal.startswith("touches_border")
        broken = refused(self.first, fit, lost=lost, vouched=self.again is not None)
        fit.reason = broken or off_hints(line_mm, self.scene, first=self.good == 0, again=self.again)
        return fit

    def hopeless(self) -> bool:
        """Whether it was not where it was pointed at, in any frame in which it is looked for there."""
        return self.good == 0 and self.missed >= FIRST_TRIES

    def awaited(self) -> bool:
        """Whether a person points at it again in a frame that is still to come."""
        return any(frame > self.frame for frame in self.corrections)

    def clamp_stderr_mm(self) -> tuple[float, float | None]:
        """Standard error of the origin along the tube: it is where it was pointed at."""
        return self.pointed_px / self.scene.px_per_mm, None

    def _guided(self) -> FloatArray | None:
        """Stations where another program saw the body in this frame, from the clamp on."""
        line = None if self.guide is None else self.guide(self.frame)
        return None if line is None else onwards(scaled(line, self.scale), self.pointed.clamp.mean(axis=0))

    def _pointed_again(self) -> FloatArray | None:
        """Points (n, 2) px of the film's first picture at which a person points in this frame; None where at none."""
        if (points := self.corrections.get(self.frame)) is None or self.good == 0:
            return None
        back = np.asarray(cv2.invertAffineTransform(self.view), dtype=float)
        return points @ back[:, :2].T + back[:, 2]

    def _corrected(self, lab: Picture, again: FloatArray, carried: list[Fit]) -> list[Fit]:
        """Fits along the lines that points (n, 2) px of the film's first picture allow; where none holds, those that were `carried`."""
        self.again, clicks = again, np.vstack([self.pointed.line[:1], scaled(again, self.scale)])
        pointed = replace(self.pointed, line=clicks, length=self.known_length)
        known, none = pointed.covariance, np.zeros((UNKNOWNS, UNKNOWNS))
        known[NORMAL, NORMAL] *= (0.5 * pointed.near / pointed.half if pointed.drawn else 1.0) ** 2
        known[ALONG, ALONG] += pointed.stderr**2 * UNIFORMLY
        found = []
        for line in hinted_lines(lab, pointed):
            outline, _ = self._outlined(lab, line)
            outline = replace(outline, points=held_near(outline.points, line, pointed.near, drawn=pointed.drawn))
            found.append(self._judged(lab, self._fit(lab, outline, none, 0.8, covariance=known)))
        off = [off_hints(unproject(self.camera, fit.body.points), self.scene, again=again) for fit in carried]
        if off[0] and not carried[0].reason:
            self.astray.append(self.frame)
        for fit, elsewhere in zip(carried, off, strict=True):
            fit.reason = fit.reason or elsewhere
        return [fit for fit in found if not fit.reason] or carried

    def _first_fit(self, lab: Picture) -> Fit:
        """The first frame's fit along lines that the hints allow; refused, or a tenth of its edges unseen, begun in other ways.

        Another leaves a quarter unseen at most, in place of one that is refused, and half as many as one that is not.
        """
        self.pointed = replace(self.pointed, allowed=allowed_pixels(lab.shape, self.scene.hints, self.scale))
        begun = FirstFrame(lab, self.wall, self.pointed).begin(hinted_lines(lab, self.pointed))
        fit = self._begun_fit(lab, begun)
        if len(self.pointed.line) > 2 or not (fit.reason or fit.unseen > 1.0 - WELL_SEEN):
            return fit
        least, best = ELSE_UNSEEN if fit.reason else LEFT_UNSEEN * fit.unseen, begun
        for anew in self._begun_again(lab, begun):
            found = self._begun_fit(lab, anew)
            if not found.reason and found.unseen < least:
                least, best = found.unseen, anew
        return self._begun_fit(lab, best)

    def _begun_again(self, lab: Picture, before: Begun) -> Iterator[Begun]:
        """Other beginnings: by the lines and what is cut out, by clamp and marks as `before` and afresh, and of a body that curls."""
        for pointed in (self.pointed, replace(self.pointed, turned=True)):
            if (cut := through_cut_out(lab, pointed)) is not None:
                frame, hinted = FirstFrame(lab, self.wall, pointed), hinted_lines(lab, pointed)
                for known, lines in product((before, None), (hinted, [cut])):
                    yield frame.begin(lines, known, end_held=True)

    def _begun_fit(self, lab: Picture, begun: Begun) -> Fit:
        """The fit of a body that was begun so, from here on."""
        self.body, self.covariance, self.foot, self.marks, self.skin = begun.body, begun.covariance, begun.foot, begun.marks, begun.skin
        self.end_offsets, self.tip_marked, self.pointed_px = begun.end_offsets, begun.tip_marked, begun.pointed_px / self.scale
        self.told_tip = self.body.points[-1]
        tube = self.scene.length_mm, self.px_per_mm
        self.first = First(self.body.length, self.body.half, lab.shape[:2], *tube, self.pointed.allowed)
        base = End(0.0, self.pointed_px / self.scene.px_per_mm, "hint")
        self.start = Initialisation(as_state(self.camera, self.body, self.work), base, 0, 1.0)
        return self._judged(lab, self._fit(lab, self.body, self._spread(), 0.8))

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
        marks = marks_in(lab, self.marks, predicted, self.body if self.good and self.again is None else predicted, self.wall)
        if self.again is not None:
            marks.append(pointed_tip(scaled(self.again[-1], self.scale), self.pointed.stderr))
        evidence = replace(evidence, marks=marks)
        if skin:
            evidence = replace(evidence, skin=self.skin, edge_offsets=self.edge_offsets, end_offsets=self.end_offsets)
        return fit_body(evidence, predicted, (self.covariance if covariance is None else covariance) + spread, max(reach * half, 5.0))

    def _predicted(self, lab: Picture) -> tuple[SeenBody, FloatArray]:
        """The body of the last frame that was measured, moved as flow tells, and the covariance of this movement."""
        last, spread = self.last.body, self._spread()
        near, told, carried = flown(self.last, lab, self.wall)
        told[ALONG, ALONG] *= TRUSTED
        if self.end_offsets is None and carried < CARRIED:  # nothing else measures how long it is
            near = as_long(self.wall.cleared(lab), near, self.skin.colours, self.first.length).likeliest
            spread, told[ALONG, ALONG] = self._spread(LENGTH_SPREAD), 0.0
        covariance = np.asarray(np.linalg.inv(np.linalg.inv(spread) + told), dtype=float)
        gone = TO_NORMAL @ np.sum((near.points - last.points) * last.normals, axis=1)
        covariance[NORMAL, NORMAL] += np.diag((FLOW_MISSES * gone) ** 2)
        if self.unseen:
            # Its end: it is as long as when that was last seen, within the lengths that it has had.
            stderr = self.lengths[1] - self.lengths[0] + STRETCH_SHARE * self.known_length
            near, covariance = held_to_length(near, covariance, self.known_length, stderr)
        return self._ended(lab, near, covariance)

    def _ended(self, lab: Picture, near: SeenBody, covariance: FloatArray) -> tuple[SeenBody, FloatArray]:
        """A body foretold to a `covariance` (25, 25) px^2, led to where its end looks like what it was, and the covariance of that.

        As foretold where its end is seen clear there: what was beyond it may have gone.
        """
        if near.untold or clear_end(end_seen(lab, self.wall, near, self.pointed.half), self.pointed.half):
            return near, covariance
        found = self.look.found(self.wall.cleared(lab), near, AT_END @ covariance @ AT_END.T)
        return led_to(near, covariance, AT_END, *found)

    def _reached(self, shown: Shown) -> list[FloatArray]:
        """Where all is that looks like the body: stations as long as when its end was last seen, and as that is."""
        known = self.body, self.foot, self.pointed.half, self.known_length
        return [] if self.body.untold else reached(shown, self.shown, self.wall, *known)

    def _outlined(self, lab: Picture, line: FloatArray) -> tuple[SeenBody, FloatArray]:
        """The outline along such a line, and what that leaves open."""
        spread = np.zeros((UNKNOWNS, UNKNOWNS))
        near = self._fit(lab, replace(self.body, points=line), spread, 1.2, skin=False, covariance=self.pointed.covariance)
        return near.body, self._spread((near.body.length - self.body.length) / self.known_length)

    def _slipped(self, fit: Fit, end: FloatArray, *, level: bool) -> float:
        """Variance, px^2, of how far an end may lie along its body off where the fit has it, beyond what the covariance of that says.

        `end` (n,) are the rays that see it, and `level` is whether most do, and alike.
        """
        beyond = 1.0 - max((min(seen.mark.share, 1.0) for seen in fit.material), default=0.0)  # the last mark that is seen
        slipped = (beyond * (fit.body.length - self.known_length)) ** 2 if self.lost or self.unseen else 0.0
        slipped += 0.0 if level or self.again is None else self.pointed.stderr**2
        if self.good:
            slipped += fit.another**2  # two sorts of evidence disagree
            if not (level or fit.length_told or self.again is not None):  # a row of marks may have slipped by one; or it goes on
                slipped += (row_apart(fit.material) * fit.body.length) ** 2 + fit.more**2
            if self.end_offsets is None:
                grown = GROWS * float(np.linalg.norm(fit.body.points[-1] - self.told_tip))
                grown = float(np.hypot(grown, 0.0 if fit.length_told else LENGTH_SPREAD * fit.body.length))
                slipped += 1.0 / (fit.length_told * fit.shown + 1.0 / max(beyond * grown, 1e-3) ** 2)
        return slipped + (float(np.median(end)) ** 2 if len(end) >= RAYS // 2 else 0.0)  # rays, or what was carried, are off by that

    def _accept(self, lab: Picture, fit: Fit) -> None:
        end = fit.end[np.isfinite(fit.end)]
        level = self.end_offsets is not None and len(end) > RAYS // 2 and bool(np.ptp(end) < END_LEVEL * self.pointed.half)
        told = level or self.again is not None  # how long it is: by its end, or by a person
        self.unseen = self.end_offsets is not None and not told
        # Found again, it may lie off by a disc: until most rays see its end alike, it may as well be as long as when they last did.
        self.lost = (self.lost or self.missed > 0) and not told
        self.known_length = self.known_length if self.good and not told else fit.body.length
        self.told_tip = self.told_tip if self.again is None else fit.body.points[-1]
        slipped = self._slipped(fit, end, level=level)
        self.guessed += self.good > 0 and self.end_offsets is None and not fit.length_told and not fit.material
        if self.good == 0 or self.end_offsets is None or len(end) > RAYS // 2:
            self.lengths = min(self.lengths[0], fit.body.length), max(self.lengths[1], fit.body.length)
        if self.good:
            self.moved_px = float(np.abs(fit.body.points - self.body.points).max())
        self.body, self.covariance = fit.body, fit.covariance
        if self.good == 0:
            self.first.fit, self.edge_offsets = fit, beyond_half(lab, self.wall, fit.body)
            self.look = EndLook.of(lab, fit.body)
        self.good, self.missed = self.good + 1, 0
        lags = LAGS * (self.lengths[1] - self.lengths[0])
        if self.end_offsets is None and not self.body.untold:
            slips = 0.0 if self.tip_marked else end_variance(self.covariance, lags)
            known = self.pointed.half, self.pointed_px * self.scale, slips
            self.end_offsets = learnt_end(end_seen(lab, self.wall, self.body, self.pointed.half), *known)
        cleared = self.wall.cleared(lab)
        self.body = in_light(cleared, lab, self.body, fit.backing)
        self.last = Sight(self.body, lab, skin_of(cleared, self.body))
        self.skin.follow(self.last.skin)
        self.wall.learn(lab, self.body)
        self.state = as_state(self.camera, self.body, self.work)
        pointed = float(np.hypot(self.pointed_px, np.linalg.norm(self.seen_from.stderr[:2]) / self.picture_scale))
        fill_numbers(
            self.work, self.state, fit, self.px_per_mm, self.scale, lags=lags, pointed=pointed, slipped=slipped,
            mistaken=float(middle(self.first.half)) - self.pointed.half, turned=float(self.seen_from.stderr[2]),
        )  # fmt: skip
        self.work.numbers["width"][0] = 2.0 * self.scene.half_mm  # that of this body, not a doubt about it
        self.material = along_line(fit.material, self.body, unproject(self.camera, self.body.points), self.px_per_mm)
