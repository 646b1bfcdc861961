"""What is wrong with an input, in sentences that name the file, the line, the key and the remedy."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from rfea_vision.campaign.yaml_file import ODD_SPACES, KeyPath, YamlFile


@dataclass(frozen=True)
class FileProblem:
    """One thing that is wrong. An ``error`` stops the stages; a ``warning`` is worth knowing."""

    file: Path
    message: str
    key: str = ""
    line: int | None = None
    severity: Literal["error", "warning"] = "error"
    experiment: str | None = None
    meant: str = ""  # the key that an unknown one probably stands for

    def __post_init__(self) -> None:
        # it may quote a name or a value of the file, and YAML takes line breaks of many kinds
        object.__setattr__(self, "message", " ".join(self.message.splitlines()))

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else str(self.file)
        return f"{where}: {self.key}: {self.message}" if self.key else f"{where}: {self.message}"

    def as_dict(self) -> dict[str, object]:
        """Return the problem as plain JSON values."""
        return {**vars(self), "file": str(self.file)}


def problem_at(
    files: Iterable[YamlFile],
    key: str,
    message: str,
    *,
    severity: Literal["error", "warning"] = "error",
    experiment: str | None = None,
) -> FileProblem:
    """Place a problem at the file, among `files`, that holds most of the dotted `key`; else at the first."""
    file, line = _locate(tuple(files), tuple(key.split(".")))
    return FileProblem(file.path, message, key, line, severity, experiment)


def validation_problems(
    error: ValidationError, model: type[BaseModel], files: Iterable[YamlFile], experiment: str | None = None
) -> list[FileProblem]:
    """Turn pydantic's findings into problems, one per key."""
    files = tuple(files)
    problems: dict[KeyPath, FileProblem] = {}
    # a misspelt key is also a missing one, and a number without its unit no word: the first of each is what to mend
    order = ("extra_forbidden", "value_error")
    found = sorted(error.errors(include_url=False), key=lambda item: (*order, item["type"]).index(item["type"]))
    for item in found:
        keys = _keys_as_written(item["loc"], files, keep_last=item["type"] == "missing")
        file, line = _locate(files, keys)
        unknown = item["type"] == "extra_forbidden" and len(item["loc"]) == 1
        meant = closest(str(item["loc"][-1]), model.model_fields) if unknown else ""
        problem = FileProblem(
            file.path, _explain(item, model), ".".join(map(str, keys)), line, "error", experiment, meant
        )
        problems.setdefault(keys, problem)
    # Where a word or a mapping may stand, and what stands in the mapping is wrong, it is not also said that it is no word.
    deeper = [keys[:length] for keys in problems for length in range(1, len(keys))]
    return [problem for keys, problem in problems.items() if keys not in deeper]


def _locate(files: tuple[YamlFile, ...], keys: KeyPath) -> tuple[YamlFile, int | None]:
    for length in range(len(keys), 0, -1):
        for file in files:
            if keys[:length] in file.lines:
                return file, file.lines[keys[:length]]
    return files[0], None


def _keys_as_written(location: tuple[str | int, ...], files: tuple[YamlFile, ...], *, keep_last: bool) -> KeyPath:
    """Drop the names of union members and models that pydantic mixes into the place of an error."""
    keys: KeyPath = ()
    for part in location:
        candidate = (*keys, part)
        if any(candidate in file.lines for file in files):
            keys = candidate
    if keep_last and location[-1] != (keys[-1] if keys else None):
        keys = (*keys, location[-1])
    return keys or location[:1]


def _explain(item: Any, model: type[BaseModel]) -> str:
    kind, found = item["type"], item.get("input")
    match kind:
        case "extra_forbidden":
            return unknown_key(str(item["loc"][-1]), _known_keys(model, item["loc"][:-1]))
        case "missing":
            return "is missing; add it"
        case "literal_error":
            return f"found {found!r}; must be {item['ctx']['expected']}"
        case "string_type" if isinstance(found, bool):
            return (
                f"found {found!r}, which is how YAML reads yes, no, on and off; put quotes around the text, as in 'yes'"
            )
        case "string_type":
            return f"found {found!r}; one text is needed" + (f", such as '{found[0]}'" if _is_of_one(found) else "")
        case "tuple_type" | "list_type":
            return f"found {found!r}; a list is needed, as in [9, 6]"
        case "too_short" | "too_long":
            number, limit = item["ctx"]["actual_length"], item["ctx"].get("min_length", item["ctx"].get("max_length"))
            return f"found {found!r}, which are {number}; there must be {limit} {'at least' if kind == 'too_short' else 'at most'}"
        case "greater_than_equal":
            return f"found {found}; must be at least {item['ctx']['ge']:g}"
        case "int_parsing" | "int_type" | "int_from_float":
            return f"found {found!r}; a whole number is needed"
        case "finite_number" | "float_parsing" | "float_type":
            return f"found {found!r}; a number is needed"
        case "value_error":
            return str(item["ctx"]["error"])
        case "model_type" | "dict_type" | "model_attributes_type":
            return f"found {found!r}; a mapping such as {{key: value}} is needed"
        case _:
            message = item["msg"][0].lower() + item["msg"][1:]
            return f"found {found!r}; {message}"


def _is_of_one(found: object) -> bool:
    """Whether a list of one text stands where the text itself should."""
    return isinstance(found, list) and len(found) == 1 and isinstance(found[0], str)


def unknown_key(name: str, known: Iterable[str]) -> str:
    """Say that a key is unknown, and which one was probably meant."""
    if (plain := "".join(" " if sign in ODD_SPACES else sign for sign in name).strip()) != name:
        return f"'{plain}' has a blank beside it that is none to YAML, as web pages and word processors write it; type it anew"
    close = closest(name, known)
    remedy = f"did you mean '{close}'?" if close else f"known here: {', '.join(sorted(known))}"
    return f"unknown key '{name}'; {remedy}"


def closest(name: str, known: Iterable[str]) -> str:
    """The known key that was probably meant; empty where none is near."""
    return next(iter(difflib.get_close_matches(name, sorted(known), n=1, cutoff=0.6)), "")


def _known_keys(model: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Return the fields of the part of `model` that `location` leads to."""
    for part in location:
        if isinstance(part, str) and part in model.model_fields:
            model = _model_in(model.model_fields[part].annotation) or model
    return list(model.model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the model inside an annotation such as ``Annotated[Model | None, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) in (Union, types.UnionType, Annotated):
        for member in get_args(annotation):
            if (found := _model_in(member)) is not None:
                return found
    return None
