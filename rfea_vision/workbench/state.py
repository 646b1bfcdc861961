"""Where a campaign stands, read from its files, beside its figures."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from rfea_vision.artefacts.reasons import reason_of
from rfea_vision.campaign import Campaign, ExperimentSpec, Reading, read_campaign
from rfea_vision.options.fit import SEGMENTS
from rfea_vision.report.camera import read_camera
from rfea_vision.stages.cache import StageCache, as_json
from rfea_vision.stages.warnings import DOUBTS, is_doubt
from rfea_vision.workbench.guide import mend, next_step, point_at_scale
from rfea_vision.workbench.scales import is_scaled, scale_told

#: Hints that one can point at: fields of `artefacts.Hints`, keys below `camera` in the files.
HINTS = ("clamp", "tip", "centre_line", "corrections", "region", "exclude")


def state_of(folder: Path, out: Path | None, failed: str = "") -> dict[str, Any]:
    """Everything about a campaign that the page shows beside its figures; `failed` as in `guide.next_step`."""
    reading = read_campaign(folder, out)
    campaign = reading.campaign
    errors = [problem for problem in reading.problems if problem.severity == "error"]
    problems = [str(problem) for problem in errors]
    if campaign is None:
        return {
            "name": folder.name,
            "problems": problems,
            "experiments": [],
            "models": [],
            "photos": [],
            "report": False,
            "next": mend(problems),
        }
    cache = StageCache(campaign.out)
    experiments = [_experiment(campaign, item, cache) for item in runs_of(reading)]
    models, report = _models(campaign.out), _report(campaign.out)
    state = {
        "name": campaign.name, "folder": str(campaign.root), "problems": problems, "experiments": experiments,
        "models": models, "photos": _photos(campaign), "report": report is not None,
    }  # fmt: skip
    if not problems:
        return state | {"next": next_step(experiments, models, report, failed)}
    others = sum(problem.key.split(".")[0] != "camera" for problem in errors)
    return state | {"next": point_at_scale(experiments, others) or mend(problems)}


def runs_of(reading: Reading) -> list[ExperimentSpec]:
    """The runs of a campaign in the order of their folders, those with mistakes too: their films help to mend them."""
    runs = [*reading.campaign.experiments, *reading.broken] if reading.campaign is not None else []
    return sorted((item for item in runs if item.role != "ignore"), key=lambda item: item.folder)


def _experiment(campaign: Campaign, item: ExperimentSpec, cache: StageCache) -> dict[str, Any]:
    camera, sync = item.camera, item.sync
    folder = campaign.out / item.name
    return {
        "name": item.name,
        "role": item.role,
        "pictures": item.video is not None and item.video.found,
        "logged": not item.pressure.missing,
        "hints": {key: as_json(getattr(camera.hints, key)) for key in HINTS} if camera is not None else {},
        "scale": scale_told(campaign, item),
        "pointable": _pointable(campaign, item),
        "sync": {"method": sync.method, "value_s": sync.value, "box": sync.lamp_box, "channel": sync.channel},
        "bends": item.actuator.bends,
        "tracked": _track(folder / "track.nc"),
        "changed": _changed(item, cache),
        "recorded": _clock(folder / "recording.nc"),
    }


def _pointable(campaign: Campaign, item: ExperimentSpec) -> tuple[str, ...]:
    """What one can point at: first the scale, if nothing gives it; where a board does, only the rest."""
    if not is_scaled(campaign, item):
        return ("scale",)
    calibrated = item.camera is not None and item.camera.scale is None
    return HINTS if calibrated else ("scale", *HINTS)


def _changed(item: ExperimentSpec, cache: StageCache) -> bool:
    """Whether the track was made with other hints than those that now stand in the files."""
    record = cache.record(f"track/{item.name}")
    if record is None or item.camera is None or "camera" not in record.options:
        return False
    now, then = as_json(item.camera.hints), record.options["camera"].get("hints", {})
    return any((then.get(key) or None) != (now[key] or None) for key in HINTS)


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
    return {"frames": int(valid.size), "good": int(valid.sum()), "reasons": _counted(reasons)}


def _counted(reasons: list[str]) -> list[dict[str, Any]]:
    """Refused frames by reason, most frequent first."""
    return [
        {
            "reason": code,
            "frames": count,
            "words": (why := reason_of(code)).words,
            "tool": why.tool,
            "button": why.button,
        }
        for code, count in Counter(reasons).most_common()
    ]


def _clock(file: Path) -> dict[str, Any] | None:
    """Offset of the clocks and its standard error in ms, and what is doubted of the run; None before synchronisation."""
    try:
        with h5netcdf.File(file, "r") as data:
            keys = ("sync_method", "offset_s", "offset_stderr_s", *DOUBTS)
            found = {key: text.decode() if isinstance(text := data.attrs.get(key), bytes) else text for key in keys}
    except OSError:
        return None
    if found["offset_s"] is None:
        return None
    said = {key: str(found[key]) for key in DOUBTS if found[key]}
    return {
        "method": str(found["sync_method"]),
        "doubts": "; ".join(text for key, text in said.items() if is_doubt(key, text)),
        "offset_ms": 1e3 * float(found["offset_s"]),
        "stderr_ms": None if found["offset_stderr_s"] is None else 1e3 * float(found["offset_stderr_s"]),
    }


def _photos(campaign: Campaign) -> list[dict[str, str]]:
    """Photos of the board with what the calibration says of each."""
    said: dict[str, dict[str, Any]] = {}
    with suppress(OSError, ValueError):
        record = read_camera(campaign.out / "calibration" / "camera.yaml")
        said = {str(item.get("file")): item for item in record.get("photos") or []}
    found = []
    for photo in campaign.camera.photos if campaign.camera else ():
        one = said.get(photo.name, {})
        error = f"{one['rms_px']:.3f} px" if isinstance(one.get("rms_px"), float) else ""
        found.append({"name": photo.name, "note": str(one.get("reason") or "") or error})
    return found


def _models(out: Path) -> list[dict[str, Any]]:
    """Models in the order of their effects, with the verdict where one has been asked for."""
    found = []
    for file in sorted(
        out.glob("models/*/model.json"), key=lambda path: (path.parent.name.count("+"), path.parent.name)
    ):
        fit, diagnosis = _json(file), _json(file.with_name("diagnosis.json"))
        found.append({
            "name": file.parent.name, "effects": fit.get("effects", []),
                "segments": fit.get("segments", SEGMENTS), "verdict": diagnosis.get("verdict"),
            "asks_less": diagnosis.get("asks_less", False), "uncertain": diagnosis.get("uncertain", False),
            "uncertain_because": diagnosis.get("uncertain_because", ""),
            "named": diagnosis.get("named", []), "candidates": diagnosis.get("candidates", []),
            "held_out": _held_out(fit),
        })  # fmt: skip
    return found


def _report(out: Path) -> str | None:
    """Path of the report, if it is younger than every model and diagnosis."""
    report = out / "report" / "index.html"
    told = [file.stat().st_mtime_ns for file in out.glob("models/*/*.json")]
    return str(report) if report.is_file() and report.stat().st_mtime_ns >= max(told, default=0) else None


def _held_out(fit: dict[str, Any]) -> dict[str, Any] | None:
    """Error of a model on the runs that judge it, of the tip in mm or else of the angle in deg; None without such runs."""
    known = (fit.get("metrics") or {}).get("validate") or {}
    for key, unit in (("tip_rmse_mm", "mm"), ("angle_rmse_deg", "deg")):
        if known.get(key) is not None:
            return {"value": known[key], "unit": unit}
    return None


def _json(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
