"""One key of a YAML file set or taken out, and not a byte of the rest touched: what people wrote, and how, is theirs.

The parser says where the value stands; the text between is replaced. What comes out is parsed again and must differ from
what went in by that key alone, else nothing is written. The example that `rfea init` left of that very key gives way to it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from rfea_vision.errors import InputError
from rfea_vision.files import whole_file
from rfea_vision.yaml_line import flow

Keys = tuple[str, ...]
INDENT = 2  # spaces, as `rfea init` writes


def set_keys(file: Path, values: Mapping[Keys, Any]) -> None:
    """Set keys of a file; it is written whole or not at all.

    Parameters
    ----------
    file : campaign.yaml or experiment.yaml
    values : path of the key, such as ``("camera", "clamp")``, to plain values: numbers, text, lists, mappings, None

    Raises
    ------
    InputError
        If the file cannot be read, or its form does not allow the change.
    """

    def changed(text: str) -> str:
        for keys, value in values.items():
            text = with_key(text, keys, value)
        return text

    _change(file, changed, "set the key by hand")


def take_out(file: Path, keys: Keys) -> None:
    """Take a key of a file out, as if it had never been written; a mapping without any other key stays, empty.

    Raises
    ------
    InputError
        If the file cannot be read, or its form does not allow the change.
    """
    _change(file, lambda text: without_key(text, keys), "take the key out by hand")


def _change(file: Path, changed: Callable[[str], str], remedy: str) -> None:
    try:
        text = changed(file.read_bytes().decode("utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{file}: cannot be changed ({' '.join(str(error).split())}); {remedy}") from error
    except ValueError as error:
        raise InputError(f"{file}: {error}; {remedy}") from error
    with whole_file(file) as temporary:
        temporary.write_bytes(text.encode("utf-8"))  # no line end is translated


def with_key(text: str, keys: Keys, value: object) -> str:
    """The text with one key set.

    Raises
    ------
    ValueError
        If it cannot be set without touching what stands around it (an alias, a list where a mapping is expected).
    """
    before = yaml.safe_load(text)
    changed = _changed(text, keys, value)
    wanted = _unshared(before) or {}
    place = wanted
    for key in keys[:-1]:
        if not isinstance(place.get(key), dict):
            place[key] = {}
        place = place[key]
    place[keys[-1]] = value
    if yaml.safe_load(changed) != wanted:
        raise ValueError(f"{'.'.join(keys)} cannot be set without changing something else")
    return changed


def without_key(text: str, keys: Keys) -> str:
    """The text without one key.

    Raises
    ------
    ValueError
        If it is not there, or cannot be taken out without touching what stands around it (an alias).
    """
    wanted, node = _unshared(yaml.safe_load(text)), yaml.compose(text, Loader=yaml.SafeLoader)
    place, above = wanted, {}
    for key in keys:
        if not isinstance(node, yaml.MappingNode) or key not in place:
            raise ValueError(f"{'.'.join(keys)} is not there")
        at = [name.value for name, _ in node.value].index(key)
        above, mapping, (name, node) = place, node, node.value[at]
        place = place[key]
    del above[keys[-1]]
    start, end = name.start_mark.index, _end(node)
    if not mapping.flow_style:  # whole lines, with what is said of it behind it
        start, end = text.rfind("\n", 0, start) + 1, _line_end(text, end)
    elif at > 0:
        start = _end(mapping.value[at - 1][1])
    elif len(mapping.value) > 1:
        end = mapping.value[1][0].start_mark.index
    changed = text[:start] + text[end:]
    if _bare(yaml.safe_load(changed)) != _bare(wanted):
        raise ValueError(f"{'.'.join(keys)} cannot be taken out without changing something else")
    return changed


def _bare(value: object) -> object:
    """The same, an empty mapping as nothing: so a block without keys is read."""
    return {key: _bare(item) for key, item in value.items()} or None if isinstance(value, dict) else value


def _unshared(value: object) -> Any:
    """The same without the identity that aliases have."""
    if isinstance(value, dict):
        return {key: _unshared(item) for key, item in value.items()}
    return [_unshared(item) for item in value] if isinstance(value, list) else value


def _changed(text: str, keys: Keys, value: object) -> str:
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    if node is None:
        return text + _lines(keys, value, 0, "\n")
    newline = "\r\n" if "\r\n" in text else "\n"
    above, block = None, True
    for depth, key in enumerate(keys):
        if not isinstance(node, yaml.MappingNode):
            if above is not None and block and node.start_mark.index == node.end_mark.index:  # nothing but comments below it
                column = above.start_mark.column + INDENT
                return _put(text, _comments_end(text, above, column), keys[depth:], value, column, newline)
            nested = _nested(keys[depth:], value)
            if above is not None:
                return _replaced(text, above, node, nested)
            return text[: node.start_mark.index] + flow(nested) + text[node.end_mark.index :]
        entry = next((pair for pair in node.value if pair[0].value == key), None)
        if entry is None:
            return _inserted(text, node, keys[depth:], value, newline)
        block = block and not node.flow_style
        above, node = entry
        if depth == len(keys) - 1:
            return _replaced(text, above, node, value)
    raise ValueError("no key was given")


def _replaced(text: str, key: yaml.Node, node: yaml.Node, value: object) -> str:
    if node.start_mark.index < key.end_mark.index:
        raise ValueError(f"{key.value} is an alias of another part")
    start = node.start_mark.index
    end = _end(node)
    lead = "" if text[start - 1] in " \t" else " "
    if not getattr(node, "flow_style", True) and node.start_mark.line > key.end_mark.line:
        start, lead = key.end_mark.index + 1, " "  # a block below its key becomes one line beside it
    return text[:start] + lead + flow(value) + text[end:]


def _inserted(text: str, node: yaml.MappingNode, keys: Keys, value: object, newline: str) -> str:
    if node.flow_style:
        last = _end(node.value[-1][1]) if node.value else node.start_mark.index + 1
        return text[:last] + (", " if node.value else "") + flow(_nested(keys, value))[1:-1] + text[last:]
    at = _line_end(text, _end(node.value[-1][1]))  # behind a comment that stands on the same line
    return _put(text, at, keys, value, node.value[0][0].start_mark.column, newline)


def _put(text: str, at: int, keys: Keys, value: object, column: int, newline: str) -> str:
    """Put a key where a line begins, or in place of the example that `rfea init` left for it in the same block."""
    lines = _lines(keys, value, column, newline)
    example = re.compile(rf"[ ]{{{column}}}# {re.escape(keys[0])}: [^\n]*# (?:if )?needed: [^\n]*(\n|$)")
    for start in _block_around(text, at, column):
        if found := example.match(text, start):
            return text[:start] + lines + text[found.end() :]
    lead = "" if at == 0 or text[at - 1] == "\n" else newline
    return text[:at] + lead + lines + text[at:]


def _block_around(text: str, at: int, column: int) -> list[int]:
    """Where the lines begin above a place that stand as far in as its block, and those of comments below it."""
    first = at
    while first > 0 and text.startswith(" " * column, before := text.rfind("\n", 0, first - 1) + 1):
        first = before
    starts = []
    while first < len(text) and (first < at or text[first : _line_end(text, first + 1)].lstrip().startswith("#")):
        starts.append(first)
        first = _line_end(text, first + 1)
    return starts


def _comments_end(text: str, key: yaml.Node, column: int) -> int:
    """Where the comments end that stand below a key, as far in as its keys would."""
    at = _line_end(text, key.end_mark.index)
    while (line := text[at : (after := _line_end(text, at + 1))].lstrip(" ")).startswith("#") and after - at - len(line) >= column:
        at = after
    return at


def _line_end(text: str, index: int) -> int:
    """Where the line behind the one begins in which the character before `index` stands."""
    found = text.find("\n", max(index - 1, 0))
    return len(text) if found < 0 else found + 1


def _end(node: yaml.Node) -> int:
    """Where the text of a node ends; a block's own mark stands behind the comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return node.end_mark.index


def _lines(keys: Keys, value: object, column: int, newline: str) -> str:
    lines = [f"{' ' * (column + INDENT * depth)}{key}:" for depth, key in enumerate(keys)]
    lines[-1] += " " + flow(value)
    return newline.join(lines) + newline


def _nested(keys: Keys, value: object) -> object:
    return value if not keys else {keys[0]: _nested(keys[1:], value)}
