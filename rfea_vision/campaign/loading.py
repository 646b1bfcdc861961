"""From a folder to a `Campaign`: find the files, inherit, resolve paths, and collect everything that is wrong."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ValidationError

from rfea_vision.artefacts import Actuator
from rfea_vision.campaign.archived import beside_results
from rfea_vision.campaign.problems import FileProblem, problem_at, validation_problems
from rfea_vision.campaign.reach import Reach
from rfea_vision.campaign.resolve import resolve_actuator, resolve_camera, resolve_experiment
from rfea_vision.campaign.schema import CampaignFile, ExperimentFile
from rfea_vision.campaign.specs import Campaign, ExperimentSpec
from rfea_vision.campaign.yaml_file import YamlFile, read_yaml
from rfea_vision.errors import InputError
from rfea_vision.files import is_file, is_folder, is_link

OUTPUT_FOLDER = "rfea"
#: What else stands in the folder of results, in lower case: some file systems do not tell Report from report.
RESERVED_NAMES = frozenset({"calibration", "models", "report", "figures", "reproduce", "ladder.json", ".stages"})
_SAFE_NAME = re.compile(r"^[^\s./\\:\x00-\x1f\x7f-\x9f][^/\\:\x00-\x1f\x7f-\x9f]*$")
_LONGEST_NAME = 150  # bytes: those that file systems allow, 255, less what stands around it in the names of files
_ALMOST = re.compile(r"^(campaign|experiment)\.(ya?ml|json)(\.txt)?$", re.IGNORECASE)
#: What a run is recorded in, by the names that docs/formats.md gives it.
_OF_A_RUN = ("video.mp4", "track.csv", "pressure.csv")
_Model = TypeVar("_Model", bound=BaseModel)


def load_campaign(
    path: Path | str, out: Path | str | None = None, *, trust: bool = False, only: Sequence[str] = ()
) -> Campaign:
    """Load a campaign folder, or a lone folder with an experiment.yaml.

    Parameters
    ----------
    path : the folder, or its campaign.yaml
    out : where results go; default ``<campaign>/rfea``
    trust : let it read outside of its folder, and from database servers
    only : names of the runs that alone are asked for: what is wrong with another one is no matter, unless they carry its memory

    Raises
    ------
    InputError
        With the first problem found, and how many more there are.
    """
    reading = read_campaign(path, out, trust=trust)
    errors = [problem for problem in reading.problems if problem.severity == "error"]
    if only and errors and reading.campaign is not None and reading.blocked is None:
        asked = [run for run in reading.campaign.experiments if run.name in only]
        carried = [run.name for run in asked if run.memory == "carried"]
        if len(asked) == len(set(only)) and not carried:
            return reading.campaign
        errors.sort(key=lambda problem: problem.experiment not in only)
        if carried and errors[0].experiment not in only:
            raise InputError(f"{errors[0]}; {carried[0]} carries the memory of the runs before it, and needs them")
    if errors or reading.campaign is None:
        more = f" ({len(errors) - 1} more: 'rfea check {path}' lists them)" if len(errors) > 1 else ""
        raise InputError(f"{errors[0]}{more}")
    return reading.campaign


@dataclass(frozen=True)
class Reading:
    """What could be read of a campaign.

    Attributes
    ----------
    campaign : the campaign with the experiments that are right; None if there is no such folder
    broken : the other experiments, as far as they could be understood
    problems : errors and warnings, in the order of the files; one without an experiment concerns all
    """

    campaign: Campaign | None
    broken: tuple[ExperimentSpec, ...]
    problems: tuple[FileProblem, ...]

    @property
    def blocked(self) -> FileProblem | None:
        """The first error that stands above all experiments, if there is one."""
        above = (item for item in self.problems if item.severity == "error" and item.experiment is None)
        return next(above, None)


def read_campaign(path: Path | str, out: Path | str | None = None, *, trust: bool = False) -> Reading:
    """Load whatever can be loaded, and say everything that is wrong; without `trust` nothing outside of it is read."""
    folder = Path(path).expanduser()
    if folder.name in ("campaign.yaml", "experiment.yaml"):
        folder = folder.parent
    folder = folder.resolve()
    reach = Reach(folder, trust)
    if not is_folder(folder) and is_file(folder):
        return _nothing(folder, "is a file; give the campaign folder that it belongs to")
    if not is_folder(folder):
        return _nothing(folder, "no such folder; give a campaign folder ('rfea init DIR' makes one)")
    if is_file(_out(folder, out)):
        return _nothing(_out(folder, out), "is a file; the results need a folder: name another with --out DIR")
    link = reach.link_out(_out(folder, None)) if out is None else None
    if link is not None:
        return _nothing(link, f"{reach.refusal(link.resolve())}; or keep results elsewhere with --out DIR")
    if is_file(folder / "campaign.yaml"):
        return _read_folder(reach, _out(folder, out))
    if is_file(folder / "experiment.yaml"):
        if (folder.parent / "campaign.yaml").is_file():
            advice = (
                f"give the campaign, '{folder.parent}', and choose the experiment with -e where one is to be chosen"
            )
            return _nothing(folder, f"belongs to the campaign above it; {advice}")
        return _read_lone(reach, _out(folder, out))
    return _nothing(folder, f"holds neither campaign.yaml nor experiment.yaml; {_instead(folder)}")


def _instead(folder: Path) -> str:
    """What was probably meant by a folder without a campaign: a file by nearly that name, or a campaign below."""
    near = [path.name for path in sorted(folder.iterdir()) if _ALMOST.match(path.name) and path.is_file()]
    if near:
        kind = "experiment" if near[0].lower().startswith("e") else "campaign"
        return f"there is {near[0]}: call it {kind}.yaml"
    if folder.name == OUTPUT_FOLDER and (folder.parent / "campaign.yaml").is_file():
        return f"these are the results; give the campaign, '{folder.parent}'"
    below = sorted(path.parent.name for path in folder.glob("*/campaign.yaml"))
    return f"give the folder {below[0]} in it" if below else "'rfea init DIR' writes both to fill in"


def _nothing(folder: Path, message: str) -> Reading:
    return Reading(None, (), (FileProblem(folder, message),))


def _out(folder: Path, out: Path | str | None) -> Path:
    return Path(out).expanduser().resolve() if out is not None else folder / OUTPUT_FOLDER


def _read_folder(reach: Reach, out: Path) -> Reading:
    root = reach.root
    file = root / "campaign.yaml"
    try:
        shared = _read_within(reach, file)
        problems = []
    except InputError as error:
        shared, problems = YamlFile(file, {}, {}), [_file_problem(file, error)]
    parsed, found = _validate(CampaignFile, shared.content, (shared,))
    problems += found
    if parsed.name is not None and _is_long(parsed.name):  # the record of its calibration is called after it
        message = f"is longer than {_LONGEST_NAME} bytes; choose a shorter one, and write the rest as 'note'"
        problems.append(problem_at((shared,), "name", message))
    actuator, camera = None, None
    if not problems or shared.content:
        actuator, found = _actuator(parsed, (shared,))
        problems += [problem for problem in found if not _about(problem, problems)]
        if parsed.camera is not None:
            camera, found = resolve_camera(parsed.camera, reach, (root,), (shared,))
            problems += found
    said = _parts(problems) | (set() if shared.content else {"actuator", "camera"})
    # What is wrong in the campaign is said once, and the experiments are looked through without it.
    shared = replace(shared, content={key: value for key, value in shared.content.items() if key not in said})
    experiments: list[ExperimentSpec] = []
    broken: list[ExperimentSpec] = []
    files = [path for path in sorted(root.glob("*/experiment.yaml")) if out not in (path.parent, *path.parents)]
    for path in files:
        experiment, found = _read_experiment(reach, path, shared, said, out)
        problems += found
        if any(problem.severity == "error" for problem in found):
            broken += [experiment] if experiment is not None else []
        elif experiment is not None:
            experiments.append(experiment)
    if is_file(out / "experiment.yaml") and out.parent == root:
        message = "is the folder of the results, and the run in it is not read; give the run's folder another name"
        problems.append(FileProblem(out, message, severity="warning"))
    problems += _across(file, experiments, complete=len(experiments) == len(files))
    problems += _passed_over(root, out, [*experiments, *broken]) if files else []
    about = (parsed.name or root.name, root, out, actuator or Actuator(), camera)
    campaign = Campaign(*about, tuple(experiments), parsed.design or {})
    return Reading(campaign, tuple(broken), tuple(problems))


def _passed_over(root: Path, out: Path, read: list[ExperimentSpec]) -> list[FileProblem]:
    """Say of folders that look like runs and are not read: one folder too deep, or with a log and no experiment.yaml."""
    used = {folder for spec in read for path in _recorded_in(spec) for folder in path.parents}
    found = []
    for folder in sorted(path for path in root.iterdir() if is_folder(path) and path != out and not is_link(path)):
        if is_file(folder / "experiment.yaml") or is_file(folder / "campaign.yaml"):  # the latter is a campaign of its own
            continue
        if deeper := sorted(folder.glob("*/experiment.yaml")):
            place = deeper[0].parent.relative_to(root)
            found.append(FileProblem(root / place, "is not read; move it up beside campaign.yaml", severity="warning"))
        elif any(is_file(folder / name) for name in _OF_A_RUN) and folder not in used:
            message = "is not read, as it has no experiment.yaml; write one, with 'role: ignore' if it is set aside"
            found.append(FileProblem(folder, message, severity="warning"))
    return found


def _recorded_in(spec: ExperimentSpec) -> list[Path]:
    """The files of a run's motion and pressure."""
    video = (spec.video.file, spec.video.frames, spec.video.times) if spec.video is not None else ()
    track = (spec.track.file,) if spec.track is not None else ()
    return [path for path in (*video, *track, *spec.pressure.files) if path is not None]


