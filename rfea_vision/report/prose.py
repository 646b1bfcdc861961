"""The sentences of the page: what was found, in the reader's words, all from artefacts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rfea_vision.artefacts.judgement import ModelFit, undecided
from rfea_vision.artefacts.rows import LEFT_BY_A_MODEL
from rfea_vision.report.collect import Evidence, LadderStep
from rfea_vision.report.formatting import inner_title, listing, number, with_unit
from rfea_vision.report.series import with_rivals
from rfea_vision.report.shown import errors_of

# The headline names the effects, the tiles the noise floor, and the diagnosis tells why the search ended: once is enough.
_SAID_ELSEWHERE = (
    "The noise floor is",
    "Stopped because",
    "Missing from the paper's model, and added",
    "The chain was made finer",
)

# What was not asked for is said in its own section.
_NO_FINDING = ("No camera was calibrated", "No ladder yet")

_PHASES = {
    "rest": "the rests",
    "hold": "the holds, while the pressure stands still",
    "rise": "the rises of the pressure",
    "fall": "the falls of the pressure",
    "reversal": "the reversals of the pressure",
    "ringing": "the ringing after a change of pressure",
}

# The base model's parameters: values at the rest radius and slopes over the inner radius, and those of the paper's table.
MEANINGS = {
    "k_ref": "bending stiffness of a joint at the tube's rest radius",
    "k_slope": "change of the stiffness with the inner radius",
    "b_pos_ref": "damping of a joint while it bends, at the tube's rest radius",
    "b_pos_slope": "change of that damping with the inner radius",
    "b_neg_ref": "damping of a joint while it straightens, at the tube's rest radius",
    "b_neg_slope": "change of that damping with the inner radius",
    "r_hyd": "lever arm of the pressure",
    "k_0": "stiffness of a joint at inner radius zero",
    "m_k": "change of the stiffness with the inner radius",
    "b_0pos": "damping of a joint while it bends, at inner radius zero",
    "m_bpos": "change of that damping with the inner radius",
    "b_0neg": "damping of a joint while it straightens, at inner radius zero",
    "m_bneg": "change of that damping with the inner radius",
}


@dataclass(frozen=True)
class Finding:
    """One sentence, and the section that holds its evidence."""

    text: str
    section: str
    link: str


@dataclass(frozen=True)
class Tile:
    """A number worth a large type: ``before`` is struck through beside it where there is one."""

    heading: str
    value: str
    before: str = ""
    note: str = ""
    section: str = ""


def effect_titles(evidence: Evidence) -> dict[str, str]:
    """Effect id -> title, from the laws of the models and the candidates; else the id in words."""
    titles: dict[str, str] = {}
    for step in evidence.steps:
        for candidate in step.diagnosis.candidates if step.diagnosis else []:
            titles[candidate.effect] = candidate.title or titles.get(candidate.effect) or _words(candidate.effect)
        named_effects = [*(step.diagnosis.named if step.diagnosis else []), *step.fit.effects, step.rung.added or ""]
        for effect in named_effects:
            titles.setdefault(effect, _words(effect))
    for rung in evidence.ladder.rungs if evidence.ladder else []:  # also of one whose model is gone
        titles.setdefault(rung.added or "", _words(rung.added or ""))
    for step in evidence.steps:
        titles |= {effect: law["title"] for effect, law in step.fit.laws.items() if law.get("title")}
    return titles


def _words(effect: str) -> str:
    text = "more segments in the chain" if effect == "segments" else effect.replace("_", " ")
    return text[:1].upper() + text[1:]


def headline(evidence: Evidence, titles: Mapping[str, str]) -> str:
    """The verdict as one sentence."""
    step = evidence.last
    if step is None:
        return "The motion is measured; no model has been fitted yet."
    diagnosis = step.diagnosis
    added = [_inner(with_rivals(one, titles)) for one in _added(evidence)]
    finer = _finer(evidence, titles)
    unsure = any(one.rung.tied for one in _added(evidence))
    if not step.outcome:
        return "The model is fitted; what it lacks has not been looked for yet."
    if step.outcome == "complete":
        nothing = f"nothing that matters is missing{_as_far(step, evidence)}"
        if not added:
            return f"The model of the paper is complete here{finer.replace(' and', ', with', 1)}: {nothing}.{_unjudged(evidence)}"
        if len(added) == 1:
            tie = " (these data cannot tell which)" if unsure else ""
            return f"The model of the paper lacked one thing: {added[0]}{tie}. With it{finer}, {nothing}.{_unjudged(evidence)}"
        things = "; ".join(added)
        return f"The model of the paper lacked {len(added)} things: {things}. With them{finer}, {nothing}.{_unjudged(evidence)}"
    if step.outcome == "uncertain":
        so_far = f"; {listing(added)} {'was' if len(added) == 1 else 'were'} added{finer}, and more may be" if added else ""
        return f"{undecided(step.uncertain_because)}{so_far}."
    if step.outcome == "unexplained":
        so_far = f" after {listing(added)} had been added" if added else ""
        so_far += finer.replace(" and", " with", 1)
        helped = _stand_ins(evidence)
        if helped:
            lower = "lowers" if helped.startswith("one") else "lower"
            helped = f"; {helped} {lower} the error without being its likely cause"
        return f"Something is missing that no effect in the catalogue explains{so_far}{_shows(step)}{helped}."
    told = [(effect, diagnosis.rivals_of(effect)) for effect in diagnosis.named] if diagnosis else []
    named = [_inner(_or(effect, rivals, titles)) for effect, rivals in told]
    lacks = f"lacks something: {'; '.join(named)}." if named else "lacks an effect."
    if step.uncertain_because:
        return f"{step.uncertain_because[0].upper()}{step.uncertain_because[1:]}: uncertain as that is, the model still {lacks}"
    return f"The model still {lacks}"


def _unjudged(evidence: Evidence) -> str:
    """That all of it is told of the runs that were fitted; empty where one was held out."""
    held = any(run.role == "validate" for run in evidence.experiments)
    return "" if held else " No run was held out: the runs that were fitted say so, and no other."


def _as_far(step: LadderStep, evidence: Evidence) -> str:
    """That held-out runs, which judge, ask less than training runs, and how far off these are; empty where they do not."""
    if not step.asks_less:
        return ""
    shown = errors_of(step, evidence)
    off = with_unit(shown.train, shown.unit)
    return f" as far as the held-out runs ask; the training runs, which ask more of the tube, are off by {off}"


def _added(evidence: Evidence, *, stand_ins: bool = False) -> list[LadderStep]:
    """Rungs of the ladder that added an effect because it is likely to be there, or as a stand-in; none that was dropped again."""
    stayed = {re.sub(r":\w+|@\d+", "", effect) for effect in evidence.last.fit.effects} if evidence.last else set()
    rungs = [one for one in evidence.steps if one.on_ladder and one.rung.added in stayed]
    return list({one.rung.added: one for one in rungs if (one.rung.grade == "stand-in") == stand_ins}.values())


def _finer(evidence: Evidence, titles: Mapping[str, str]) -> str:
    """That the ladder made the chain finer, which is no missing physics, with what that cannot be told from; else empty."""
    before, after = (evidence.climbed[index].fit.segments for index in (0, -1))
    if not evidence.ladder or after <= before:
        return ""
    rivals = dict.fromkeys(other for one in evidence.climbed if one.rung.added == "segments" for other in one.rung.tied)
    told = listing((inner_title(titles.get(other, other)) for other in rivals), "or")
    tied = f" (these data cannot tell the finer chain from {told})" if told else ""
    return f" and {after} segments in place of {before}{tied}"


def _stand_ins(evidence: Evidence) -> str:
    """How many stand-ins were added, in words; empty without any."""
    count = len(_added(evidence, stand_ins=True))
    return f"{count} stand-ins" if count > 1 else "one stand-in" * count


def _or(effect: str, rivals: Sequence[str], titles: Mapping[str, str]) -> str:
    return listing([titles.get(effect, effect), *(inner_title(titles.get(other, other)) for other in rivals)], "or")


def _inner(name: str) -> str:
    """A title inside a sentence; what follows a colon is left out."""
    head, comma, rest = name.partition(", or ")
    return inner_title(head) + comma + rest


def _shows(step: LadderStep) -> str:
    """Where on the tube a model fails most, if that is not everywhere."""
    places = step.comparison.where if step.comparison else []
    if not places or not 0.0 < places[0].to_sigma - places[0].from_sigma <= 0.5:  # of an angle there is no place
        return ""
    low, high = (round(100 * share) for share in (places[0].from_sigma, places[0].to_sigma))
    where = f"between {low} and {high} % of the way from clamp to tip"
    if high == 100:
        where = f"in the last {100 - low} % of the way to the tip"
    elif low == 0:
        where = f"in the first {high} % of the way from the clamp"
    return f"; the model is off most {where}"


def no_stretch(fit: ModelFit, unit: str) -> str:
    """That a model fails nowhere more than elsewhere, and out of what nothing stands."""
    own, source = fit.noise_floor_mm if fit.noise_floor_mm is not None else fit.noise_floor_deg, fit.noise_floor_source
    if source == LEFT_BY_A_MODEL:
        return f"No stretch of any run stands out from the rest of it: of its worst run this fit leaves {with_unit(own, unit)}."
    size = "" if own is None else f", {with_unit(own, unit)}"
    return f"No stretch of any run stands out from the noise floor of this fit{size}{': ' * bool(source)}{source}."


def findings(evidence: Evidence, titles: Mapping[str, str]) -> Iterator[Finding]:
    """What the artefacts say in sentences, each with the place of its evidence."""
    for finding in _findings(evidence):
        yield Finding(in_words(finding.text, evidence, titles), finding.section, finding.link)


def _findings(evidence: Evidence) -> Iterator[Finding]:
    step = evidence.last
    if evidence.ladder:
        for sentence in evidence.ladder.findings:
            if not sentence.startswith(_SAID_ELSEWHERE):
                yield Finding(sentence, "ladder", "ladder")
    if step and step.diagnosis and step.diagnosis.sentence:
        yield Finding(step.diagnosis.sentence, "why", "evidence")
    first = evidence.steps[0] if evidence.steps else None
    if first and first.comparison:
        for sentence in first.comparison.sentences[:2]:
            yield Finding(f"{_stop(sentence)}", "where", "where")
    if step and step.comparison and step.comparison.elongation.get("profiles"):
        yield Finding(step.comparison.elongation.get("sentence", ""), "elongation", "elongation")
    if evidence.ladder and evidence.ladder.stopped_because and not (step and step.diagnosis):
        yield Finding(f"The search ended: {evidence.ladder.stopped_because}", "ladder", "ladder")
    for reason in evidence.absent.values():
        if not reason.startswith(_NO_FINDING):
            yield Finding(reason, "trust", "")


def in_words(text: str, evidence: Evidence, titles: Mapping[str, str]) -> str:
    """A sentence of an artefact with the names of models and added effects as a reader knows them."""
    for step in evidence.steps:
        model = "the model of the paper" if not step.fit.effects else _with_effects(step, titles)
        text = re.sub(rf"\bmodel {re.escape(step.rung.model)}(?![\w+])", model, text)
    text = re.sub(r"\b[Tt]he phase '(\w+)'", lambda found: _PHASES.get(found[1], found[0]), text)
    known = {rung.added for rung in evidence.ladder.rungs} if evidence.ladder else set()
    known |= {effect for step in evidence.steps if step.diagnosis for effect in step.diagnosis.named}
    for effect in map(str, known - {None}):  # a name in brackets stands beside its title already, which may hold it
        title = inner_title(titles[effect])
        name = rf"(?i:{re.escape(title)})|(?<![\w(+.`]){re.escape(effect)}(?![\w+]|\.\w)"
        text = re.sub(name, lambda found, it=effect, title=title: title if found[0] == it else found[0], text)
    return text


def _with_effects(step: LadderStep, titles: Mapping[str, str]) -> str:
    return f"the model with {' and '.join(inner_title(titles.get(e, e)) for e in step.fit.effects)}"


def how_it_ended(evidence: Evidence, titles: Mapping[str, str]) -> str:
    """Why the ladder has no further rung, as one sentence; empty where there is no ladder."""
    reason = in_words(evidence.ladder.stopped_because, evidence, titles) if evidence.ladder else ""
    _, _, sentence = reason.partition(": ")
    if reason.startswith("the verdict is ") and sentence:
        return f"The search ended here. {_stop(sentence)}"
    return f"The search ended because {_stop(reason[:1].lower() + reason[1:])}" if reason else ""


def parameter_words(evidence: Evidence, titles: Mapping[str, str]) -> dict[str, str]:
    """What each parameter means; one of an effect by the effect's title and by what is declared of it."""
    known = {
        name: item.text for step in evidence.steps for name, item in (*step.fit.parameters.items(), *step.fit.paper_parameters.items())
    }
    of_effects = {name: titles.get(name.split(".")[0], "").split(":")[0] for name in known if "." in name}
    return {name: MEANINGS.get(name) or ": ".join(filter(None, (of_effects.get(name), text))) for name, text in known.items()}


