"""From joint angles to the lines a camera sees: hinge line, centre line and edges, as arcs and not as a polygon.

Rig frame of a tube that bends left, in metres: origin where the centre line leaves the clamp, x right, y up.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from rfea_vision.arrays import FloatArray


def hinge_arcs(
    theta: FloatArray, length: float, layout: Literal["middle", "start"] = "middle"
) -> tuple[FloatArray, FloatArray]:
    """Angle and hinge-line length of the arcs that make up the tube.

    Parameters
    ----------
    theta : (T, n) joint angles
    length : of the tube at rest
    layout : ``middle`` spreads each angle evenly over its arc; ``start`` turns in a point and then runs straight

    Returns
    -------
    angles : (T, m)
    lengths : (m,)
    """
    n = theta.shape[1]
    if layout == "middle":
        return theta, np.full(n, length / n)
    angles = np.zeros((theta.shape[0], 2 * n))
    angles[:, ::2] = theta
    return angles, np.tile([0.0, length / n], n)


def line_at(
    angles: FloatArray,
    lengths: FloatArray,
    fraction: FloatArray,
    outer_radius: FloatArray,
    offset: float | FloatArray = 0.0,
    clamp_angle: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Points on the tube at fractions of the centre line's length.

    Parameters
    ----------
    angles, lengths : arcs of the hinge line, see `hinge_arcs`
    fraction : (k,) from clamp (0) to tip (1)
    outer_radius : (T,) distance of the centre line from the hinge line
    offset : of the points from the centre line, in outer radii; -1 is the hinge line, +1 the outer edge
    clamp_angle : (T,) turn of the clamp about the origin

    Returns
    -------
    points : (T, k, 2)
    phi : (T, k) angle of the tangent
    """
    frames = angles.shape[0]
    start = np.zeros(frames) if clamp_angle is None else clamp_angle
    phi = np.concatenate([start[:, None], start[:, None] + np.cumsum(angles, axis=1)], axis=1)
    step = _chord(phi[:, :-1], angles, lengths[None, :])
    first = -outer_radius[:, None] * _outward(start)
    hinge = first[:, None, :] + np.concatenate([np.zeros((frames, 1, 2)), np.cumsum(step, axis=1)], axis=1)
    grown = lengths[None, :] + outer_radius[:, None] * angles
    reach = np.concatenate([np.zeros((frames, 1)), np.cumsum(grown, axis=1)], axis=1)
    wanted = reach[:, -1:] * fraction[None, :]
    # the arc each point lies on; rows differ, so count the arc ends passed
    arc = np.clip((wanted[:, :, None] >= reach[:, None, 1:-1]).sum(axis=2), 0, angles.shape[1] - 1)
    take = np.take_along_axis
    part = (wanted - take(reach, arc, 1)) / np.where(np.abs(take(grown, arc, 1)) > 0, take(grown, arc, 1), 1.0)
    turn = part * take(angles, arc, 1)
    begin = take(phi, arc, 1)
    points = take(hinge, arc[:, :, None], 1) + _chord(begin, turn, part * lengths[arc])
    here = begin + turn
    points = points + (1 + offset) * outer_radius[:, None, None] * _outward(here)
    return points, here


def _chord(begin: FloatArray, turn: FloatArray, length: FloatArray) -> FloatArray:
    """Vector along a circular arc of given length that starts at angle `begin` and turns by `turn`."""
    middle = begin + turn / 2
    reach = length * np.sinc(turn / (2 * np.pi))
    return np.stack([-reach * np.sin(middle), -reach * np.cos(middle)], axis=-1)


def _outward(phi: FloatArray) -> FloatArray:
    return np.stack([np.cos(phi), -np.sin(phi)], axis=-1)
