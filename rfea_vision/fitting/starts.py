"""Where a fit may start: stiffness as the recordings show it, and gentler versions of a start that cannot be simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.fitting.coordinates import Coordinates, base_reference, bend_of
from rfea_vision.fitting.observation import Observed
from rfea_vision.tube import inner_radius

FloatArray = NDArray[np.float64]
#: Springs and dampers that are this much smaller at one end of the reach than at the other are evened out.
EVEN = 0.5


def seen_scale(items: Sequence[Observed], actuator: Actuator) -> float:
    """How many times stiffer than the paper's (at this size) the tube is, judged by how far it bends under which pressure.

    Weight and motion are left out: a rough value to start from, for a tube of any rubber. 1 where no run shows it.
    """
    ratios = []
    base = base_reference(actuator, 1)
    for item in items:
        angle = bend_of(item)
        pressure = item.excitation.at(item.time)
        loaded = (pressure > 0.5 * pressure.max()) & (angle > 0.05)
        if pressure.max() <= 0 or not loaded.any():
            continue
        radius = inner_radius(actuator, angle[loaded], actuator.length)
        torque = pressure[loaded] * np.pi * radius**2 * base[6]
        stiffness = base[0] + base[1] * (radius - actuator.inner_radius)
        ratios.append(np.median(torque / angle[loaded] / np.maximum(stiffness, 0.1 * base[0])))
    return float(np.clip(np.median(ratios), 0.05, 20.0)) if ratios else 1.0


def evened(coordinates: Coordinates, par: FloatArray) -> FloatArray:
    """The same parameters with no spring and no damper that all but vanishes at one end of the reach."""
    y = coordinates.coordinates(par)
    for rest in ("k_ref", "b_pos_ref", "b_neg_ref"):
        slope = rest.replace("_ref", "_slope")
        if rest in coordinates.names and slope in coordinates.names:
            pair = [coordinates.names.index(rest), coordinates.names.index(slope)]
            y[pair] = np.maximum(y[pair], EVEN * np.max(y[pair]))
    return coordinates.parameters(np.clip(y, coordinates.lower, coordinates.upper))
