"""Where a fit may start: stiffness as the recordings show it, and gentler versions of a start that cannot be simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.fitting.coordinates import Coordinates, base_reference, bend_of
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.rules import pushed
from rfea_vision.tube import inner_radius

#: Springs and dampers that are this much smaller at one end of the reach than at the other are evened out.
EVEN = 0.5


#: Damping ratio of a start whose stiffness is read from a swing: that of a soft rubber.
START_DAMPING_RATIO = 0.05


def observed_scale(items: Sequence[Observed], actuator: Actuator) -> FloatArray:
    """How many times the paper's (at this size) the six stiffnesses and dampings are, judged by what the runs show.

    By how far the tube bends under which pressure; weight and motion are left out: a rough value to start from, for a tube of
    any rubber. Where no pressure moves it, by how fast it swings. 1 where no run shows it.
    """
    if not pushed(items):
        return _scale_of_swing(items, actuator)
    ratios = []
    base = base_reference(actuator, 1)
    for item in items:
        angle = bend_of(item)
        pressure = item.excitation.at(item.time)
        loaded = (np.abs(pressure) > 0.5 * np.abs(pressure).max()) & (angle * np.sign(pressure) > 0.05)
        if not loaded.any():
            continue
        # A rough value: past straight, where a narrow bore would close, that at rest.
        radius = inner_radius(actuator, np.maximum(angle[loaded], 0.0), actuator.length)
        torque = pressure[loaded] * np.pi * radius**2 * base[6]
        stiffness = base[0] + base[1] * (radius - actuator.inner_radius)
        ratios.append(np.median(torque / angle[loaded] / np.maximum(stiffness, 0.1 * base[0])))
    return np.full(6, np.clip(np.median(ratios), 0.05, 20.0) if ratios else 1.0)


def _scale_of_swing(items: Sequence[Observed], actuator: Actuator) -> FloatArray:
    """From the frequency of the first bending mode of a cantilever: (1.8751^2)^2 E I / (m L^4), m the mass per length."""
    found = []
    for item in items:
        signal = item.points[:, -1, 0] if item.has_tip else item.angle
        step = float(np.median(np.diff(item.time)))
        even = np.interp(np.arange(item.time[0], item.time[-1], step), item.time, signal)
        power = np.abs(
            np.fft.rfft(
                (even - np.mean(even[even.size // 2 :])) * np.hanning(2 * even.size)[even.size :], 8 * even.size
            )
        )
        lowest = 8  # one swing over the run
        place = lowest + int(np.argmax(power[lowest:]))
        found.append(2 * np.pi * place / (8 * even.size * step))
    omega = float(np.median(found))
    stiffness = omega**2 * actuator.linear_density * actuator.length**4 / 12.36
    base = base_reference(actuator, 1)
    k = stiffness / actuator.length / base[0]
    scale = np.full(6, k)
    scale[2:6] = 2 * START_DAMPING_RATIO / omega * k * base[0] / base[2]
    return scale


def without_vanishing_ends(coordinates: Coordinates, par: FloatArray) -> FloatArray:
    """The same parameters with no spring and no damper that all but vanishes at one end of the reach."""
    y = coordinates.coordinates(par)
    for rest in ("k_ref", "b_pos_ref", "b_neg_ref"):
        slope = rest.replace("_ref", "_slope")
        if rest in coordinates.names and slope in coordinates.names:
            pair = [coordinates.names.index(rest), coordinates.names.index(slope)]
            y[pair] = np.maximum(y[pair], EVEN * np.max(y[pair]))
    return coordinates.parameters(np.clip(y, coordinates.lower, coordinates.upper))
