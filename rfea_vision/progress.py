"""How a stage tells its surroundings what it does; the command line draws bars, Python users may stay silent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

Progress = Callable[[int, int], None]
Outcome = Literal["done", "unchanged", "failed"]


class Listener:
    """Hears of every stage; this one says nothing."""

    def begin(self, stage: str, subject: str) -> Progress:
        """Hear that a stage starts; the function returned is called as ``progress(done, total)``."""
        return lambda done, total: None

    def end(self, stage: str, subject: str, outcome: Outcome, sentence: str) -> None:
        """Hear how the stage ended."""

    def note(self, sentence: str) -> None:
        """Hear something worth saying while a stage runs, such as a new rung of the ladder."""
