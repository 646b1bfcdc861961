"""A campaign guessed from files: which belong together, and what each of them is. Every guess is marked in the YAML."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path

from rfea_vision.campaign.guess import FileGuess, Key, look
from rfea_vision.campaign.loading import OUTPUT_FOLDER, RESERVED_NAMES
from rfea_vision.campaign.template import CAMERA_EXAMPLES, RIG_EXAMPLE, campaign_name, write_new
from rfea_vision.campaign.tension import OF_A_TUBE
from rfea_vision.data import column_words
from rfea_vision.errors import InputError
from rfea_vision.yaml_line import flow

_MOST_FILES = 1000  # more is a whole disk, not a campaign
_ALBUM = 30  # more pictures than these are no photos of a board
#: What brings a log to its run, where both were found alone.
_UNPAIRED = " by its name; call it as its run is called, and join the parts of one run into one file"
#: Boards as they are sold and printed, the usual ones first.
_SIZES = ((9, 6), (8, 6), (7, 6), (7, 5), (8, 5), (10, 7), (11, 8), (6, 5), (7, 4), (6, 4), (5, 4), (6, 9), (5, 7))


@dataclass(frozen=True)
class RunFiles:
    """A film or track with the log that belongs to it; `why` says how they were brought together."""

    name: str
    motion: FileGuess
    log: FileGuess | None
    why: str


@dataclass(frozen=True)
class Written:
    """What was written, every guess as ``file: key: value: why``, and the files left out with their reason."""

    files: tuple[Path, ...]
    guesses: tuple[str, ...]
    left_out: tuple[str, ...]


def write_campaign_from(folder: Path, files: Sequence[Path]) -> Written:
    """Write campaign.yaml and one experiment per run; files from elsewhere are linked (or copied) into the campaign.

    Raises
    ------
    InputError
        If a campaign is there already, a file is not, or none of them holds a film or a track.
    """
    if (folder / "campaign.yaml").exists():
        raise InputError(f"{folder / 'campaign.yaml'}: is there already and is left as it is; choose another folder")
    found = [_opened(look(path)) for path in _expanded(files)]
    runs, alone = _runs(found)
    if not runs:
        seen = "; ".join(f"{item.path.name}: {item.note or item.what}" for item in found[:6])
        if sum(item.what == "picture" for item in found) > _ALBUM:
            seen += "; of pictures that are a film 'rfea init DIR' writes a campaign: 'frames: {folder: NAME, rate: 30 Hz}' in it"
        raise InputError(
            f"{folder}: none of the files holds a film or a track ({seen}); give those of at least one run"
        )
    draft = _Draft(folder)
    logged = [run for run in runs if run.log is not None]
    last = (logged if len(logged) > 1 else runs)[-1]  # a run without a pressure judges no model
    pages = {folder / run.name / "experiment.yaml": draft.experiment(run, held_out=len(runs) > 1 and run is last) for run in runs}
    pages[folder / "campaign.yaml"] = draft.campaign(runs, [item.path for item in found if item.what == "picture"])
    write_new(pages)
    lost = "belongs to no film or track" + (_UNPAIRED if len(logged) < len(runs) else "")
    left_out = [f"{item.path}: {item.note or (lost if item.what == 'log' else 'belongs to no film or track')}" for item in alone]
    return Written(tuple(pages), tuple(draft.guesses), tuple(left_out))


def _expanded(files: Sequence[Path]) -> list[Path]:
    """Every file given, those below folders too, without hidden ones and results."""
    out: list[Path] = []
    for path in files:
        if not path.exists():
            raise InputError(f"--from {path}: not found; correct the name")
        below = sorted(path.rglob("*")) if path.is_dir() else [path]
        for item in below:
            inside = item.relative_to(path).parts if path.is_dir() else ()
            if item.is_file() and OUTPUT_FOLDER not in inside and not any(part.startswith(".") for part in inside):
                out.append(item.resolve())
    out = [path for path in dict.fromkeys(out) if path.suffix.lower() not in (".yaml", ".yml", ".md", ".json", ".html")]
    if len(out) > _MOST_FILES:
        raise InputError(f"--from: {len(out)} files, {_MOST_FILES} at most; name those of one campaign")
    return out


def _opened(item: FileGuess) -> FileGuess:
    """A file as it is, but a film that cannot be opened as one that is unknown, and why."""
    if item.what != "film":
        return item
    from rfea_vision.readers.video import open_video  # brings FFmpeg with it

    try:
        open_video(item.path)
    except InputError as error:
        return replace(item, what="unknown", note=str(error).removeprefix(f"{item.path}: video.file "))
    return item


def _stem(path: Path) -> str:
    """The part of a name that tells runs apart, without the words that tell films from logs."""
    stem = re.sub(r"dlc.*$", "", path.stem, flags=re.IGNORECASE)
    words = [word for word in re.split(r"[^\w]+|_", stem.lower()) if word and word not in column_words()["file"]]
    return "-".join(words) or path.parent.name.lower()


def _runs(found: Sequence[FileGuess]) -> tuple[list[RunFiles], list[FileGuess]]:
    """Bring films and tracks together with logs: by name, then by folder, then in order where the numbers agree."""
    if not any(item.what in ("film", "track", "both") for item in found):
        found = [_moving(item) if item.what == "log" and len(item.motion) > 1 else item for item in found]
    logs = [item for item in found if item.what == "log"]
    alone = [item for item in found if item.what == "unknown"]
    tracked = {_stem(item.path) for item in found if item.what in ("track", "both")}
    pending: list[FileGuess] = []
    for item in found:
        if item.what == "film" and _stem(item.path) in tracked:
            alone.append(replace(item, note="a track of the same run is there; name the film in its place if you like"))
        elif item.what in ("film", "track", "both"):
            pending.append(item)
    pairs: list[tuple[FileGuess, FileGuess | None, str]] = [(item, item, "") for item in pending if item.what == "both"]
    pending = [item for item in pending if item.what != "both"]
    for same, why in ((_stem, "their names agree"), (lambda path: path.parent, "they lie in one folder, alone")):
        for item in list(pending):
            fitting = [log for log in logs if same(log.path) == same(item.path)]
            rivals = [other for other in pending if same(other.path) == same(item.path)]
            if len(fitting) == 1 and len(rivals) == 1:
                pairs.append((item, fitting[0], why))
                pending.remove(item)
                logs.remove(fitting[0])
    if pending and len(pending) == len(logs):
        order = "as many logs as films or tracks were left; they are paired in the order of their names"
        pairs += [(item, log, order) for item, log in zip(pending, logs, strict=True)]
        pending, logs = [], []
    pairs += [(item, None, "") for item in pending]
    pairs.sort(key=lambda pair: pair[0].path)
    names = _names([item.path for item, _, _ in pairs])
    return [RunFiles(name, *pair) for name, pair in zip(names, pairs, strict=True)], alone + logs


def _moving(log: FileGuess) -> FileGuess:
    """A log whose one column that nothing explains is taken for an angle."""
    angle = next(key.value for key in log.motion if key.name == "angle")
    return replace(log, what="track" if any(key.value == angle for key in log.pressure) else "both")


def _names(paths: Sequence[Path]) -> list[str]:
    """A name of its own for each run: its file's, or its folder's where runs lie in folders of their own under one file name."""
    names: list[str] = []
    for path in paths:
        alike = [other.parent for other in paths if _stem(other) == _stem(path)]
        apart = len(alike) > 1 and len(set(alike)) == len(alike) and not any(one in other.parents for one in alike for other in alike)
        name = re.sub(r"[^\w-]+", "-", path.parent.name.lower() if apart else _stem(path)).strip("-_") or "run"
        name = f"{name}-run" if name.casefold() in RESERVED_NAMES or name == OUTPUT_FOLDER else name
        names.append(next(free for free in chain([name], (f"{name}-{n}" for n in count(2))) if free not in names))
    return names


#: What stands in place of a log that was not found; of a beam, or a tube that was let go, there is none.
NO_LOG = """# pressure: {file: pressure.csv}  # needed: no log was found that belongs here; without one, at constant pressure:
# pressure: {value: 0 kPa}
# start: {shape: measured}  # where the tube was held at first, and let go
"""


class _Draft:
    """The YAML files of a campaign in `folder`, and every guess in them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.guesses: list[str] = []

    def experiment(self, run: RunFiles, *, held_out: bool) -> str:
        """experiment.yaml of a run."""
        role, why = ("validate", "the last run, set aside to judge the model") if held_out else ("train", "a model needs runs to fit")
        self.guesses.append(f"{run.name}.role: {role}: {why}")
        heading = "video" if run.motion.what == "film" else "track"
        text = f"format: rfea-experiment/1\nname: {flow(run.name)}\nrole: {role}  # guessed: {why}\n"
        text += f"{heading}:\n" + self._lines(self._brought(run.name, run.motion.motion), f"{run.name}.{heading}")
        where = f"{run.name}.pressure"
        if run.log is None:
            self.guesses.append(f"{where}: needed, and not guessed: no log was found that belongs to {run.motion.path.name}")
            return text + NO_LOG
        text += "pressure:" + (f"  # guessed: {run.why}" if run.why else "") + "\n"
        if run.why:
            self.guesses.append(f"{where}: {run.log.path.name}: {run.why}")
        for index, keys in enumerate(run.log.chambers):
            first, *others = self._lines(self._brought(run.name, keys), f"{where}[{index}]").splitlines(keepends=True)
            text += "  - " + first[2:] + "".join(f"  {line}" for line in others)
        if not run.log.chambers:
            text += self._lines(self._brought(run.name, run.log.pressure), where)
        if run.log is run.motion:
            return text + "sync: {method: common_clock}  # pressure and motion stand in one table\n"
        self.guesses.append(f"{run.name}.sync: motion: nothing says that the two clocks are one")
        return text + "sync: {method: motion}  # guessed: nothing says that the two clocks are one\n"

    def campaign(self, runs: Sequence[RunFiles], pictures: Sequence[Path]) -> str:
        """campaign.yaml of the runs, with the camera of their films."""
        said = {key.name: key for run in runs for item in (run.log, run.motion) if item is not None for key in item.actuator}
        paper = "that of the paper's tube; measure yours"
        keys = [
            Key("outer_radius", "4 mm", paper),
            Key("inner_radius", "3 mm", paper),
            said.get("length", Key("length", "155 mm", paper)),
            Key("density", "965 kg/m^3", "that of PDMS"),
            Key("fluid_density", "1000 kg/m^3", "that of water"),
            said.get("bends", Key("bends", "left", "the paper's tube; as the camera sees it")),
        ]
        if "section" in said:
            keys = [*(key for key in keys if key.name not in OF_A_TUBE), said["section"]]
        text = "# Guessed from files by 'rfea init --from'. Every guess is marked: correct it, or take the mark away.\n"
        text += f"format: rfea-campaign/1\nname: {flow(campaign_name(self.folder))}\n"
        text += "actuator:\n" + self._lines(keys, "actuator")
        filmed = any(run.motion.what == "film" for run in runs)
        camera = "camera:\n" + self._lines(self._camera(pictures), "camera") + CAMERA_EXAMPLES if filmed else ""
        return text + camera + RIG_EXAMPLE

    def _lines(self, keys: Sequence[Key], where: str) -> str:
        """Keys as lines of YAML below a heading: guesses are marked, what nobody can guess is left as a comment."""
        text = ""
        for key in keys:
            if key.value is None:
                text += f"  # {key.name}: {key.example}  # needed: {key.why}\n"
                self.guesses.append(f"{where}.{key.name}: needed, and not guessed: {key.why}")
                continue
            text += f"  {key.name}: {flow(key.value)}" + (f"  # guessed: {key.why}" if key.why else "") + "\n"
            if key.why:
                self.guesses.append(f"{where}.{key.name}: {flow(key.value)}: {key.why}")
        return text

    def _camera(self, pictures: Sequence[Path]) -> list[Key]:
        """The board and its photos, if one is seen in the pictures; else what else gives a scale."""
        called = [path for path in pictures if any(word in path.stem.lower() for word in column_words()["board"])]
        plane = next((path for path in pictures if re.search("plane|ebene", path.stem.lower())), None)
        boards = [path for path in called or pictures if path != plane]
        if not boards:
            board = "{kind: checkerboard, inner_corners: [9, 6], square: 12 mm}"
            points = "two points of the first frame and what lies between them, where there is no board; 'rfea open' points at them"
            return [
                Key("board", None, "a board, with 'photos' of it; or 'scale'", board),
                Key("scale", None, points, "{points: [[x, y], [x, y]], distance: 155 mm}"),
            ]
        corners = next((size for path in boards[:3] if (size := _corners(path)) is not None), None)
        seen = f"seen in {boards[0].name}" if corners else "of 'rfea board checkerboard-9x6-12mm'; none was recognised in the photos"
        board = {"kind": "checkerboard", "inner_corners": list(corners or (9, 6)), "square": "12 mm"}
        keys = [
            Key("board", board, f"corners {seen}; the square of 'rfea board'; measure yours"),
            Key("photos", [self._photo(path) for path in boards], "pictures that are no films"),
        ]
        return keys if plane is None else [*keys, Key("plane", self._photo(plane), "its name says so")]

    def _photo(self, path: Path) -> str:
        """A photo of the board, brought into the campaign, as campaign.yaml names it."""
        name = self._bring("calibration", path)
        return name if (self.folder / name).exists() else f"calibration/{name}"

    def _brought(self, run: str, keys: Sequence[Key]) -> list[Key]:
        return [Key("file", self._bring(run, key.value)) if key.name == "file" else key for key in keys]

    def _bring(self, place: str, path: Path) -> str:
        """The name by which a campaign finds a file: where it lies if that is inside, else a link to it in the folder `place`."""
        root, room = self.folder.resolve(), self.folder / place
        if path.is_relative_to(room.resolve()):
            return os.path.relpath(path, room.resolve())
        if path.is_relative_to(root):
            return str(path.relative_to(root))
        room.mkdir(parents=True, exist_ok=True)
        there = room / path.name
        if there.exists() and not there.samefile(path):
            raise InputError(f"{there}: is there already and is another file than {path}; choose another folder")
        if not there.exists():
            try:
                os.link(path, there)
            except OSError:  # another disk
                shutil.copy2(path, there)
        return path.name


def _corners(path: Path) -> tuple[int, int] | None:
    """How many inner corners the board in a picture has; None where none is seen."""
    from rfea_vision.calibration.board import Board
    from rfea_vision.calibration.corners import Refused, find_corners
    from rfea_vision.readers.pictures import read_grey

    if (grey := read_grey(path)) is None:
        return None
    found = ((size, find_corners(path, grey, Board("checkerboard", size, 0.012))) for size in _SIZES)
    return next((size for size, view in found if not isinstance(view, Refused)), None)
