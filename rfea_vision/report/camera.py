"""Reads `camera.yaml` (OpenCV FileStorage) with PyYAML: the report shows the calibration, it does not use it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import yaml

# OpenCV escapes an apostrophe inside double quotes, which YAML does not know.
_APOSTROPHE = re.compile(r"(?<!\\)((?:\\\\)*)\\'")


# OpenCV writes .Nan, which YAML takes for a word: it knows .nan, .NaN and .NAN.
_NOT_A_NUMBER = re.compile(r"\.Nan\b")


class _Loader(yaml.SafeLoader):
    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):  # a stranger's, which could stand for more than any memory holds
            raise yaml.YAMLError("it has aliases, which OpenCV does not write")
        return super().compose_node(parent, index)


def _matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> list[list[float]]:
    record = loader.construct_mapping(node, deep=True)
    columns = int(record["cols"])
    data = [float(value) for value in record["data"]]
    return [data[start : start + columns] for start in range(0, len(data), columns)]


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def read_camera(path: Path) -> dict[str, Any]:
    """Keys of the file as plain numbers, lists and text; ``photos`` and ``quality`` are parsed from their JSON.

    Raises
    ------
    ValueError
        If the file is not YAML or has no ``camera_matrix``.
    """
    text = path.read_text(encoding="utf-8")
    if text.startswith("%YAML"):  # OpenCV writes "%YAML:1.0", which is not a YAML directive
        text = text.split("\n", 1)[1]
    text = _NOT_A_NUMBER.sub(".nan", _APOSTROPHE.sub(r"\1'", text))
    try:
        record = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ValueError(f"not an OpenCV YAML file: {error}") from error
    if not isinstance(record, dict) or "camera_matrix" not in record:
        raise ValueError("camera_matrix is missing")
    for key, value in list(record.items()):
        if key.endswith("_json") and isinstance(value, list):  # long text, cut in pieces that begin with a bar
            record[key.removesuffix("_json")] = json.loads("".join(str(piece)[1:] for piece in value))
    return record
