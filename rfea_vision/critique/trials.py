"""Refits of sets of effects: each set once, in full, never worse than a smaller set that it contains.

A set is simulated under the law of its own effects alone: under that of the whole catalogue a step takes two to three times
as long, and what acts once a run costs no compilation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rfea_vision.critique.measures import Errors, errors_of
from rfea_vision.critique.refinement import SEGMENTS, refit_segments
from rfea_vision.effects.base import Effect
from rfea_vision.effects.catalogue import find_effects, plain, split_joint
from rfea_vision.errors import DataError
from rfea_vision.fitting.coordinates import sized
from rfea_vision.fitting.fit import Fitted, Problem, refit
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.ratio import with_lever_free
from rfea_vision.fitting.refit import carried, rough_runs
from rfea_vision.options import FitOptions

#: Evaluations at most on thinned runs in long steps, then on all frames, and for a glance; and the share of the cost that one more
#: must still win. What has not converged is called worse than it is, so the share ends most of them. Work is counted, never timed.
ROUGH_EVALUATIONS, FULL_EVALUATIONS, GLANCE_EVALUATIONS = 25, 12, 12
ROUGH_GAIN, FULL_GAIN = 1e-4, 3e-4
#: Segments of a glance at most: of the chain on which the probabilities were counted.
GLANCE_SEGMENTS = 8
#: Where a refit starts again from the optimum of a smaller model: this share of the usual start of what is new.
FAINT = 0.02
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


@dataclass
class Trials:
    """What was tried so far, by the sets of effects."""

    problem: Problem
    effect_files: tuple[Path, ...] = ()
    progress: Callable[[], None] = field(default=lambda: None)
    done: dict[frozenset[str], Trial | None] = field(default_factory=dict)
    rough: list[Observed] = field(default_factory=list)  # the training runs as a refit first meets them

    def stands(self, fitted: Fitted, effects: frozenset[str] | None = None) -> Trial:
        """Take note of a fit that was made elsewhere, its lever free: what more effects leave may tell it (fitting/ratio.py)."""
        fitted = with_lever_free(self.problem, fitted)
        key = frozenset(fitted.options.effects) if effects is None else effects
        trial = Trial(key, fitted, errors_of(self.problem, fitted))
        self.done[key] = trial
        self.rough = rough_runs(self.problem, fitted)
        return trial

    def refit(self, base: Trial, added: Sequence[str], start: Mapping[str, float]) -> Trial | None:
        """Add effects to a model from the values in `start` (by name); None if it cannot be simulated on the training runs."""
        key = base.effects | set(added)
        if key not in self.done:
            fitted = self._segments(base) if SEGMENTS in added else self._solved(base, key, start)
            trial = None
            if fitted is not None:
                trial = Trial(key, fitted, errors_of(self.problem, fitted), _at_bound(fitted))
            self.done[key] = trial
            self.progress()
        return self.done[key]

    def _segments(self, base: Trial) -> Fitted | None:
        return refit_segments(self.problem, base.fitted, f"{base.fitted.options.name}+{SEGMENTS}")

    def _solved(self, base: Trial, key: frozenset[str], start: Mapping[str, float]) -> Fitted | None:
        options, values, absent = self._options(base, key)
        held = base.fitted.values
        grids = [values, *({**values, name: v} for name, points in self._grids(key, start).items() for v in points[1:])]
        tries = [self._from(options, {**grid, **held, **start}, base.fitted) for grid in grids]
        best = min((one for one in tries if one is not None), key=lambda one: one.solution.cost, default=None)
        smaller = [t for k, t in self.done.items() if t is not None and k < key and SEGMENTS not in k]
        nearest = min(smaller, key=lambda t: t.cost, default=base)
        if best is None or best.solution.cost > nearest.cost:
            # The larger model holds the smaller one: where it ends above, it was led astray. Again from there, faintly.
            wanted = {**values, **held, **start}
            faint = {n: zero + FAINT * (wanted[n] - zero) for n, zero in absent.items() if n in wanted}
            again = self._from(options, {**wanted, **faint, **nearest.fitted.values}, nearest.fitted)
            found = [one for one in (best, again, nearest.fitted) if one is not None]
            best = min(found, key=lambda one: one.solution.cost)
        return best

    def _grids(self, key: frozenset[str], start: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Points from which to start what vanishes with an amplitude and is not in `start`: of another form, never screened."""
        forms = find_effects([one for one in key if ":" in one], self.effect_files)
        found = {
            f"{e.id}.{name}": spec.grid for e in forms for name, spec in e.parameters.items() if len(spec.grid) > 1
        }
        return {name: points for name, points in found.items() if name not in start}

    def _options(self, base: Trial, key: frozenset[str]) -> tuple[FitOptions, dict[str, float], dict[str, float]]:
        """Options of the law of a set; where its parameters start; and the absent values of its effects."""
        like = base.fitted
        files = self.effect_files or like.options.effect_files
        values, absent = {}, {}
        named = find_effects([split_joint(one)[0] for one in sorted(key)], files)
        for effect in sized(named, self.problem.actuator):
            for name, spec in effect.parameters.items():
                values[f"{effect.id}.{name}"] = (
                    spec.start if spec.absent is not None else (spec.grid or (spec.start,))[0]
                )
                if spec.absent is not None:
                    absent[f"{effect.id}.{name}"] = spec.absent
        name = "+".join(("base", *sorted(key)))
        options = replace(like.options, effects=tuple(sorted(key)), effect_files=files, name=name)
        return options, values, absent

    def glance(
        self, base: Trial, added: Sequence[str], start: Mapping[str, float]
    ) -> tuple[float, dict[str, float]] | None:
        """Mean square and values of a set fitted on thinned runs alone, on a coarse chain: to see whether a refit is worth it."""
        options, values, _ = self._options(base, base.effects | set(added))
        begin = {**values, **base.fitted.values, **start}
        near = self._near(_coarse(options), begin, base.fitted, GLANCE_EVALUATIONS)
        if near is None:
            return None
        par = carried(near.model, self.problem.actuator, options.segments, near.values, near.options.segments)
        return near.solution.mean_square, dict(zip(near.model.names, par.tolist(), strict=True))

    def _near(
        self, options: FitOptions, values: Mapping[str, float], like: Fitted, most: int = ROUGH_EVALUATIONS
    ) -> Fitted | None:
        try:
            return refit(
                self.problem, options, values, like.options.segments, like.solution.clocks,
                items=self.rough, most_evaluations=most, tolerance=ROUGH_GAIN,
            )  # fmt: skip
        except DataError:
            return None

    def _from(self, options: FitOptions, values: Mapping[str, float], like: Fitted) -> Fitted | None:
        """Fit from these values: first on thinned runs in long steps, then on all frames."""
        near = self._near(options, values, like)  # what a long step does not survive, that of the log may
        begin = (values, like.solution.clocks) if near is None else (near.values, near.solution.clocks)
        try:
            return refit(
                self.problem, options, begin[0], like.options.segments, begin[1],
                most_evaluations=FULL_EVALUATIONS, tolerance=FULL_GAIN,
            )  # fmt: skip
        except DataError:
            return None


def _coarse(options: FitOptions) -> FitOptions:
    """The chain of a glance; the same where an effect sits in one joint of it, or where the joints' places go with their number."""
    placed = any(split_joint(one)[1] for one in options.effects)
    few = GLANCE_SEGMENTS if options.joints == "middle" and not placed else options.segments
    return options.with_segments(min(options.segments, few))


def _at_bound(fitted: Fitted) -> bool:
    """Whether an amplitude ran into a bound (other than that at which its effect is absent)."""
    return any(_effect_at_bound(fitted, effect) for effect in fitted.model.effects)


def _effect_at_bound(fitted: Fitted, effect: Effect) -> bool:
    for name in effect.amplitudes():
        spec = effect.parameters[name]
        value, span = fitted.values[f"{effect.id}.{name}"], spec.upper - spec.lower
        if spec.upper - value < AT_BOUND * span or (value - spec.lower < AT_BOUND * span and spec.lower != spec.absent):
            return True
    return False


__all__ = ["Trial", "Trials", "plain"]
