"""What a climb has found, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from rfea_vision.artefacts.judgement import UNCERTAIN, Rung
from rfea_vision.artefacts.rows import TestScore
from rfea_vision.critique.refinement import SEGMENTS
from rfea_vision.critique.trials import plain
from rfea_vision.fitting.refit import Fitted
from rfea_vision.units import rounded


def titles_of(last: Fitted, rungs: Sequence[Rung]) -> list[str]:
    """Effects that were added and stayed, in words, with the id by which they are asked for and what they cannot be told from."""
    stayed = {*map(plain, last.options.effects)}
    known = {effect.id: effect.title for effect in last.model.effects}
    titles: dict[str | None, str] = {}  # what was added, dropped and added again is told once
    for rung in rungs:
        if rung.added not in stayed:
            continue
        title = f"{known[rung.added]} ({rung.added})" if rung.added in known else rung.added
        title += f", which these data cannot tell from {' or '.join(rung.tied)}" if rung.tied else ""
        titles[rung.added] = title + " (a stand-in: it lowers the error, and nothing names it)" * (rung.grade == "stand-in")
    return list(titles.values())


def finer_of(first: Fitted, last: Fitted, rungs: Sequence[Rung]) -> str:
    """That the chain was cut finer on the way, which is no physics that was missing; empty where it was not."""
    before, after = first.options.segments, last.options.segments
    rivals = dict.fromkeys(other for rung in rungs if rung.added == SEGMENTS for other in rung.tied)
    tied = f"; these data cannot tell what that does from {' or '.join(rivals)}" if rivals else ", which is no missing effect"
    return f"The chain was made finer: {after} segments in place of {before}{tied}." if after > before else ""


def findings_of(
    rungs: Sequence[Rung],
    titles: Sequence[str],
    finer: str,
    test: TestScore | None,
    floor: float | None,
    unit: str,
    stopped: str,
    doubts: Sequence[str] = (),
) -> list[str]:
    """Return what was added, how far the error fell by it, the floor, what is doubtful, and why the climb ended."""
    out = []
    what = "tip error" if unit == "mm" else "error of the bend angle"
    key = "tip_rmse_mm" if unit == "mm" else "angle_rmse_deg"
    if titles:
        missing = "" if any("(a stand-in:" in title for title in titles) else "Missing from the paper's model, and "
        others = {"complete": f"{missing}added in this order", UNCERTAIN: "added, and too uncertain to say whether more is missing"}
        lead = others.get(rungs[-1].outcome, "added so far, and not yet enough")
        lead = lead[0].upper() + lead[1:]
        out.append(f"{lead}: {'; '.join(titles)}.")
    out += filter(None, (finer,))
    changed = titles or finer
    first, last = (getattr(rung, f"validate_{key}") for rung in (rungs[0], rungs[-1]))
    if changed and first and last:
        fall = f"fell from {rounded(first)} to {rounded(last)} {unit} ({rounded(first / last)} times)"
        out.append(f"The {what} on validation runs {fall}.")
    elif changed and not first:
        out.append(f"No run was held out: the {what} was weighed on the runs that were fitted. Give one 'role: validate' to prove it.")
    before, after = (test.get(f"first_model_{key}"), test.get(key)) if test else (None, None)
    if changed and before and after:
        fall = f"fell from {rounded(before)} to {rounded(after)} {unit}"
        out.append(f"On test runs, on which nothing was chosen, it {fall}.")
    if floor:
        out.append(f"The noise floor is {rounded(floor)} {unit}: an error below it says nothing about the model.")
    out += doubts
    out.append(f"Stopped because {stopped}")
    return out


__all__ = ["findings_of", "finer_of", "titles_of"]
