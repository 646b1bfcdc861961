"""The last stage: all artefacts to one page."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from rfea_vision.artefacts import Ladder
from rfea_vision.campaign.loading import OUTPUT_FOLDER
from rfea_vision.errors import InputError
from rfea_vision.files import write_text
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.options.asking import from_record, written
from rfea_vision.progress import Progress
from rfea_vision.stages import measurement, mechanics
from rfea_vision.stages.cache import StageRecord
from rfea_vision.stages.runner import Runner, Stage
from rfea_vision.stages.stored import Stored

_ARTEFACTS = (
    "ladder.json", "calibration/*", "calibration/photos/*", "*/camera.yaml", "*/track.nc", "*/recording.nc", "*/clip.*",
    "models/*/*",
)  # fmt: skip


def report(work: Runner) -> Stored[Path]:
    """Write the report of what there is; what is out of date is redone first; without a model the ladder is climbed.

    Where no run has a pressure there is nothing to fit, and the page shows the motion alone.
    """
    path = work.out / "report" / "index.html"
    if work.active() and all(run.pressure.missing for run in work.active()):
        work.each((), lambda run: measurement.track(work, run), "tracked")
    else:
        bring_up_to_date(work)
    files = sorted({file for pattern in _ARTEFACTS for file in work.out.glob(pattern) if file.is_file()})

    asked = commands(work)

    def make(progress: Progress) -> tuple[Path, list[Path], str]:
        from rfea_vision.report import render

        page = render(work.out, title=work.campaign.name, commands=asked, runs=work.runs())
        write_text(path, page)
        return path, [path], f"{path} ({path.stat().st_size / 1e6:.1f} MB)"

    return work.run(
        Stage(
            "report",
            "page",
            earlier=[f"{file.relative_to(work.out)}:{work.cache.sha256(file)}" for file in files],
            options={"title": work.campaign.name, "commands": asked, "runs": work.runs()},
        ),
        make=make,
        load=lambda: path,
    )


def figures(work: Runner, *, formats: Sequence[str], style: str, model: str | None = None) -> list[Path]:
    """Write every figure of the report as a file, with its data, to ``figures/``.

    Raises
    ------
    InputError
        If there is no such model, a format is unknown, or matplotlib is not installed.
    """
    from rfea_vision.figures import save_plates
    from rfea_vision.figures.models import plates
    from rfea_vision.report.collect import collect

    if model is not None and model not in mechanics.model_names(work):
        there = ", ".join(mechanics.model_names(work)) or "none"
        raise InputError(f"{work.campaign.root}: no model '{model}'; there are: {there}")
    return save_plates(plates(collect(work.out, work.runs()), model), work.out / "figures", formats=formats, style=style)


def notebook(work: Runner) -> Path:
    """Write a notebook that opens the artefacts, for those who go on by hand."""
    from rfea_vision.report import render_notebook

    path = work.out / "report" / "explore.ipynb"
    write_text(path, render_notebook(work.out, title=work.campaign.name))
    return path


def side_by_side(first: Runner, second: Runner) -> Path:
    """Write the page that puts two campaigns side by side; it goes to the first one's report."""
    from rfea_vision.report import render_comparison

    names = _labels((first, second))
    path = _page_beside(first, names[1])
    write_text(path, render_comparison(first.out, second.out, names=(names[0], names[1])))
    return path


def group(works: Sequence[Runner], path: Path) -> list[Path]:
    """Write one page of many campaigns, and its drawings with their data beside it; the page is the first of the files."""
    from rfea_vision.figures import save_plates
    from rfea_vision.report.collect import collect
    from rfea_vision.report.group import GroupMember, group_plates, render_group

    tubes = [
        GroupMember(label, work.campaign.design, collect(work.out, work.runs()))
        for label, work in zip(_labels(works), works, strict=True)
    ]
    write_text(path, render_group(tubes))
    return [path, *save_plates(group_plates(tubes), path.with_name(f"{path.stem}-figures"))]


def _labels(works: Sequence[Runner]) -> list[str]:
    """What to call campaigns beside one another: by their names, else by their folders, else by their whole paths."""
    by_name = [work.campaign.name for work in works]
    by_folder = [work.campaign.root.name for work in works]
    by_path = [str(work.campaign.root) for work in works]
    return next((names for names in (by_name, by_folder) if len(set(names)) == len(names)), by_path)


def is_results(folder: Path) -> bool:
    """Whether a folder holds results, an ``rfea/`` or a copy of one, rather than a campaign."""
    campaign = (folder / "campaign.yaml").is_file() or (folder / "experiment.yaml").is_file()
    return not campaign and ((folder / "models").is_dir() or (folder / Ladder.FILE).is_file())


def beside_results(work: Runner, earlier: Path) -> Path:
    """Write the page that puts a campaign beside earlier results of it, which are taken as they are."""
    from rfea_vision.report import render_comparison

    name = earlier.resolve().name
    path = _page_beside(work, name)
    write_text(path, render_comparison(work.out, earlier, names=(f"{work.campaign.name}, now", name)))
    return path


def _page_beside(work: Runner, name: str) -> Path:
    """The page that puts a campaign beside one called `name`, which may hold characters that no file name can."""
    safe = re.sub(r"[^\w.-]+", "-", name)[-60:]  # of a long path what tells it apart
    return work.out / "report" / f"beside-{safe}.html"


def bring_up_to_date(work: Runner) -> None:
    """Redo what depends on changed data: the ladder with its options, single models with theirs."""
    climbed_as = asked_of_ladder(work)
    names = mechanics.model_names(work)
    if climbed_as is not None:
        mechanics.improve(work, *climbed_as)
    elif not names:
        mechanics.improve(work, FitOptions(), CritiqueOptions())
    climbed = rung_models(work)
    for name in names:
        if name not in climbed:
            mechanics.compare(work, name)


def asked_of_ladder(work: Runner) -> tuple[FitOptions, CritiqueOptions] | None:
    """Return the options with which the ladder that is there was climbed; None if there is none, or no record says."""
    ladder = work.cache.record("improve/ladder")
    options = mechanics.fitted_with(ladder)
    return None if ladder is None or options is None else (options, _critique_of(ladder))


def rung_models(work: Runner) -> set[str]:
    """Return the models that the ladder consists of."""
    path = work.out / Ladder.FILE
    return {rung.model for rung in Ladder.load(path).rungs} if path.is_file() else set()


def _critique_of(ladder: StageRecord) -> CritiqueOptions:
    """Return the critique's options with which a ladder was climbed."""
    return from_record(CritiqueOptions, ladder.options.get("critique")) or CritiqueOptions()


def commands(work: Runner) -> list[str]:
    """Return the commands that make these results again."""
    campaign, beside = shlex.quote(work.campaign.root.name), _beside(work)
    made = []
    climbed = rung_models(work)
    climbed_as = asked_of_ladder(work)
    if climbed:
        asked = "" if climbed_as is None else written("improve", *climbed_as)
        made.append(f"rfea improve {campaign} {asked}".rstrip() + beside)
    for record in work.cache.records("fit"):
        options = mechanics.fitted_with(record)
        if options is not None and options.name not in climbed:
            made.append(f"rfea fit {campaign} {written('fit', options)}{beside}")
    return [*made, f"rfea report {campaign}{beside}"]


def _beside(work: Runner) -> str:
    """The option --out, as seen from the campaign's parent folder; empty where results lie in the campaign."""
    if work.out == work.campaign.root / OUTPUT_FOLDER:
        return ""
    return f" --out {shlex.quote(os.path.relpath(work.out, work.campaign.root.parent))}"
