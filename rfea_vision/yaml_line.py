"""Values as YAML on one line, as people write them and as errors advise them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import yaml


def flow(value: object) -> str:
    """A value as YAML on one line; text has quotes wherever YAML might read something else into it."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(flow, value)) + "]"
    if not isinstance(value, str | Path):
        return json.dumps(value)
    text = str(value)
    plain = text.strip() == text != "" and all(sign.isalnum() or sign in " .+-_^/%" for sign in text)
    return text if plain and yaml.safe_load(f"[{text}]") == [text] else json.dumps(text, ensure_ascii=False)
