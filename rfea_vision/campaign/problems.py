"""What is wrong with an input, in sentences that name the file, the line, the key and the remedy."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from rfea_vision.campaign.yaml_file import ODD_SPACES, KeyPath, YamlFile
from rfea_vision.yaml_line import flow

#: How what stands in a picture, or on a board, is written, by its key.
_FORMS = {
    **dict.fromkeys(("clamp", "plumb"), "[[x, y], [x, y]]"),
    "tip": "[x, y]",
    **dict.fromkeys(("region", "box", "led"), "[x, y, width, height]"),
    "inner_corners": "[columns, rows]",
}
#: Keys by what else they are called.
_CALLED = {"fps": "rate", "frame_rate": "rate", "filename": "file", "path": "file"}
#: What pydantic says of lists of another form.
_MISFORMED = ("tuple_type", "list_type", "too_short", "too_long", "missing")


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
    for item in _as_meant(found, files):
        keys = _keys_as_written(item["loc"], files, keep_last=item["type"] == "missing")
        file, line = _locate(files, keys)
        placed = next((keys[: at + 1] for at, key in enumerate(keys) if key in _FORMS and keys[: at + 1] in file.lines), None)
        if placed and item["type"] in _MISFORMED:
            message = f"found {_value_at(file, placed)}; write it as {_FORMS[str(placed[-1])]}"
            problems.setdefault(placed, FileProblem(file.path, message, ".".join(map(str, placed)), line, "error", experiment))
            continue
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


def _value_at(file: YamlFile, keys: KeyPath) -> object:
    value: Any = file.content
    for key in keys:
        value = value[key]
    return value


def _as_meant(found: Sequence[Any], files: tuple[YamlFile, ...]) -> list[Any]:
    """Without keys that are unknown, or missing, to one kind of mapping only, where the other kind that may stand there is meant.

    Nor are those missing that an unknown key stands for, nor has a number no unit that a decimal comma has parted from it.
    """
    unknown = {item["loc"] for item in found if item["type"] == "extra_forbidden"}
    astray = {item["loc"][:-1] for item in found if item["type"] in ("extra_forbidden", "missing")}
    meant = {item["loc"][:-1] for item in found if len(item["loc"]) > 1} - astray
    cut = {item["loc"][:-1] for item in found if _is_cut(item)}

    def misled(item: Any) -> bool:
        kind, place = item["type"], item["loc"][:-1]
        if place in cut and isinstance(item.get("input"), int):
            return True  # what stands before the comma
        if kind not in ("extra_forbidden", "missing") or not place:
            return False
        of_a_kind = isinstance(place[-1], str) and _keys_as_written(place, files, keep_last=False)[-1] != place[-1]
        if of_a_kind and any(other[:-1] == place[:-1] and isinstance(other[-1], str) for other in meant):
            return True
        beside = [str(other[-1]) for other in unknown if other[:-1] == place]
        return kind == "missing" and any(of_a_kind or closest(other, [str(item["loc"][-1])]) for other in beside)

    return [item for item in found if not misled(item)]


def _is_cut(item: Any) -> bool:
    """Whether a key that is unknown is what a decimal comma left of a value in braces: `5 s` of ``{value: 1,5 s}``."""
    return item["type"] == "extra_forbidden" and item.get("input") is None and str(item["loc"][-1])[:1].isdigit()


def _explain(item: Any, model: type[BaseModel]) -> str:
    kind, found = item["type"], item.get("input")
    match kind:
        case "extra_forbidden":
            name, known = str(item["loc"][-1]), _known_keys(model, item["loc"][:-1])
            if _is_cut(item):
                return f"'{name}' stands after a comma, which ends a value in braces; write decimals with a point"
            return _of_elsewhere(name, item["loc"][:-1], model) or unknown_key(name, known)
        case "missing":
            return "is missing; add it"
        case "literal_error":
            in_place = _annotation_of(model, item["loc"][:-1]) if str(item["loc"][-1]).startswith("literal[") else None
            keys = [name for part in _models_in(in_place) for name in part.model_fields]
            return f"found {found!r}; must be {item['ctx']['expected']}" + (f", or a mapping with {', '.join(keys)}" if keys else "")
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
        case "model_type" | "model_attributes_type":
            known = _known_keys(model, item["loc"])
            if "file" in known and isinstance(found, str):
                return f"found {found!r}; write '{flow({item['loc'][0]: {'file': found}})[1:-1]}'"
            return f"found {found!r}; a mapping is needed; known here: {', '.join(sorted(known))}"
        case "dict_type":
            return f"found {found!r}; a mapping such as {{key: value}} is needed"
        case _:
            message = item["msg"][0].lower() + item["msg"][1:]
            return f"found {found!r}; {message}"


def _is_of_one(found: object) -> bool:
    """Whether a list of one text stands where the text itself should."""
    return isinstance(found, list) and len(found) == 1 and isinstance(found[0], str)


def _of_elsewhere(name: str, location: tuple[str | int, ...], model: type[BaseModel]) -> str:
    """Say where a key belongs that is unknown at `location`: above it, or in one part that may stand there; empty where nowhere.

    Or that it is one of the words that a key beside it takes.
    """
    part = next(_models_in(_annotation_of(model, location)), model)
    above = {key: _known_keys(model, location[:at]) for at, key in enumerate(location) if isinstance(key, str)}
    for key, known in above.items():
        if name in known:
            return f"belongs one level up, beside '{key}', and not in it"
    fields = {key: field.annotation for key, field in part.model_fields.items()}
    if key := next((key for key, annotation in fields.items() if name in _words_of(annotation)), ""):
        return f"is no key but a word for '{key}'; write '{key}: {name}'"
    within = [key for key, annotation in fields.items() if any(name in kind.model_fields for kind in _models_in(annotation))]
    if not within:
        return ""
    return f"belongs in {' or '.join(map(repr, within))}, as in '{within[0]}: {{{name}: ...}}'"


def _words_of(annotation: Any) -> Iterator[object]:
    """Yield the words of an annotation such as ``Literal["motion", "offset"]``."""
    if get_origin(annotation) is Literal:
        yield from get_args(annotation)
    elif get_origin(annotation) in (Union, types.UnionType, Annotated):
        for member in get_args(annotation):
            yield from _words_of(member)


def unknown_key(name: str, known: Iterable[str]) -> str:
    """Say that a key is unknown, and which one was probably meant."""
    if (plain := "".join(" " if sign in ODD_SPACES else sign for sign in name).strip()) != name:
        return f"'{plain}' has a blank beside it that is none to YAML, as web pages and word processors write it; type it anew"
    close = closest(name, known)
    remedy = f"did you mean '{close}'?" if close else f"known here: {', '.join(sorted(known))}"
    return f"unknown key '{name}'; {remedy}"


def closest(name: str, known: Iterable[str]) -> str:
    """The known key that was probably meant; empty where none is near."""
    if (usual := _CALLED.get(name.lower(), "")) in known:
        return usual
    return next(iter(difflib.get_close_matches(name, sorted(known), n=1, cutoff=0.6)), "")


def _known_keys(model: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Return the fields of the part of `model` that `location` leads to."""
    part = next(_models_in(_annotation_of(model, location)), model)
    return list(part.model_fields)


def _annotation_of(model: type[BaseModel], location: tuple[str | int, ...]) -> Any:
    """Return what the last key of `location` that is a field may hold; None where there is none."""
    found = None
    for part in location:
        if isinstance(part, str) and part in model.model_fields:
            found = model.model_fields[part].annotation
            model = next(_models_in(found), model)
    return found


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models inside an annotation such as ``Annotated[Model | None, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    if get_origin(annotation) in (Union, types.UnionType, Annotated):
        for member in get_args(annotation):
            yield from _models_in(member)
