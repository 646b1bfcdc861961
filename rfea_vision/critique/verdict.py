"""From trials to a verdict: missing (and what), complete, or unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rfea_vision.artefacts.judgement import Tie
from rfea_vision.critique.measures import STRUCTURE_FLOORS, delta_bic, structure
from rfea_vision.critique.refinement import MOST_SEGMENTS, refit_segments
from rfea_vision.critique.trials import MOST_TIED, Refitted, Trials
from rfea_vision.fitting.fit import Fitted

#: Two candidates may be tied where the held-out error differs by less than this share (or these floors) and the cost of the
#: training runs by less than that share: so little, the sampling of the tube and of its motion may decide, not physics.
TIE_SHARE = 0.03
TIE_FLOORS = 0.05
TIE_COST = 0.04
#: They are told apart all the same where a chain twice as fine, too, prefers the same one by this share of the cost, and by
#: more than noise can: ten points of BIC (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572, "very strong").
CLEAR_COST = 0.01
CLEAR_BIC = 10.0


@dataclass(frozen=True)
class Verdict:
    """What was decided; `best` is the trial that is named, `rivals` those that it is tied with (itself first)."""

    verdict: Literal["missing", "complete", "unexplained"]
    sentence: str
    best: Refitted | None
    tied: list[Tie]
    rivals: list[Refitted]
    explained: float | None


def decide(trials: Trials, singles: Mapping[str, Refitted], together: Sequence[Refitted]) -> Verdict:
    """Name only what explains the misfit, alone or together with others; a part of a large misfit earns no name.

    A stand-in for an effect that is not on offer also lowers the error; what gives it away is what it leaves behind.
    """
    winners = sorted((r for r in singles.values() if r.wins), key=lambda r: r.merit)
    found = [r for r in winners if r.reaches] or list(together)
    left = structure(trials.errors, trials.floor)
    if found:
        best = found[0]
        tied, rivals = _ties(trials, [r for r in found if is_tied(trials, best, r)][:MOST_TIED])
        return Verdict("missing", _missing(trials, best, tied), best, tied, rivals, best.explained)
    part = winners[0] if winners else None
    if left < STRUCTURE_FLOORS or (part is None and left < max(1.0, trials.small)):
        return Verdict("complete", _complete(trials, left), None, [], [], None)
    return Verdict("unexplained", _unexplained(trials, part), None, [], [], part.explained if part else 0.0)


def is_tied(trials: Trials, best: Refitted, other: Refitted) -> bool:
    """Whether the data cannot tell two refits apart."""
    if other is best:
        return True
    gap = other.merit - best.merit
    cost = _cost(other.fitted) / _cost(best.fitted) - 1
    if gap > max(TIE_FLOORS * trials.floor, TIE_SHARE * best.merit) or cost > TIE_COST:
        return False
    return not (_prefers(trials, best.fitted, other.fitted) and _prefers_finer(trials, best.fitted, other.fitted))


def _cost(fitted: Fitted) -> float:
    return fitted.solution.evaluation.cost


def _prefers(trials: Trials, best: Fitted, other: Fitted) -> bool:
    """Whether the training runs prefer one of two fits clearly."""
    clearer = _cost(other) > (1 + CLEAR_COST) * _cost(best)
    return clearer and delta_bic(trials.problem, other, best) < -CLEAR_BIC


def _prefers_finer(trials: Trials, best: Fitted, other: Fitted) -> bool:
    """The same question to chains with twice the segments; no where they cannot be compared, yes where they are fine as it is."""
    if 2 * best.options.segments > MOST_SEGMENTS:
        return True
    if any("@" in effect for fitted in (best, other) for effect in fitted.options.effects):
        return False  # a joint by its number is another place on another chain
    pair = [refit_segments(trials.problem, fitted, fitted.options.name) for fitted in (best, other)]
    return pair[0] is not None and pair[1] is not None and _prefers(trials, pair[0], pair[1])


def _ties(trials: Trials, rivals: Sequence[Refitted]) -> tuple[list[Tie], list[Refitted]]:
    """One group of effects that may stand for one another, and the trials they come from."""
    best = rivals[0]
    for own in best.added:
        group, members = [own], [best]
        for other in rivals[1:]:
            different = set(other.added) - set(best.added)
            if set(best.added) - set(other.added) == {own} and len(different) == 1:
                group.append(different.pop())
                members.append(other)
        if len(group) > 1:
            return [Tie(effects=group, split_by=trials.split_by(own))], members
    return [], []


def _missing(trials: Trials, best: Refitted, tied: Sequence[Tie]) -> str:
    runs = "runs that were not used" if trials.problem.validate else "the training runs (there are no validation runs)"
    titles = " and ".join(trials.title(name) for name in best.added)
    verb, it = ("is", "it") if len(best.added) == 1 else ("are", "them")
    text = (
        f"{titles} {verb} missing: adding {it} takes the error on {runs} from {trials.errors.held:.3f} to "
        f"{best.errors.held:.3f} {_unit(trials)}."
    )
    for tie in tied:
        text += f" These data cannot tell {tie.effects[0]} from {' or '.join(tie.effects[1:])}: {tie.split_by} would."
    return text


def _complete(trials: Trials, left: float) -> str:
    unit = _unit(trials)
    held, floor = f"{trials.errors.held:.3f} {unit}", f"{trials.floor:.3f} {unit}"
    if left < STRUCTURE_FLOORS:
        return f"Nothing is missing that matters: the held-out error is {held}, the noise floor {floor}."
    return f"The held-out error ({held}, noise floor {floor}) is not lowered by 10 % by any effect on offer."


def _unexplained(trials: Trials, part: Refitted | None) -> str:
    left = float(np.sqrt(max(trials.errors.held**2 - trials.floor**2, 0.0)))
    text = (
        f"Structure of {left:.3f} {_unit(trials)} is left above the noise floor, and no effect of the catalogue explains it, "
        "nor do the best of them together: see the residual torque and what it depends on."
    )
    if part is not None:
        share = f"{100 * part.explained:.0f} % of the squared error"
        text += f" The nearest, {part.added[0]}, would account for {share}: less than the {100 * trials.enough:.0f} % asked of a name."
    return text


def _unit(trials: Trials) -> str:
    return "mm" if trials.in_mm else "deg"
