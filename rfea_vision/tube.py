"""The tube's geometry: radii, volumes and masses, as the paper writes them and corrected (docs/physics.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rfea_vision.artefacts.measurement import Actuator

FloatArray = NDArray[np.float64]


def inner_radius(actuator: Actuator, theta: ArrayLike, rest_length: float) -> FloatArray:
    """Inner radius (m) of an arc of rest length `rest_length` (m) bent by theta (rad).

    Closed form of eq. DynInnerRadius (the same as eq. InnerRadius): the rubber keeps its volume at constant outer radius.
    """
    stretched = rest_length + actuator.outer_radius * np.asarray(theta, dtype=float)
    rubber = (actuator.outer_radius**2 - actuator.inner_radius**2) * rest_length
    return np.sqrt(actuator.outer_radius**2 - rubber / stretched)


def fluid_volume(actuator: Actuator, theta: ArrayLike, rest_length: float) -> FloatArray:
    """Fluid volume (m^3) in an arc: pi r_i^2 (L_0 + r_o theta)."""
    stretched = rest_length + actuator.outer_radius * np.asarray(theta, dtype=float)
    return np.pi * inner_radius(actuator, theta, rest_length) ** 2 * stretched


def fluid_volume_rate(
    actuator: Actuator, theta: ArrayLike, rate: ArrayLike, rest_length: float, *, as_printed: bool = False
) -> FloatArray:
    """Rate of the fluid volume (m^3/s).

    With ``as_printed`` eq. SegmentVolume of the paper, which leaves out the volume that the arc has at rest; else the full
    derivative, which equals pi r_o^3 dtheta/dt exactly.
    """
    theta, rate = np.asarray(theta, dtype=float), np.asarray(rate, dtype=float)
    outer, inner = actuator.outer_radius, inner_radius(actuator, theta, rest_length)
    stretched = rest_length + outer * theta
    inner_rate = (outer**2 - inner**2) / (2 * stretched * inner) * outer * rate  # eq. DynInnerRadius
    if as_printed:
        return np.pi * outer * inner * (inner * rate + 2 * theta * inner_rate)
    return np.pi * (2 * inner * stretched * inner_rate + inner**2 * outer * rate)


def flow_needed(actuator: Actuator, joint_rates: ArrayLike) -> FloatArray:
    """Flow into the whole tube (m^3/s) for joint rates (..., n) in rad/s: pi r_o^3 times their sum."""
    return np.pi * actuator.outer_radius**3 * np.asarray(joint_rates, dtype=float).sum(axis=-1)


def body_mass(actuator: Actuator, length: ArrayLike) -> FloatArray:
    """Mass (kg) of rubber and water at rest in a body of `length` (m)."""
    outer, inner = actuator.outer_radius, actuator.inner_radius
    area = actuator.density * (outer**2 - inner**2) + actuator.fluid_density * inner**2
    return area * np.pi * np.asarray(length, dtype=float)


def body_inertia(actuator: Actuator, length: ArrayLike) -> FloatArray:
    """Moment of inertia (kg m^2) of a body about its centre of mass, eq. CylinderIx with the mass of `body_mass`."""
    length = np.asarray(length, dtype=float)
    radii = 3 * (actuator.outer_radius**2 + actuator.inner_radius**2)
    return body_mass(actuator, length) * (radii + length**2) / 12
