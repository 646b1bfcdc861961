"""Fitted values with their intervals, in the engine's terms and in the paper's; where the data cannot give one, none is invented."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import RAN_AWAY, Parameter
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.parameters import PAPER_UNITS, as_paper, as_paper_matrix
from rfea_vision.effects.base import BASE_UNITS
from rfea_vision.effects.catalogue import parameters_of
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.uncertainty import Uncertainty, uncertainty_of

#: Correlation above which two parameters are told of together.
NEAR_TIE = 0.995
#: Standard error of a positive parameter without an upper bound, in times its value, from which on it is not determined.
UNKNOWN_TIMES = 10.0


@dataclass(frozen=True)
class Intervals:
    """Parameters as they go into `model.json`, and the covariance of the full vector behind them."""

    parameters: dict[str, Parameter]
    paper: dict[str, Parameter]
    covariance: FloatArray
    correlation: FloatArray
    sentences: list[str]


def intervals(
    fitted: Fitted, items: Sequence[Observed], actuator: Actuator, drift: FloatArray | None = None
) -> Intervals:
    """Intervals of a solved fit.

    Parameters
    ----------
    items : the training runs, in the order in which they were fitted
    drift : (parameters,) in SI by which they would change towards a finer chain (`discretisation.drift`), added to half an interval
    """
    uncertainty = uncertainty_of(fitted.solution, items)
    par = fitted.par
    coarse = np.zeros(par.size) if drift is None else drift
    parameters, covariance = _parameters(fitted, uncertainty, par, coarse)
    free = list(fitted.coordinates.free)
    spread = np.sqrt(np.maximum(np.diag(covariance)[free], 1e-300))
    absent = {name: spec.absent for name, spec in parameters_of(fitted.model.effects).items()}
    correlation = covariance[np.ix_(free, free)] / np.outer(spread, spread)
    return Intervals(
        parameters,
        _paper(parameters, par, actuator, covariance, uncertainty.quantile, coarse),
        covariance,
        correlation,
        [
            *_sentences(parameters, correlation, fitted.coordinates.names, _ties(fitted, uncertainty), absent),
            *_about_coarseness(fitted, parameters, uncertainty.quantile, coarse),
        ],
    )


def _parameters(
    fitted: Fitted, uncertainty: Uncertainty, par: FloatArray, drift: FloatArray
) -> tuple[dict[str, Parameter], FloatArray]:
    """Parameters with intervals, and the covariance of the full vector."""
    coordinates, model = fitted.coordinates, fitted.model
    ny = len(coordinates.free)
    matrix = coordinates.matrix
    covariance = matrix @ uncertainty.covariance[:ny, :ny] @ matrix.T
    doubtful = np.zeros(len(model.names), dtype=bool)
    for column in range(ny):
        if uncertainty.undetermined[column]:
            doubtful |= matrix[:, column] != 0
    y = fitted.solution.y
    at_bound = {
        coordinates.free[i]: "lower" if y[i] - coordinates.lower[i] < coordinates.upper[i] - y[i] else "upper"
        for i in np.flatnonzero(~coordinates.inside(y))
    }
    specs = parameters_of(model.effects)
    out = {}
    for k, name in enumerate(model.names):
        unit, lower, upper = _unit_and_bounds(fitted, k)
        value, error = float(par[k]), float(np.sqrt(max(covariance[k, k], 0.0)))
        note, known = "", k in coordinates.free
        if not known:
            note = "held fixed"
        elif doubtful[k] or error > _unknown_from(value, lower, upper):
            note, known = "these data do not determine it: no interval", False
        elif k in at_bound:
            note, known = f"at its {at_bound[k]} bound: no interval", False
        half = uncertainty.quantile * error + abs(float(drift[k]))
        out[name] = Parameter(
            value=value,
            unit=unit,
            stderr=half / uncertainty.quantile if known else None,
            interval_95=(value - half, value + half) if known else None,
            lower=lower,
            upper=upper,
            fixed=k not in coordinates.free,
            note=note,
            text=specs[name].text if name in specs else "",
        )
    return out, covariance


def _unknown_from(value: float, lower: float | None, upper: float | None) -> float:
    """Standard error from which on a value tells nothing: with it either side, all that physics allows is covered."""
    if lower is not None and upper is not None:
        return (upper - lower) / 2
    return UNKNOWN_TIMES * abs(value) if lower == 0 else np.inf


def _unit_and_bounds(fitted: Fitted, k: int) -> tuple[str, float | None, float | None]:
    name = fitted.model.names[k]
    given = fitted.options.bounds.get(name)
    if k >= 7:
        spec = parameters_of(fitted.model.effects)[name]
        return spec.unit, *(given or (spec.lower, spec.upper))
    if given is not None:
        return BASE_UNITS[name], *given
    coordinates = fitted.coordinates
    if k == 6 and k in coordinates.free:
        column = coordinates.free.index(k)
        low, high = (float(bound[column] * coordinates.matrix[k, column]) for bound in (coordinates.lower, coordinates.upper))
        return BASE_UNITS[name], low, high
    return BASE_UNITS[name], 0.0 if k % 2 == 0 else None, None


def limits(fitted: Fitted, name: str) -> tuple[float, float]:
    """Lowest and highest value (SI) that a parameter may take; infinite where nothing bounds it."""
    _, low, high = _unit_and_bounds(fitted, fitted.model.names.index(name))
    return -np.inf if low is None else low, np.inf if high is None else high


def _paper(
    parameters: dict[str, Parameter],
    par: FloatArray,
    actuator: Actuator,
    covariance: FloatArray,
    quantile: float,
    drift: FloatArray,
) -> dict[str, Parameter]:
    """k_0, m_k, ... per joint and per degree, so that both tables can be compared."""
    inner = actuator.inner_radius
    values, matrix = as_paper(par[:7], inner), as_paper_matrix(inner)
    spread = np.sqrt(np.maximum(np.diag(matrix @ covariance[:7, :7] @ matrix.T), 0.0))
    half = quantile * spread + np.abs(matrix @ drift[:7])
    own = list(parameters.values())[:7]
    out = {}
    for row, (name, unit), h in zip(matrix, PAPER_UNITS.items(), half, strict=True):
        used = [p for p, share in zip(own, row, strict=True) if share != 0]
        known = all(p.stderr is not None or p.fixed for p in used) and h > 0
        out[name] = Parameter(
            value=values[name],
            unit=unit,
            stderr=float(h / quantile) if known else None,
            interval_95=(values[name] - h, values[name] + h) if known else None,
            fixed=all(p.fixed for p in used),
            note="" if known else next((p.note for p in used if p.note), ""),
        )
    return out


def _ties(fitted: Fitted, uncertainty: Uncertainty) -> list[list[str]]:
    """Groups of parameters of which the data tell a combination only, from the directions that leave no trace."""
    ny = len(fitted.coordinates.free)
    out = []
    for direction in uncertainty.weak:
        moved = np.abs(fitted.coordinates.matrix @ direction[:ny]) / np.maximum(np.abs(fitted.par), 1e-12)
        group = [fitted.model.names[k] for k in np.flatnonzero(moved > 0.05 * max(moved.max(), 1e-300))]
        if group and group not in out:
            out.append(group)
    return out


def _sentences(
    parameters: dict[str, Parameter],
    correlation: FloatArray,
    names: Sequence[str],
    ties: Sequence[Sequence[str]],
    absent: Mapping[str, float | None],
) -> list[str]:
    out = []
    for group in ties:
        listed = f"{', '.join(group[:-1])} and {group[-1]}" if len(group) > 1 else group[0]
        if len(group) == 1:
            out.append(f"{listed} has no effect on these data: no interval is given; hold it fixed or give a prior.")
        else:
            out.append(
                f"{listed} cannot be told apart by these data: only their combination is determined, no intervals are "
                "given; hold one of them fixed or give a prior."
            )
    for group in _near_ties(correlation, names, ties):
        places = [names.index(name) for name in group]
        strongest = float(np.max(np.abs(correlation[np.ix_(places, places)] - np.eye(len(places)))))
        out.append(
            f"{', '.join(group[:-1])} and {group[-1]} can hardly be told apart by these data (correlation up to "
            f"{strongest:.4f}): read their intervals together, or give a prior for one of them."
        )
    for name, parameter in parameters.items():
        if "bound" in parameter.note:
            bound = parameter.lower if "lower" in parameter.note else parameter.upper
            told = "the data ask for a value beyond what physics allows"
            if name == "r_hyd":
                told = (
                    "the data ask for another lever than a body of this size has: where no effect that is missing does so, check the "
                    "pressure's unit and the area on which it acts (actuator.inner_radius, of a beam actuator.section.chamber_area)"
                )
            if name in absent and absent[name] == bound:
                told = "there the effect is absent; these data do not ask for it"
            out.append(f"{name} ended {parameter.note.split(':')[0]}: {told}.")
    return out


def _near_ties(correlation: FloatArray, names: Sequence[str], ties: Sequence[Sequence[str]]) -> list[list[str]]:
    """Groups of parameters that hang together by strong correlations; those of which a tie was told already are left out."""
    groups: list[set[int]] = []
    for i in range(len(names)):
        for j in range(i):
            told = any(names[i] in group and names[j] in group for group in ties)
            if abs(correlation[i, j]) > NEAR_TIE and not told:
                joined = [group for group in groups if i in group or j in group]
                groups = [group for group in groups if group not in joined] + [set().union({i, j}, *joined)]
    return [[names[k] for k in sorted(group)] for group in groups]


def _about_coarseness(
    fitted: Fitted, parameters: Mapping[str, Parameter], quantile: float, drift: FloatArray
) -> list[str]:
    """Say where the number of bodies widens an interval more than the noise does."""
    wide = [
        name
        for change, (name, p) in zip(drift, parameters.items(), strict=True)
        if p.interval_95 is not None and p.stderr is not None and abs(change) > 0.5 * quantile * p.stderr
    ]
    if not wide:
        return []
    count = fitted.options.segments
    return [
        f"The intervals of {', '.join(wide)} come more from the {count} bodies that stand for the tube than from the noise; "
        f"with `--segments {2 * count}` they are narrower."
    ]


def without_intervals(parameters: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """The same values with every interval refused."""
    refused = {"stderr": None, "interval_95": None, "note": f"{RAN_AWAY}: no interval"}
    return {name: p if p.fixed else p.model_copy(update=refused) for name, p in parameters.items()}
