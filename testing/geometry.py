"""Formulas of the paper that the model does not compute by, as printed and corrected (docs/physics.md): what tests hold it against."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.tube import body_mass, inner_radius

#: Section II as printed, "outer radius 8 mm, inner radius 6 mm": these are diameters (docs/physics.md, erratum 1).
AS_PRINTED = Actuator(outer_radius=0.008, inner_radius=0.006)


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


def hydraulic_torque(
    actuator: Actuator, pressure_Pa: ArrayLike, theta: ArrayLike, rest_length: float, r_hyd: float | None = None
) -> FloatArray:
    """Torque of the pressure on a joint (N m), eq. HydraulicTorque with the lever `r_hyd` (m).

    Without `r_hyd` as eqs. HydTorqueAlpha and AlphaR print it, p A R cos(alpha) with alpha = atan(dL / r_o) and
    R = sqrt(r_o^2 + dL^2): a lever that is r_o for every body length (docs/physics.md, erratum 3).
    """
    if r_hyd is None:
        alpha = np.arctan(rest_length / actuator.outer_radius)
        r_hyd = float(np.hypot(actuator.outer_radius, rest_length) * np.cos(alpha))
    return np.asarray(pressure_Pa, dtype=float) * np.pi * inner_radius(actuator, theta, rest_length) ** 2 * r_hyd


def potential_energy(
    actuator: Actuator, theta: ArrayLike, stiffness: ArrayLike, *, gravity: float = 9.80665, as_printed: bool = False
) -> float:
    """Energy (J) of springs (N m/rad, per joint) and weight of a chain with its joints at the start of each body.

    theta : (n,) joint angles in rad. With ``as_printed`` eq. PotentialEnergy of the paper, whose weight has a cosine too
    many; else m g y of each centre of mass (docs/physics.md, erratum 6).
    """
    angles = np.asarray(theta, dtype=float)
    phi, length = np.cumsum(angles), actuator.length / angles.size
    height = -length * (np.cumsum(np.cos(phi)) - np.cos(phi) / 2)
    weight = body_mass(actuator, length) * gravity * height
    if as_printed:
        weight = weight * np.cos(phi)
    return float(np.sum(0.5 * np.asarray(stiffness, dtype=float) * angles**2 + weight))


def hinge_line_tip(theta: np.ndarray, segment_length: float) -> np.ndarray:
    """Tip of the hinge line, eq. KinematicsClosedForm: theta (..., n) in rad to (..., 2) in m, clamp end at the origin."""
    phi = np.cumsum(np.asarray(theta, dtype=float), axis=-1)
    return -segment_length * np.stack([np.sin(phi).sum(axis=-1), np.cos(phi).sum(axis=-1)], axis=-1)
