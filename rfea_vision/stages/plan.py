"""What a recipe would do to a campaign: the stages that are up to date, and those that are to do; nothing is written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

from rfea_vision.campaign import Campaign, read_campaign
from rfea_vision.errors import RfeaError
from rfea_vision.stages.recipes import Recipe, run_recipe
from rfea_vision.stages.runner import Stage
from rfea_vision.stages.workspace import Workspace


@dataclass(frozen=True)
class Planned:
    """One stage: ``unchanged`` (its result is there), ``to do``, or ``broken`` with the reason."""

    stage: str
    subject: str
    state: Literal["unchanged", "to do", "broken"]
    sentence: str = ""


class _NotYetError(RfeaError):
    """A stage would have to run."""


class _Looking(Workspace):
    """A campaign that is looked at: a stage that would run stops here."""

    def _made(self, stage: Stage, *asked: Any) -> NoReturn:
        raise _NotYetError(f"{stage.name} {stage.subject}")


def plan(
    folder: Path, recipe: Recipe, *, out: Path | None = None, force: bool = False, trust: bool = False
) -> list[Planned]:
    """Say what running `recipe` over the campaign in `folder` would do.

    Parameters
    ----------
    folder : campaign or lone experiment
    recipe : its steps
    out, force, trust : as for the run
    """
    reading = read_campaign(folder, out, trust=trust)
    if reading.campaign is None or reading.blocked is not None:
        return [Planned("read", folder.name, "broken", str(reading.blocked or reading.problems[0]))]
    found = [
        Planned("read", str(problem.experiment), "broken", str(problem))
        for problem in reading.problems
        if problem.severity == "error"
    ]
    steps = recipe.calls()
    forced = {name for name, _ in steps} if force else set()
    for experiment in reading.campaign.experiments:
        if experiment.role != "ignore":
            found += _measured(reading.campaign, experiment.name, forced)
    complete = not any(item.state == "to do" for item in found)
    work = _Looking(reading.campaign, force=forced, tolerant=True)
    for index, (name, _) in enumerate(steps):
        if name in ("calibrate", "track", "sync"):
            continue
        if complete:
            try:
                run_recipe(work, Recipe(steps=(recipe.steps[index],)))
            except _NotYetError:
                complete = False
            except RfeaError as error:
                return [*found, Planned(name, "", "broken", str(error))]
        found.append(Planned(name, "", "unchanged" if complete else "to do"))
    return found


def _measured(campaign: Campaign, name: str, forced: set[str]) -> list[Planned]:
    """How far the measurement of one run is."""
    work = _Looking(campaign, force=forced, tolerant=True)
    work.sync([name])
    failure = work.failures.get(name)
    if failure is not None and not isinstance(failure, _NotYetError):
        return [Planned("sync", name, "broken", str(failure))]
    done = {item["stage"] for item in work.outcomes}
    experiment = campaign.experiment(name)
    stages = ["calibrate", "track", "clip", "sync"] if experiment.video is not None else ["track", "sync"]
    return [Planned(stage, name, "unchanged" if stage in done else "to do") for stage in stages]
