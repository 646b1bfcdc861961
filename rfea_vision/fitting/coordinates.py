"""Coordinates of the optimiser: of order one, in which the fit is well conditioned and k and b stay positive.

In place of the slopes over the inner radius (which cancel against the value at rest, docs/physics.md 3.7) it turns the
values at rest and at the largest radius that the recordings reach; both must be positive, so everything between is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.parameters import PUBLISHED, scaled
from rfea_vision.dynamics.simulation import Model
from rfea_vision.effects.base import Effect
from rfea_vision.effects.catalogue import parameters_of
from rfea_vision.fitting.observed import Observed
from rfea_vision.tube import inner_radius

#: The law must hold to so many times the largest bend of the runs: springs and dampers stay positive to there.
REACH = 1.5
#: Stiffness and damping may differ from the reference by these factors: of a tube of rubber, and of a beam of anything. The softest
#: silicones have a sixtieth of the modulus of the paper's (0.03 MPa), and at rest a fraction of what they have when bent.
STIFFNESS_RANGE, DAMPING_RANGE, BEAM_RANGE = (1e-3, 50.0), (0.02, 50.0), (1e-5, 1e6)
BEAM_MODULUS = 1e6  # Pa
#: A start is kept this far off its bounds at most.
MARGIN = 5e-3
R_HYD_BOUNDS = (0.003, 0.005)  # m, the paper's: a free r_hyd runs away along k (docs/physics.md 3.10)


@dataclass(frozen=True)
class Coordinates:
    """Affine map par = matrix @ y, with bounds on y. `free` are indices of the parameters that `y` moves.

    What is known beforehand says prior_rows @ y = prior_targets, each with a standard error of one.
    """

    matrix: FloatArray
    offset: FloatArray
    lower: FloatArray
    upper: FloatArray
    free: tuple[int, ...]
    names: tuple[str, ...]
    prior_rows: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    prior_targets: FloatArray = field(default_factory=lambda: np.zeros(0))

    def parameters(self, y: FloatArray) -> FloatArray:
        """Full parameter vector (parameters,) in SI at the coordinates `y` (free,)."""
        return self.offset + self.matrix @ y

    def inside(self, y: FloatArray) -> NDArray[np.bool_]:
        """Which of the coordinates `y` (free,) are off their bounds, and so may move either way."""
        # Coordinates are of order one; a generous upper bound must not make a small amplitude look like none, nor hide a large
        # one that has run into it.
        span = np.minimum(self.upper - self.lower, 1.0)
        low, high = (
            1e-3 * np.where(np.isfinite(bound), np.maximum(span, np.abs(bound)), 1.0)
            for bound in (self.lower, self.upper)
        )
        return (y > self.lower + low) & (y < self.upper - high)

    def coordinates(self, par: FloatArray) -> FloatArray:
        """Coordinates (free,) nearest to `par` (parameters,) within the bounds, a little inside."""
        free = list(self.free)
        y = np.linalg.solve(self.matrix[free], (par - self.offset)[free])
        # Coordinates are of order one; bounds that lie far apart must not push a start away, nor a value that had ended at a
        # small bound: a stiffness that is a fiftieth of the usual would come back a quarter larger.
        span = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 1.0)
        margin = np.minimum(1e-4 * span, MARGIN)
        low, high = (
            np.where(bound == 0, margin, np.minimum(margin, MARGIN * np.abs(bound)))
            for bound in (self.lower, self.upper)
        )
        return np.clip(y, self.lower + low, self.upper - high).astype(np.float64)


def bend_of(item: Observed) -> FloatArray:
    """Bending angle (frames,) in rad: as measured, or from the chord to the tip where no angle was."""
    if np.any(np.isfinite(item.angle)) or not item.has_tip:
        return item.angle
    tip = item.points[:, -1]
    return 2 * np.arctan2(-tip[:, 0], -tip[:, 1])


def largest_bend(items: Sequence[Observed]) -> float:
    """Largest bending angle (rad) that the recordings reach, to either side."""
    bends = [bend_of(item) for item in items]
    return max([0.1, *(float(np.nanpercentile(np.abs(b), 99.5)) for b in bends if np.any(np.isfinite(b)))])


def base_reference(actuator: Actuator, segments: int) -> FloatArray:
    """The paper's 8-DoF table (7,) in SI for this number of segments, scaled to this tube's length and radius.

    Of a beam, the stiffness of rubber of 1 MPa with damping as the paper's tube has it; nothing follows a bore. A tendon's lever is its
    distance from the middle.
    """
    if actuator.kind != "tube":
        table = PUBLISHED["8-DoF"].vector()
        k = BEAM_MODULUS * stiffness_per_modulus(actuator, segments)
        lever = actuator.tendon or actuator.outer_radius
        return np.array([k, 0.0, k * table[2] / table[0], 0.0, k * table[2] / table[0], 0.0, lever])
    reference = PUBLISHED["8-DoF"].vector()
    standard = Actuator()
    size = (actuator.outer_radius / standard.outer_radius) ** 3 * (standard.length / actuator.length)
    out = scaled(reference, 8, segments)
    out[[0, 2, 4]] *= size
    out[[1, 3, 5]] *= size * standard.inner_radius / actuator.inner_radius
    out[6] *= actuator.outer_radius / standard.outer_radius
    return out


def sized(effects: Sequence[Effect], actuator: Actuator) -> tuple[Effect, ...]:
    """Effects whose torques (N m) may be as large as this body is stiff, and masses (kg) as heavy as bend it as far.

    Declared are those of the paper's tube. Bounds and starts widen by the stiffness at rest, as `base_reference` has it, masses by
    that over the length; of a smaller tube they stay.
    """
    paper = Actuator()
    torques = base_reference(actuator, 1)[0] / base_reference(paper, 1)[0]
    times = {"N*m": max(1.0, torques), "kg": max(1.0, torques * paper.length / actuator.length)}
    return tuple(effect.scaled(times) for effect in effects)


def stiffness_per_modulus(actuator: Actuator, segments: int) -> float:
    """k_ref per joint (N m/rad) of a wall with a Young's modulus of 1 Pa that bends about its inextensible side.

    Area moment of the ring about its own middle, moved to the hinge line by the parallel axis theorem, over the arc of
    one joint. What the inextensible side is made of, and the pressure in the wall, are left out: a rough value.
    """
    return actuator.bending_moment_of_area * segments / actuator.length


@dataclass(frozen=True)
class _Axis:
    """One coordinate: the direction in parameter space that it moves along, and its bounds."""

    column: FloatArray
    lower: float
    upper: float


def _base_axis(
    k: int,
    size: float,
    reach: float,
    held: float,
    count: int,
    paired: bool,
    given: tuple[float, float] | None,
    usual: tuple[float, float],
) -> _Axis:
    """Coordinate of a value at rest or of a slope; `held` is the value at rest where only the slope is free."""
    column = np.zeros(count)
    if k % 2 == 0:  # value at rest; where the slope is free too, it follows so that the value at full reach stays
        column[k] = size
        if paired:
            column[k + 1] = -size / reach
        low, high = given or (usual[0] * size, usual[1] * size)
        return _Axis(column, low / size, high / size)
    column[k] = size / reach
    if given is not None:
        return _Axis(column, given[0] * reach / size, given[1] * reach / size)
    return _Axis(column, 0.005 if paired else -0.98 * held / size, 50.0)


def _effect_axis(model: Model, k: int, given: tuple[float, float] | None) -> _Axis:
    spec = parameters_of(model.effects)[model.names[k]]
    absent = 0.0 if spec.absent is None else spec.absent
    size = abs(spec.start - absent) or 0.05 * (spec.upper - spec.lower)
    column = np.zeros(len(model.names))
    column[k] = size
    low, high = given or (spec.lower, spec.upper)
    return _Axis(column, low / size, high / size)


def build(
    model: Model,
    actuator: Actuator,
    segments: int,
    bend: float,
    fixed: Mapping[str, float] | None = None,
    only: Sequence[str] | None = None,
    held: FloatArray | None = None,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
) -> Coordinates:
    """Coordinates for a model.

    Parameters
    ----------
    fixed : pins parameters; names that the model does not have are passed over, here and in `bounds` and `priors`
    only : frees no others
    held : (parameters,) in SI, gives the values of the rest
    bounds, priors : as in `FitOptions`; a slope that has bounds of its own is a coordinate itself
    """
    names = model.names
    reference = base_reference(actuator, segments)
    # The tube does not bend evenly: keep k and b positive to half as much again as the mean angle reached. At twice that
    # angle the paper's own b_neg is negative.
    theta = REACH * bend / segments
    reach = max(float(inner_radius(actuator, theta, actuator.length / segments)) - actuator.inner_radius, 1e-6)
    pinned, given = dict(fixed or {}), dict(bounds or {})
    offset = np.zeros(len(names)) if held is None else held.copy()
    free = [k for k, name in enumerate(names) if name not in pinned and (only is None or name in only)]
    for k, name in enumerate(names):
        offset[k] = pinned.get(name, offset[k])
    offset[free] = 0.0
    axes = []
    for k in free:
        own = given.get(names[k])
        if k < 6:
            rest = k - k % 2
            usual = BEAM_RANGE if actuator.kind != "tube" else STIFFNESS_RANGE if k < 2 else DAMPING_RANGE
            paired = rest in free and rest + 1 in free and names[rest + 1] not in given
            axes.append(_base_axis(k, reference[rest], reach, offset[rest], len(names), paired, own, usual))
        elif k == 6:
            column = np.zeros(len(names))
            column[6] = reference[6]
            # for another tube the bounds widen, they do not move; a tendon's lever was measured, and lies a quarter to both sides
            size = (actuator.tendon or actuator.outer_radius) / Actuator().outer_radius
            narrow, wide = (size, size) if actuator.tendon else (min(size, 1.0), max(size, 1.0))
            low, high = own or (R_HYD_BOUNDS[0] * narrow, R_HYD_BOUNDS[1] * wide)
            axes.append(_Axis(column, low / reference[6], high / reference[6]))
        else:
            axes.append(_effect_axis(model, k, own))
    matrix = np.column_stack([axis.column for axis in axes]) if axes else np.zeros((len(names), 0))
    rows, targets = _priors(names, matrix, offset, priors or {}, stiffness_per_modulus(actuator, segments))
    return Coordinates(
        matrix,
        offset,
        np.array([axis.lower for axis in axes]),
        np.array([axis.upper for axis in axes]),
        tuple(free),
        tuple(names[k] for k in free),
        rows,
        targets,
    )


def _priors(
    names: Sequence[str],
    matrix: FloatArray,
    offset: FloatArray,
    priors: Mapping[str, tuple[float, float]],
    per_modulus: float,
) -> tuple[FloatArray, FloatArray]:
    """Rows and right-hand sides of what is known beforehand, each in units of its standard error."""
    rows, targets = [], []
    for name, (mean, sd) in priors.items():
        if name == "modulus":
            name, mean, sd = "k_ref", mean * per_modulus, sd * per_modulus
        if name in names:
            k = list(names).index(name)
            rows.append(matrix[k] / sd)
            targets.append((mean - offset[k]) / sd)
    return np.array(rows).reshape(len(rows), matrix.shape[1]), np.array(targets, dtype=float)