def _stop(sentence: str) -> str:
    return sentence if sentence.endswith((".", "!", "?")) else f"{sentence}."


def _missing(added: Sequence[str], step: LadderStep | None, stand_ins: str, finer: bool) -> Tile:
    verdict, where, asks_less = (step.outcome, _shows(step), step.asks_less) if step else ("", "", False)
    note = "added to the model of the paper" if added else "nothing had to be added"
    note += " but segments" * (finer and not added)
    note += ", as far as the held-out runs ask" * asks_less
    if verdict == "unexplained":
        value = "; ".join([*added, "something that is not in the catalogue"] if added else ["Not in the catalogue"])
        helped = f"; {stand_ins} added for the prediction" if stand_ins else ""
        note = f"see the error along the tube{where}; rfea propose reads a law for it from the residual torque{helped}"
        return Tile("Missing physics", value, note=note, section="where")
    if step and verdict == "uncertain":
        value = "; ".join([*added, "perhaps more"]) if added else "Cannot be said"
        return Tile("Missing physics", value, note=undecided(step.uncertain_because), section="trust")
    if verdict == "missing" and not added:
        return Tile("Missing physics", "Named, not yet added", note="see the candidates", section="why")
    value = "; ".join(added) if len(added) < 3 else f"{len(added)} effects"  # more would push the picture down; the headline has them
    return Tile("Missing physics", value or "None found", note=note, section="why")


