"""Which effect files may run: those that a person named, on the command line or in a program of their own.

A recipe, or the record of an earlier fit, names files too, but a campaign comes with those, and may be a stranger's.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rfea_vision.errors import InputError

_named: set[Path] = set()


def name_files(files: Iterable[Path | str]) -> None:
    """Let these files run in this process."""
    _named.update(Path(file).resolve() for file in files)


def refuse_unnamed(path: Path) -> None:
    """Raise unless the file has been named.

    Raises
    ------
    InputError
        If it has not.
    """
    if path.resolve() not in _named:
        raise InputError(
            f"{path}: is an effect file, whose code runs only where the command names it; give --effect-file {path} if you trust it"
        )
