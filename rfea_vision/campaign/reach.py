"""What a campaign may make this machine read: what lies below its own folder, and nothing else."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

REMEDY = "copy it into the campaign, or give --trust if you trust whoever wrote this campaign"


@dataclass(frozen=True)
class Reach:
    """The folder that a campaign may read; with `trusted` it may read whatever the user may.

    What counts is where a path ends, after ``..`` and links: an absolute path into the folder is fine.
    """

    root: Path
    trusted: bool = False

    @property
    def within(self) -> Path | None:
        """The folder that nothing may lead out of; None where anything may be read."""
        return None if self.trusted else self.root

    def path(self, base: Path, name: str) -> Path | None:
        """The path behind a `name` that a file gives, with links followed; None if no path can be called so."""
        try:
            return (base / (Path(name).expanduser() if self.trusted else name)).resolve()
        except (OSError, RuntimeError, ValueError):  # a loop of links, a user that is not there, a null character
            return None

    def refusal(self, path: Path) -> str | None:
        """Why a path, with links followed, may not be read; None if it may."""
        if self.trusted or path.is_relative_to(self.root):
            return None
        return f"leads out of the campaign's folder, to {path}; {REMEDY}"

    def link_out(self, folder: Path) -> Path | None:
        """The first link at or below `folder` that leads out of what may be read, and out of `folder`."""
        if self.trusted:
            return None
        if self.refusal(folder.resolve()) is not None:
            return folder
        for place, folders, files in os.walk(folder):
            for name in (*folders, *files):
                path = Path(place, name)
                if path.is_symlink() and self.refusal(path.resolve()) is not None:
                    return path
        return None
