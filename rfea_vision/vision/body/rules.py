"""Which fits of the body are measurements: one table of rules, each with its limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray, longest
from rfea_vision.vision.body.around import BEYOND
from rfea_vision.vision.body.begin import PIECES
from rfea_vision.vision.body.fit import Fit
from rfea_vision.vision.body.model import ACROSS_TEXTURE, SHARES, STATIONS, Picture, SeenBody, middle, skin_of
from rfea_vision.vision.body.sampling import SEEN
from rfea_vision.vision.body.wall import Wall
from rfea_vision.vision.curve import SHARPEST
from rfea_vision.vision.find.begin import digits_of

MIDDLES = slice(STATIONS // PIECES // 2, None, STATIONS // PIECES)  # of five pieces along the body
INNER = np.abs(ACROSS_TEXTURE) < 0.7  # half widths: what lies farther out is read with an edge
# Limits of the table at the end, set on the even scenes of testing/phone.py, that of the last body width on scene 7.
# Most of the last body width, and of the last fifth, looks like the body or has its edges; most of what lies beyond the end does not.
MOST = 0.5
# Of the length: what holds for less than that in one piece may be chance, and so much of the line may lie where the hints forbid it.
PIECE = 0.1
# Times as long as wide. Chosen between 1.2 and 1.8: of filmed bodies of 1.0, 1.0 and 1.2 none was followed well, one of 1.8 was.
LEAST_SLENDER = 1.5
# Of both its edges so much must be seen in the first frame (arms 0.31 and more; beside them the worse edge 0.22 at most), and of one
# ever after. Of 14,901 frames of 200 drawn films (seen) these two refuse 63 later ones; in 60 the line was off by half its width.
FIRST_SEEN = 0.25
LENGTHS = (0.75, 1.5)  # of the first frame's: rubber is not drawn out farther by its own pressure
# Likewise of its width: a muscle's braid opens to 2.4 times its width at most, from 20 to 54.7 degrees; silicone arms swelled to 1.8.
WIDTHS = (0.5, 2.4)
FOLDED = "the line that fits is folded"
# The line ends short where rays find the end so many half widths beyond it, and so much of what lies between looks like the body:
# 0.43 to 0.71 and 0.57 to 0.86 where an arm that swelled went on by up to 10 mm. Either alone is seen in films that are followed
# well: rays find a ruled line, and lines look like rubber; both together were not.
END_OFF = 0.3
# An end that is seen up to a half width beyond the line is known to how far that is, if the line is square to it: in five drawn films
# (seen) rays to either side of right lines differed by 0.4 half widths at most there, and by 0.8 and more where one had gone astray.
END_SQUARE = 0.5
# Of neither colour, in variances of the body's over three channels: where evidence has stopped to count it (7 standard deviations).
# Of all of a body, chosen: a hand leaves more.
STRANGE, MOST_HIDDEN = 50.0, 0.95


@dataclass
class First:
    """The first frame, to which all others are compared: length and half width (S,) px, and its `fit`, None until it is accepted.

    `shape` is that of the picture, `length_mm` the tube's; `allowed` (h, w) says where the hints let it be (None: everywhere).
    """

    length: float
    half: FloatArray
    shape: tuple[int, int]
    length_mm: float
    px_per_mm: float
    allowed: NDArray[np.bool_] | None
    fit: Fit | None = None


def elsewhere(allowed: NDArray[np.bool_] | None, points: FloatArray) -> float:
    """Share of the points (n, 2) that lie where the hints say that the body never is: outside of `allowed` (h, w)."""
    if allowed is None:
        return 0.0
    x, y = np.clip(np.round(points), 0, np.array(allowed.shape[::-1]) - 1).astype(int).T
    return float(np.mean(~allowed[y, x]))


def _elsewhere(first: First, fit: Fit) -> str:
    share = elsewhere(first.allowed, fit.body.points)
    return (
        "" if share <= PIECE else f"{100 * share:.0f} % of it lies where camera.region or camera.exclude forbid it"
    )


def _beyond(first: First, fit: Fit) -> str:
    """The end is measured only where the body reaches to it."""
    # A dot that is stuck on the end looks like nothing of the body, but has its edges. Of a line that had left a fish's thin tail a
    # third of the last fifth at most was like it.
    there = np.maximum(fit.backing, fit.seen.all(axis=1))[: fit.body.last + 1]
    for count, part in ((fit.body.width_in_stations, "body width"), (STATIONS // PIECES, "fifth")):
        share = float(np.mean(there[-count:]))
        if share < MOST:
            return f"{100 * share:.0f} % of the last {part} looks like the tube, or has its edges"
    return ""


def _squat(first: First, fit: Fit) -> str:
    """Of a body about as long as wide the edges do not say which way its line goes."""
    slender = fit.body.length / (2.0 * float(middle(fit.body.half)))
    return "" if first.fit is not None or slender >= LEAST_SLENDER else f"it is {slender:.1f} times as long as wide"


def _short(first: First, fit: Fit) -> str:
    """The body does not go on beyond the line, up to where the rays find its end.

    What lies beyond an end that the skin tells is another thing that looks like it: its image in a table, a hose.
    """
    if fit.length_told:
        return ""
    seen = fit.end[np.isfinite(fit.end)].tolist()
    off, half = goes_on(fit), float(middle(fit.body.half))
    if off == 0.0 or (first.fit is not None and off <= half and np.ptp(seen) <= END_SQUARE * half):
        return ""
    return f"the tube goes on beyond the line's end, by {off / first.px_per_mm:.{digits_of(first.length_mm) + 1}f} mm or more"


def goes_on(fit: Fit) -> float:
    """How far (px) a body goes on beyond its line, to where rays find its end; 0 if that is near, or what is between unlike it."""
    off, half = median(fit.end[np.isfinite(fit.end)].tolist() or [0.0]), float(middle(fit.body.half))
    between = fit.beyond[: max(int(np.sum(BEYOND * half < off)), 1)]
    return off if off > END_OFF * half and between.min() > MOST else 0.0


def may_go_on(first: First, fit: Fit) -> float:
    """How far (px) a body may go on beyond its line, where rays find no end; 0 where what is there is no more like it than at first.

    It is where all up to one and a half half widths on is, by `MOST`. That is sought again, and no reason to refuse it: it may lie
    before another body.
    """
    if first.fit is None or fit.length_told or 2 * int(np.isfinite(fit.end).sum()) >= len(fit.end):
        return 0.0
    if fit.beyond[:3].min() - first.fit.beyond[:3].min() <= MOST:
        return 0.0
    return float(BEYOND[int(np.argmin(np.append(fit.beyond > MOST, False))) - 1] * middle(fit.body.half))


def _stretch(first: First, where: NDArray[np.bool_]) -> str:
    """The longest stretch of stations (S,) in which something holds, in words; empty where it is no longer than may be chance."""
    run = longest(where)
    if run is None or run.stop - run.start <= PIECE * STATIONS:
        return ""
    ends = [f"{end * first.length_mm:.{digits_of(first.length_mm)}f}" for end in SHARES[[run.start, run.stop - 1]]]
    return f"{' to '.join(ends)} mm from the clamp"


def _nothing(first: First, fit: Fit) -> str:
    """Every stretch of it looks like the body, or shows an edge: a line that has stayed on another thing crosses the wall to it."""
    where = _stretch(first, ~fit.seen.any(axis=1) & (fit.backing < MOST))
    return where and f"neither the tube nor an edge of it is seen {where}"


def _edges(first: First, fit: Fit) -> str:
    left, right = (float(np.mean(fit.seen[:, side])) for side in (0, 1))
    seen = f"{100 * left:.0f} % of the left edge and {100 * right:.0f} % of the right one are seen"
    if first.fit is None:
        return "" if min(left, right) >= FIRST_SEEN else f"{seen} where it was pointed at"
    return "" if max(left, right) >= FIRST_SEEN else seen


def _length(first: First, fit: Fit) -> str:
    share = fit.body.length / first.length
    return "" if LENGTHS[0] <= share <= LENGTHS[1] else f"{share:.2f} times as long as in the first frame"


def _width(first: First, fit: Fit) -> str:
    share = float(middle(fit.body.half) / middle(first.half))
    return "" if WIDTHS[0] <= share <= WIDTHS[1] else f"the line that fits is {share:.1f} times as wide as in the first frame"


def _folded(first: First, fit: Fit) -> str:
    """A body does not bend within its own width."""
    step = fit.body.length / (STATIONS - 1)
    span = int(np.clip(float(middle(fit.body.half)) / step, 2, STATIONS // 4))
    chords = fit.body.points[span:] - fit.body.points[:-span]  # half a width long: shorter ones wiggle
    heading = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    bend = np.abs(heading[span:] - heading[:-span]) / (span * step)
    sharp = (bend * fit.body.half[span:-span])[span:]  # nearer to the clamp edges count less
    place = SHARES[int(np.argmax(sharp)) + 2 * span] * first.length_mm
    return "" if sharp.max() < SHARPEST else f"{FOLDED}, {place:.{digits_of(first.length_mm)}f} mm from the clamp"


def _border(first: First, fit: Fit) -> str:
    x, y = fit.body.points[-1]
    height, width = first.shape
    margin = 0.3 * float(fit.body.half[-1])
    inside = margin <= x <= width - 1 - margin and margin <= y <= height - 1 - margin
    return "" if inside else "the tip is at the border of the picture"


# Reason for which a fitted frame is refused, and a test that returns what was seen, or nothing.
RULES: tuple[tuple[str, Callable[[First, Fit], str]], ...] = (
    ("touches_border", _border),
    ("no_fit", _squat),
    ("no_fit", _folded),
    ("no_tube", _nothing),
    ("no_fit", _short),
    ("edge_lost", _edges),
    ("length_off", _length),
    ("no_fit", _width),
    ("off_hints", _elsewhere),
    ("tip_hidden", _beyond),
)


LOOKS = _nothing, _short, _edges, _beyond  # those of them that ask whether it looks like the body


def in_front(first: First, picture: Picture, wall: Wall, body: SeenBody) -> str:
    """Where something stands in front of a body in a picture; empty where nothing does.

    Most of a tenth of its length and more has neither a colour of the body, nor the wall's there, nor a mixture of it with that of the
    body's place; where all of it is so, it is the light that has changed.
    """
    strip = skin_of(picture, body)[:, INNER]
    places = body.points[:, None] + (ACROSS_TEXTURE[INNER] * body.half[:, None])[..., None] * body.normals[:, None]
    columns, rows = np.clip(np.round(places), 0, np.array(picture.shape[1::-1]) - 1).astype(int).transpose(2, 0, 1)
    beside = body.outside[:, (ACROSS_TEXTURE[INNER] < 0.0).astype(int), 0]
    behind = np.where((wall.times[rows, columns] >= SEEN)[..., None], wall.colour[rows, columns], beside)
    own, variance = body.inside.transpose(1, 0, 2)[:, :, None]
    way, off = own - behind, strip - behind
    share = np.clip(np.sum(off * way, axis=2) / np.maximum(np.sum(way**2, axis=2), 1e-9), 0.0, 1.0)
    apart = [np.sum((off - share[..., None] * way) ** 2 / variance, axis=2)]
    apart += [np.sum((strip - mean) ** 2 / spread, axis=2) for mean, spread in body.inside[MIDDLES]]  # it may have slipped
    strange = np.mean(np.min(apart, axis=0) > STRANGE, axis=1) > 0.5
    said = "" if np.mean(strange) > MOST_HIDDEN else _stretch(first, strange)
    return said and f"occluded: something of another colour is in front of it, {said}"


def refused(first: First, fit: Fit, *, lost: bool = False, vouched: bool = False) -> str:
    """The first rule that a fit breaks, with what was seen; empty where it is a measurement.

    Of a body that was `lost` before, a line may come to end at the border without it: there the border is the last rule. Where a person
    has `vouched` for it, it need not look like the body.
    """
    rules = (*RULES[1:], RULES[0]) if lost else RULES
    found = ((reason, test(first, fit)) for reason, test in rules if not (vouched and test in LOOKS))
    return next((f"{reason}: {seen}" for reason, seen in found if seen), "")
