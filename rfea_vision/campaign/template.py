"""An empty campaign to fill in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from rfea_vision.data import template
from rfea_vision.errors import InputError
from rfea_vision.files import write_text

_RUNS = (("run-1", "train"), ("run-2", "validate"))
#: What most real films need below `camera`, and some rigs: each a line that holds once its first '#' is gone and its numbers are yours.
CAMERA_EXAMPLES = """\
  # clamp: [[x, y], [x, y]]  # if needed: both ends of the first visible cross-section, px of frame 0; 'rfea open' points at them
  # tip: [x, y]  # if needed: the middle of the tube's end, px of frame 0
  # vertical: rest  # if needed: board: its rows are level (default) | rest: the resting tube hangs straight | image: its rows are level
"""
RIG_EXAMPLE = """\
# rig: {gravity: down}  # if needed: gravity in the frame in which the unloaded tube points down: down | up | left | right | none
"""


def write_campaign_template(folder: Path) -> list[Path]:
    """Write campaign.yaml and two experiments with comments, and return the files.

    Raises
    ------
    InputError
        If one of the files is there already: nothing is overwritten.
    """
    pages = {folder / "campaign.yaml": template("campaign.yaml").format(name=campaign_name(folder)) + CAMERA_EXAMPLES + RIG_EXAMPLE}
    run_page = template("experiment.yaml")
    pages |= {folder / run / "experiment.yaml": run_page.format(name=run, role=role) for run, role in _RUNS}
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; choose another folder")
    write_new(pages)
    (folder / "calibration").mkdir(exist_ok=True)
    return list(pages)


def campaign_name(folder: Path) -> str:
    """What a campaign in a folder is called: as the folder, with a dash for each character that YAML might misread."""
    return re.sub(r"[^\w .-]", "-", folder.resolve().name) or "campaign"


def write_new(pages: Mapping[Path, str]) -> None:
    """Write texts by their files, all or none; InputError if one of the files is there already."""
    for path in pages:
        if path.exists():
            raise InputError(f"{path}: is there already and is left as it is; choose another folder")
    for path, text in pages.items():
        write_text(path, text)
