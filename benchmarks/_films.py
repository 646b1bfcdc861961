"""What films gave that the whole body was followed in: the rows are the same for real films, phones' and drawn ones."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.errors import DataError
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision import track_frames
from testing.pointing import Pointed
from testing.real_films import Ends, Score, score
from testing.whole_line import LineScore, line_score

WELL = (0.95, 0.02)  # share of the frames, and error over the range: what a film is to reach
WRONG = 0.02  # share of the frames compared that are sure and wrong, beyond which a film counts as such


@dataclass(frozen=True)
class Outcome:
    """What one film gave: how its tip compares with what is known of it, and frames/s; or why it was refused.

    `frames_per_s` are those of processor time, `elapsed_per_s` those by the clock, with whatever else ran beside it.
    `off_px` (frames,) is how far the line's end lies off in the frames that are asked for, NaN where it was refused or is not known;
    `line` is how the whole line lies, where that is known.
    """

    scored: Score
    frames_per_s: float
    elapsed_per_s: float
    refused: str = ""
    off_px: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    line: LineScore | None = None

    @property
    def share(self) -> float:
        return self.scored.read / self.scored.frames

    @property
    def well(self) -> bool:
        return not self.refused and self.share >= WELL[0] and self.scored.error <= WELL[1]


def followed(
    source: FrameSource,
    pointed: Pointed,
    known: NDArray[np.float64],
    hand_px: float,
    half_width_px: float,
    *,
    stayed: bool = False,
    counts: NDArray[np.bool_] | None = None,
    middles: Mapping[int, NDArray[np.float64]] | None = None,
    whole: bool = False,
) -> Outcome:
    """Track a film from what is pointed at in its first frame.

    Parameters
    ----------
    known : (frames, 2) px, where the tip is, NaN where that is not known; where it would be, had the camera `stayed`
    hand_px : standard error of each component of `known`, and of `middles` across the body
    half_width_px : of the body
    counts : (frames,) those that are asked for; all by default
    middles : (n, 2) px places on the middle of the body, by the frames that show them there
    whole : these are whole lines, at even distances from the clamp to the end
    """
    began, refused, line = np.array([time.process_time(), time.perf_counter()]), "", None
    try:
        track = track_frames(source, pointed.calibration, pointed.tube, hints=pointed.hints, vertical="image")
    except DataError as error:
        track, refused = None, str(error)
    rates = (len(known) / (np.array([time.process_time(), time.perf_counter()]) - began)).tolist()
    ends = Ends.none(len(known)) if track is None else Ends.of(track, pointed.calibration, stayed=stayed)
    if track is not None and middles:
        line = line_score(track, pointed.calibration, middles, half_width_px, hand_px=hand_px, whole=whole)
    asked = np.flatnonzero(np.ones(len(known), dtype=bool) if counts is None else counts)
    asked = asked[asked < len(ends.tip_px)]
    off_px = np.linalg.norm(ends.at(asked).tip_px - known[asked], axis=1)
    return Outcome(score(ends.at(asked), known[asked], hand_px, half_width_px), *rates, refused, off_px, line)


def told(name: str, outcome: Outcome) -> str:
    """One line of what a film gave."""
    found = outcome.scored
    if outcome.refused:
        return f"{name}: refused: {outcome.refused}"
    line = "" if outcome.line is None else f"line {outcome.line.off:.2f} half widths off, "
    return (
        f"{name}: {found.read}/{found.frames} frames, "
        f"{100 * found.error:.2f} % ({100 * found.carried:.2f}) of {found.range_px:.0f} px, "
        f"{found.off:.2f} half widths, "
        f"{100 * found.covered:.0f} % within, {line}{found.sure_and_wrong} of {found.compared} sure and wrong, "
        f"{outcome.frames_per_s:.0f} frames/s ({outcome.elapsed_per_s:.0f} by the clock)"
    )


def rows_of(name: str, outcomes: list[Outcome], against: str, *, alone: bool = False) -> list[dict[str, Any]]:
    """Medians and counts over a set of films, and what they are held against; speed by the clock where each was followed `alone`."""
    tracked = [item for item in outcomes if not item.refused]
    compared = [item for item in tracked if item.scored.compared]
    astray = sum(item.scored.sure_and_wrong > WRONG * item.scored.compared for item in compared)
    wrong = sum(item.scored.sure_and_wrong for item in compared)
    share = float(np.median([item.share for item in outcomes]))
    error = _median([item.scored.error for item in compared])
    carried = _median([item.scored.carried for item in compared])
    table = [
        ("films with 95 % of the frames", sum(item.share >= WELL[0] for item in outcomes), "films", None, None),
        ("films with 95 % of the frames and 2 % error", sum(item.well for item in outcomes), "films", None, None),
        ("films refused (exit code 1)", len(outcomes) - len(tracked), "films", None, None),
        ("films with frames that are wrong and do not say so", astray, "films", "0", astray == 0),
        ("frames that are wrong and do not say so", wrong, "frames", None, None),
        ("share of the frames tracked, median film", 100 * share, "%", ">= 95", share >= WELL[0]),
        ("error over the range, median film", 100 * error, "%", "<= 2", error <= WELL[1]),
        ("tip off, median film", _median([item.scored.off for item in compared]), "half widths", None, None),
        ("error over the range less what was off at first, median film", 100 * carried, "%", None, None),
        ("tip within its 95 % interval", 100 * _mean([item.scored.covered for item in compared]), "%", None, None),
        ("speed", _median([item.frames_per_s for item in tracked]), "frames/s of processor time", ">= 60", None),
    ]
    if lines := [item.line for item in tracked if item.line is not None]:
        table += _of_lines(lines)
    if alone:
        elapsed = _median([item.elapsed_per_s for item in tracked])
        table.append(("speed by the clock, one at a time", elapsed, "frames/s", ">= 60", elapsed >= 60.0))
    return [
        {
            "name": f"{name} ({len(outcomes)}): {what}",
            "value": round(float(value), 2),
            "unit": unit,
            "target": target,
            "met": met,
            "against": against,
        }
        for what, value, unit, target, met in table
    ]


def _of_lines(lines: list[LineScore]) -> list[tuple[str, float, str, str | None, bool | None]]:
    """What they give: name, value, unit, target, and whether that is met."""
    table = [
        ("line off the body's middle, median film", _median([item.off for item in lines]), "half widths", None, None),
        ("line within its 95 % interval", 100 * _mean([item.within for item in lines]), "%", None, None),
    ]
    if np.isfinite(lines[0].turned):
        table += [
            ("bend angle off, median film", _median([item.turned for item in lines]), "deg", None, None),
            ("bend angle within its 95 % interval", 100 * _mean([item.turned_within for item in lines]), "%", None, None),
            ("curvature times length off, median film", _median([item.bent for item in lines]), "rad", None, None),
            ("curvature within its 95 % interval", 100 * _mean([item.bent_within for item in lines]), "%", None, None),
        ]
    return table


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else np.nan


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else np.nan
