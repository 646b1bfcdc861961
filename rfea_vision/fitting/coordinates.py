"""What the optimiser turns: coordinates of order one in which the fit is well conditioned and k and b stay positive.

In place of the slopes over the inner radius (which cancel against the value at rest, docs/physics.md 3.7) it turns the
values at rest and at the largest radius that the recordings reach; both must be positive, so everything between is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.parameters import PUBLISHED, scaled
from rfea_vision.dynamics.simulation import Model
from rfea_vision.fitting.observation import Observed
from rfea_vision.tube import inner_radius

FloatArray = NDArray[np.float64]
R_HYD_BOUNDS = (0.003, 0.005)  # m, the paper's: a free r_hyd runs away along k (docs/physics.md 3.10)


@dataclass(frozen=True)
class Coordinates:
    """Affine map par = matrix @ y, with bounds on y. `free` are indices of the parameters that `y` moves."""

    matrix: FloatArray
    offset: FloatArray
    lower: FloatArray
    upper: FloatArray
    free: tuple[int, ...]
    names: tuple[str, ...]

    def parameters(self, y: FloatArray) -> FloatArray:
        return self.offset + self.matrix @ y

    def coordinates(self, par: FloatArray) -> FloatArray:
        """Nearest coordinates within the bounds, a little inside."""
        free = list(self.free)
        y = np.linalg.solve(self.matrix[free], (par - self.offset)[free])
        margin = 1e-4 * np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 1.0)
        return np.clip(y, self.lower + margin, self.upper - margin).astype(np.float64)


def largest_bend(items: Sequence[Observed]) -> float:
    """Largest bending angle (rad) that the recordings reach; from the chord where no angle was measured."""
    largest = 0.1
    for item in items:
        if np.any(np.isfinite(item.angle)):
            largest = max(largest, float(np.nanpercentile(item.angle, 99.5)))
        elif item.has_tip:
            tip = item.points[:, -1]
            largest = max(largest, float(np.percentile(2 * np.arctan2(-tip[:, 0], -tip[:, 1]), 99.5)))
    return largest


def base_reference(actuator: Actuator, segments: int) -> FloatArray:
    """The paper's 8-DoF table for this number of segments, scaled to this tube's length and radius."""
    reference = PUBLISHED["8-DoF"].vector()
    standard = Actuator()
    size = (actuator.outer_radius / standard.outer_radius) ** 3 * (standard.length / actuator.length)
    out = scaled(reference, 8, segments)
    out[[0, 2, 4]] *= size
    out[[1, 3, 5]] *= size * standard.inner_radius / actuator.inner_radius
    out[6] *= actuator.outer_radius / standard.outer_radius
    return out


def build(
    model: Model,
    actuator: Actuator,
    segments: int,
    bend: float,
    fixed: Mapping[str, float] | None = None,
    only: Sequence[str] | None = None,
    held: FloatArray | None = None,
) -> Coordinates:
    """Coordinates for a model; `fixed` pins parameters, `only` frees no others, `held` gives the values of the rest."""
    names = model.names
    reference = base_reference(actuator, segments)
    # The tube does not bend evenly, and a run may overshoot: keep k and b positive to twice the mean angle reached.
    theta = 2.0 * bend / segments
    reach = max(float(inner_radius(actuator, theta, actuator.length / segments)) - actuator.inner_radius, 1e-6)
    pinned = dict(fixed or {})
    columns, lower, upper, free = [], [], [], []
    offset = np.zeros(len(names)) if held is None else held.copy()
    for k, name in enumerate(names):
        if name in pinned:
            offset[k] = pinned[name]
        elif only is None or name in only:
            free.append(k)
    for k in free:
        offset[k] = 0.0
    for k in free:
        column = np.zeros(len(names))
        if k < 6:
            rest = k - k % 2
            size = reference[rest]
            paired = rest in free and rest + 1 in free
            if k % 2 == 0:  # value at rest; the slope follows so that the value at full reach stays
                column[k] = size
                if paired:
                    column[k + 1] = -size / reach
                low, high = 0.02, 50.0
            elif paired:  # value at full reach
                column[k] = size / reach
                low, high = 0.005, 50.0
            else:  # a slope alone
                column[k] = size / reach
                low, high = -0.98 * offset[rest] / size, 50.0
        elif k == 6:
            column[k] = reference[6]
            standard = actuator.outer_radius / 0.004
            low, high = R_HYD_BOUNDS[0] * standard / reference[6], R_HYD_BOUNDS[1] * standard / reference[6]
        else:
            effect, parameter = names[k].split(".")
            spec = next(e for e in model.effects if e.id == effect).parameters[parameter]
            absent = 0.0 if spec.absent is None else spec.absent
            size = abs(spec.start - absent) or 0.05 * (spec.upper - spec.lower)
            column[k] = size
            low, high = spec.lower / size, spec.upper / size
        columns.append(column)
        lower.append(low)
        upper.append(high)
    return Coordinates(
        np.column_stack(columns) if columns else np.zeros((len(names), 0)),
        offset,
        np.array(lower),
        np.array(upper),
        tuple(free),
        tuple(names[k] for k in free),
    )
