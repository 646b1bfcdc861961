"""A look without prejudice: each effect with a base model fitted anew, on a coarse chain.

A large misfit may have driven the base parameters into a wrong minimum (ringing out of phase), where the slopes that the
score test reads point nowhere near the effect. There, every effect gets its own start from the statics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rfea_vision.effects.base import Effect
from rfea_vision.fitting.problem import Problem, make_model, start_vector
from rfea_vision.fitting.refit import Fitted, coordinates_for
from rfea_vision.fitting.solver import solve
from rfea_vision.fitting.starts import seen_scale

COARSE = 6
FRAMES = 300
EVALUATIONS = 12


@dataclass(frozen=True)
class FreshFit:
    """An effect with the parameters of the whole model, from a short fit of a coarse chain.

    `parameters` by name, per joint of a chain of `segments`; `cost` is that of the thinned training runs.
    """

    effect: str
    parameters: dict[str, float]
    segments: int
    cost: float


def fresh_look(
    problem: Problem, fitted: Fitted, effects: Sequence[Effect], progress: Callable[[], None] = lambda: None
) -> list[FreshFit]:
    """Fit every effect from the statics, best first; those that cannot be simulated are left out."""
    thin = [o.rough(FRAMES) for o in problem.train]
    segments = min(COARSE, fitted.options.segments) if fitted.options.joints == "middle" else fitted.options.segments
    scale = seen_scale(problem.train, problem.actuator)
    known = {n: v for n, v in zip(fitted.model.names, fitted.par, strict=True) if "." in n}
    found = []
    for effect in effects:
        wanted = (*fitted.options.effects, effect.id)
        options = replace(fitted.options.with_segments(segments), effects=wanted)
        model = make_model(problem.actuator, options, problem.mirror)
        start = start_vector(model, problem.actuator, segments)
        start[:6] *= scale
        for k, name in enumerate(model.names):
            start[k] = known.get(name, start[k])
            spec = effect.parameters.get(name.partition(".")[2]) if name.startswith(f"{effect.id}.") else None
            if spec is not None and spec.grid:
                start[k] = spec.grid[len(spec.grid) // 2]
        solution = solve(
            model,
            thin,
            coordinates_for(problem, options, model),
            start,
            fitted.solution.clocks,
            most_evaluations=EVALUATIONS,
            tolerance=1e-3,
        )
        progress()
        if solution is not None and np.isfinite(solution.cost):
            values = dict(zip(model.names, solution.par.tolist(), strict=True))
            found.append(FreshFit(effect.id, values, segments, solution.cost))
    return sorted(found, key=lambda item: item.cost)


__all__ = ["FreshFit", "fresh_look"]
