"""Score test of every effect at the present fit: how much of the misfit would each explain, by one linear step?

All effects are compiled into one law, at their absent values, so a single run gives the sensitivity to every amplitude. The
base parameters and clocks are projected out, so what they can absorb is not credited; one that has run into a bound can
absorb nothing more, and is left in. Parameters that vanish with the amplitude (a time constant, a loop width, the place of
a wall) are screened over their grid (Davies 1987, doi:10.1093/biomet/74.1.33). Significance allows for correlated
residuals: gradients are summed over blocks of time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.effects.base import Effect
from rfea_vision.effects.catalogue import catalogue, find_effects, line_effects, load_effect_file, parameters_of
from rfea_vision.fitting.coordinates import sized
from rfea_vision.fitting.observation import TUBE_LAG_S
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.refit import ROUGH_NEWTON, Fitted, on_few_bodies
from rfea_vision.fitting.residuals import Evaluation, evaluate
from rfea_vision.fitting.rules import pushed
from rfea_vision.fitting.uncertainty import BLOCK_S, frame_of_row

FRAMES_SCREENED = 400  # of each run: many times its independent values (rule.py), at a part of the cost
#: A slope of which less than this share is left, once base parameters and clocks are projected out, says nothing.
ABSORBED = 0.05


@dataclass(frozen=True)
class Screened:
    """One effect at one point of its grid: its amplitudes after a linear step, and the share of the squared error that would go."""

    effect: str
    grid: dict[str, float]
    amplitudes: dict[str, float]
    explained: float
    score_p: float | None  # None where no score test says it: see refinement.py


def offered(
    problem: Problem, fitted: Fitted, candidates: Sequence[str] | None, effect_files: Sequence[Path]
) -> tuple[Effect, ...]:
    """Effects to be screened: those asked for (all by default) that are not in the model and could be told from it."""
    own = [item.__class__.id for item in fitted.model.effects]
    users = [effect.id for path in effect_files for effect in load_effect_file(Path(path))]
    ids = (
        list(candidates)
        if candidates is not None
        else [*sorted(catalogue()), *(u for u in users if u not in catalogue()), *_by_chamber(problem)]
    )
    # A parameter at its bound cannot make up for an effect that it is tied to: a lever beyond its bounds shows as `pressure_gain`.
    inside = fitted.coordinates.inside(fitted.solution.y)
    turned = [name for name, moves in zip(fitted.coordinates.names, inside, strict=True) if moves]
    clocks_free = all(item.clock_sigma >= TUBE_LAG_S for item in problem.train)
    moving = pushed(problem.train)
    chosen = []
    for effect in sized(find_effects([i for i in ids if i not in own], effect_files), problem.actuator):
        tied_to_base = any(name in turned for name in effect.exactly_tied_to)
        # Of a pressure that never changes neither its line, nor what it lengthens, nor the clock of its log can be told.
        by_log = effect.id in line_effects() or effect.overrides("stretch") or effect.overrides("time_shift")
        unpushed = not moving and by_log
        no_such_body = problem.actuator.kind in effect.not_of or (effect.needs_tendon and problem.actuator.tendon is None)
        if tied_to_base or no_such_body or unpushed or (effect.id == "time_offset" and clocks_free):
            continue
        chosen.append(effect)
    return tuple(chosen)


def _by_chamber(problem: Problem) -> list[str]:
    """Effects of the line at each of several chambers; the lever of the first one is that of the model (r_hyd).

    Of one chamber, named or not, its line is the line: the same effect under two names would share its probability.
    """
    chambers = list(problem.train[0].excitation.chambers)
    if len(chambers) < 2:
        return []
    placed = [(effect, chamber) for effect in line_effects() for chamber in chambers]
    return [f"{effect}@{chamber}" for effect, chamber in placed if effect != "pressure_gain" or chamber != chambers[0]]


def available(effects: Sequence[Effect], present: Collection[str]) -> tuple[Effect, ...]:
    """Effects that are not in a model yet, and for which those that they go with are."""
    return tuple(e for e in effects if e.id not in present and set(e.goes_with) <= set(present))


def grids(effects: Sequence[Effect]) -> list[dict[str, float]]:
    """Points at which to screen: every effect walks along its own grid at the same time."""
    longest = max([len(s.grid) for e in effects for s in e.parameters.values() if s.absent is None], default=1)
    walks = {name: s.grid or (s.start,) for name, s in parameters_of(effects).items() if s.absent is None}
    return [
        {name: values[min(index, len(values) - 1)] for name, values in walks.items()} for index in range(max(longest, 1))
    ]


def _vector(model: Model, fitted: Fitted, point: dict[str, float]) -> FloatArray:
    known, specs = {**fitted.values, **point}, parameters_of(model.effects)
    par = np.zeros(len(model.names))
    for k, name in enumerate(model.names):
        if name in known:
            par[k] = known[name]
        else:
            spec = specs[name]
            par[k] = (spec.grid or (spec.start,))[-1] if spec.absent is None else spec.absent
    return par


def room(effect: Effect, names: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Three times (amplitudes,): where each is absent, and how far it may step down (negative) and up from there."""
    specs = [effect.parameters[name] for name in names]
    zero = np.array([spec.absent or 0.0 for spec in specs])
    return zero, np.array([spec.lower for spec in specs]) - zero, np.array([spec.upper for spec in specs]) - zero


