"""Fit of the steady state to a table of tip position against pressure: for a tube that was measured at rest only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.simulation import STANDARD_GRAVITY, Chain, Model
from rfea_vision.effects.base import BASE_UNITS, Effect
from rfea_vision.errors import DataError, InputError
from rfea_vision.fitting.coordinates import base_reference, build
from rfea_vision.fitting.steady_fit import Plateau, fit_steady
from testing.real_records import PressureTable
from testing.steady import steady_curve

TIP = np.array([1.0])


@dataclass(frozen=True)
class PressureTipFit:
    """Steady state fitted to (pressure, tip) pairs.

    parameters : SI values by name; only those in `fitted` were moved (k over r_hyd is all that a steady state can tell)
    standard_error : of the fitted ones, from the scatter of the residuals
    tip_mm : (m, 2) modelled, residual_mm : (m, 2) measured less modelled, in the rig frame
    rms_mm : root mean square distance; straight_rms_mm : the same for a tube that does not move
    limit_Pa : the pressure at which the fitted steady state ends, where that is within the table's range, else None
    """

    parameters: dict[str, float]
    units: dict[str, str]
    fitted: tuple[str, ...]
    standard_error: dict[str, float]
    tip_mm: FloatArray
    residual_mm: FloatArray
    angle_deg: FloatArray
    rms_mm: float
    straight_rms_mm: float
    limit_Pa: float | None


def fit_pressure_tip(
    pressure_Pa: ArrayLike,
    tip_mm: ArrayLike,
    actuator: Actuator,
    *,
    segments: int = 16,
    free: Sequence[str] = ("k_ref", "k_slope"),
    effects: Sequence[Effect] = (),
    gravity: float = STANDARD_GRAVITY,
) -> PressureTipFit:
    """Fit stiffness (and parameters of effects) to tip positions at rest.

    Parameters
    ----------
    pressure_Pa : (m,) gauge pressure
    tip_mm : (m, 2) tip of the centre line in the rig frame: origin in the clamp, x right, y up, hanging tube at (0, -L)
    actuator : the tube; `bends` says to which side
    free : parameters to fit, by name. r_hyd is held at the paper's unless named here: a steady state tells k / r_hyd only
    gravity : m/s^2; 0 for a tube that moves in a horizontal plane

    Raises
    ------
    InputError
        Too few points, not finite, or shapes that do not belong together.
    DataError
        No steady state exists near any start.
    """
    pressure, tip = np.asarray(pressure_Pa, dtype=float), np.asarray(tip_mm, dtype=float)
    if pressure.ndim != 1 or tip.shape != (pressure.size, 2):
        raise InputError(
            f"tip_mm: shape {tip.shape} does not go with {pressure.size} pressures; give one x, y per pressure"
        )
    if not (np.all(np.isfinite(pressure)) and np.all(np.isfinite(tip))):
        raise InputError("pressure_Pa, tip_mm: not every value is a number; leave such rows out")
    if 2 * pressure.size < len(free) + 1:
        raise InputError(f"pressure_Pa: {pressure.size} points cannot carry {len(free)} parameters; add points")
    mirror = 1.0 if actuator.bends == "left" else -1.0
    seen = tip * np.array([mirror, 1.0]) / 1e3
    model = Model(Chain.tube(actuator, segments), tuple(effects), mirror=mirror, gravity=gravity)
    unknown = sorted(set(free) - set(model.names))
    if unknown:
        raise InputError(f"free: {unknown[0]} is not a parameter of this model; it has {', '.join(model.names)}")
    bend = max(0.1, float(np.max(2 * np.arctan2(-seen[:, 0], -seen[:, 1]))))
    plateaus = [
        Plateau("table", 0.0, 0.0, float(p), point[None], 0.0, gravity)
        for p, point in zip(pressure, seen, strict=True)
    ]
    reference = np.append(base_reference(actuator, segments), np.zeros(len(model.names) - 7))
    best: tuple[FloatArray, FloatArray] | None = None
    for factor in (1.0, 0.3, 3.0, 0.1, 10.0, 0.03, 30.0):
        held = reference.copy()
        held[:6] *= factor
        held[1] = 0.0  # a constant spring has a steady state at every pressure
        coordinates = build(model, actuator, segments, bend, only=tuple(free), held=held)
        found = fit_steady(model, plateaus, coordinates, held, TIP)
        if found is None:
            continue
        again = best is not None and abs(np.sum(found[1] ** 2) / np.sum(best[1] ** 2) - 1) < 1e-4
        if best is None or np.sum(found[1] ** 2) < np.sum(best[1] ** 2):
            best = found
        if again:  # two starts agree
            break
    if best is None:
        raise DataError(
            "tip_mm: no steady state comes near these points; check the units of pressure and the tube's radii"
        )
    parameters = best[0]
    curve = steady_curve(model, parameters, pressure)
    modelled = curve.tip_m * np.array([mirror, 1.0]) * 1e3
    residual = tip - modelled
    index = [model.names.index(name) for name in free]
    errors = _standard_errors(model, parameters, pressure, residual, index)
    top = steady_curve(model, parameters, [float(pressure.max()) * 1.5])
    units = {**BASE_UNITS, **{f"{e.id}.{name}": spec.unit for e in effects for name, spec in e.parameters.items()}}
    return PressureTipFit(
        parameters=dict(zip(model.names, map(float, parameters), strict=True)),
        units={name: units[name] for name in model.names},
        fitted=tuple(free),
        standard_error=dict(zip(free, map(float, errors), strict=True)),
        tip_mm=modelled,
        residual_mm=residual,
        angle_deg=np.rad2deg(curve.angle_rad),
        rms_mm=float(np.sqrt(np.mean(np.sum(residual**2, axis=1)))),
        straight_rms_mm=float(np.sqrt(np.mean(np.sum((seen * 1e3 - [0, -1e3 * actuator.length]) ** 2, axis=1)))),
        limit_Pa=top.limit_Pa,
    )


def _standard_errors(
    model: Model, parameters: FloatArray, pressure: FloatArray, residual_mm: FloatArray, index: list[int]
) -> FloatArray:
    """From the Jacobian at the solution and the scatter of the residuals; NaN where a parameter leaves no trace."""
    rows = []
    for p in pressure:
        columns = []
        for k in index:
            step = 1e-5 * max(abs(parameters[k]), 1e-9)
            ends = []
            for sign in (1, -1):
                moved = parameters.copy()
                moved[k] += sign * step
                ends.append(steady_curve(model, moved, [float(p)]).tip_m[0])
            columns.append((ends[0] - ends[1]) / (2 * step) * 1e3)
        rows.append(np.column_stack(columns))
    jacobian = np.concatenate(rows)
    freedom = max(residual_mm.size - len(index), 1)
    size = np.linalg.norm(jacobian, axis=0)
    if np.any(size == 0) or not np.all(np.isfinite(jacobian)):
        return np.full(len(index), np.nan)
    scaled = jacobian / size
    covariance = np.linalg.pinv(scaled.T @ scaled) * float(np.sum(residual_mm**2)) / freedom
    return np.sqrt(np.diag(covariance)) / size


__all__ = ["PressureTipFit", "fit_pressure_tip"]


RADII_M = (0.008, 0.012, 0.016, 0.020, 0.024)


def fit_table(table: PressureTable) -> tuple[float, PressureTipFit]:
    """Fit the steady state for several effective radii (the actuator is no tube) and keep the best: (radius m, fit).

    The pressure's unit is not stated; it is read as kPa, which scales the stiffness and nothing else. Which way the rig
    stood is not stated either: gravity is left out.
    """
    fits = []
    for radius in RADII_M:
        actuator = Actuator(outer_radius=radius, inner_radius=0.75 * radius, length=0.135)
        fits.append((radius, fit_pressure_tip(table.pressure * 1e3, table.tip_mm, actuator, gravity=0.0)))
    return min(fits, key=lambda pair: pair[1].rms_mm)
