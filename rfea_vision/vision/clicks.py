"""Whether clamp and tip were pointed at on the body: what of the line lies on the wall, and where the body is seen to go."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along, scaled
from rfea_vision.vision.body.begin import SQUARE
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.body.gone import reached
from rfea_vision.vision.body.model import STATIONS, SeenBody, end_of, frame_of
from rfea_vision.vision.body.rules import MOST
from rfea_vision.vision.find.begin import HINT_CLAMP, HINT_ELSEWHERE, POINTING_PX

LEAST_CLEAR = 0.5  # of their scatter, the median along the body: chosen, most of what is read has more than 1
# Likewise, of a station: on mottled walls four in five had less, and the outline goes to those that have most. At half of this two of
# the three answers that a test expects hung on the noise, or on the processor.
STATION_CLEAR = 1.0
# Of the tube's length by the scale: another line is a body's that is as long as it, to so much. On seven films with one click beside
# the body it was so to 1 %; of bodies with a cap or tape at their end, which look like none of them, the rest is 0.87 to 0.98 as long.
AS_LONG = 0.05
SHORTEST = 0.8  # of that length: `reached` looks for ways from this to one and a half times this
# Stations at an end that look like the wall on one side: 5 to 45 where that end was clicked 20 to 130 px beside the body or beyond it;
# of 125 bodies that were pointed at rightly none had one at an end that is seen to be elsewhere.
HALF_ON_WALL = 4
LEAST_OWN = STATIONS // 5  # stations in a row from a click on: so much of the body tells its colours


class Aside(NamedTuple):
    """What was pointed at beside the body: the hint's name, its pixels in the film where the body is instead, and the body's length."""

    name: str
    places: FloatArray
    length_mm: float


def sides_clear(body: SeenBody) -> FloatArray:
    """By how many times their scatter (S, 2) a body's colour differs from what is beside it, to each side."""
    within, beside = body.inside[:, None], body.outside
    off = np.abs(within[:, :, 0] - beside[:, :, 0]) / np.sqrt(within[:, :, 1] + beside[:, :, 1])
    return np.asarray(off.max(axis=-1), dtype=float)


def on_wall(body: SeenBody) -> str:
    """Say from or up to where the line looks like what is on both sides of it: there it lies on the wall. Empty where it does not."""
    wall = sides_clear(body).max(axis=1) < STATION_CLEAR
    # From either end on the stations most of which are on it: as many as leave the fewest wrong.
    first, last = (np.cumsum(np.where(end, 1, -1)) for end in (wall, wall[::-1]))
    at_clamp = first.max() > last.max()
    count = int(np.argmax(first if at_clamp else last)) + 1
    if count < SQUARE:
        return ""
    where = f"up to {100 * count / STATIONS:.0f} %" if at_clamp else f"from {100 - 100 * count / STATIONS:.0f} % on"
    hints = "camera.clamp" if at_clamp else "camera.tip"
    if 2 * count > STATIONS:
        hints = "camera.clamp and camera.tip"
    return (
        f"{where} (of the way from clamp to tip) what was pointed at looks like the wall on both sides of it: check {hints} against "
        "the first frame"
    )


def aside(look: BodyFollower) -> Aside | None:
    """The click that is not on the body, by one that has looked at the first picture alone. None where none is known to be.

    Where all that looks like the body and hangs together with the other click is as long as the tube and ends elsewhere; if the line as
    it was pointed at was refused there, looks like the wall where it ends, on one side at least, or falls short of a body that goes on.
    """
    half_on_wall = sides_clear(look.body).min(axis=1) < LEAST_CLEAR
    first = look.first.fit
    line = _line_from(look, tip=False)
    if line is not None and float(np.linalg.norm(line[-1] - look.pointed.line[-1])) > _allowed(look, HINT_ELSEWHERE):
        goes_on = first is not None and first.beyond[:3].min() > MOST and along(line)[-1] > look.body.length
        if first is None or goes_on or end_of(half_on_wall) >= HALF_ON_WALL:
            return _instead(look, "tip", line[-1], line)
    line = _line_from(look, tip=True)
    if line is not None and (first is None or end_of(half_on_wall[::-1]) >= HALF_ON_WALL):
        near = int(np.argmin(np.linalg.norm(line - look.foot[0], axis=1)))
        across = frame_of(line)[1][near]
        if abs((look.foot[0] - line[near]) @ across) > _allowed(look, HINT_CLAMP):
            return _instead(look, "clamp", line[near] + look.pointed.half * across * np.array([[1.0], [-1.0]]), line)
    return None


def _line_from(look: BodyFollower, *, tip: bool) -> FloatArray | None:
    """Stations (S, 2) px of all that looks like the body and hangs together with its clamp, or its tip, from there on.

    By the colours that are seen in a row from there on. None where that is not as long as the tube.
    """
    body = look.body
    clear = sides_clear(body).min(axis=1) >= LEAST_CLEAR
    first = 0 if tip else SQUARE  # beside a clamp there is what holds it
    own = first + int(np.argmin(np.append((clear[::-1] if tip else clear)[first:], False)))
    if own - first < LEAST_OWN:
        return None
    taken = np.linspace(first // 2, own - 1, STATIONS).astype(int)
    taken = STATIONS - 1 - taken if tip else taken
    known = replace(body, inside=body.inside[taken], outside=body.outside[taken])
    foot = np.array([look.pointed.line[-1], -body.tangents[-1]]) if tip else look.foot
    length = look.pointed.length
    # Of one picture alone nothing is known to be another thing.
    ways = reached(look.shown, None, look.wall, known, foot, look.pointed.half, SHORTEST * length)
    return next((way for way in ways[1:] if abs(along(way)[-1] / length - 1.0) <= AS_LONG), None)


def _allowed(look: BodyFollower, halves: float) -> float:
    """How far (px) beside the body a person points."""
    return float(np.hypot(halves * look.pointed.half, POINTING_PX * look.scale))


def _instead(look: BodyFollower, name: str, places: FloatArray, line: FloatArray) -> Aside:
    return Aside(name, np.round(scaled(places, 1.0 / look.scale), 1), float(along(line)[-1]) / look.px_per_mm)