def bounded_step(
    gradient: FloatArray, hessian: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, float]:
    """Best step (amplitudes,) within bounds, and the fall of the squared error that it predicts.

    Where the free step leaves its bounds, the amplitude that is farthest out is held at its bound and the others step again.
    """
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    normed = hessian / np.outer(scale, scale) + 1e-8 * np.eye(scale.size)
    slope, least, most = gradient / scale, low * scale, high * scale
    step, free = np.zeros(scale.size), np.ones(scale.size, dtype=bool)
    while free.any():
        step[free] = np.linalg.solve(
            normed[np.ix_(free, free)], slope[free] - normed[np.ix_(free, ~free)] @ step[~free]
        )
        beyond = np.where(free, np.maximum(least - step, step - most), 0.0)
        worst = int(np.argmax(beyond))
        if beyond[worst] <= 0:
            break
        step[worst] = np.clip(step[worst], least[worst], most[worst])
        free[worst] = False
    step = step / scale
    return step, float(2 * gradient @ step - step @ hessian @ step)


@dataclass(frozen=True)
class Sensitivity:
    """Slopes of the residual over the amplitudes of one effect, less what base parameters and clocks can absorb.

    jacobian (rows, amplitudes) and residual (rows,) are in standard errors of the measurement; `slices` are the rows of
    each of `items`. `secant` is the amplitude at which the change was taken where the slope at none at all is absorbed; what
    is left of it grows with the square of the amplitude. Else it is 0.
    """

    effect: Effect
    grid: dict[str, float]
    names: list[str]
    jacobian: FloatArray
    residual: FloatArray
    items: tuple[Observed, ...]
    slices: tuple[slice, ...]
    secant: float = 0.0


def sensitivities(problem: Problem, fitted: Fitted, effects: Sequence[Effect]) -> Iterator[Sensitivity]:
    """Sensitivity of every effect at every point of its grid; one simulation per point serves all effects.

    Where a run with all of them cannot be simulated, they are taken in halves.
    """
    points = grids(effects)
    # The law of the whole catalogue is compiled once and for all; a law of those asked for would be another each time.
    compiled = tuple({e.id: e for e in (*find_effects(sorted(catalogue())), *effects)}.values())
    for round_, point in enumerate(points):
        active = (
            effects if round_ == 0 else [e for e in effects if any(len(s.grid) > round_ for s in e.parameters.values())]
        )
        yield from _at_point(problem, fitted, compiled, active, point)


def absorbable(result: Evaluation, fitted: Fitted, free: int) -> FloatArray:
    """What base parameters and clocks can make of a residual: columns (rows, moves) of size one.

    `free` parameters were differentiated by, those of the fit first. One that stands at a bound can take up nothing more.
    """
    clocks = [free + i for i in fitted.solution.clock_index]
    coordinates = fitted.coordinates
    moves = coordinates.matrix[list(coordinates.free)][:, coordinates.inside(fitted.solution.y)]
    base = np.concatenate([result.jacobian[:, : moves.shape[0]] @ moves, result.jacobian[:, clocks]], axis=1)
    return base / np.maximum(np.linalg.norm(base, axis=0), 1e-300)


