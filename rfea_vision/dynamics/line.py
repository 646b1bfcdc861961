"""From the sensors to the tube: what effects make of the pressure on its way, with the derivatives.

`par` is the vector of parameters in SI, in the order of the law's `parameters`; `con` that of the constants of a model, in the
order of `laws.CONSTANTS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.compilation import CompiledLaw
from rfea_vision.dynamics.excitation import Excitation, lagged
from rfea_vision.effects.base import LINE_HOOKS
from rfea_vision.errors import InputError


def scalar(function: Callable[..., Any], par: FloatArray, con: FloatArray) -> tuple[float, FloatArray]:
    """Value of a hook that depends on parameters alone, and its derivatives (parameters,)."""
    row = function(par, con)[0]
    return float(row[0]), np.array([float(v) for v in row[1:]])


def pressure_of_chambers(
    law: CompiledLaw, par: FloatArray, con: FloatArray, excitation: Excitation
) -> tuple[FloatArray, FloatArray | None]:
    """Pressure (Pa) on the grid (grid,) with the effects that chambers have of their own, and its derivative (grid, parameters).

    Without such effects it is the sum that the excitation has; the derivative is then None.

    Raises
    ------
    InputError
        An effect names a chamber that the run does not have.
    """
    if not law.chambers:
        return excitation.pressure, None
    pressure, derivative = excitation.pressure.copy(), np.zeros((excitation.pressure.size, par.size))
    for chamber in law.chambers:
        if chamber not in excitation.chambers:
            there = (
                f"the chambers are {', '.join(excitation.chambers)}" if excitation.chambers else "there is one chamber"
            )
            raise InputError(f"an effect stands @{chamber}, which is neither a joint's number nor a chamber; {there}")
        sign, own = excitation.chambers[chamber]
        sense, constant = (law.line(hook, chamber) for hook in LINE_HOOKS)
        felt, slopes = _behind(par, con, (sense, constant), own, None, excitation.step_s, np.array([0.0, 1.0]))
        pressure += sign * (np.append(felt[:1, 0], felt[:, 1]) - own)
        derivative += sign * np.concatenate([slopes[:1, 0], slopes[:, 1]])
    return pressure, derivative


def sensed(
    sense: Callable[..., Any], par: FloatArray, con: FloatArray, pressure: FloatArray, change: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """True pressures (k,) for sensed ones, and their derivative (k, parameters); `change` is that of the sensed ones."""
    row = sense(par, con, pressure)[0]
    values, slope, *own = (np.broadcast_to(np.asarray(value, dtype=float), pressure.shape) for value in row)
    slopes = np.stack(own, axis=-1)
    if change is not None:
        slopes = first_of(change.shape[-1], slopes) + slope[:, None] * change
    return values.copy(), slopes


def first_of(columns: int, values: FloatArray) -> FloatArray:
    """Derivatives (..., parameters) as the first of so many columns; the others, of waves that no hook knows, are zero."""
    out = np.zeros((*values.shape[:-1], columns))
    out[..., : values.shape[-1]] = values
    return out


def at_rest(
    law: CompiledLaw, par: FloatArray, con: FloatArray, pressure: float, change: FloatArray | None
) -> tuple[float, FloatArray]:
    """Pressure (Pa) in the tube that rests at a sensed one, and its derivative (parameters,); `change` is that of the sensed one."""
    values, slopes = sensed(law.felt_pressure, par, con, np.array([float(pressure)]), change)
    return float(values[0]), slopes[0]


def _behind(
    par: FloatArray,
    con: FloatArray,
    hooks: tuple[Callable[..., Any], Callable[..., Any]],
    pressure: FloatArray,
    change: FloatArray | None,
    step_s: float,
    nodes: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Pressure (steps, stages) behind a sensor and a line with a lag, and its derivative (steps, stages, parameters)."""
    values, slopes = sensed(hooks[0], par, con, pressure, change)
    lag, dlag = scalar(hooks[1], par, con)
    felt, slope = lagged(values, step_s, nodes, max(lag, 0.0))
    derivative = first_of(slopes.shape[1], slope[..., None] * dlag)
    for k in np.flatnonzero(slopes.any(axis=0)):
        derivative[..., k] += lagged(slopes[:, k].copy(), step_s, nodes, max(lag, 0.0))[0]
    return felt, derivative


def felt_pressure(
    law: CompiledLaw,
    par: FloatArray,
    con: FloatArray,
    pressure: FloatArray,
    change: FloatArray | None,
    step_s: float,
    nodes: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Pressure (steps, stages) in Pa in the tube at the fractions `nodes` (stages,) of each step.

    And its derivative (steps, stages, parameters), with no rows if there is none. `pressure` (grid,) is the sensed one, `change` its
    derivative (grid, parameters), of waves of pressure (grid, waves) behind them.
    """
    if change is None and not law.changes(*LINE_HOOKS):
        return lagged(pressure, step_s, nodes, 0.0)[0], np.zeros((0, 0, 0))
    return _behind(par, con, (law.felt_pressure, law.line_time_constant), pressure, change, step_s, nodes)