def _is_long(name: str) -> bool:
    return len(name.encode(errors="replace")) > _LONGEST_NAME


def _read_lone(reach: Reach, out: Path) -> Reading:
    folder = reach.root
    experiment, problems = _read_experiment(reach, folder / "experiment.yaml", None, set(), out)
    if experiment is None:
        return Reading(None, (), tuple(problems))
    found, broken = (experiment,), ()
    if any(problem.severity == "error" for problem in problems):
        found, broken = (), (experiment,)
    if experiment.role != "train":
        alone = f"'{experiment.role}' of a run that stands alone leaves none to fit a model to; write 'role: train'"
        problems.append(FileProblem(experiment.file, alone, "role", severity="warning", experiment=experiment.name))
    campaign = Campaign(experiment.name, folder, out, experiment.actuator, experiment.camera, found)
    return Reading(campaign, broken, tuple(problems))


def _read_within(reach: Reach, path: Path) -> YamlFile:
    """Read a YAML file that lies within reach."""
    refusal = reach.refusal(path.resolve())
    if refusal is not None:
        raise InputError(f"{path}: {refusal}")
    return read_yaml(path)


def _read_experiment(
    reach: Reach, path: Path, shared: YamlFile | None, said: set[str], out: Path
) -> tuple[ExperimentSpec | None, list[FileProblem]]:
    """Read one experiment.yaml on top of what the campaign shares; `said` are parts that were complained of there.

    The experiment is returned as far as it is understood; None only if the file cannot be read at all.
    """
    name = path.parent.name
    try:
        own = _read_within(reach, path)
    except InputError as error:
        return None, [_file_problem(path, error, name)]
    name = str(own.content.get("name") or name)
    files = (own,) if shared is None else (own, shared)
    inherited = (
        {} if shared is None else {k: v for k, v in shared.content.items() if k not in ("format", "name", "design")}
    )
    parsed, problems = _validate(ExperimentFile, _merge(inherited, own.content), files, name)
    if name.casefold() in RESERVED_NAMES:
        message = f"'{name}' is what rfea calls results of its own; choose another name"
        problems.append(problem_at(files, "name", message, experiment=name))
    elif not _SAFE_NAME.match(name) or _is_long(name):
        message = (
            f"'{name}' cannot name a folder of results; use letters, digits and dashes, {_LONGEST_NAME} bytes at most"
        )
        problems.append(problem_at(files, "name", message, experiment=name))
    actuator, found = _actuator(parsed, files, name)
    if shared is None or "actuator" in own.content:
        problems += [problem for problem in found if not _about(problem, problems)]
    folders = (path.parent,) if shared is None else (path.parent, shared.path.parent)
    experiment, found = resolve_experiment(parsed, name, actuator or Actuator(), reach, folders, files)
    said = {part for part in said if part not in own.content}
    found = [problem for problem in found if not _about(problem, problems) and _part(problem) not in said]
    problems += beside_results(found, experiment, out, files)
    if parsed.role == "ignore":  # what is set aside may be broken
        problems = [problem for problem in problems if problem.key.startswith(("role", "format"))]
    return experiment, problems