def _times_smaller(first: float | None, last: float | None) -> str:
    """By how much an error was cured; no more digits than a reader needs."""
    if not first or not last or first < 1.05 * last:
        return "root mean square"
    times = first / last
    return f"{number(times, 2) if times < 100 else round(times)} times smaller, root mean square"


def tiles(evidence: Evidence, titles: Mapping[str, str]) -> Iterator[Tile]:
    """The few numbers that a reader takes away."""
    step, ladder = evidence.last, evidence.ladder
    climbed = [errors_of(one, evidence) for one in evidence.steps if one.on_ladder]
    if ladder and climbed:
        added = [with_rivals(one, titles).split(":")[0] for one in _added(evidence)]
        finer = bool(_finer(evidence, titles))
        yield _missing(added, step, _stand_ins(evidence), finer)
        first, last = climbed[0], climbed[-1]
        which = "held-out" if first.validate is not None else "training"
        before = number(first.best) if len(climbed) > 1 else ""
        note = _times_smaller(first.best, last.best) if before else "root mean square"
        yield Tile(f"{last.what}, {which} runs", with_unit(last.best, last.unit), before, note, "ladder")
        test, key = ladder.test or {}, "tip_rmse_mm" if last.unit == "mm" else "angle_rmse_deg"
        if (after := test.get(key)) is not None:
            before = number(test.get(f"first_model_{key}")) if len(climbed) > 1 else ""
            value = with_unit(after, last.unit)
            yield Tile(f"{last.what}, test run", value, before, "scored once, at the end", "ladder")
    elif step:
        shown = errors_of(step, evidence)
        for value, heading in ((shown.train, "training"), (shown.validate, "held-out")):
            if value is not None:
                value = with_unit(value, shown.unit)
                yield Tile(f"{shown.what}, {heading} runs", value, note="root mean square", section="ladder")
    shown = errors_of(step, evidence) if step else None
    if step and shown and shown.floor is not None:
        floors = step.diagnosis.floors if step.diagnosis else None
        known = (floors.source if floors else "") or (step.fit.noise_floor_source if shown.unit == "mm" else "")
        source = f"from {known}" if known else "of the measurement"
        if floors and (floors.irreproducible or 0.0) > (floors.measurement or 0.0):
            source = "motion that does not come again, or that pressure cannot cause"
        reached = shown.validate if shown.validate is not None else shown.train
        if reached is not None and reached < shown.floor:
            source = f"{source}; an error below it says nothing about the model"
        yield Tile("Noise floor", with_unit(shown.floor, shown.unit), note=source, section="trust")
