"""What of a track the checks look at: the rows that count, what moves and how far, the length of the centre line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import along

if TYPE_CHECKING:
    import xarray as xr

# of the farthest that its tip ever reaches, but for a hundredth of the rows: a tube that bends by 40 degrees keeps 98 % of it
_STRAIGHT = 0.98


def valid_rows(track: xr.Dataset, name: str) -> FloatArray:
    """Those rows (k, ...) of a variable of a track that count."""
    return track[name].values[track["valid"].values.astype(bool)]


def begins_at(tip: FloatArray) -> FloatArray:
    """Where a tip (n, 2) is at first: the median (2,) over a twentieth of its rows."""
    return np.median(tip[: max(1, len(tip) // 20)], axis=0)


def motion_of(track: xr.Dataset) -> tuple[FloatArray, str]:
    """What moves (frames, 2 or 1) of a track or recording, and its unit: its tip in mm, else its angle in deg; (0, 1) of neither."""
    for name, unit in (("tip", "mm"), ("bend_angle", "deg")):
        if name in track:
            return np.asarray(track[name].values, dtype=float).reshape(len(track[name]), -1), unit
    return np.empty((0, 1)), "deg"


def swing(motion: FloatArray) -> float:
    """How far a motion (n, 1 or 2) goes from side to side, without the outermost hundredths."""
    return float(np.linalg.norm(np.ptp(np.percentile(motion, (1, 99), axis=0), axis=0)))


def across(tip: FloatArray) -> FloatArray:
    """How far across (n,) a tip (n, 2) in the rig has gone: from the clamp, or from where it begins if it begins straight.

    Markers that stand beside the line put a straight tube's tip beside its clamp, too.
    """
    reach = np.hypot(*tip.T)
    begins_straight = np.median(reach[: max(1, len(tip) // 20)]) > _STRAIGHT * np.percentile(reach, 99)
    return tip[:, 0] - (begins_at(tip)[0] if begins_straight else 0.0)


def lengths(lines: FloatArray) -> FloatArray:
    """Lengths (n,) of centre lines (n, points, 2)."""
    return along(lines)[:, -1]
