"""How the clocks of a run are brought together, written into its experiment.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rfea_vision.campaign import ExperimentSpec
from rfea_vision.campaign.yaml_file import read_yaml
from rfea_vision.errors import InputError
from rfea_vision.workbench.yaml_edit import set_keys


def write_sync(experiment: ExperimentSpec, asked: dict[str, Any]) -> Path:
    """Write `sync` as the page asks: ``motion``; ``offset`` with `value_ms`; ``led`` with `box` in pixels and `channel`.

    Raises
    ------
    InputError
        If the method needs something that was not given, or the file's form does not allow the change.
    """
    method = asked["method"]
    values: dict[str, Any] = {"method": method}
    if method == "offset":
        values["value"] = f"{float(asked['value_ms']):.3f} ms"
    elif method == "led":
        if not asked.get("channel"):
            raise InputError("sync.channel: is missing; name the column of the log that holds the lamp's signal")
        values |= {"box": [float(number) for number in asked["box"]], "channel": str(asked["channel"])}
    elif method != "motion":
        raise InputError(f"sync.method: '{method}' is set by hand")
    file = experiment.file
    present = read_yaml(file).content.get("sync")
    if isinstance(present, dict):  # what stands beside, and its comments, stay
        gone = {("sync", key): None for key in ("value",) if key in present and key not in values}
        set_keys(file, {("sync", key): value for key, value in values.items()} | gone)
    else:
        set_keys(file, {("sync",): values})
    return file
