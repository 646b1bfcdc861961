"""Steady states: bending angle against pressure, with and without gravity, and where it ends.

Without gravity eq. TorqueEquilibrium of the paper, r_hyd pi r_i^2 p = k_ss theta with k_ss = k_j / n, gives the pressure
that holds an angle in closed form; the angle at a pressure follows by bracketing. Because the spring softens as the tube
stretches there can be a largest pressure (limit point); beyond it no steady state exists and the answer is NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, minimize_scalar

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.simulation import Model
from rfea_vision.tube import inner_radius

LARGEST_ANGLE = 4 * np.pi  # rad; no tube is asked to wind up further


@dataclass(frozen=True)
class LimitPoint:
    """The largest pressure (Pa) that has a steady state, and the tube's bending angle there (rad)."""

    pressure_Pa: float
    angle_rad: float


def holding_pressure(parameters: FloatArray, segments: int, angle_rad: ArrayLike, actuator: Actuator) -> FloatArray:
    """Pressure (Pa) that holds the tube at a bending angle (rad, of the whole tube) without gravity.

    parameters : the seven of `effects.base.BASE_PARAMETERS`, per joint of a chain of `segments` joints, SI units
    Source: eqs. TorqueEquilibrium, InnerRadius and SpringCoefficient of the paper.
    """
    angle = np.asarray(angle_rad, dtype=float)
    radius = inner_radius(actuator, angle, actuator.length)
    stiffness = (parameters[0] + parameters[1] * (radius - actuator.inner_radius)) / segments
    return stiffness * angle / (np.pi * radius**2 * parameters[6])


def limit_point(
    parameters: FloatArray, segments: int, actuator: Actuator, largest_angle_rad: float = LARGEST_ANGLE
) -> LimitPoint | None:
    """First pressure that cannot be exceeded, without gravity; None if there is none up to the largest angle."""
    grid = np.linspace(0, largest_angle_rad, 2001)
    pressure = holding_pressure(parameters, segments, grid, actuator)
    falling = np.flatnonzero(np.diff(pressure) <= 0)
    if falling.size == 0:
        return None
    top = int(falling[0])
    if top == 0:
        return LimitPoint(0.0, 0.0)  # the spring is negative at rest
    found = minimize_scalar(
        lambda angle: -float(holding_pressure(parameters, segments, angle, actuator)),
        bounds=(grid[top - 1], grid[top + 1]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return LimitPoint(-float(found.fun), float(found.x))


def bending_angle(
    parameters: FloatArray,
    segments: int,
    pressure_Pa: ArrayLike,
    actuator: Actuator,
    largest_angle_rad: float = LARGEST_ANGLE,
) -> FloatArray:
    """Bending angle theta_ss (rad, of the whole tube) at each pressure, without gravity, on the branch that starts at rest.

    NaN where there is no steady state (see `limit_point`) or none up to the largest angle. Source: eq. BendingAngleSS,
    which is of second order only for a constant spring (docs/physics.md).
    """
    pressures = np.asarray(pressure_Pa, dtype=float)
    limit = limit_point(parameters, segments, actuator, largest_angle_rad)
    top = largest_angle_rad if limit is None else limit.angle_rad
    highest = float(holding_pressure(parameters, segments, top, actuator))
    # Below zero pressure the hinge line is on the outside; the stretched length must stay positive.
    bottom = -0.9 * (actuator.inner_radius / actuator.outer_radius) ** 2 * actuator.length / actuator.outer_radius
    if actuator.offset == 0:  # a beam keeps its section
        bottom = -largest_angle_rad
    lowest = float(holding_pressure(parameters, segments, bottom, actuator))
    out = np.full(pressures.shape, np.nan)
    for place, pressure in np.ndenumerate(pressures):
        if not (lowest <= pressure <= highest):
            continue
        ends = (0.0, top) if pressure >= 0 else (bottom, 0.0)

        def unbalanced(angle: float, target: float = float(pressure)) -> float:
            return float(holding_pressure(parameters, segments, angle, actuator)) - target

        out[place] = ends[1] if unbalanced(ends[1]) == 0 else brentq(unbalanced, *ends, xtol=1e-13)
    return out


@dataclass(frozen=True)
class SteadyCurve:
    """Steady states of a model over pressures (m,), with gravity and every effect of the model.

    found : (m,) whether there is a stable one; phi : (m, n + 1) absolute angles (rad), NaN where not found
    tip_m : (m, 2) tip of the centre line; angle_rad : (m,) bending angle
    stability : (m,) smallest pivot of the stiffness (N m/rad), positive where stable
    limit_Pa : last pressure that could be reached on the way up where some were not found, else None
    """

    pressure_Pa: FloatArray
    found: NDArray[np.bool_]
    phi: FloatArray
    tip_m: FloatArray
    angle_rad: FloatArray
    stability: FloatArray
    limit_Pa: float | None


def steady_curve(model: Model, parameters: FloatArray, pressure_Pa: Sequence[float] | FloatArray) -> SteadyCurve:
    """Steady states at pressures (Pa), each reached by continuation from the unloaded tube."""
    pressures = np.asarray(pressure_Pa, dtype=float)
    count, n = pressures.size, model.chain.bodies
    phi, tip, stability = np.full((count, n + 1), np.nan), np.full((count, 2), np.nan), np.full(count, np.nan)
    found = np.zeros(count, dtype=bool)
    limit: float | None = None
    for k, pressure in enumerate(pressures):
        state = model.steady(parameters, float(pressure))
        found[k] = state.found
        if state.found:
            phi[k], stability[k] = state.phi, state.stability
            tip[k] = model.line_at_rest(parameters, state, np.ones(1))[0][0]
        else:
            limit = state.pressure if limit is None else max(limit, state.pressure)
    return SteadyCurve(pressures, found, phi, tip, phi[:, -1] - phi[:, 0], stability, limit)
