"""A result that is on disk, read when somebody looks at it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

_Value = TypeVar("_Value")


class Stored(Generic[_Value]):
    """The result of a stage: known to be up to date, loaded on first use.

    A command that finds everything unchanged reads only what it prints.
    """

    def __init__(self, load: Callable[[], _Value], facts: Mapping[str, object] | None = None) -> None:
        self._load = load
        self._loaded: list[_Value] = []
        #: what its record says of it, or nothing
        self.facts: Mapping[str, Any] = facts or {}

    @classmethod
    def of(cls, value: _Value, facts: Mapping[str, object] | None = None) -> Stored[_Value]:
        """Return a result that is in memory already."""
        return cls(lambda: value, facts)

    @property
    def value(self) -> _Value:
        """The result itself."""
        if not self._loaded:
            self._loaded.append(self._load())
        return self._loaded[0]


def values(stored: Mapping[str, Stored[_Value]]) -> dict[str, _Value]:
    """Load all of them."""
    return {name: item.value for name, item in stored.items()}
