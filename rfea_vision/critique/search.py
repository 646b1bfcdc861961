"""Which sets of effects are worth a refit, and what all that were refitted say together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rfea_vision.artefacts.judgement import Floors
from rfea_vision.critique.floors import binding, floors_of
from rfea_vision.critique.measures import (
    MATTERS_SHARE,
    STRUCTURE_FLOORS,
    Errors,
    common_runs,
    matters,
    share,
    structure,
)
from rfea_vision.critique.refinement import SEGMENTS
from rfea_vision.critique.rule import RULE, Rule
from rfea_vision.critique.screening import Screened, available, screened_rows, sensitivities
from rfea_vision.critique.subsets import MOST_TOGETHER, CandidateSet, Combinations
from rfea_vision.critique.trials import Trial, Trials, plain
from rfea_vision.effects.base import Effect
from rfea_vision.effects.catalogue import catalogue, forms_of, look_alikes
from rfea_vision.fitting.fit import stiff_start
from rfea_vision.fitting.information import effective_count

#: Sets of one, two, three and four effects that are refitted from the model as it stands, and from each better one found then.
FIRST, LATER = (6, 3, 2, 1), (3, 2, 1, 1)
#: Better models from which the search goes on.
ROUNDS = 4
#: Single effects, and pairs, that are refitted where something is left, whatever their linear step predicts (from a better model one
#: of each); and how many times better than its linear step a refit may be.
SURE, LENIENT = 2, 2.0
#: Two sets are equally likely where the odds are less than 20 to 1, the usual bound for what data can decide.
EVEN = float(np.log(20.0))
#: Two effects move the tube alike where their motions differ by less than this share (a correlation of 0.95).
ALIKE = 0.3


@dataclass(frozen=True)
class Weighed:
    """A set that was refitted, relative to the model as it stands: its probability and its share of the misfit."""

    trial: Trial
    added: tuple[str, ...]
    weight: float
    probability: float
    share: float


@dataclass
class Search:
    """The search from one model: effects on offer, floors, and the sets that were tried."""

    trials: Trials
    present: Trial
    effects: tuple[Effect, ...]
    rule: Rule = RULE
    wide: bool = False  # whether to refit what could help, too, though it could not become likely
    #: Held-out error of the present model as `model.json` has it, by finer steps than those here.
    scored: float | None = None
    #: Errors of the model without any effect, which the forms of effects are measured against; of the present one where it has none.
    base: Errors | None = None

    def __post_init__(self) -> None:
        self.independent = effective_count(self.trials.problem, self.present.fitted)
        self.count = self.rule.count(self.independent)
        self.screened: list[Screened] = []
        # By effect: the share of the squared error that it takes away by itself, at a glance.
        self.removes: dict[str, float] = {}
        self._against_rivals = set[frozenset[str]]()  # sets whose rivals were refitted
        self._quietest: Trial | None = None
        self.floors = self._settled()

    def _settled(self) -> Floors:
        """The floors by the best fit so far: what a poor fit leaves is motion, which looks like noise."""
        tried = [t for t in self.trials.done.values() if t is not None]
        quietest = min(tried, key=lambda t: t.cost, default=self.present)
        if quietest is not self._quietest:
            self._quietest = quietest
            self.floors = floors_of(self.trials.problem, quietest.fitted)
            self.floor = binding(self.floors)
        return self.floors

    @property
    def held(self) -> float:
        """Held-out error of the present model as people are told of it."""
        return self.present.errors.held if self.scored is None else self.scored

    # -- the rule ------------------------------------------------------------------------------------------------------

    def weigh(self) -> list[Weighed]:
        """All sets that hold the present model, most probable first; the present model itself among them.

        Of the forms of one set the best stands for all, at the price of having chosen among them.
        """
        self._settled()
        now = self.present.effects
        tried = [t for k, t in self.trials.done.items() if t is not None and k >= now and self._offered(t)]
        names = common_runs(t.errors for t in tried)
        forms: dict[frozenset[str], list[tuple[float, Trial]]] = {}
        for trial in tried:
            added = frozenset(map(plain, trial.effects - now))
            forms.setdefault(added, []).append((self._weight(trial, names), trial))
        best = {added: max(rows, key=lambda row: row[0]) for added, rows in forms.items()}
        weights = [weight - float(np.log(len(forms[added]))) for added, (weight, _) in best.items()]
        before = self.present.errors.on(names)
        out = [
            Weighed(trial, tuple(sorted(added)), w, p, share(before, trial.errors.on(names), self.floor))
            for (added, (_, trial)), w, p in zip(best.items(), weights, self.rule.posterior(weights), strict=True)
        ]
        return sorted(out, key=lambda item: -item.weight)

    def without(self, item: Weighed, own: str) -> Trial | None:
        """The best fit of a set less one of its members, in whatever forms."""
        rest = set(item.added) - {own}
        now = self.present.effects
        tried = [
            t for k, t in self.trials.done.items() if t is not None and k >= now and set(map(plain, k - now)) == rest
        ]
        return min(tried, key=lambda t: t.cost, default=None)

    def _offered(self, trial: Trial) -> bool:
        """Whether a set holds effects on offer alone, each with those that it needs (a second Maxwell branch the first)."""
        goes_with = {effect.id: set(effect.goes_with) for effect in self.effects} | {SEGMENTS: set()}
        added, have = {plain(one) for one in trial.effects - self.present.effects}, set(map(plain, trial.effects))
        return added <= goes_with.keys() and all(goes_with[one] <= have for one in added)

    def _weight(self, trial: Trial, names: set[str]) -> float:
        errors = trial.errors.on(names)
        roles = {name: run.role for name, run in errors.runs.items()}
        return self._evidence(errors.excess(self.floor), roles) - self._price(trial.effects)

    def _evidence(self, excess: Mapping[str, float], roles: Mapping[str, str]) -> float:
        whole = (self.base or self.present.errors).excess(self.floor)
        return self.rule.evidence(excess, whole, roles, self._room, self.count)

    @property
    def _room(self) -> float:
        """What is never told apart, in the unit of the floor."""
        return float(np.hypot(self.rule.resolution * self.floor, self.floors.calibration or 0.0))

    def _price(self, effects: frozenset[str]) -> float:
        return self.rule.price(len(effects - self.present.effects), len(catalogue()))

    # -- the search ----------------------------------------------------------------------------------------------------

    def run(self) -> list[Weighed]:
        """Screen, propose, refit; again from every better set; where none comes, forms and rivals; members are left out in turn."""
        centre, seen = self.present, set[frozenset[str]]()
        for _ in range(ROUNDS):
            seen.add(centre.effects)
            if centre is self.present or self._can_win(len(centre.effects - self.present.effects) + 1):
                self._look_from(centre, FIRST if centre is self.present else LATER)
            if self.weigh()[0].trial.effects in seen:
                self._forms()
                self._leave_one_out()  # what is left of a set without one member is where its rivals start from
                self._rivals()
            best = self.weigh()[0].trial
            if best.effects in seen or SEGMENTS in best.effects:
                break
            centre = best
        for _ in range(ROUNDS):  # the rivals of the last one, too
            self._leave_one_out()
            if self.weigh()[0].trial.effects in self._against_rivals:
                break
            self._rivals()
        return self._led(self.weigh())

    def _led(self, weighed: list[Weighed]) -> list[Weighed]:
        """The same sets; first the best of those tied sets whose probabilities add up to most."""
        near = [item for item in weighed if weighed[0].weight - item.weight < EVEN]
        groups = []
        for item in near:
            others = [row for rows in self.tied([item, *near]).values() for row in rows]
            groups.append([item, *(row for row in near if row in others)])
        together = max(groups, key=lambda group: sum(item.probability for item in group))
        first = max(together, key=lambda item: item.weight)
        return [first, *(item for item in weighed if item is not first)]

    def _look_from(self, centre: Trial, widths: Sequence[int]) -> None:
        have = frozenset(plain(one) for one in centre.effects)
        offered = tuple(e for e in self.effects if e.id not in have)
        already = len(centre.effects - self.present.effects)
        room = MOST_TOGETHER - already
        if not offered or room <= 0:
            return
        rows = list(sensitivities(self.trials.problem, centre.fitted, offered))
        if centre is self.present:
            self.screened = screened_rows(rows, offered)
            self.removes = {row.effect: row.explained for row in reversed(self.screened)}
            self._afresh(offered, max(widths))
        sure = (SURE if centre is self.present else 1) if self.structure(centre) >= STRUCTURE_FLOORS else 0
        proposals = Combinations(rows).best(have, min(room, len(widths)), max(widths))
        for size, (group, width) in enumerate(zip(proposals, widths, strict=False)):
            for rank, proposal in enumerate(group[:width]):
                sure_one = rank < sure and (size == 0 or (size == 1 and self._can_win(already + 2)))
                if sure_one or self._worth(centre, proposal):
                    self.trials.refit(centre, proposal.effects, proposal.start)

    def _afresh(self, offered: Sequence[Effect], most: int) -> None:
        """Where the present model is too far off for a linear step to rank effects: fit each from other base parameters."""
        problem, fitted = self.trials.problem, self.present.fitted
        if not self.trials.bent:
            return
        stiff, grids = stiff_start(problem, fitted), {row.effect: row.grid for row in reversed(self.screened)}
        starts = {}
        for effect in available(offered, set(map(plain, self.present.effects))):
            grid = {f"{effect.id}.{name}": value for name, value in grids.get(effect.id, {}).items()}
            starts[effect.id] = {**stiff, **grid}
        looks = self.trials.glances(self.present, starts, most)
        self.removes.update({name: 1 - look.mean_square / fitted.solution.mean_square for name, look in looks.items()})
        for name, look in list(looks.items())[:most]:
            self.trials.refit(self.present, (name,), look.values)

    def _worth(self, centre: Trial, proposal: CandidateSet) -> bool:
        """Whether a refit could be worth its price: if it left nothing, and if it gained twice what its linear step predicts.

        In a wide search also whether it could lower the error by what matters.
        """
        if self.wide and LENIENT * proposal.fall >= 1 - (1 - MATTERS_SHARE) ** 2:
            return True
        added = centre.effects | set(proposal.effects)
        if self.weigh()[0].trial is not self.present and not self._can_win(len(added - self.present.effects)):
            return False
        gain = -0.5 * self.count * float(np.log(max(1 - proposal.fall, 1e-6)))
        return LENIENT * gain >= self._price(added) - self._price(centre.effects)

    def _can_win(self, size: int) -> bool:
        """Whether a set of so many effects that left nothing at all would be better than the best so far."""
        roles = {name: run.role for name, run in self.present.errors.runs.items()}
        perfect = self._evidence(dict.fromkeys(roles, 0.0), roles)
        return perfect - self.rule.price(size, len(catalogue())) > self.weigh()[0].weight

    def _forms(self) -> None:
        """Refit members of the best set in their other forms, one at a time, where the set leaves something or stands at a bound.

        One effect in another form may explain what two did: it is tried without each of the others, and, where the set leaves
        nothing, without those that it is said to be mistaken for. A smaller set is tried in its other forms, too, where an error of
        its form alone could leave as much as it does. Where the best set leaves something, every effect is, alone.
        """
        if self.structure(self.weigh()[0].trial) >= STRUCTURE_FLOORS:
            for effect in available(self.effects, set(map(plain, self.present.effects))):
                self._in_other_forms(self.present, effect.id, ())
        for own in self.weigh()[0].added:
            best = self.weigh()[0]
            left = self.structure(best.trial) >= STRUCTURE_FLOORS or best.trial.at_bound
            rest = _others(best.trial, self.present, own)
            alike = look_alikes(self.effects, own)
            fewer = [
                [one for one in rest if plain(one) not in alike],
                *([[o for o in rest if o != one] for one in rest] * left),
            ]
            for others in [rest] * left + [others for others in fewer if len(others) < len(rest)]:
                self._in_other_forms(best.trial, own, others)
        best, faults = self.weigh()[0], (LENIENT * self.rule.form) ** 2
        for item in self.weigh():
            if len(item.added) < len(best.added) and item.share >= 1 - faults:
                for own in item.added:
                    self._in_other_forms(item.trial, own, _others(item.trial, self.present, own))

    def _in_other_forms(self, trial: Trial, own: str, others: Sequence[str]) -> None:
        """Refit an effect of a set in each of its other forms, with others of that set as they stand in it."""
        start = _values_of(trial, others)
        for form in forms_of(own):
            self.trials.refit(self.present, (*others, form), start)

    def _rivals(self) -> None:
        """Refit the rivals of each member of the best set in its place, and alone.

        Rivals are effects said to be mistaken for it; those as likely by themselves; and, where it stands alone, those whose linear
        step removes half as much. Of a rival that is as likely, its rivals are refitted, too; of one that does half as well, its
        other forms. Where the best set leaves something, those said to be mistaken for it are tried in all their forms.
        """
        weighed = self.weigh()
        best, alone = weighed[0], {w.added[0]: w.weight for w in weighed if len(w.added) == 1}
        self._against_rivals.add(best.trial.effects)
        left = self.structure(best.trial) >= STRUCTURE_FLOORS
        least = max(w.weight for w in weighed if not w.added)
        for own in best.added:
            others = [one for one in look_alikes(self.effects, own) if one not in best.added]
            forms = [form for one in others for form in (forms_of(one) if left else ())]
            if alone.get(own, -np.inf) > least:
                others += [one for one in alone if one not in best.added and alone[own] - alone[one] < EVEN]
            if len(best.added) == 1:
                half = self.removes.get(own, np.inf) / LENIENT
                alike = [name for name, share in self.removes.items() if name != own and share >= half]
                others += sorted(alike, key=lambda name: -self.removes[name])[: FIRST[0]]
            base = self.without(best, own) or self.present
            possible = {e.id for e in available(self.effects, {plain(one) for one in base.effects})}
            starts = {row.effect: {**row.grid, **row.amplitudes} for row in reversed(self.screened)}  # of a grid its best point
            names = list(dict.fromkeys([*others, *forms]))
            for name in names:  # more are added below
                if plain(name) not in possible & set(starts):
                    continue
                start = {f"{plain(name)}.{k}": v for k, v in starts[plain(name)].items()}
                rival = self.trials.refit(base, (name,), start)
                if rival is None:
                    continue
                self.trials.refit(self.present, (name,), _values_of(rival, (name,)))  # in place of all members
                if best.weight - self._weight(rival, set(rival.errors.runs)) < EVEN:
                    known = {*map(plain, names), *best.added}
                    names += [one for one in look_alikes(self.effects, plain(name)) if one not in known]
                elif base.cost - rival.cost > (base.cost - best.trial.cost) / LENIENT:
                    names += [form for form in forms_of(plain(name)) if form not in names]

    def _leave_one_out(self) -> None:
        """Refit the best set without each of its members, and every set that would be best with one effect less; until none is new."""
        price, tried = self.rule.price(1, len(catalogue())), -1
        while tried < (tried := len(self.trials.done)):
            weighed = self.weigh()
            for item in weighed:
                if len(item.added) < 2 or (item is not weighed[0] and item.weight + price <= weighed[0].weight):
                    continue
                for own in item.added:
                    rest = _others(item.trial, self.present, own)
                    known = self.present.effects | set(rest) in self.trials.done  # `refit` repeats what began too far off
                    if known or self.without(item, own) is None:
                        self.trials.refit(self.present, rest, _values_of(item.trial, rest))

    # -- what it says --------------------------------------------------------------------------------------------------

    def tied(self, weighed: Sequence[Weighed]) -> dict[str, list[Weighed]]:
        """For each member of the best set, the sets with another effect in its place that are as likely and move the tube alike.

        Alike are those that cannot be told from the best set, or from another of its rivals.
        """
        out = dict[str, list[Weighed]]()
        for own, other in _in_place(weighed):
            without, known = self.without(weighed[0], own), [weighed[0], *out.get(own, [])]
            if without is not None and any(self._alike(one.trial, other.trial, without) for one in known):
                out.setdefault(own, []).append(other)
        return out

    def as_likely(self, weighed: Sequence[Weighed]) -> dict[str, list[Weighed]]:
        """For each member of the best set, the sets with another effect in its place that are as likely, likeliest effect first."""
        alone, out = self.probabilities(weighed, {}), dict[str, list[Weighed]]()
        for own, other in _in_place(weighed):
            out.setdefault(own, []).append(other)
        have = set(weighed[0].added)
        return {
            own: sorted(rows, key=lambda row: -max(alone[n] for n in {*row.added} - have)) for own, rows in out.items()
        }

    def _alike(self, one: Trial, other: Trial, without: Trial) -> bool:
        apart, change = one.distance(other), one.distance(without)
        unit = 1e-3 if self.floors.unit == "mm" else np.pi / 180
        return apart < max(ALIKE * change, self.rule.resolution * self.floor * unit)

    def probabilities(self, weighed: Sequence[Weighed], ties: dict[str, list[Weighed]]) -> dict[str, float]:
        """Probability, for every effect that was refitted, that it or a member of its tie is there."""
        group = {
            own: {own, *(next(iter(set(w.added) - set(weighed[0].added))) for w in rows)} for own, rows in ties.items()
        }
        imitated, out = {effect.id for effect in self.effects if effect.imitated_by}, dict[str, float]()
        for name in {one for item in weighed for one in item.added}:
            mates = next((members for members in group.values() if name in members), {name})
            have = [(item.probability, mates & set(item.added)) for item in weighed]
            out[name] = self.rule.told((p, bool(own & imitated)) for p, own in have if own)
        return out

    def matters(self, weighed: Sequence[Weighed], own: str) -> bool:
        """Whether leaving a member of the best set out would raise the held-out error by what matters."""
        best = weighed[0]
        without = self.without(best, own)
        if without is None:
            return False
        names = common_runs([best.trial.errors, without.errors])
        return matters(without.errors.on(names), best.trial.errors.on(names), self.floor)

    def structure(self, trial: Trial) -> float:
        """What a trial leaves above the floor, in floors."""
        return structure(trial.errors, self.floor)


def _others(trial: Trial, present: Trial, own: str) -> list[str]:
    """What a trial adds to the present model, in the forms that it has there, without one of them."""
    return [one for one in trial.effects - present.effects if plain(one) != own]


def _values_of(trial: Trial, effects: Sequence[str]) -> dict[str, float]:
    """Fitted values by name, SI, of the parameters of some effects."""
    ids = {plain(one) for one in effects}
    return {name: value for name, value in trial.fitted.values.items() if name.partition(".")[0] in ids}


def _in_place(weighed: Sequence[Weighed]) -> Iterator[tuple[str, Weighed]]:
    """Members of the best set, each with the sets that hold another effect in its place and are as likely."""
    best = weighed[0]
    for own in best.added:
        for other in weighed[1:]:
            new, gone = set(other.added) - set(best.added), set(best.added) - set(other.added)
            if len(new) == 1 and gone == {own} and best.weight - other.weight < EVEN:
                yield own, other


__all__ = ["Search", "Weighed"]
