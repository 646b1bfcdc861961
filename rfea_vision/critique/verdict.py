"""From the sets that were weighed to a verdict: missing (what, how surely, how much of it), complete, or unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rfea_vision.artefacts.judgement import TRACK_UNCERTAIN, EffectSet, Remainder, Tie, undecided
from rfea_vision.artefacts.rows import LEFT_BY_A_MODEL, STATED_ERRORS, GoesWith
from rfea_vision.critique.floors import left_by_a_model
from rfea_vision.critique.measures import MATTERS_SHARE, STRUCTURE_FLOORS, matters, motion
from rfea_vision.critique.refinement import SEGMENTS, SPLIT_BY, TITLE
from rfea_vision.critique.search import Search, Weighed
from rfea_vision.critique.trials import Trial, plain
from rfea_vision.units import rounded

#: Sets that are written down, and effects that one tie may hold where fewer than all of it are likely.
MOST_SETS, MOST_TIED = 12, 3
#: A floor of more than so many times what no calibration vouches for (0.02 % of the length) is a coarse one. Chosen.
COARSE = 10.0


@dataclass(frozen=True)
class Verdict:
    """What was decided. `best` is the set that is named (the present model where nothing is), `rivals` those it is tied with."""

    verdict: Literal["missing", "complete", "unexplained"]
    sentence: str
    named: tuple[str, ...]
    best: Trial
    share: float
    sufficient: bool
    tied: list[Tie]
    rivals: list[Trial]
    probability: dict[str, float]
    weighed: list[Weighed]
    stand_ins: tuple[str, ...] = ()
    asks_less: bool = False  # whether it is complete for the held-out runs alone: training runs ask more, and are farther off
    uncertain_because: str = ""  # why it is none to rest on; empty where it is


def decide(search: Search, weighed: list[Weighed], refused: str = "") -> Verdict:
    """Name what is likely to be there and matters; call it complete where nothing that could be seen matters; else unexplained.

    `refused` is the message of a fit that was refused, or that is off on one run: nothing that is said of it is to be rested on.
    """
    top = weighed[0]
    ties, probability, likely = _likely(search, weighed, search.tied(weighed))
    # Where no effect is likely, neither alone nor with its ties, sets between which the odds do not decide may be so together.
    for most in (MOST_TIED, None):
        if not likely:
            shared = _likely(search, weighed, search.as_likely(weighed), most)
            ties, probability, likely = shared if shared[2] else (ties, probability, likely)
    follows = {e.id for e in search.effects if set(e.goes_with) & set(likely)}  # what needs another is added after it
    alone = _alone(weighed)
    likely.sort(key=lambda one: (one in follows, -alone.get(one, -np.inf)))
    own = next((item for item in weighed if set(item.added) == set(likely)), weighed[0])
    best = own.trial
    left = search.structure(best)
    small = max(STRUCTURE_FLOORS, (search.floors.calibration or 0.0) / search.floor if search.floor > 0 else 0.0)
    tied = [
        Tie(effects=[one, *(_other(top, row) for row in ties[one])], split_by=split_by(search, one))
        for one in likely
        if one in ties
    ]
    rivals = [best, *(row.trial for one in likely for row in ties.get(one, []))] if tied else []
    mattering = any(search.rule.likely > item.probability > 0 and _matters_at_all(search, item) for item in weighed)
    verdict: Literal["missing", "complete", "unexplained"] = "unexplained"
    if likely:
        verdict = "missing"
    elif left < small or (left < 1.0 and not mattering):
        verdict = "complete"
    found = Verdict(
        verdict, "", tuple(likely), best, own.share, left < small, tied, rivals, probability, weighed,
        () if left < small else stand_ins_of(search, weighed), verdict == "complete" and _asks_less(search),
        refused.removeprefix("Refused: ").partition(";")[0] or (TRACK_UNCERTAIN if verdict == "complete" and hides(search) else ""),
    )  # fmt: skip
    words = {"missing": _missing, "complete": _complete, "unexplained": _unexplained}[verdict](search, found)
    if refused:
        words = _of_refused(refused, words if likely else "")
    elif found.uncertain_because:
        words = _uncertain(search, found)
    return Verdict(**{**vars(found), "sentence": words})


def _passes(search: Search) -> float:
    """Structure (mm, or deg) that passes for none: half a floor, and of a floor that is a model's own error all of it."""
    return search.floor * (1.0 if left_by_a_model(search.floors, search.trials.problem) else STRUCTURE_FLOORS)


