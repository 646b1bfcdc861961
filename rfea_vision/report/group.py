"""Many tubes on one page: what their parameters do with a design variable, and which effects each of them shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from rfea_vision.artefacts import Parameter
from rfea_vision.figures import Lines, Plate, Series
from rfea_vision.figures.plates import Axis, told_apart
from rfea_vision.figures.saving import as_svg
from rfea_vision.report import prose
from rfea_vision.report.collect import Evidence, LadderStep
from rfea_vision.report.formatting import listing, unit_text
from rfea_vision.report.page import environment, static
from rfea_vision.report.shown import PER_JOINT, errors_of, of_the_tube

Design = Mapping[str, tuple[float, str]]


@dataclass(frozen=True)
class GroupMember:
    """One campaign of a group: its name, its design variables (value and unit), and what was found out."""

    name: str
    design: Design
    evidence: Evidence

    @property
    def last(self) -> LadderStep | None:
        """The last rung of the ladder, or the last model there is."""
        return self.evidence.last


def parameters_of(tube: GroupMember) -> dict[str, Parameter]:
    """The parameters of a tube's last model; stiffness and damping of the whole tube."""
    return of_the_tube(tube.last.fit) if tube.last is not None else {}


def group_plates(tubes: Sequence[GroupMember]) -> list[Plate]:
    """Each parameter that two tubes share, over each design variable of which they have different values."""
    return told_apart([plate for plate, _ in _drawn(tubes)])


def _drawn(tubes: Sequence[GroupMember]) -> list[tuple[Plate, str]]:
    """Each plate, and a sentence about the tubes that are not in it."""
    found: list[tuple[Plate, str]] = []
    values = {tube.name: parameters_of(tube) for tube in tubes}
    names = dict.fromkeys(name for item in values.values() for name in item)
    for variable in dict.fromkeys(key for tube in tubes for key in tube.design):
        having = [tube for tube in tubes if variable in tube.design]
        unit = having[0].design[variable][1]
        if len({tube.design[variable][0] for tube in having}) < 2 or _units(having, variable) != {unit}:
            continue
        for name in names:
            there = sorted((t.design[variable][0], t.name) for t in having if name in values[t.name])
            if len(there) > 1:
                plate = _plate(variable, unit, name, [(x, values[tube][name]) for x, tube in there])
                found.append((plate, _left_out(tubes, variable, name, values)))
    return found


def _left_out(
    tubes: Sequence[GroupMember], variable: str, name: str, values: Mapping[str, Mapping[str, Parameter]]
) -> str:
    """Which tubes a plate does not show, and why."""
    reasons = {
        "no model": [t.name for t in tubes if t.last is None],
        f"no {variable} in its design": [t.name for t in tubes if t.last is not None and variable not in t.design],
        f"no {name} in its model": [
            t.name for t in tubes if t.last is not None and variable in t.design and name not in values[t.name]
        ],
    }
    said = [f"{listing(names)} ({why})" for why, names in reasons.items() if names]
    return f"Not in it: {'; '.join(said)}." if said else ""


def _units(tubes: Sequence[GroupMember], variable: str) -> set[str]:
    return {tube.design[variable][1] for tube in tubes if variable in tube.design}


def _not_drawn(tubes: Sequence[GroupMember]) -> list[str]:
    """Design variables over which nothing can be drawn, as their units differ."""
    variables = dict.fromkeys(key for tube in tubes for key in tube.design)
    units = {variable: sorted(_units(tubes, variable)) for variable in variables}
    return [
        f"{variable} is given in {listing(unit or 'plain numbers' for unit in found)}: write it in one unit."
        for variable, found in units.items()
        if len(found) > 1
    ]


def _plate(variable: str, unit: str, name: str, points: Sequence[tuple[float, Parameter]]) -> Plate:
    x = np.array([place for place, _ in points])
    y = np.array([item.value for _, item in points])
    half = np.array([_half(item) for _, item in points])
    whole = ", whole tube" if name.startswith(PER_JOINT) else ""
    title = f"{name}{whole} over {variable}"
    dots = Series(name, "dots", x, y, half)
    file = f"{name.replace('.', '-')}-over-{variable}"
    return Lines(file, title, Axis(variable, unit), Axis(name, unit_text(points[0][1].unit)), (dots,))


def _half(item: Parameter) -> float:
    """Half the width of the 95 % interval, from the value to its farther end."""
    if item.interval_95 is None:
        return np.nan
    return max(abs(end - item.value) for end in item.interval_95)


def render_group(tubes: Sequence[GroupMember]) -> str:
    """Make the page of a group: one HTML document without any link to another file."""
    titles: dict[str, str] = {}
    for tube in tubes:
        titles |= prose.effect_titles(tube.evidence)
    meanings: dict[str, str] = {}
    for tube in tubes:
        for name, words in prose.parameter_words(tube.evidence, titles).items():
            meanings[name] = words.replace(" of a joint ", " of the whole tube ")  # as `of_the_tube` gives them
    cells = {tube.name: _effects(tube) for tube in tubes}
    effects = list(dict.fromkeys(effect for row in cells.values() for effect in row))
    rows = [_row(tube) for tube in tubes]
    drawn = _drawn(tubes)
    plates = [
        {"title": plate.title, "svg": Markup(as_svg(plate)), "left_out": left_out}
        for plate, (_, left_out) in zip(told_apart([plate for plate, _ in drawn]), drawn, strict=True)
    ]
    parameters = {tube.name: parameters_of(tube) for tube in tubes}
    return environment().get_template("group.html.j2").render(
        title="Tubes beside one another", rows=rows, cells=cells, effects=effects, titles=titles, meanings=meanings, plates=plates,
        parameters=parameters,
        not_drawn=_not_drawn(tubes), unasked=[row["name"] for row in rows if row["shown"] and not row["verdict"]],
        variables=list(dict.fromkeys(key for tube in tubes for key in tube.design)),
        shared=list(dict.fromkeys(name for item in parameters.values() for name in item)), style=static("style.css"),
    )  # fmt: skip


def _row(tube: GroupMember) -> dict[str, object]:
    step = tube.last
    shown = errors_of(step, tube.evidence) if step is not None else None
    verdict = step.outcome if step is not None else ""
    absent = tube.evidence.absent.get("models", "") if step is None else ""
    return {"name": tube.name, "design": tube.design, "shown": shown, "verdict": verdict, "absent": absent,
            "model": step.rung.model if step is not None else ""}  # fmt: skip


def _effects(tube: GroupMember) -> dict[str, dict[str, object]]:
    """What each effect is to a tube: part of its model, named beyond it, or tied; with probability and share where known."""
    if tube.last is None:
        return {}
    found: dict[str, dict[str, Any]] = {effect: {"what": "in the model"} for effect in tube.last.fit.effects}
    for step in tube.evidence.steps:
        if step.diagnosis is None:
            continue
        known = {item.effect: item for item in step.diagnosis.candidates}
        for effect in step.diagnosis.named:
            found.setdefault(effect, {"what": "named"})
        for tie in step.diagnosis.tied:
            if set(tie.effects) & set(step.diagnosis.named):
                for effect in tie.effects:
                    found.setdefault(effect, {"what": "tied"})
        for effect, item in found.items():
            if effect in known and "probability" not in item:
                item |= {key: getattr(known[effect], key, None) for key in ("probability", "share")}
    return found