def _part(problem: FileProblem) -> str:
    return problem.key.split(".")[0]


_SOURCES = {"video", "frames", "track"}  # parts of which a run has one


def _about(problem: FileProblem, problems: list[FileProblem]) -> bool:
    """Say whether the part of the file that a problem is about is among those complained of already."""
    return _part(problem) in _parts(problems)


def _parts(problems: list[FileProblem]) -> set[str]:
    """The parts of the file that are complained of: a misspelt one stands for the one that was meant."""
    found = {_part(problem) for problem in problems} | {problem.meant for problem in problems if problem.meant}
    return found | _SOURCES if found & _SOURCES else found


def _across(file: Path, experiments: list[ExperimentSpec], *, complete: bool) -> list[FileProblem]:
    """What can only be seen over all experiments together."""
    if not experiments and complete:
        message = "no experiment here; each needs its own folder with an experiment.yaml ('rfea init DIR' writes one)"
        if deeper := sorted(file.parent.glob("*/*/experiment.yaml")):
            place = deeper[0].parent.relative_to(file.parent)
            message = f"no experiment here, and one in {place}: move such folders up beside campaign.yaml"
        return [FileProblem(file, message)]
    problems: list[FileProblem] = []

    def refuse(item: ExperimentSpec, key: str, message: str) -> None:
        problems.append(FileProblem(item.file, message, key, experiment=item.name))

    def of_all(key: str, message: str, severity: Literal["error", "warning"]) -> None:
        problems.append(FileProblem(file, message, key, severity=severity))

    names, first = [item.name for item in experiments], experiments[0] if experiments else None
    for item in experiments:
        if names.count(item.name) > 1:
            refuse(item, "name", f"'{item.name}' names {names.count(item.name)} experiments; give each its own")
        if item.repeat_of is not None and complete and (item.repeat_of not in names or item.repeat_of == item.name):
            others = ", ".join(name for name in names if name != item.name)
            is_what = "is this run itself" if item.repeat_of == item.name else "is no experiment"
            refuse(item, "repeat_of", f"'{item.repeat_of}' {is_what}; a run repeats another one; there are {others}")
        if first is not None and not item.pressure.missing and (own := _chambers(item)) != (other := _chambers(first)):
            remedy = "name the same ones in all experiments"
            refuse(item, "pressure", f"has the chambers {own}, '{first.name}' has {other}; {remedy}")
    both_ways = [item for item in experiments if {part.keys.sign for part in item.pressure.chambers} == {1, -1}]
    if any(item.actuator.offset for item in both_ways):
        one_side = "the body has its inextensible side on one side, and the chambers bend it to both"
        middle = "a section that bends about its middle is for example 'section: {kind: rod, chamber_area: 60 mm^2}'"
        of_all("actuator.section", f"{one_side}; {middle}", "warning")
    roles = {item.role for item in experiments}
    if complete and "train" not in roles:
        of_all("role", "no experiment has 'role: train'; give that role to at least one experiment.yaml", "error")
    if complete and "train" in roles and "validate" not in roles:
        unseen = "no experiment has 'role: validate', so nothing judges a model on data it has not seen; set one aside"
        of_all("role", unseen, "warning")
    return problems


