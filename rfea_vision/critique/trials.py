"""Refits of candidates: singles first, and pairs (or three) where no single effect explains what is left."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rfea_vision.critique.fresh_look import fresh_look
from rfea_vision.critique.measures import (
    STRUCTURE_FLOORS,
    Errors,
    delta_bic,
    errors_of,
    excess,
    matters,
    merit,
    structure,
)
from rfea_vision.critique.refinement import SEGMENTS, SPLIT_BY, TITLE, refit_segments
from rfea_vision.critique.screening import Screened, available, offered, screen
from rfea_vision.effects.base import Effect
from rfea_vision.errors import DataError
from rfea_vision.fitting.fit import Fitted, Problem, fit_added
from rfea_vision.fitting.observation import MM
from rfea_vision.options.critique import EXPLAINED
from rfea_vision.options.fit import PER_JOINT

#: Structure below this share of the tube's length (0.03 mm of 155) is within the systematic errors of calibration, clamp
#: and the chain's own segments, however fine the noise: it earns no effect a name, and denies none.
NEGLIGIBLE_SHARE = 2e-4
REFITS = 6
MORE_REFITS = 9
#: Misfit, in noise floors, from which on the base parameters may sit in a wrong minimum.
FAR = 8.0
FRESH = 3
FIRSTS = 2
SECONDS = 3
PAIRS = 4
MOST_TOGETHER = 3
MOST_TIED = 3
#: Refits whose held-out errors differ by less than this share do the same.
SAME_MERIT = 3e-3
#: A combination that explains less than this is not taken further.
PROMISING = 0.8
#: Where no single effect explains this share, pairs have nothing to build on; and where the misfit is so many floors that
#: its cost says it, an effect that would lower the cost by less than this is not polished.
HOPELESS, CLEAR_FLOORS = 0.1, 2.0
#: More than this many noise floors left is too much for a combination, which bends to more than a single effect does, unless
#: it explains nearly everything; a single effect that leaves more is named only after everything was looked at afresh. For
#: the same reason a combination has to explain its share even where little is left, and each of its steps as much of what the
#: steps before have left as a single effect would.
SETTLED_FLOORS, NEARLY_ALL = 1.0, 0.99


@dataclass(frozen=True)
class Refitted:
    """A candidate, or several together, added to the model and refitted.

    `explained` is the share of the squared error above the noise that all of them remove; `reaches` says whether the last of
    them removes enough of what the others had left, or leaves too little to blame anything for.
    """

    added: tuple[str, ...]
    screened: Screened
    fitted: Fitted
    errors: Errors
    delta_bic: float
    allowed: bool
    explained: float
    reaches: bool
    matters: bool

    @property
    def merit(self) -> float:
        return merit(self.errors)

    @property
    def wins(self) -> bool:
        return self.matters and self.delta_bic < 0 and self.allowed


@dataclass(frozen=True)
class Trials:
    """What a diagnosis tries: the model before, its errors, and how to refit with more."""

    problem: Problem
    before: Fitted
    errors: Errors
    floor: float
    effects: tuple[Effect, ...]
    effect_files: tuple[Path, ...] = ()
    enough: float = EXPLAINED
    progress: Callable[[], None] = field(default=lambda: None)

    @property
    def in_mm(self) -> bool:
        """Whether errors are of the tip, in mm; else of the bend angle, in deg."""
        return self.problem.train[0].has_tip

    @property
    def small(self) -> float:
        """Structure, in noise floors, that no effect is blamed for: half a floor, or what no reading of a tube can prove."""
        if not self.in_mm or self.floor <= 0:
            return STRUCTURE_FLOORS
        return max(STRUCTURE_FLOORS, NEGLIGIBLE_SHARE * self.problem.actuator.length / MM / self.floor)

    def settles(self, trial: Refitted) -> bool:
        """Whether a trial that wins leaves so little that nothing else need be looked at."""
        return trial.wins and trial.reaches and structure(trial.errors, self.floor) < max(SETTLED_FLOORS, self.small)

    def carries(self, trial: Refitted) -> bool:
        """Whether a combination explains enough, and leaves little enough, to be named."""
        if not (trial.wins and trial.reaches and trial.explained >= self.enough):
            return False
        least = NEARLY_ALL if self.enough >= EXPLAINED else self.enough
        return trial.explained >= least or structure(trial.errors, self.floor) < max(SETTLED_FLOORS, self.small)

    def _share(self, before: Errors, after: Errors) -> float:
        """Share of the squared error above the noise that is gone."""
        had = excess(before, self.floor)
        return 1 - excess(after, self.floor) / had if had > 0 else 1.0

    def effect(self, name: str) -> Effect:
        return next(e for e in self.effects if e.id == name)

    def title(self, name: str) -> str:
        """What a candidate is called in a sentence."""
        return TITLE if name == SEGMENTS else self.effect(name).title

    def split_by(self, name: str) -> str:
        """What would tell a candidate from its look-alikes."""
        return SPLIT_BY if name == SEGMENTS else self.effect(name).split_by

    def _solved(
        self, base: Fitted, name: str, rows: Sequence[Screened], starts: Sequence[Mapping[str, float]] | None
    ) -> Fitted | None:
        called = f"{base.options.name}+{name}"
        if name == SEGMENTS:
            return refit_segments(self.problem, base, called)
        files = self.effect_files or base.options.effect_files
        options = replace(base.options, effects=(*base.options.effects, name), name=called, effect_files=files)
        points = [dict(s) for s in starts] if starts else [_start(self.effect(name), row) for row in rows]
        try:
            worth = HOPELESS if structure(self.errors, self.floor) >= CLEAR_FLOORS else 0.0
            return fit_added(self.problem, options, base, starts=points, worth=worth)
        except DataError:
            return None

    def refit(
        self,
        rows: Sequence[Screened],
        since: Refitted | None = None,
        starts: Sequence[Mapping[str, float]] | None = None,
    ) -> Refitted | None:
        """Add one effect to the model (or to an earlier trial), from each of the screened points; None if it cannot be.

        `starts` are other values to start from, by name.
        """
        base = since.fitted if since is not None else self.before
        name = rows[0].effect
        trial = self._solved(base, name, rows, starts)
        if trial is None:
            return None
        errors = errors_of(self.problem, trial)
        earlier = since.errors if since is not None else self.errors
        added = (*(since.added if since is not None else ()), name)
        small = structure(errors, self.floor) < self.small
        self.progress()
        return Refitted(
            added,
            rows[0],
            trial,
            errors,
            delta_bic(self.problem, base, trial),
            all(_physical(trial, one) for one in added if one != SEGMENTS),
            self._share(self.errors, errors),
            small or self._share(earlier, errors) >= self.enough,
            matters(earlier, errors, self.floor) and (since is None or since.matters),
        )


def _physical(fitted: Fitted, effect_id: str) -> bool:
    """Whether the amplitudes of the effect stayed off their bounds (other than the bound at which it is absent)."""
    effect = next(e for e in fitted.model.effects if e.id == effect_id)
    for name in effect.amplitudes():
        spec = effect.parameters[name]
        value = fitted.value(f"{effect_id}.{name}")
        span = spec.upper - spec.lower
        if spec.upper - value < 2e-3 * span or (value - spec.lower < 2e-3 * span and spec.lower != spec.absent):
            return False
    return True


def _start(effect: Effect, screened: Screened) -> dict[str, float]:
    """Start of a refit: the linear step, kept within the bounds, at the screened point of the grid."""
    out = {f"{effect.id}.{name}": value for name, value in screened.grid.items()}
    for name, step in screened.step.items():
        spec = effect.parameters[name]
        absent = spec.absent or 0.0
        value = absent + step if step else absent + 0.1 * (spec.start - absent)
        out[f"{effect.id}.{name}"] = float(np.clip(value, spec.lower, spec.upper))
    return out


def _by_effect(screened: Sequence[Screened], least: float = 1e-4) -> dict[str, list[Screened]]:
    """Two best points of the grid of every effect, the effect that explains most first."""
    out: dict[str, list[Screened]] = {}
    for item in screened:
        out.setdefault(item.effect, []).append(item)
    return {name: rows[:2] for name, rows in out.items() if rows[0].explained >= least}


def try_one(trials: Trials, name: str) -> Refitted | None:
    """Refit one candidate that is named already, just as `try_singles` would."""
    if name == SEGMENTS:
        return trials.refit([Screened(SEGMENTS, {}, {}, 0.0, None)])
    rows = [r for r in screen(trials.problem, trials.before, [trials.effect(name)]) if r.effect == name]
    return trials.refit(rows[:2]) if rows else None


def try_singles(trials: Trials, screened: Sequence[Screened], expected: Sequence[str] = ()) -> dict[str, Refitted]:
    """Refit candidates, first those expected, then in the order of the score test, until none left could still compete.

    A linear step says little about a large misfit, so more are refitted while none explains it; once one does, only
    those whose score comes near are worth the time.
    """
    ranked = _by_effect([row for row in screened if row.effect != SEGMENTS])
    top = max((rows[0].explained for rows in ranked.values()), default=0.0)
    # Where one linear step would not even explain half of the misfit, the order of the score test is worth less.
    least = 2 if top > 0.5 else 4
    most = REFITS if structure(trials.errors, trials.floor) < FAR else MORE_REFITS
    done: dict[str, Refitted] = {}
    finer = [row for row in screened if row.effect == SEGMENTS]
    if finer and (trial := trials.refit(finer)) is not None:  # what needs no law is tried before any law
        done[SEGMENTS] = trial
    for name in expected:
        if name in ranked and (trial := trials.refit(ranked.pop(name))) is not None:
            done[name] = trial
    for name, rows in ranked.items():
        reached = any(r.reaches and r.wins for r in done.values())
        share = rows[0].explained / max(top, 1e-300)
        if len(done) >= most or (len(done) >= least and share < (0.4 if reached else 0.1)):
            break
        trial = trials.refit(rows)
        if trial is not None:
            done[name] = trial
    everyone = _by_effect(screened, least=0.0)  # a look-alike may hide behind what the base parameters have swallowed
    for name in look_alikes(trials, [n for n, r in done.items() if r.reaches and r.wins]):
        if name in everyone and name not in done and (trial := trials.refit(everyone[name])) is not None:
            done[name] = trial
    return done


def look_alikes(trials: Trials, names: Sequence[str]) -> list[str]:
    """Effects that are said to be mistaken for one of these, or the other way round: none is named without its rivals."""
    found = []
    for name in names:
        if name == SEGMENTS:
            continue
        said = set(re.findall(r"\w+", trials.effect(name).mistaken_for))
        found += [e.id for e in trials.effects if e.id in said or name in re.findall(r"\w+", e.mistaken_for)]
    return list(dict.fromkeys(found))


def try_expected(
    trials: Trials, screened: Sequence[Screened], singles: Mapping[str, Refitted], expected: Sequence[str]
) -> list[Refitted]:
    """What an earlier diagnosis named together and is not in the model yet, one after the other; empty if it fails."""
    last = singles.get(expected[0])
    for name in expected[1:]:
        if last is None:
            break
        rows = _by_effect(screen(trials.problem, last.fitted, [trials.effect(name)]), least=0.0).get(name)
        last = trials.refit(rows, last) if rows else None
    return [last] if last is not None and trials.carries(last) else []


def try_fresh(trials: Trials, screened: Sequence[Screened], singles: Mapping[str, Refitted]) -> dict[str, Refitted]:
    """Candidates again, each with a base model fitted anew: for a large misfit that no refit from the present one explains."""
    present = {e.id for e in trials.before.model.effects}
    rows = _by_effect(screened, least=0.0)
    looks = fresh_look(trials.problem, trials.before, available(trials.effects, present), trials.progress)
    done = dict(singles)
    for look in looks[:FRESH]:
        factor = trials.before.options.segments / look.segments
        start = {n: v * (factor if n in PER_JOINT else 1.0) for n, v in look.parameters.items()}
        blind = [Screened(look.effect, {}, {}, 0.0, None)]
        trial = trials.refit(rows.get(look.effect, blind), starts=[start])
        if trial is not None and (look.effect not in done or trial.merit < done[look.effect].merit):
            done[look.effect] = trial
    return done


def alike(candidates: Sequence[Refitted], effects: Sequence[Effect]) -> list[list[Refitted]]:
    """Groups of candidates that do exactly the same, best first; in each, the one first with which most other effects go."""
    partners = {item.added: sum(item.added[-1] in effect.goes_with for effect in effects) for item in candidates}
    groups: list[list[Refitted]] = []
    for item in sorted(candidates, key=lambda r: r.merit):
        if groups and item.merit < (1 + SAME_MERIT) * groups[-1][0].merit:
            groups[-1].append(item)
        else:
            groups.append([item])
    return [sorted(group, key=lambda r: -partners[r.added]) for group in groups]


def _exchanged(trials: Trials, best: Refitted, twin: Refitted) -> Refitted | None:
    """The best combination, with a twin of its first effect in place of that."""
    trial: Refitted | None = twin
    for name in best.added[1:]:
        own = [n for n in best.fitted.model.names if n.startswith(f"{name}.")]
        start = {n: best.fitted.value(n) for n in own}
        trial = trial and trials.refit([Screened(name, {}, {}, 0.0, None)], trial, starts=[start])
    return trial


def try_together(trials: Trials, singles: Mapping[str, Refitted]) -> list[Refitted]:
    """Combinations that explain what no single effect does; best first, empty if there are none.

    Behind each of the best singles the score test says what would go with it; the most promising pairs are refitted, and
    where none suffices, the best of them is taken one step further. Of singles that do exactly the same one stands for all;
    with the others in its place, the combination that is found is a tie.
    """
    groups = alike([r for r in singles.values() if r.wins], trials.effects)[:FIRSTS]
    firsts = [group[0] for group in groups]
    if max((r.explained for r in firsts), default=0.0) < HOPELESS:
        return []
    found: list[Refitted] = []
    while firsts and len(firsts[0].added) < MOST_TOGETHER:
        proposals: list[tuple[float, Refitted, list[Screened]]] = []
        for first in firsts:
            effects = available(trials.effects, {e.id for e in first.fitted.model.effects})
            rows = _by_effect(screen(trials.problem, first.fitted, effects))
            trials.progress()
            cost = first.fitted.solution.evaluation.cost
            proposals += [(cost * (1 - r[0].explained), first, r) for r in list(rows.values())[:SECONDS]]
        seen: set[frozenset[str]] = set()
        tried: list[Refitted] = []
        for _, first, rows in sorted(proposals, key=lambda p: p[0]):
            members = frozenset((*first.added, rows[0].effect))
            if members in seen or len(seen) >= PAIRS:
                continue
            seen.add(members)
            trial = trials.refit(rows, first)
            if trial is not None and trial.wins:
                tried.append(trial)
        tried.sort(key=lambda r: r.merit)
        found = [r for r in tried if trials.carries(r)]
        if found:
            break
        firsts = [r for r in tried[:1] if r.explained >= PROMISING]
    for group in groups if found else ():
        if group[0].added == found[0].added[:1]:
            also = [_exchanged(trials, found[0], twin) for twin in group[1:MOST_TIED]]
            found += [trial for trial in also if trial is not None and trials.carries(trial)]
    return found


__all__ = [
    "Refitted",
    "Trials",
    "offered",
    "try_expected",
    "try_fresh",
    "try_one",
    "try_singles",
    "try_together",
]
