"""Which version a row speaks for."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path


@cache
def commit() -> str:
    """The commit that is run, short, with a plus where the package is not as committed; empty outside of a repository."""
    here = Path(__file__).parent

    def told(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=False).stdout.strip()

    return told("rev-parse", "--short", "HEAD") + (
        "+" if told("status", "--porcelain", "--untracked-files=no", "--", "../rfea_vision") else ""
    )
