"""What can be asked of the worker, and the command that does the same."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rfea_vision.errors import InputError
from rfea_vision.options.fit import SEGMENTS

#: Methods of `stages.Workspace` and the options that the page may set.
ORDERS: dict[str, tuple[str, ...]] = {
    "calibrate": (),
    "track": ("names",),
    "sync": ("names",),
    "fit": ("name", "add", "effect_files", "start", "segments"),
    "compare": (),
    "diagnose": ("model", "effect_files"),
    "improve": ("effect_files",),
    "propose": ("model", "file", "effect_files"),
    "report": (),
}


def order(campaign: str, out: Path | None, do: str, options: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Options of a job as the stage takes them, and the command line.

    Parameters
    ----------
    campaign : folder as the user wrote it
    out : folder of results, where it is not the campaign's own
    do : name of the command
    options : as the page sends them

    Raises
    ------
    InputError
        If the page asks for something that is not on offer.
    """
    if do not in ORDERS or not set(options) <= set(ORDERS[do]):
        raise InputError(f"{do}: the workbench offers {', '.join(ORDERS)}; other options are the command line's")
    kept = {key: value for key, value in options.items() if value not in (None, [], {}, "")}
    if kept.get("segments") == SEGMENTS:
        kept.pop("segments")  # as ever
    words = ["rfea", do, campaign]
    if "model" in kept:
        words.append(str(kept["model"]))
    for key, flag in (("names", "-e"), ("add", "--add"), ("effect_files", "--effect-file")):
        words += [word for item in _listed(kept.get(key)) for word in (flag, item)]
    words += [word for name, text in kept.get("start", {}).items() for word in ("--start", f"{name}={text}")]
    words += ["--segments", str(kept["segments"])] if "segments" in kept else []
    words += ["-o", str(kept["file"])] if "file" in kept else []
    words += ["--name", str(kept["name"])] if "name" in kept else []
    words += ["--out", str(out)] if out is not None else []
    if "start" in kept:
        kept["start"] = tuple(f"{name}={text}" for name, text in kept["start"].items())
    return kept, shlex.join(words)


def _listed(value: object) -> Sequence[str]:
    return [str(item) for item in value] if isinstance(value, list) else []