def _at_point(
    problem: Problem, fitted: Fitted, effects: Sequence[Effect], active: Sequence[Effect], point: dict[str, float]
) -> Iterator[Sensitivity]:
    """Sensitivities of the active effects at one point of the grid; `effects` are those that the law is compiled with."""
    rough = tuple(o.rough(FRAMES_SCREENED) for o in problem.train)
    thin = tuple(o.thinned(max(1, o.time.size // FRAMES_SCREENED)) for o in problem.train)
    everything = {e.id: e for e in (*effects, *fitted.model.effects)}
    few = on_few_bodies(fitted.options).segments
    model = replace(
        fitted.model,
        chain=Chain.tube(problem.actuator, few, fitted.options.joints),
        effects=tuple(everything[name] for name in sorted(everything)),
        tolerance=ROUGH_NEWTON,
    )
    base_free = [model.names.index(name) for name in fitted.coordinates.names]
    par = _vector(model, fitted, point)
    par[:6] *= few / fitted.options.segments
    extra = [model.names.index(f"{e.id}.{n}") for e in active for n in e.amplitudes()]
    free = [*base_free, *extra]
    for items in (rough, thin):  # a run that fails in long steps may succeed in those of the log
        result = evaluate(model, par, items, free, fitted.solution.clocks)
        if result is not None:
            break
    else:
        if len(effects) > len(active):
            yield from _at_point(problem, fitted, active, active, point)
            return
        half = len(active) // 2
        for part in (active[:half], active[half:]) if half else ():
            yield from _at_point(problem, fitted, part, part, point)
        return
    q, _ = np.linalg.qr(absorbable(result, fitted, len(free)))
    residual = result.residual - q @ (q.T @ result.residual)
    column = len(base_free)
    for effect in active:
        names = list(effect.amplitudes())
        jacobian = result.jacobian[:, column : column + len(names)]
        column += len(names)
        raw = np.linalg.norm(jacobian, axis=0)
        jacobian = jacobian - q @ (q.T @ jacobian)
        left = np.linalg.norm(jacobian, axis=0)
        own_grid = {k.split(".")[1]: v for k, v in point.items() if k.startswith(effect.id + ".")}
        secant = 0.0
        if len(names) == 1 and left[0] <= ABSORBED * raw[0]:
            # To first order a lag is a shift, which a free clock takes up: its finite change is looked at instead.
            secant = effect.parameters[names[0]].start
            changed = par.copy()
            changed[model.names.index(f"{effect.id}.{names[0]}")] = secant
            moved = evaluate(model, changed, items, (), fitted.solution.clocks)
            if moved is None:
                continue
            jacobian = ((moved.residual - result.residual) / secant)[:, None]
            raw, jacobian = np.linalg.norm(jacobian, axis=0), jacobian - q @ (q.T @ jacobian)
            left = np.linalg.norm(jacobian, axis=0)
        if np.all(left <= 1e-6 * np.maximum(raw, 1e-300)):
            continue  # the base parameters absorb it whole
        yield Sensitivity(effect, own_grid, names, jacobian, residual, items, result.slices, secant)


def screened_rows(rows: Sequence[Sensitivity], effects: Sequence[Effect]) -> list[Screened]:
    """Score of every effect at every point of its grid, best first."""
    found: list[Screened] = []
    tests = len(grids(effects))
    for row in rows:
        # The residual is measured minus modelled; its Jacobian has the sign of minus the model's.
        gradient, hessian = -row.jacobian.T @ row.residual, row.jacobian.T @ row.jacobian
        zero, low, high = room(row.effect, row.names)
        step, fall = bounded_step(gradient, hessian, low, high)
        found.append(
            Screened(
                row.effect.id,
                row.grid,
                dict(zip(row.names, (zero + step).tolist(), strict=True)),
                max(fall, 0.0) / max(float(row.residual @ row.residual), 1e-300),
                _score_p(row.jacobian, row.residual, _clusters(row.items, row.slices), tests),
            )
        )
    return sorted(found, key=lambda s: -s.explained)


def _clusters(items: Sequence, slices: Sequence[slice]) -> NDArray[np.int64]:
    out, first = [], 0
    for item, part in zip(items, slices, strict=True):
        frame = frame_of_row(item, part.stop - part.start)
        block = ((item.time - item.time[0]) / BLOCK_S).astype(int)
        out.append(first + block[frame])
        first += int(block.max()) + 1
    return np.concatenate(out)


def _score_p(jacobian: FloatArray, residual: FloatArray, clusters: NDArray[np.int64], tests: int) -> float:
    """Cluster-robust score test, Bonferroni over the grid."""
    count = int(clusters.max()) + 1
    p = jacobian.shape[1]
    sums = np.stack([np.bincount(clusters, jacobian[:, k] * residual, minlength=count) for k in range(p)], axis=1)
    variance = sums.T @ sums
    scale = np.sqrt(np.maximum(np.diag(variance), 1e-300))
    score = sums.sum(axis=0) / scale
    statistic = float(score @ np.linalg.pinv(variance / np.outer(scale, scale), rcond=1e-8) @ score)
    return float(min(1.0, chi2.sf(statistic, p) * tests))
