"""Films that are gone while their tracks are among the results: how to go on from a copy of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rfea_vision.campaign.problems import FileProblem, problem_at
from rfea_vision.campaign.specs import ExperimentSpec
from rfea_vision.campaign.yaml_file import YamlFile
from rfea_vision.files import is_file

_PICTURES = {"video.file": "video", "frames.folder": "frames"}


def beside_results(
    found: Sequence[FileProblem], experiment: ExperimentSpec, out: Path, files: tuple[YamlFile, ...]
) -> list[FileProblem]:
    """What was found wrong with a run: of pictures that are gone also where their track is, and a track that is itself a result."""
    kept, folder = out / experiment.name / "track.nc", experiment.folder
    gone = [problem for problem in found if problem.key in _PICTURES and problem.message.startswith("no ")]
    said = list(found)
    if is_file(kept):
        for problem in gone:
            instead = f"write 'track: {{file: track.nc}}' in place of {_PICTURES[problem.key]}"
            text = f"{problem.message}; or go on from its track: copy {kept} into {folder} and {instead}"
            said[said.index(problem)] = replace(problem, message=text)
    if experiment.track is not None and experiment.track.file.is_relative_to(out):
        text = f"'{experiment.track.file.name}' is in {out}, where results are written anew; copy it into {folder} and name the copy"
        said.append(problem_at(files, "track.file", text, experiment=experiment.name))
    return said
