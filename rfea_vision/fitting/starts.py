"""Where a fit may start: stiffness as the recordings show it, and gentler versions of a start that cannot be simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.simulation import Model
from rfea_vision.fitting.coordinates import Coordinates, base_reference, bend_of
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.residuals import evaluate
from rfea_vision.fitting.rules import pushed
from rfea_vision.fitting.solver import solve
from rfea_vision.tube import inner_radius

#: Springs and dampers that are this much smaller at one end of the reach than at the other are evened out.
EVEN = 0.5


#: Shares of a run that was let go, from its release on, that are fitted one after the other before the whole is.
OPENINGS = (0.125, 0.25, 0.5)
#: Frames that an opening has at least: as many as a base model has parameters, twice.
SHORTEST_OPENING = 14
#: Factors on the stiffness, and on the time in which a joint without mass would relax, of the starts that are looked at: rubbers
#: from a sixtieth of the paper's modulus on (`coordinates.STIFFNESS_RANGE`) to a beam, lightly damped to overdamped.
GRID = tuple(4.0**power for power in range(-3, 4))
#: Damping ratio of a start whose stiffness is read from a swing: that of a soft rubber.
START_DAMPING_RATIO = 0.05


def observed_scale(items: Sequence[Observed], actuator: Actuator) -> FloatArray:
    """How many times the paper's (at this size) the stiffnesses and dampings (6,) are, judged by what the runs show.

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
        step = item.period_s
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


def from_the_release(
    model: Model, items: Sequence[Observed], coordinates: Coordinates, reference: FloatArray
) -> FloatArray:
    """Start parameters (SI) for runs that were let go, found from their beginnings on.

    Of a tube that rings, a start with another frequency ends in a minimum that is half a swing off; of one that creeps, no swing shows
    the stiffness. So stiffness and damping are searched on a grid over the opening of the runs, and fitted to more and more of them.
    `reference` (parameters,) is the middle of the grid; it is returned where no run was let go or no point of it can be simulated.
    """
    let_go = [item for item in items if item.held is not None]
    if not let_go:
        return reference

    def opening(share: float) -> list[Observed]:
        return [
            item.opening(min(max(SHORTEST_OPENING, int(share * item.time.size)), item.time.size)) for item in let_go
        ]

    def cost(factors: tuple[float, float]) -> float:
        par = coordinates.parameters(coordinates.coordinates(_with_factors(reference, *factors)))
        seen = evaluate(model, par, first, ())
        return np.inf if seen is None else seen.cost

    first = opening(OPENINGS[0])
    looks = {(k, k * b): cost((k, k * b)) for k in GRID for b in GRID}
    best = min(looks, key=lambda factors: looks[factors])
    if not np.isfinite(looks[best]):
        return reference
    par = _with_factors(reference, *best)
    for share in OPENINGS:
        found = solve(model, opening(share), coordinates, par, most_evaluations=20, tolerance=1e-3)
        par = par if found is None else found.par
    return par


def _with_factors(reference: FloatArray, stiffness: float, damping: float) -> FloatArray:
    """Parameters with every stiffness and every damper times a factor."""
    par = reference.copy()
    par[:2] *= stiffness
    par[2:6] *= damping
    return par


def without_vanishing_ends(coordinates: Coordinates, par: FloatArray) -> FloatArray:
    """The same parameters (parameters,) in SI with no spring and no damper that all but vanishes at one end of the reach."""
    y = coordinates.coordinates(par)
    for rest in ("k_ref", "b_pos_ref", "b_neg_ref"):
        slope = rest.replace("_ref", "_slope")
        if rest in coordinates.names and slope in coordinates.names:
            pair = [coordinates.names.index(rest), coordinates.names.index(slope)]
            y[pair] = np.maximum(y[pair], EVEN * np.max(y[pair]))
    return coordinates.parameters(np.clip(y, coordinates.lower, coordinates.upper))
