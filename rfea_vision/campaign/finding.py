"""Files that a campaign names: looked for beside the experiment and beside the campaign, and within reach."""

from __future__ import annotations

import re
from glob import has_magic
from pathlib import Path

from rfea_vision.campaign.problems import FileProblem, problem_at
from rfea_vision.campaign.reach import REMEDY, Reach
from rfea_vision.campaign.yaml_file import YamlFile
from rfea_vision.files import is_file, is_folder, is_link

Folders = tuple[Path, ...]
Files = tuple[YamlFile, ...]


class Finder:
    """Looks for files in the experiment's folder, then in the campaign's, and notes what is not there, or out of reach."""

    def __init__(self, reach: Reach, folders: Folders, files: Files, experiment: str | None) -> None:
        self.reach, self.folders, self.files, self.experiment = reach, folders, files, experiment
        self.problems: list[FileProblem] = []

    def complain(self, key: str, message: str) -> None:
        """Note a problem under the dotted `key` of the YAML files; nothing is raised."""
        self.problems.append(problem_at(self.files, key, message, experiment=self.experiment))

    def file(self, key: str, name: str | None, *, folder: bool = False) -> Path | None:
        """Return the path behind `name`, or note under `key` that it does not exist."""
        if name is None:
            return None
        refusals: list[str] = []
        for base in self.folders:
            path = self.reach.path(base, name)
            refusal = None if path is None else self.reach.refusal(path)
            if refusal is not None:
                refusals.append(refusal)
            elif path is not None and (is_folder(path) if folder else is_file(path)):
                return path
        if refusals:
            self.complain(key, f"'{name}' {refusals[0]}")
            return None
        kind = "folder" if folder else "file"
        if not folder and is_folder(self.folders[0] / name):
            # Who filmed pictures one by one has no file to name.
            pictures = f"; where it holds the pictures of a film, write frames: {{folder: {name}, rate: 240 Hz}} in place of video"
            self.complain(
                key,
                f"'{name}' in {self.folders[0]} is a folder; name the file, with its folder, as in '{name}/FILE'"
                + pictures * (key == "video.file"),
            )
            return None
        if is_link(self.folders[0] / name):
            self.complain(
                key, f"'{name}' in {self.folders[0]} is a link that leads to no file; put the {kind} itself there"
            )
            return None
        there = _nearby(self.folders[0], name)
        even = ", or, where they were taken at an even rate, write frames.rate, such as '30 Hz'" * (key == "frames.times")
        self.complain(key, f"no {kind} '{name}' in {self.folders[0]}{there}; correct the name or put the {kind} there{even}")
        return None

    def photos(self, key: str, patterns: str | list[str] | None) -> tuple[Path, ...]:
        """Return the photos that the patterns match, each once, in order of name."""
        found: dict[Path, None] = {}
        for pattern in [patterns] if isinstance(patterns, str) else patterns or []:
            if not has_magic(pattern):
                path = self.file(key, pattern)
                found |= {path: None} if path is not None else {}
                continue
            matches = self._matches(key, pattern)
            if matches is None:
                continue
            if not matches:
                self.complain(
                    key,
                    f"no photo matches '{pattern}' in {self.folders[0]}; correct the pattern or put the photos there",
                )
            found |= dict.fromkeys(matches)
        return tuple(found)

    def _matches(self, key: str, pattern: str) -> list[Path] | None:
        """Return the files that a pattern matches, in the first folder where it does; None if it may not be looked for."""
        absolute = pattern.startswith("/")
        if not self.reach.trusted and (absolute or ".." in Path(pattern).parts):
            self.complain(key, f"'{pattern}' leads out of the folder that it is written in; {REMEDY}")
            return None
        for base in self.folders:
            where, relative = (Path("/"), pattern.lstrip("/")) if absolute else (base, pattern)
            try:
                matches = sorted(path.resolve() for path in where.glob(relative) if path.is_file())
            except (OSError, RuntimeError, ValueError, NotImplementedError) as error:
                self.complain(key, f"'{pattern}' is no pattern for files ({error}); write for example 'board_*.png'")
                return None
            refusal = next((text for path in matches if (text := self.reach.refusal(path)) is not None), None)
            if refusal is not None:
                self.complain(key, f"'{pattern}' {refusal}")
                return None
            if matches:
                return matches
        return []

    def database(self, url: str | None) -> str | None:
        """Return a database's URL, if the campaign may read it: a file below its folder, read with SQLite."""
        if url is None or self.reach.trusted:
            return url
        kind, separator, rest = url.partition(":///")
        if not separator or kind not in ("sqlite", "sqlite+pysqlite") or set("?$") & set(rest):
            said = "only SQLite files below the campaign's folder are read unasked, written 'sqlite:///log.db'"
            self.complain("pressure.url", f"'{_hidden(url)}': {said}; {REMEDY}")
            return None
        path = self.reach.path(self.folders[0], rest)
        refusal = "is no path" if path is None else self.reach.refusal(path)
        if refusal is not None:
            self.complain("pressure.url", f"'{rest}' {refusal}")
        return url if refusal is None else None


def _hidden(url: str) -> str:
    """A URL without its password."""
    return re.sub(r"(//[^:/@]*):[^@]*@", r"\1:***@", url)


def _nearby(folder: Path, name: str) -> str:
    """Name the files of the same kind that do lie in the folder, or the one that another way of writing it leads to."""
    turned = name.replace("\\", "/")
    if turned != name and ".." not in turned and not Path(turned).is_absolute() and (folder / turned).is_file():
        return f" (there is {turned})"
    suffix = Path(name).suffix.lower()
    files = [path for path in folder.glob("*") if path.is_file()]
    others = sorted(path.name for path in files if (path.suffix.lower() == suffix if suffix else path.stem == name))
    return f" (there is {', '.join(others[:4])})" if others else ""