def hides(search: Search) -> bool:
    """Whether the floor hides what would matter.

    An effect matters from a tenth on: where what passes for none is more than a tenth of the motion, it may matter, and no error at
    the floor says that nothing is missing.
    """
    return _passes(search) > MATTERS_SHARE * motion(search.trials.problem)


def _asks_less(search: Search) -> bool:
    """Whether training runs are off by a whole floor more, in squares, than the floor and the held-out runs, which judge."""
    if not search.trials.problem.validate:
        return False
    return bool(search.present.errors.train > np.sqrt(2) * max(search.floor, search.held))


def _likely(
    search: Search, weighed: list[Weighed], ties: Mapping[str, list[Weighed]], most: int | None = MOST_TIED
) -> tuple[dict[str, list[Weighed]], dict[str, float], list[str]]:
    """The ties that are told, the probability of every effect with them, and members of the best set that are likely and matter.

    A tie holds `most` effects, or all that there are. Only what is named shares its claim with those that it cannot be told from.
    """
    told = {own: rows if most is None else rows[: most - 1] for own, rows in ties.items()}
    probability = search.probabilities(weighed, told)
    likely = [
        one for one in weighed[0].added if probability[one] >= search.rule.likely and search.matters(weighed, one)
    ]
    shared = {own: rows for own, rows in told.items() if own in likely}
    return told, search.probabilities(weighed, shared), likely


def _other(best: Weighed, row: Weighed) -> str:
    return next(iter(set(row.added) - set(best.added)))


def _alone(weighed: Sequence[Weighed]) -> dict[str, float]:
    """Share of the misfit that each effect takes away by itself, of those that were refitted so: what helps most is added first."""
    return {item.added[0]: item.share for item in weighed if len(item.added) == 1}


def _matters_at_all(search: Search, item: Weighed) -> bool:
    return bool(item.added) and matters(search.present.errors, item.trial.errors, search.floor)


def stand_ins_of(search: Search, weighed: Sequence[Weighed]) -> tuple[str, ...]:
    """Effects that together lower the held-out error, though hardly its cause; what helps most by itself first.

    The set that leaves least, where every larger set must lower the error by what matters over the smaller ones.
    """
    chosen: Weighed | None = None
    for item in sorted(weighed, key=lambda item: (len(item.added), -item.share)):
        if item.added and matters((chosen.trial if chosen else search.present).errors, item.trial.errors, search.floor):
            chosen = item
    if chosen is None:
        return ()
    alone = _alone(weighed)
    return tuple(sorted(chosen.added, key=lambda one: -alone.get(one, -np.inf)))


def sets_of(search: Search, weighed: Sequence[Weighed]) -> list[EffectSet]:
    """The sets, most probable first, as they are written down."""
    return [
        EffectSet(
            effects=list(item.added),
            probability=item.probability,
            share=item.share,
            **{f"validate_rmse_{search.floors.unit}": item.trial.errors.validate},  # type: ignore[arg-type]
        )
        for item in weighed[:MOST_SETS]
    ]


