"""The tube's geometry: inner radius, masses and inertia, as the paper writes them and corrected (docs/physics.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator


def inner_radius(actuator: Actuator, theta: ArrayLike, rest_length: float) -> FloatArray:
    """Inner radius (m) of an arc of rest length `rest_length` (m) bent by theta (rad, any shape: the result has it).

    Closed form of eq. DynInnerRadius (the same as eq. InnerRadius): the rubber keeps its volume at constant outer radius.
    """
    stretched = rest_length + actuator.bore_offset * np.asarray(theta, dtype=float)
    rubber = (actuator.outer_radius**2 - actuator.inner_radius**2) * rest_length
    return np.sqrt(actuator.outer_radius**2 - rubber / stretched)


def body_mass(actuator: Actuator, length: ArrayLike) -> FloatArray:
    """Mass (kg) of rubber and water at rest in a body of `length` (m, any shape)."""
    return actuator.linear_density * np.asarray(length, dtype=float)


def body_inertia(actuator: Actuator, length: ArrayLike) -> FloatArray:
    """Moment of inertia (kg m^2) of a body of `length` (m, any shape) about its centre of mass, eq. CylinderIx."""
    length = np.asarray(length, dtype=float)
    outer = actuator.outer_radius
    across = {"tube": 3 * (outer**2 + actuator.inner_radius**2), "rectangle": 4 * outer**2}.get(
        actuator.kind, 3 * outer**2
    )
    return body_mass(actuator, length) * (across + length**2) / 12
