"""A whole line held against what is known of it: how far it lies beside the body's middle, which way its end points, how it bends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts import Calibration, Track
from rfea_vision.calibration.projection import plane_mm_to_pixels
from rfea_vision.lines import along, evenly, from_down
from rfea_vision.vision.show.clip import in_frame, rig_to_plane

Floats = NDArray[np.float64]
CERTAIN = 1.96  # standard errors to either side of the 95 % interval
FINE = 1024  # pieces of a line, to whose ends places beside it are held


@dataclass(frozen=True)
class LineScore:
    """How a line lies: root mean squares over all frames and places that were compared, and shares within 95 % intervals.

    `off` is across the line, over the half width of the body. Where whole lines are known `turned` is that of the direction of its
    end, deg, and `bent` that of its curvature times the length of the body; else they and their shares are NaN.
    """

    frames: int
    off: float
    within: float
    turned: float = np.nan
    turned_within: float = np.nan
    bent: float = np.nan
    bent_within: float = np.nan


def beside(line: Floats, places: Floats) -> tuple[Floats, Floats]:
    """How far (m,) `places` (m, 2) lie from a line of points (n, 2), continued straight, and at which share (m,) of its length."""
    fine = evenly(line, FINE + 1)
    step = along(line)[-1] / FINE
    reach = step * np.arange(1, FINE // 4)[:, None]
    before = fine[0] - (reach * _direction(fine[[0, FINE // 32]]))[::-1]
    after = fine[-1] + reach * _direction(fine[[-1 - FINE // 32, -1]])
    whole = np.concatenate([before, fine, after])
    apart = np.linalg.norm(places[:, None] - whole, axis=2)
    nearest = apart.argmin(axis=1)
    return apart.min(axis=1), np.clip((nearest - len(before)) / FINE, 0.0, 1.0)


def _direction(ends: Floats) -> Floats:
    return (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])


def line_score(
    track: Track, calibration: Calibration, known_px: Mapping[int, Floats], half_width_px: float, *, hand_px: float = 0.0, whole: bool
) -> LineScore | None:
    """Hold a track against places on the middle of the body by frame, (n, 2) px as that shows them; None where none was read.

    Parameters
    ----------
    hand_px : standard error of a place across the body
    whole : the places are a whole line, at even distances from the clamp to the end
    """
    data, numbers = track.dataset, [number for number in known_px if track.valid[number]]
    if not numbers:
        return None
    px_per_mm, nodes = float(data.attrs["px_per_mm"]), data["node"].values
    places = plane_mm_to_pixels(calibration, rig_to_plane(track, data["midline"].values[numbers]))
    off, doubt, turned, bent = [], [], [], []
    for number, seen in zip(numbers, places, strict=True):
        line, known = in_frame(track, seen, number), known_px[number]
        apart, share = beside(line, known)
        off.append(apart)
        doubt.append(np.hypot(np.interp(share, nodes, data["midline_sigma"].values[number]) * px_per_mm, hand_px))
        if whole:
            frame = data.isel(time=number)
            # Cameras of films turn little: what theirs does to a direction is left out.
            angle, curvature = headings(known, 1.0 if data.attrs["bends"] == "left" else -1.0)
            turn = (float(frame["bend_angle"]) - np.degrees(angle[-1]) + 180.0) % 360.0 - 180.0
            turned.append([turn, float(frame["bend_angle_sigma"])])
            length_px = along(known)[-1]
            bends = np.interp(nodes, np.linspace(0, 1, len(known)), curvature)
            scales = length_px / px_per_mm * np.stack([frame["curvature"].values, frame["curvature_sigma"].values])
            bent.append([scales[0] - length_px * bends, scales[1]])
    aside, stderr = np.concatenate(off), np.concatenate(doubt)
    return LineScore(
        len(numbers),
        _rms(aside) / half_width_px,
        _within(aside, stderr),
        *(_compared(np.array(turned).T) if whole else ()),
        *(_compared(np.moveaxis(np.array(bent), 1, 0)) if whole else ()),
    )


def headings(line: Floats, sign: float) -> tuple[Floats, Floats]:
    """Direction (n,) rad from straight down and curvature (n,) 1/px of a line of even points (n, 2) px; positive towards the bend."""
    slopes = np.gradient(line, axis=0)
    angle = np.unwrap(from_down(slopes * (1.0, -1.0), sign))
    return angle, np.gradient(angle) / np.linalg.norm(slopes, axis=1)


def _compared(values: Floats) -> tuple[float, float]:
    """Root mean square of errors, the first of `values` (2, ...), and the share within their intervals, by the second."""
    return _rms(values[0]), _within(values[0], values[1])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _within(values: Floats, stderr: Floats) -> float:
    return float(np.mean(np.abs(values) < CERTAIN * stderr))
