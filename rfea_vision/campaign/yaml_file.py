"""YAML with the line of every key, so that an error can point at it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rfea_vision.errors import InputError

KeyPath = tuple[str | int, ...]
#: What looks like a blank and is none to YAML.
ODD_SPACES = set("\u00a0\u2007\u202f\u2003\u2009\u200b\u3000")
# Far beyond what a person writes, and read within a second: what is more is a mistake, or meant to stop the machine.
_MOST_BYTES, _MOST_DEPTH, _MOST_VALUES = 1_000_000, 20, 50_000


@dataclass(frozen=True)
class YamlFile:
    """The mapping that a file holds, and the line (from 1) on which each key path stands."""

    path: Path
    content: dict[str, Any]
    lines: dict[KeyPath, int]

    def line_of(self, keys: KeyPath) -> int | None:
        """Return the line of the longest leading part of `keys` that stands in the file."""
        for length in range(len(keys), 0, -1):
            if keys[:length] in self.lines:
                return self.lines[keys[:length]]
        return None


def read_yaml(path: Path) -> YamlFile:
    """Read one YAML mapping.

    Raises
    ------
    InputError
        If the file is missing, not UTF-8, not YAML, holds a key twice or is not a mapping.
    """
    try:
        text = read_text(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: not found") from error
    except IsADirectoryError as error:
        raise InputError(f"{path}: is a folder, a file is needed") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}:{line}: not UTF-8 text; save the file as UTF-8") from error
    try:
        content, node = parse_yaml(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        fault = error.problem or error.context
        tab = "write blanks in place of the tab" if "\\t" in str(fault) else ""
        remedy = tab or odd_space(text) or "check indentation, colons and brackets there"
        raise InputError(f"{path}{line}: not valid YAML: {fault}; {remedy}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        found = "empty" if content is None else "not a mapping"
        raise InputError(f"{path}: is {found}; keys such as 'format:' and 'name:' are needed ('rfea init' shows which)")
    lines: dict[KeyPath, int] = {}
    _collect(path, node, (), lines)
    # "~: 1" has a key that is no text
    return YamlFile(path, {str(key): value for key, value in content.items()}, lines)


def read_text(path: Path) -> str:
    """The text of a file of settings; whoever made it, it does not fill the memory or block.

    Raises
    ------
    InputError
        If it is no plain file, or larger than settings are.
    """
    if not path.is_file() and path.exists() and not path.is_dir():
        raise InputError(f"{path}: is no plain file; put one in its place")
    with path.open("rb") as stream:
        raw = stream.read(_MOST_BYTES + 1)
    if len(raw) > _MOST_BYTES:
        raise InputError(f"{path}: is larger than {_MOST_BYTES / 1e6:g} MB; this file holds settings, not data")
    return raw.decode("utf-8-sig")


def odd_space(text: str) -> str:
    """Where blanks stand that look like blanks and are none to YAML, and the remedy; empty where there are none."""
    for number, line in enumerate(text.splitlines(), start=1):
        if set(line) & ODD_SPACES:
            return f"line {number} holds a blank that is none to YAML, as web pages and word processors write it: type it anew"
    return ""


def parse_yaml(text: str) -> tuple[Any, yaml.Node | None]:
    """The value that YAML stands for and its nodes.

    Raises
    ------
    yaml.YAMLError, ValueError
        If it is not YAML, is nested too deeply, or would grow beyond all measure as its aliases are written out.
    """
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):  # flat: what is nested deeply cannot exhaust the stack
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MOST_DEPTH:
            raise yaml.MarkedYAMLError(problem=f"nested more than {_MOST_DEPTH} deep", problem_mark=event.start_mark)
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    if _size(node, {}) > _MOST_VALUES:
        raise ValueError(f"its aliases stand for more than {_MOST_VALUES} values; write out what is meant")
    return yaml.safe_load(text), node


def _size(node: yaml.Node | None, known: dict[int, int]) -> int:
    """Number of values below a node with every alias written out; one that holds itself is endless."""
    if id(node) not in known:
        known[id(node)] = _MOST_VALUES + 1  # as long as it is being counted
        children: list[yaml.Node] = []
        if isinstance(node, yaml.MappingNode):
            children = [part for pair in node.value for part in pair]
        elif isinstance(node, yaml.SequenceNode):
            children = node.value
        known[id(node)] = 1 + sum(_size(child, known) for child in children)
    return known[id(node)]


def _collect(path: Path, node: yaml.Node | None, keys: KeyPath, lines: dict[KeyPath, int]) -> None:
    """Note the line of every key below `node`; a key given twice is an error, as YAML drops the first in silence."""
    if isinstance(node, yaml.MappingNode):
        for key_node, value_node in node.value:
            here = (*keys, str(key_node.value))
            if here in lines:
                name, line = ".".join(map(str, here)), key_node.start_mark.line + 1
                raise InputError(f"{path}:{line}: '{name}' stands here and on line {lines[here]}; keep one of them")
            lines[here] = key_node.start_mark.line + 1
            _collect(path, value_node, here, lines)
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            lines[(*keys, index)] = item.start_mark.line + 1
            _collect(path, item, (*keys, index), lines)
