"""Libraries are loaded when something first needs them, so that the page is there before them."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from threading import Lock
from types import ModuleType

_IMPORTING = Lock()


@cache
def loaded(name: str) -> ModuleType:
    """A module of the package, imported by one thread at a time: two that import each other's modules would see them half loaded."""
    with _IMPORTING:
        return import_module(f"rfea_vision.{name}")
