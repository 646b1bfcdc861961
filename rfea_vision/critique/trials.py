"""Refits of sets of effects: each set once, in full, never worse than a smaller set that it contains.

A set is simulated under the law of its own effects alone: under that of the whole catalogue a step takes two to three times
as long, and what acts once a run costs no compilation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rfea_vision.artefacts.rows import Refit
from rfea_vision.critique.carrying import carried_over
from rfea_vision.critique.measures import Errors, errors_of
from rfea_vision.critique.refinement import SEGMENTS, refit_segments
from rfea_vision.effects.catalogue import find_effects, parameters_of, plain
from rfea_vision.errors import DataError
from rfea_vision.fitting.fit import BENT, stiff_start
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem, make_model
from rfea_vision.fitting.ratio import with_lever_free
from rfea_vision.fitting.refit import ROUGH_NEWTON, Fitted, coordinates_for, on_few_bodies, refit, rough_runs
from rfea_vision.fitting.residuals import side_by_side
from rfea_vision.fitting.solver import farthest
from rfea_vision.options import FitOptions

#: Evaluations at most on thinned runs in long steps, on all frames, and for a first and a second glance; and the share of the cost
#: that one more must still win, and that a step from thinned runs to all frames must. A fit that has not converged looks worse than
#: it is, so most end by this share. Work is counted, never timed.
ROUGH_EVALUATIONS, FULL_EVALUATIONS, GLANCES = 25, 12, (4, 8)
ROUGH_GAIN, CARRIED_GAIN, FULL_GAIN = 1e-4, 1e-4, 3e-4
#: Of more starts than this, the best after a few evaluations are followed to their ends: a wrong time constant shows at once.
FINALISTS = 2
#: Change of an angle (rad) at which a step is solved where all frames count: a third fewer iterations; it moves the tip by 0.2 um.
FINE_NEWTON = 1e-6
#: Where a refit starts again from the optimum of a smaller model: this share of the usual start of what is new.
FAINT = 0.02
#: A refit is repeated once the squared error of the best fit is this many times smaller than that which the refit began from.
NEARER = 4.0
#: An amplitude this near to a bound, as a share of its range, has run into it.
AT_BOUND = 2e-3


@dataclass(frozen=True)
class Trial:
    """A set of effects that was fitted; `effects` are all that the model then has, `at_bound` that one of them ran into a bound."""

    effects: frozenset[str]
    fitted: Fitted
    errors: Errors
    at_bound: bool = False

    @property
    def cost(self) -> float:
        """Squared residual on the training runs, in standard errors."""
        return self.fitted.solution.cost

    @property
    def free(self) -> int:
        """Parameters that were fitted."""
        return len(self.fitted.coordinates.free)

    def distance(self, other: Trial) -> float:
        """Root mean square difference of two fits on the training runs: of the points (m), or of the angle (rad)."""
        seen = (trial.fitted.solution.evaluation.predicted for trial in (self, other))
        squares = []
        for a, b in zip(*seen, strict=True):
            gap = (a.points - b.points) if a.points.shape[1] else (a.angle - b.angle)[:, None, None]
            squares.append(float(np.mean(np.sum(gap**2, axis=2))))
        return float(np.sqrt(np.mean(squares)))


class Glance(NamedTuple):
    """A fit of thinned runs alone: its mean square, in standard errors, and its values by name."""

    mean_square: float
    values: dict[str, float]


@dataclass
class Trials:
    """What was tried so far, by the sets of effects."""

    problem: Problem
    effect_files: tuple[Path, ...] = ()
    progress: Callable[[], None] = field(default=lambda: None)
    done: dict[frozenset[str], Trial | None] = field(default_factory=dict)
    rough: list[Observed] = field(default_factory=list)  # the training runs as a refit first meets them
    #: Parameters by name, SI, by the sets of effects that an earlier search has refitted on a chain like this: where theirs begin.
    known: Mapping[frozenset[str], Mapping[str, float]] = field(default_factory=dict)
    bent: bool = False  # whether the model as it stands is too far out of shape to begin a refit from
    stiff: dict[str, float] = field(default_factory=dict)  # base parameters that no fit has bent out of shape
    #: Where it is bent: by the sets of effects, the cost of the fit that their refit began from.
    began: dict[frozenset[str], float] = field(default_factory=dict)

    def adopt(self, fitted: Fitted) -> Trial:
        """Take note of a fit that was made elsewhere, its lever free: what more effects leave may tell it (fitting/ratio.py)."""
        fitted = with_lever_free(self.problem, fitted)
        key = frozenset(fitted.options.effects)
        trial = Trial(key, fitted, errors_of(self.problem, fitted))
        self.done[key] = trial
        self.rough = rough_runs(self.problem, fitted)
        self.stiff = stiff_start(self.problem, fitted)
        self.bent = farthest(self.problem.train, fitted.solution, self.problem.actuator.length) >= BENT
        return trial

    def refit(self, base: Trial, added: Sequence[str], start: Mapping[str, float]) -> Trial | None:
        """Add effects to a model from the values in `start` (by name); None if it cannot be simulated on the training runs.

        Where the model as it stands is bent out of shape, a refit begins from the best fit so far, and again where that has become
        much better since.
        """
        key = base.effects | set(added)
        before = self.done.get(key)
        if key not in self.done or self._began_too_far_off(key):
            if SEGMENTS in added:
                fitted = refit_segments(self.problem, base.fitted, f"{base.fitted.options.name}+{SEGMENTS}")
            else:
                fitted = self._solved(base, key, start)
            if fitted is not None and (before is None or fitted.solution.cost < before.cost):
                self._keep(base, key, fitted)
            else:
                self.done[key] = before
            self.progress()
        return self.done[key]

    def _keep(self, base: Trial, key: frozenset[str], fitted: Fitted) -> None:
        """Take a fit for that of its set, and fit what contains the set again from it where that stands above it now."""
        self.done[key] = Trial(key, fitted, errors_of(self.problem, fitted), _at_bound(fitted))
        larger = [k for k, t in self.done.items() if t is not None and k > key and SEGMENTS not in k]
        for above in sorted(larger, key=lambda k: (len(k), sorted(k))):
            before, cost = self.done[above], fitted.solution.cost
            if before is not None and before.cost > cost:
                far = before.cost > (1 + FULL_GAIN) * cost  # else it stands at this fit already
                again = self._again(base, above, before.fitted.values, fitted) if far else None
                self._keep(base, above, min((again or fitted, fitted), key=lambda one: one.solution.cost))

    def _best(self) -> Trial:
        """The fit of the least cost so far, on the chain of the model as it stands."""
        return min((t for k, t in self.done.items() if t is not None and SEGMENTS not in k), key=lambda t: t.cost)

    def _began_too_far_off(self, key: frozenset[str]) -> bool:
        trial = self.done[key]
        reached = np.inf if trial is None else trial.cost
        return self.bent and NEARER * self._best().cost < min(self.began.get(key, 0.0), reached)

    def _nearest(self, base: Trial, key: frozenset[str]) -> tuple[Fitted, dict[str, float]]:
        """The fit that a refit begins from, and of its values those that the set has, too."""
        if not self.bent:
            return base.fitted, base.fitted.values
        best = self._best()
        self.began[key] = best.cost
        shared = {plain(one) for one in key & best.effects}
        own = {n: v for n, v in best.fitted.values.items() if "." not in n or n.partition(".")[0] in shared}
        return best.fitted, {**base.fitted.values, **own}

    def _solved(self, base: Trial, key: frozenset[str], start: Mapping[str, float]) -> Fitted | None:
        options = self._options(base, key)
        best, held = None, base.fitted.values
        if key in self.known:
            best = self._in_full(options, self.known[key], base.fitted)
        if best is None:
            like, held = self._nearest(base, key)
            grids = [{}, *({n: v} for n, points in self._grids(key, start).items() for v in points[1:])]
            starts = [{**grid, **held, **start} for grid in grids]
            alone = key - base.effects
            # The present model may have absorbed what one effect does; where it is bent, all but other forms have begun afresh.
            if len(alone) == 1 and (not self.bent or ":" in next(iter(alone))):
                starts += [{**grid, **held, **self.stiff, **start} for grid in grids]
            if like is not base.fitted:  # a linear step from the present model tells nothing of amplitudes there
                amplitudes = self._amplitudes(options)
                starts.append({**{n: v for n, v in start.items() if n not in amplitudes}, **held})
            best = self._from(options, starts, like)
        smaller = [t for k, t in self.done.items() if t is not None and k < key and SEGMENTS not in k]
        nearest = min(smaller, key=lambda t: t.cost, default=base)
        if best is None or best.solution.cost > nearest.cost:
            again = self._again(base, key, {**held, **start}, nearest.fitted)
            found = [one for one in (best, again, nearest.fitted) if one is not None]
            best = min(found, key=lambda one: one.solution.cost)
        return best

    def _again(self, base: Trial, key: frozenset[str], wanted: Mapping[str, float], smaller: Fitted) -> Fitted | None:
        """Fit a set from the optimum of a smaller one, with what is new faint.

        The larger model contains the smaller one: where it ends at a higher cost, it has missed the minimum.
        """
        options = self._options(base, key)
        amplitudes = self._amplitudes(options).items()
        faint = {n: zero + FAINT * (wanted.get(n, usual) - zero) for n, (zero, usual) in amplitudes}
        return self._from(options, [{**wanted, **faint, **smaller.values}], smaller)

    def _grids(self, key: frozenset[str], start: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Grids of what vanishes with an amplitude and is not in `start`, of effects in other forms, which are not screened."""
        forms = find_effects([one for one in key if ":" in one], self.effect_files)
        return {name: s.grid for name, s in parameters_of(forms).items() if len(s.grid) > 1 and name not in start}

    def _options(self, base: Trial, key: frozenset[str]) -> FitOptions:
        """Options of the law of a set."""
        like, effects = base.fitted.options, tuple(sorted(key))
        name = "+".join(("base", *effects))
        return replace(like, effects=effects, effect_files=self.effect_files or like.effect_files, name=name)

    def _amplitudes(self, options: FitOptions) -> dict[str, tuple[float, float]]:
        """By name where an amplitude of a law is absent, and where it usually starts."""
        specs = parameters_of(make_model(self.problem.actuator, options, self.problem.mirror).effects)
        return {name: (spec.absent, spec.start) for name, spec in specs.items() if spec.absent is not None}

    def glances(self, base: Trial, starts: Mapping[str, Mapping[str, float]], most: int) -> dict[str, Glance]:
        """Each of some effects added from its start and fitted on thinned runs alone, the best first: which are worth a refit.

        All get a first glance, the better half (`most` at least) a second: successive halving, of Jamieson and Talwalkar 2016,
        doi:10.48550/arXiv.1502.07943.
        """
        found = dict[str, Glance]()
        for name in starts:
            self._derive_law(self._options(base, base.effects | {name}))
        for evaluations in GLANCES:
            looks = side_by_side(partial(self._glance, base, evaluations), list(starts.items()))
            for name, near in zip(starts, looks, strict=True):
                if near is not None:
                    found[name] = Glance(near.solution.mean_square, near.values)
            found = dict(sorted(found.items(), key=lambda item: (item[1].mean_square, item[0])))
            better = list(found)[: max(most, (len(found) + 1) // 2)]
            starts = {name: found[name].values for name in better}
        return found

    def _derive_law(self, options: FitOptions) -> None:
        """Derive and compile a law before threads ask for it, one law after the other as ever."""
        make_model(self.problem.actuator, options, self.problem.mirror).law  # noqa: B018

    def _glance(self, base: Trial, evaluations: int, begun: tuple[str, Mapping[str, float]]) -> Fitted | None:
        name, start = begun
        options = self._options(base, base.effects | {name})
        return self._near(options, {**base.fitted.values, **start}, base.fitted, evaluations)

    def _near(
        self, options: FitOptions, values: Mapping[str, float], like: Fitted, most: int = ROUGH_EVALUATIONS
    ) -> Fitted | None:
        """Fit to thinned runs in long steps on a coarse chain; what it found stands for the chain of the options."""
        try:
            near = refit(
                self.problem, on_few_bodies(options), values, like.options.segments, like.solution.clocks,
                items=self.rough, most_evaluations=most, tolerance=ROUGH_GAIN, newton=ROUGH_NEWTON,
            )  # fmt: skip
        except DataError:
            return None
        usual = make_model(self.problem.actuator, options, self.problem.mirror)
        model = replace(usual, tolerance=FINE_NEWTON)
        coordinates = coordinates_for(self.problem, options, model)  # of order one, whatever the number of joints
        solution = replace(near.solution, par=coordinates.parameters(near.solution.y))
        return Fitted(model, options, coordinates, solution)

    def _from(self, options: FitOptions, starts: Sequence[Mapping[str, float]], like: Fitted) -> Fitted | None:
        """Fit thinned runs in long steps from each start, of many from the best after a few evaluations; carry the best over.

        Where the fit is not carried over to all frames it is fitted to these, unless a smaller set has a lower cost already; where no
        start can be simulated in long steps, the first is fitted to all frames.
        """
        self._derive_law(options)
        tried = self._near_from_each(options, [*starts], like, GLANCES[0] if len(starts) > FINALISTS else ROUGH_EVALUATIONS)
        if len(starts) > FINALISTS:
            better = [one.values for one in tried[:FINALISTS]]
            tried = self._near_from_each(options, better, like, ROUGH_EVALUATIONS)
        near = tried[0] if tried else None
        values = starts[0]
        if near is not None:
            like, arrived = carried_over(near, self.rough, self.problem.train, CARRIED_GAIN)
            values = like.values
            smaller = [t.cost for k, t in self.done.items() if t is not None and len(k) < len(options.effects)]
            beaten = like is not near and like.solution.cost > min(smaller)  # by a set of fewer effects
            if (arrived or beaten) and options.loss != "huber":
                return like
        return self._in_full(options, values, like)

    def _near_from_each(
        self, options: FitOptions, starts: Sequence[Mapping[str, float]], like: Fitted, most: int
    ) -> list[Fitted]:
        """Fits to thinned runs from each start that can be simulated, the best first."""
        tried = side_by_side(lambda values: self._near(options, values, like, most), starts)
        return sorted((one for one in tried if one is not None), key=lambda one: one.solution.cost)

    def _in_full(self, options: FitOptions, values: Mapping[str, float], like: Fitted) -> Fitted | None:
        """Fit on all frames from one start; None where it cannot be simulated."""
        try:
            return refit(
                self.problem, options, values, like.options.segments, like.solution.clocks,
                most_evaluations=FULL_EVALUATIONS, tolerance=FULL_GAIN, newton=FINE_NEWTON,
            )  # fmt: skip
        except DataError:
            return None

    def refits(self) -> list[Refit]:
        """What is known of the chain as it stands, the smallest sets first: for the search from the next rung."""
        fitted = {key: trial.fitted.values for key, trial in self.done.items() if trial is not None and SEGMENTS not in key}
        known = {**self.known, **fitted}
        return [Refit(effects=sorted(key), values={**known[key]}) for key in sorted(known, key=lambda k: (len(k), sorted(k)))]


def _at_bound(fitted: Fitted) -> bool:
    """Whether an amplitude ran into a bound (other than that at which its effect is absent)."""
    for name, spec in parameters_of(fitted.model.effects).items():
        near, value = AT_BOUND * (spec.upper - spec.lower), fitted.values[name]
        low = value - spec.lower < near and spec.lower != spec.absent
        if spec.absent is not None and (spec.upper - value < near or low):
            return True
    return False


__all__ = ["Trial", "Trials", "plain"]
