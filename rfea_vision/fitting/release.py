"""Runs that begin held by hand: when the tube was let go, and in which shape it was until then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.chain import Chain
from rfea_vision.errors import DataError
from rfea_vision.scatter import scatter as robust

#: The tube moves once it has left its held place by this many times the scatter there, and by this share of its whole way.
CLEAR_SIGMAS, CLEAR_SHARE = 8.0, 0.01
#: Frames that tell how the tube was held, at least.
FEWEST_HELD = 5


@dataclass(frozen=True)
class Held:
    """The tube while it was held, SI, in the dynamics' frame.

    until_s : on the log's clock; line (m, 2) : points of the centre line from clamp to tip, mean over the held frames, none where only
    an angle was measured; angle : of the tip (rad), NaN where it was not measured; force (2,) : in N, where a known one at the tip
    held it, which then says the shape
    """

    until_s: float
    line: FloatArray
    angle: float
    force: FloatArray | None = None

    def start(self, chain: Chain) -> dict[str, Any]:
        """How a simulation begins, as keywords of `Model.simulate`."""
        return {"held": self.joint_angles(chain)} if self.force is None else {"pulled": self.force}

    def joint_angles(self, chain: Chain) -> FloatArray:
        """Angles (n,) of the joints in the held shape.

        From the directions of a measured centre line; from a tip or an angle alone, those of a cantilever that is held by a
        force across its tip, whose curvature falls evenly from clamp to tip.
        """
        if len(self.line) > 2:
            return _along(self.line, chain)
        share = 1 - np.minimum(chain.position, 1.0)
        share = share / share.sum()
        if not len(self.line):
            return share * self.angle
        return share * _angle_to(float(self.line[-1, 0]), share, chain)


def _along(line: FloatArray, chain: Chain) -> FloatArray:
    """Joint angles from a centre line whose first point lies behind the clamp or in it."""
    points = line if np.linalg.norm(line[0]) < 1e-9 else np.concatenate([np.zeros((1, 2)), line])
    pieces = np.diff(points, axis=0)
    length = np.linalg.norm(pieces, axis=1)
    places = (np.cumsum(length) - length / 2) / length.sum()
    direction = np.unwrap(np.arctan2(-pieces[:, 0], -pieces[:, 1]))
    # A body's direction is the centre line's in its middle; the joint before it turns by what that changed.
    ends = np.append(chain.position[1:], 1.0)
    bodies = np.interp((chain.position + ends) / 2, places, direction)
    return np.diff(bodies, prepend=0.0)


def _angle_to(tip_x: float, share: FloatArray, chain: Chain) -> float:
    """Angle of the tip at which the tube, bent in these shares, has its tip at `tip_x` (m)."""

    def reach(angle: float) -> float:
        phi = np.cumsum(share * angle)
        return float(-np.sum(chain.length * np.sin(phi)) - chain.offset * (1 - np.cos(phi[-1])))

    # Up to a quarter turn the tip goes aside with the angle.
    angles = np.linspace(-np.pi / 2, np.pi / 2, 721)
    across = np.array([reach(a) for a in angles])
    return float(np.interp(-tip_x, -across, angles))


def release_frame(name: str, time: FloatArray, signal: FloatArray, until_s: float) -> int:
    """Index of the first frame after the tube was let go; `until_s` NaN: when it is seen to move.

    time : (frames,) in s; signal : (frames, columns) of one unit, what shows the tube's motion

    Raises
    ------
    DataError
        The tube never moves, or is never held.
    """
    if np.isfinite(until_s):
        first = int(np.searchsorted(time, until_s))
    else:
        still = signal[:FEWEST_HELD]
        scatter = np.maximum(robust(np.diff(signal, axis=0)) / np.sqrt(2), 1e-12)
        scatter = np.minimum(scatter, np.maximum(np.std(still, axis=0), 1e-12))
        limit = np.maximum(CLEAR_SIGMAS * scatter, CLEAR_SHARE * np.ptp(signal, axis=0).max())
        away = np.any(np.abs(signal - np.median(still, axis=0)) > limit, axis=1)
        away[:-1] &= away[1:]  # one frame alone is no motion
        first = int(np.argmax(away)) if away.any() else 0
        if not away.any():
            raise DataError(
                f"experiment {name}: start.held_until: the tube is never seen to move; give the time, such as 0.71 s"
            )
    if first < FEWEST_HELD or first > time.size - 10:
        raise DataError(
            f"experiment {name}: start.held_until: {first} frames before and {time.size - first} after the tube is let go; "
            f"at least {FEWEST_HELD} and 10 are needed to see how it was held and what it did"
        )
    return first


def release_time_s(time: FloatArray, signal: FloatArray, first: int) -> float:
    """Time (s) of the release: where the first frames after it, as they fall freely, meet the held place.

    time : (frames,) in s; signal : (frames, columns) of one unit; first : index of the first free frame
    """
    held = np.median(signal[:first], axis=0)
    seen = slice(first - 1, min(first + 3, time.size))
    way = np.linalg.norm(signal[seen] - held, axis=1)
    # From rest under a force the way goes with the square of the time.
    root = np.sqrt(np.maximum(way, 0.0))
    slope, level = np.polyfit(time[seen] - time[first], root, 1)
    found = time[first] - level / slope if slope > 0 else time[first - 1]
    return float(np.clip(found, time[max(first - 3, 0)], time[first]))
