"""One key of a YAML file set, and not a byte of the rest touched: what people wrote, and how, is theirs.

The parser says where the value stands; the text between is replaced. What comes out is parsed again and must differ from
what went in by that key alone, else nothing is written.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rfea_vision.campaign.yaml_file import flow
from rfea_vision.errors import InputError
from rfea_vision.files import whole_file

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
    try:
        text = file.read_bytes().decode("utf-8")
        for keys, value in values.items():
            text = with_key(text, keys, value)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{file}: cannot be changed ({' '.join(str(error).split())}); set the key by hand") from error
    except ValueError as error:
        raise InputError(f"{file}: {error}; set the key by hand") from error
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
    above = None
    for depth, key in enumerate(keys):
        if not isinstance(node, yaml.MappingNode):
            nested = _nested(keys[depth:], value)
            if above is not None:
                return _replaced(text, above, node, nested)
            return text[: node.start_mark.index] + flow(nested) + text[node.end_mark.index :]
        entry = next((pair for pair in node.value if pair[0].value == key), None)
        if entry is None:
            return _inserted(text, node, keys[depth:], value, newline)
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
    last = _end(node.value[-1][1])
    line_end = text.find("\n", max(last - 1, 0))  # behind a comment that stands on the same line
    at = len(text) if line_end < 0 else line_end + 1
    lead = newline if line_end < 0 else ""
    return text[:at] + lead + _lines(keys, value, node.value[0][0].start_mark.column, newline) + text[at:]


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
