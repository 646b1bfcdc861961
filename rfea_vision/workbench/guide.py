"""The one thing to do next, so that a person who knows nothing finds the way: from films to a model that lacks nothing."""

from __future__ import annotations

from typing import Any

from rfea_vision.artefacts.judgement import TRACK_UNCERTAIN, undecided
from rfea_vision.units import counted

#: Share of refused frames from which the films come before the model.
MANY_REFUSED = 0.2
#: What `rfea track` says of a film in which a hint helps; a file that cannot be read needs another remedy.
UNSEEN = ("no tube found", "frames could be measured")

Advice = dict[str, Any]


def _step(
    panel: str, say: str, label: str, do: str | None = None, experiment: str | None = None, **options: Any
) -> Advice:
    return {"panel": panel, "say": say, "label": label, "do": do, "options": options, "experiment": experiment}


def mend(problems: list[str]) -> Advice:
    """What to do with a campaign that cannot be read."""
    more = f" and {len(problems) - 1} more: 'rfea check' lists them" if len(problems) > 1 else ""
    return _step("setup", f"The campaign cannot be read yet: {problems[0]}{more}", "Look again")


def point_at_scale(experiments: list[dict[str, Any]], others: int) -> Advice | None:
    """Of films of which nothing says how long a pixel is, the first one's; `others` are mistakes of another kind."""
    name = next((item["name"] for item in experiments if item["pictures"] and item["pointable"] == ("scale",)), None)
    if name is None:
        return None
    more = f" Beside that {counted(others, 'thing')} to mend: 'rfea check' says what." if others else ""
    say = f"The film of {name} has no scale yet: click two points in it a known distance apart, or give photos of a board.{more}"
    step = _step("setup", say, "Point at them", experiment=name)
    return step | {"tool": "scale", "otherwise": _step("setup", say, "Look again")}


def next_step(
    experiments: list[dict[str, Any]], models: list[dict[str, Any]], report: str | None = None, failed: str = ""
) -> Advice:
    """The action that brings the campaign on: its panel, a sentence, a label, and the command with its options.

    `report` is where the report of these models lies, once it is written; `failed` is what was said where the runs could not
    be measured at the last try. Without a label nothing is left to do.
    """
    return _measure(experiments, failed) or (_judge(models, report) if models else _begin(experiments))


def _measure(experiments: list[dict[str, Any]], failed: str) -> Advice | None:
    """What the films need before anything else."""
    if not experiments:
        return _step("setup", "There is no experiment yet: add a folder with an experiment.yaml.", "Look again")
    do = "sync" if all(item["logged"] for item in experiments) else "track"
    if lost := [item for item in experiments if item["tracked"] is None]:
        measure = _step("setup", "The runs have not been measured yet.", "Measure the runs", do)
        return (_point(lost, measure) if any(said in failed for said in UNSEEN) else None) or measure
    if any(item["changed"] for item in experiments):
        return _step("setup", "Hints have changed since the films were measured.", "Measure again", do)
    for item in experiments:
        if item["logged"] and item["recorded"] is None:
            together = _step("clock", "Film and log are not on one clock yet.", "Bring them on one clock", "sync")
            if not failed:
                return together
            say = f"The clocks of {item['name']} were not brought together: type the offset, or show where the lamp is."
            by_hand = _step("clock", say, "Give it by hand", experiment=item["name"])
            return by_hand | {"otherwise": together | {"label": "Look for it again"}}
    return None


def _point(lost: list[dict[str, Any]], measure: Advice) -> Advice | None:
    """Of films in which no tube was found, the first that lacks a hint, and what to point at in it."""
    for item in lost:
        for tool, what in (("clamp", "click both edges of its clamp"), ("tip", "click its free end")):
            if item["pictures"] and not item["hints"].get(tool):
                step = _step(
                    "setup", f"No tube was found in {item['name']}: {what}.", "Point at it", experiment=item["name"]
                )
                return step | {"tool": tool, "otherwise": measure | {"label": "Measure without"}}
    return None


def _begin(experiments: list[dict[str, Any]]) -> Advice:
    """With everything measured and no model: look at what was refused or is doubted, then fit."""
    fit = _step("play", "Everything is measured.", "Fit the paper's model", "fit", add=[])
    heedless = {"otherwise": fit | {"label": "Fit all the same"}}
    for item in experiments:
        if item["tracked"]["good"] < (1 - MANY_REFUSED) * item["tracked"]["frames"]:
            say = f"Many frames of {item['name']} were refused: look why, or fit without them."
            return _step("setup", say, "See the refused frames", experiment=item["name"]) | heedless
    if not all(item["logged"] for item in experiments):
        return _step(
            "setup", "The tube is tracked; a model needs a pressure log: name it in experiment.yaml.", "Look again"
        )
    if not any(item["role"] == "train" for item in experiments):
        return _step("setup", "No run has 'role: train': a model needs one to be fitted to.", "Look again")
    for item in experiments:
        if doubts := item["recorded"]["doubts"]:
            where, label = ("setup", "Look at its film") if item["pictures"] else ("clock", "Look at its curves")
            return _step(where, f"{item['name']}: {doubts}", label, experiment=item["name"]) | heedless
    return fit


def _judge(models: list[dict[str, Any]], report: str | None) -> Advice:
    """With a model: ask what it lacks, add that, again; then write it down."""
    last = max(models, key=lambda model: (len(model["effects"]), model["segments"], model["verdict"] is not None))
    name, lacking = last["name"], [effect for effect in last["named"] if effect not in last["effects"]]
    if last["verdict"] is None:
        say = f"{name} is fitted; nobody has asked yet what it lacks."
        return _step("add", say, "Ask what is missing", "diagnose", model=name)
    if last["verdict"] == "missing" and lacking:
        laws = [effect for effect in lacking if effect != "segments"]  # no law, but a finer chain
        segments = last["segments"] if laws == lacking else 2 * last["segments"]
        titles = [item.get("title", "") for item in last.get("candidates", []) if item["effect"] in lacking]
        words = f": {', '.join(filter(None, titles)).lower()}" if any(titles) else ""
        say, label = f"{name} lacks {' and '.join(lacking)}{words}.", f"Add {' and '.join(lacking)} and watch"
        return _step("add", say, label, "fit", add=[*last["effects"], *laws], segments=segments)
    if last.get("uncertain") and last["verdict"] != "missing":
        because = last.get("uncertain_because", "")
        remedy = "" if because not in ("", TRACK_UNCERTAIN) else ". A board, and ends that are seen clear, lower its floor"
        say = f"{undecided(because)}{remedy}."
        return _step("add", say, "") | {"file": report} if report is not None else _step("add", say, "Write the report", "report")
    if last["verdict"] == "complete":
        say = f"Nothing that matters is missing{' as far as the held-out runs ask' if last.get('asks_less') else ''}"
        if report is not None:
            return _step("add", f"{say}, and the report is written.", "") | {"file": report}
        return _step("add", f"{say}.", "Write the report", "report")
    say = "Something is left that no effect in the catalogue explains: a law can be looked for, or written by you."
    if report is not None:
        return _step("law", f"{say} The report is written.", "Propose a law", "propose", model=name)
    # A law is not always found, so there is a way on.
    return _step("law", say, "Propose a law", "propose", model=name) | {
        "otherwise": _step("law", say, "Write the report", "report")
    }