def _chambers(item: ExperimentSpec) -> str:
    """Names of the chambers of a run."""
    return " and ".join(sorted(part.name for part in item.pressure.chambers if part.name)) or "without a name"


def _actuator(
    parsed: CampaignFile | ExperimentFile, files: tuple[YamlFile, ...], experiment: str | None = None
) -> tuple[Actuator | None, list[FileProblem]]:
    if parsed.actuator is None:
        message = "is missing; the tube of the paper is assumed"
        return Actuator(), [problem_at(files, "actuator", message, severity="warning", experiment=experiment)]
    try:
        return resolve_actuator(parsed.actuator), []
    except InputError as error:
        key, _, message = str(error).partition(" ")
        return None, [problem_at(files, key, message, experiment=experiment)]


def _validate(
    model: type[_Model], content: Mapping[str, object], files: tuple[YamlFile, ...], experiment: str | None = None
) -> tuple[_Model, list[FileProblem]]:
    """Return the file as far as it is valid: parts with a problem are left out, and their problems returned."""
    try:
        return model.model_validate(content), []
    except ValidationError as error:
        problems = validation_problems(error, model, files, experiment)
        broken = {_part(problem) for problem in problems}
        return model.model_validate({key: value for key, value in content.items() if key not in broken}), problems


#: Keys, by the part that has them, of which each stands in the place of the others: a log of its own, another calibration.
_ALTERNATIVES = {
    "pressure": {"file", "url", "value"},
    "gravity": {"angle", "plumb"},
    "camera": {"file", "photos", "scale"},
    "scale": {"distance", "places"},
    "actuator": {"mass", "mass_per_length"},
}
#: Keys on which the meaning of the others hangs: with another value nothing is inherited beside them.
_KINDS = {"sync": "method", "section": "kind"}


def _merge(below: Mapping[str, object], above: Mapping[str, object], part: str = "") -> dict[str, object]:
    """Return `above` laid over `below`, mapping by mapping; what stands in the place of an inherited key replaces it."""
    kind, keys = _KINDS.get(part, ""), _ALTERNATIVES.get(part, set())
    if kind in below and kind in above and below[kind] != above[kind]:
        return dict(above)
    merged = {key: value for key, value in below.items() if not (key in keys and keys & set(above))}
    for key, value in above.items():
        under = merged.get(key)
        merged[key] = _merge(under, value, key) if isinstance(under, dict) and isinstance(value, dict) else value
    return merged


def _file_problem(path: Path, error: InputError, experiment: str | None = None) -> FileProblem:
    """Take the leading ``path:line`` of a reader's error apart again."""
    text = str(error).removeprefix(str(path))
    match = re.match(r"^(?::(\d+))?:\s*(.*)$", text, re.DOTALL)
    line, message = (int(match[1]) if match[1] else None, match[2]) if match else (None, text)
    return FileProblem(path, message, line=line, experiment=experiment)