def remainder_of(search: Search, verdict: Verdict, goes_with: Sequence[GoesWith]) -> Remainder:
    """What the named set leaves; `goes_with` is what the torque left by the present model goes with, and by no other."""
    unit, left = search.floors.unit, 1 - verdict.share
    known = verdict.best is search.present
    held = search.held if known else verdict.best.errors.held
    told = rounded(held) if known else foreseen(held)
    if verdict.sufficient and verdict.uncertain_because:
        sentence = ""  # to be at such a floor, or to be left so little by such a fit, tells nothing
    elif verdict.sufficient:
        own = ", which is a model's own error" if left_by_a_model(search.floors, search.trials.problem) else ""
        sentence = f"What is left, {told} {unit}, is at the floor ({rounded(search.floor)} {unit}{own})."
    else:
        runs = "held-out runs" if search.trials.problem.validate else "the training runs"
        part = f"{100 * left:.0f} %" if left >= 0.01 else "Less than 1 %"
        sentence = f"{part} of the squared error above the floor is left: {told} {unit} on {runs}."
        if known:  # nothing was added: a share of it says nothing, and beside that of an effect that was, the wrong thing
            sentence = f"What is left is {told} {unit} on {runs}, where the floor is {rounded(search.floor)} {unit}."
        if known and goes_with:
            sentence += f" {100 * goes_with[0]['r2']:.0f} % of its torque goes with {goes_with[0]['what']}."
    own = list(goes_with) if known else []
    return Remainder(share=left, goes_with=own, sentence=sentence, **{f"rmse_{unit}": held})  # type: ignore[arg-type]


# -- words ---------------------------------------------------------------------------------------------------------------


def title(search: Search, name: str) -> str:
    """What a candidate is called in a sentence."""
    return TITLE if name == SEGMENTS else next(e.title for e in search.effects if e.id == plain(name))


def _imitated(search: Search, name: str) -> str:
    """What outside of the catalogue would move the tube in the same way, as an aside; empty for most."""
    by = next((e.imitated_by for e in search.effects if e.id == plain(name)), "")
    return f"; {by} would do the same" if by else ""


def split_by(search: Search, name: str) -> str:
    """What would tell a candidate from its look-alikes; an effect of one's own need not say."""
    if name == SEGMENTS:
        return SPLIT_BY
    return next(e.split_by for e in search.effects if e.id == plain(name)) or "another run"


def percent(probability: float) -> str:
    """A probability in words that promise no more than it does."""
    return f"{100 * min(max(probability, 0.01), 0.99):.0f} %"


def foreseen(error: float) -> str:
    """The error of a model that only the search has fitted, in its longer steps: a fit of its own may differ in the third digit."""
    return f"about {rounded(error, 2)}"


def _missing(search: Search, found: Verdict) -> str:
    problem, unit = search.trials.problem, search.floors.unit
    runs = "runs that were not used" if problem.validate else "the training runs (there are no validation runs)"
    told = {one: f"{title(search, one)} (probability {percent(found.probability[one])}{_imitated(search, one)})" for one in found.named}
    it = "it" if len(told) == 1 else "them"
    effects = [text for one, text in told.items() if one != SEGMENTS]  # a finer chain is no physics that is missing
    parts = [f"{' and '.join(effects)} {'is' if len(effects) == 1 else 'are'} missing"] if effects else []
    parts += [told[SEGMENTS].replace(TITLE, "The chain is too coarse")] if SEGMENTS in told else []
    text = (
        f"{'. '.join(parts)}: adding {it if effects else 'segments'} takes the error on {runs} from {rounded(search.held)} to "
        f"{foreseen(found.best.errors.held)} {unit}, {100 * found.share:.0f} % of the squared error above the floor."
    )
    for tie in found.tied:
        text += f" These data cannot tell {tie.effects[0]} from {' or '.join(tie.effects[1:])}. What would: {tie.split_by}."
    return text


def _complete(search: Search, found: Verdict) -> str:
    unit = search.floors.unit
    held, floor = rounded(search.held), rounded(search.floor)
    which = "held-out error" if search.trials.problem.validate else "training error (there are no validation runs)"
    if found.sufficient:
        far = ", as far as the held-out runs ask" if found.asks_less else ""
        text = f"Nothing is missing that matters{far}: the {which} is {held} {unit}, the floor {floor} {unit}."
        text += _of_calibration(search) + _of_repeats(search)
    else:
        text = f"The {which}, {held} {unit} (floor {floor} {unit}), is not lowered by 10 % by any effect on offer."
    if found.asks_less:
        text += (
            f" The training runs are off by {rounded(search.present.errors.train)} {unit}: they ask more of the tube than the "
            "held-out runs, which alone judge. Give one like them 'role: validate'."
        )
    return text


