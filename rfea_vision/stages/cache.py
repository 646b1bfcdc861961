"""Which results are still true: a stage is redone only if its inputs, its options or its code have changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from rfea_vision import __version__
from rfea_vision.files import is_file, sha256_of, write_text

_MEASURED = ("calibrate", "track", "clip", "preview", "sync")


@dataclass(frozen=True)
class StageRecord:
    """What a finished stage was made from and what it made.

    Attributes
    ----------
    key : stage and subject, for example ``track/steps-270kPa``
    digest : hash of inputs, options and code
    options : the options, so that a later command can redo the stage in the same way
    outputs : path relative to the output folder -> SHA-256
    inputs : raw files that went in, as path relative to the campaign -> SHA-256
    order : rises with every stage of the models that finishes; 0 where runs are measured side by side, in no order
    version : of the package that made it
    facts : what a command prints of the result, so that it need not be read for that
    """

    key: str
    digest: str
    options: dict[str, Any] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    order: int = 0
    version: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


class StageCache:
    """The records of one output folder, in ``.stages/``."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.folder = out / ".stages"
        self.lock = self.folder / "lock"
        self._hashes_file = self.folder / "hashes.json"
        self._hashes: dict[str, list[Any]] = _read_json(self._hashes_file)

    def sha256(self, path: Path) -> str:
        """Return the content hash of a file; remembered while size and time of change stay, so that it is instant."""
        state = path.stat()
        mark = [state.st_size, state.st_mtime_ns, state.st_ctime_ns, state.st_ino]
        known = self._hashes.get(str(path))
        if isinstance(known, list) and known[:4] == mark and len(known) == 5:
            return str(known[4])
        digest = sha256_of(path)
        self._hashes[str(path)] = [*mark, digest]
        return digest

    def digest(self, stage: str, hashes: Iterable[str], options: object, code: str) -> str:
        """Return one hash for what a stage depends on.

        Parameters
        ----------
        stage : its name
        hashes : content hashes of the inputs, in order
        options : anything made of dataclasses, mappings, sequences and plain values
        code : hash of the source that makes the result, see `code.code_of`
        """
        parts = {"stage": stage, "hashes": list(hashes), "options": as_json(options), "code": code}
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def record(self, key: str) -> StageRecord | None:
        """Return the record of a stage, or None if it has never finished here."""
        return _record(self._file(key))

    def made(self, key: str) -> datetime:
        """Return when the stage finished, on the clock of the place."""
        return datetime.fromtimestamp(self._file(key).stat().st_mtime)

    def told(self, what: str, made: datetime | None) -> bool:
        """Return whether a result made then was told to a person before; from now on it was."""
        file = self.folder / "told.json"
        times = _read_json(file)
        before, times[what] = times.get(what), datetime.now().timestamp()
        if made is not None and isinstance(before, float) and before >= made.timestamp():
            return True
        with suppress(OSError):  # it saves lines and nothing else
            write_text(file, json.dumps(times) + "\n")
        return False

    def records(self, stage: str) -> list[StageRecord]:
        """Return the records of all subjects of a stage, in the order in which they finished."""
        found = [record for path in self.folder.glob(f"{stage}@*.json") if (record := _record(path)) is not None]
        return sorted(found, key=lambda record: record.order)

    def is_fresh(self, key: str, digest: str) -> bool:
        """Say whether the stage has run with just these inputs, options and code, and its outputs are untouched."""
        record = self.record(key)
        if record is None or record.digest != digest:
            return False
        files = {self.out / name: sha for name, sha in record.outputs.items()}
        return all(
            ".." not in path.parts and path.is_relative_to(self.out) and is_file(path) and self.sha256(path) == sha
            for path, sha in files.items()
        )

    def finished(
        self,
        key: str,
        digest: str,
        outputs: Iterable[Path],
        *,
        options: object = None,
        inputs: Mapping[str, str] | None = None,
        facts: Mapping[str, object] | None = None,
    ) -> StageRecord:
        """Return what is to be noted of a stage that has finished."""
        made = {path.relative_to(self.out).as_posix(): self.sha256(path) for path in outputs}
        return StageRecord(
            key, digest, as_json(options) or {}, made, dict(inputs or {}), 0, __version__, as_json(facts or {})
        )

    def store(self, *records: StageRecord) -> None:
        """Note that stages have finished, in this order and at once, as far as files can be."""
        order = max((item.order for item in self.records("*")), default=0)
        for record in records:
            if record.key.partition("/")[0] not in _MEASURED:
                order += 1
                record = replace(record, order=order)
            write_text(self._file(record.key), json.dumps(asdict(record), indent=1) + "\n")
        self.save_hashes()

    def keep_place(self, key: str, order: int) -> None:
        """Let a stage that was only brought up to date count as finished when it first was."""
        record = self.record(key)
        if record is not None and record.order != order:
            write_text(self._file(key), json.dumps(asdict(replace(record, order=order)), indent=1) + "\n")

    def save_hashes(self) -> None:
        """Keep the remembered hashes for the next run."""
        if self._hashes != _read_json(self._hashes_file):
            write_text(self._hashes_file, json.dumps(self._hashes) + "\n")

    def _file(self, key: str) -> Path:
        return self.folder / _file_name(key)


def as_json(value: object) -> Any:
    """Return dataclasses, models, paths and arrays as JSON values; a path counts by its name, for its content is hashed."""
    if isinstance(value, BaseModel) or (is_dataclass(value) and not isinstance(value, type)):
        return {key: as_json(item) for key, item in vars(value).items()}
    if isinstance(value, Mapping):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [as_json(item) for item in value]
    if isinstance(value, Path):
        return value.name
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    return value


def _record(path: Path) -> StageRecord | None:
    """Return a record; None where there is none, or it is damaged: then the stage runs again."""
    try:
        record = TypeAdapter(StageRecord).validate_python(_read_json(path))
    except ValidationError:
        return None
    return record if path.name == _file_name(record.key) else None


def _file_name(key: str) -> str:
    return f"{key.replace('/', '@')}.json"


def _read_json(path: Path) -> dict[str, Any]:
    """Return a JSON mapping, empty where the file is absent or damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}
