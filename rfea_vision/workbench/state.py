"""Where a campaign stands, read from its files, and the one thing to do next."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from rfea_vision.campaign import Campaign, ExperimentSpec, read_campaign
from rfea_vision.stages.cache import StageCache, plain

#: Hints that one can point at: fields of `artefacts.Hints`, keys below `camera` in the files.
POINTABLE = ("clamp", "tip", "region", "exclude")
#: Share of refused frames from which the films come before the model.
MANY_REFUSED = 0.2


def state_of(folder: Path, out: Path | None) -> dict[str, Any]:
    """Everything about a campaign that the page shows beside its figures."""
    reading = read_campaign(folder, out)
    campaign = reading.campaign
    problems = [str(problem) for problem in reading.problems if problem.severity == "error"]
    if campaign is None:
        return {
            "name": folder.name,
            "problems": problems,
            "experiments": [],
            "models": [],
            "photos": [],
            "next": _mend(problems),
        }
    cache = StageCache(campaign.out)
    experiments = [_experiment(campaign, item, cache) for item in campaign.experiments if item.role != "ignore"]
    models = _models(campaign.out)
    photos = campaign.camera.photos if campaign.camera else ()
    state = {
        "name": campaign.name, "folder": str(campaign.root), "problems": problems, "experiments": experiments,
        "models": models, "photos": [photo.name for photo in photos],
    }  # fmt: skip
    return state | {"next": _mend(problems) if problems else next_step(experiments, models)}


def _experiment(campaign: Campaign, item: ExperimentSpec, cache: StageCache) -> dict[str, Any]:
    camera, sync = item.camera, item.sync
    folder = campaign.out / item.name
    return {
        "name": item.name,
        "role": item.role,
        "pictures": item.video is not None,
        "hints": {key: plain(getattr(camera.hints, key)) for key in POINTABLE} if camera is not None else {},
        "sync": {"method": sync.method, "value_s": sync.value_s, "box": sync.box, "channel": sync.channel},
        "bends": item.actuator.bends,
        "tracked": _track(folder / "track.nc"),
        "changed": _changed(item, cache),
        "recorded": _clock(folder / "recording.nc"),
    }


def _changed(item: ExperimentSpec, cache: StageCache) -> bool:
    """Whether the track was made with other hints than those that now stand in the files."""
    record = cache.record(f"track/{item.name}")
    return record is not None and "camera" in record.options and record.options["camera"] != plain(item.camera)


def _track(file: Path) -> dict[str, Any] | None:
    """Frames, how many were refused, and why; None before tracking, or where the file cannot be read."""
    try:
        with h5netcdf.File(file, "r") as data:
            valid = np.asarray(data["valid"], dtype=bool)
            reasons = [
                text.decode() if isinstance(text, bytes) else str(text) for text in np.asarray(data["reason"])[~valid]
            ]
    except (OSError, KeyError):
        return None
    return {"frames": int(valid.size), "good": int(valid.sum()), "reasons": dict(Counter(reasons).most_common())}


def _clock(file: Path) -> dict[str, Any] | None:
    """Offset of the clocks and its standard error in ms; None before synchronisation."""
    try:
        with h5netcdf.File(file, "r") as data:
            found = {key: data.attrs.get(key) for key in ("sync_method", "offset_s", "offset_stderr_s")}
    except OSError:
        return None
    if found["offset_s"] is None:
        return None
    method = found["sync_method"]
    return {
        "method": method.decode() if isinstance(method, bytes) else str(method),
        "offset_ms": 1e3 * float(found["offset_s"]),
        "stderr_ms": None if found["offset_stderr_s"] is None else 1e3 * float(found["offset_stderr_s"]),
    }


def _models(out: Path) -> list[dict[str, Any]]:
    """Models in the order of their effects, with the verdict where one has been asked for."""
    found = []
    for file in sorted(
        out.glob("models/*/model.json"), key=lambda path: (path.parent.name.count("+"), path.parent.name)
    ):
        diagnosis = _json(file.with_name("diagnosis.json"))
        found.append({
            "name": file.parent.name, "effects": _json(file).get("effects", []), "verdict": diagnosis.get("verdict"),
            "named": diagnosis.get("named", []), "candidates": diagnosis.get("candidates", []),
        })  # fmt: skip
    return found


def _json(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _mend(problems: list[str]) -> dict[str, Any]:
    more = f" and {len(problems) - 1} more" if len(problems) > 1 else ""
    return {
        "panel": "setup",
        "say": f"The campaign cannot be read yet: {problems[0]}{more}",
        "label": "Look again",
        "do": None,
    }


def next_step(experiments: list[dict[str, Any]], models: list[dict[str, Any]]) -> dict[str, Any]:
    """The one action that brings the campaign on: its panel, a sentence, a label and the job."""
    unmeasured = [item["name"] for item in experiments if item["recorded"] is None or item["changed"]]
    if unmeasured:
        never = [item for item in experiments if item["tracked"] is None and item["pictures"]]
        say = "The films have not been measured yet." if never else "Hints have changed since the films were measured."
        return {"panel": "setup", "say": say, "label": "Measure the films", "do": "sync", "options": {}}
    lost = [
        item["name"] for item in experiments if item["tracked"]["good"] < (1 - MANY_REFUSED) * item["tracked"]["frames"]
    ]
    if lost and not models:
        say = f"Many frames of {lost[0]} were refused: look why."
        return {"panel": "setup", "say": say, "label": "See the refused frames", "do": None, "experiment": lost[0]}
    if not models:
        return {
            "panel": "play",
            "say": "Everything is measured.",
            "label": "Fit the paper's model",
            "do": "fit",
            "options": {"add": []},
        }
    last = max(models, key=lambda model: (len(model["effects"]), model["verdict"] is not None))
    if last["verdict"] is None:
        say = f"{last['name']} is fitted; what it lacks has not been asked yet."
        return {
            "panel": "add",
            "say": say,
            "label": "Ask what is missing",
            "do": "diagnose",
            "options": {"model": last["name"]},
        }
    if last["verdict"] == "missing" and last["named"]:
        effects = [*last["effects"], *[name for name in last["named"] if name not in last["effects"]]]
        say = f"{last['name']} lacks {' and '.join(last['named'])}."
        return {
            "panel": "add",
            "say": say,
            "label": f"Add {last['named'][0]} and watch",
            "do": "fit",
            "options": {"add": effects},
        }
    if last["verdict"] == "unexplained":
        say = "Something is left that no effect in the catalogue explains."
        return {"panel": "law", "say": say, "label": "Write a law of your own", "do": None}
    return {
        "panel": "add",
        "say": "Nothing that matters is missing.",
        "label": "Write the report",
        "do": "report",
        "options": {},
    }