def _of_calibration(search: Search) -> str:
    """Say of a floor that it is mostly what a coarse scale may be off by; empty where it is not."""
    problem = search.trials.problem
    if search.floors.source != STATED_ERRORS or not 0.0 < COARSE * (search.floors.calibration or 0.0) < search.floor:
        return ""
    attributes = [problem.recordings[run.name].dataset.attrs for run in problem.scored]
    shared = [float(said.get("calibration_sigma_mm", 0.0)) for said in attributes]
    typical = float(np.sqrt(np.mean(np.square(shared))))
    if typical < search.floor / 2:
        return ""
    return (
        f" Most of that floor is what the calibration may be off by, {rounded(typical)} mm, alike in every frame: effects that move "
        "the tip by less than the floor are neither found nor ruled out. A better scale (a board, or four points around it) lowers it."
    )


def _of_repeats(search: Search) -> str:
    """Say of a floor that is a model's own error how far below it runs that repeat agree; empty where they do not."""
    problem = search.trials.problem
    if search.floors.source != LEFT_BY_A_MODEL or not any(item.repeat_of for item in problem.scored):
        return ""
    again = search.floors.irreproducible
    if again is None or again > STRUCTURE_FLOORS * search.floor:
        return ""
    return (
        f" Runs that repeat agree to {rounded(again)} {search.floors.unit}, and that floor is what a model leaves of its worst run: "
        "what lies between is the track's own error, alike in both, or an effect that is neither found nor ruled out."
    )


def _uncertain(search: Search, found: Verdict) -> str:
    unit = search.floors.unit
    which = "held-out error" if search.trials.problem.validate else "training error (there are no validation runs)"
    return (
        f"{undecided(found.uncertain_because)}; the {which} is {rounded(search.held)} {unit}, the floor "
        f"{rounded(search.floor)} {unit}, and {unseen(search)}"
    )


def _of_refused(message: str, words: str) -> str:
    """What is said of a fit that was refused, with its `message`: the reason first, and `words` where something is named."""
    reason, _, remedy = message.removeprefix("Refused: ").partition("; ")
    if words:
        return f"{reason[:1].upper()}{reason[1:]}, so that this is uncertain: {words}"
    return f"{undecided(reason)}. {remedy[:1].upper()}{remedy[1:]}"


def unseen(search: Search) -> str:
    """What a large floor hides, as the end of a sentence."""
    hidden, moved, unit = _passes(search), motion(search.trials.problem), search.floors.unit
    share = f"{100 * hidden / moved:.0f} % of the motion ({rounded(moved)} {unit}" if moved > 0 else f"more than the motion (0 {unit}"
    half = "what half of that hides"
    if left_by_a_model(search.floors, search.trials.problem):
        half = "what all of that hides (it is what a model leaves of its worst run)"
    much = f"{half}, {rounded(hidden)} {unit}, is {share}, root mean square)"
    return f"{much}, where {100 * MATTERS_SHARE:.0f} % would matter."


def _unexplained(search: Search, found: Verdict) -> str:
    unit = search.floors.unit
    errors = search.present.errors
    along = " along the tube" if (errors.held_midline or 0.0) > errors.held else ""
    left = rounded(search.structure(search.present) * search.floor)
    text = (
        f"Structure of {left} {unit} is left{along} above the floor, and no effect of the catalogue can be named for it: that takes "
        f"a probability of {100 * search.rule.likely:.0f} % and a lower held-out error."
    )
    nearest = next((item for item in found.weighed if item.added and item.share > 0), None)
    if nearest is not None:
        told = " with ".join(f"{one} (probability {percent(found.probability[one])})" for one in nearest.added)
        text += f" The nearest, {told}, removes {100 * nearest.share:.0f} % of the squared error above the floor."
    return text


__all__ = ["MOST_TIED", "Verdict", "decide", "hides", "percent", "remainder_of", "sets_of", "split_by", "title", "unseen"]
