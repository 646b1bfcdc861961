"""What the page draws of the artefacts: the report's own records, as one packet."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.report import prose
from rfea_vision.report.collect import Evidence, LadderStep
from rfea_vision.report.pack import Pack
from rfea_vision.report.page import bends_of, length_mm_of
from rfea_vision.report.series import pack_experiment, pack_step
from rfea_vision.workbench.packets import packet


def evidence_packet(evidence: Evidence, title: str) -> bytes:
    """The manifest of the report for this campaign, with what the workbench says beside each rung."""
    pack, titles = Pack(), prose.effect_titles(evidence)
    rungs = [
        pack_step(step, evidence, pack, titles)
        | {
            "effects": list(step.fit.effects),
            "diagnosis": _diagnosis(step, titles),
            "runs": _runs(step),
            "segments": step.fit.segments,
        }
        for step in evidence.steps
    ]
    experiments = [pack_experiment(experiment, pack) for experiment in evidence.experiments]
    for number, experiment in enumerate(experiments):
        if experiment["clip"]:
            experiment["clip"]["address"] = f"clip/{number}"
    manifest = {
        "title": title, "experiments": experiments, "rungs": rungs, "calibration": {"photos": []},
        "length_mm": length_mm_of(evidence), "bends": bends_of(evidence), "headline": prose.headline(evidence, titles),
        "limits": limits_of(evidence),
    }  # fmt: skip
    return packet(manifest, pack)


def _runs(step: LadderStep) -> dict[str, float | None]:
    """Error of each run as it was fitted: of the tip in mm, or of the angle in deg where there is no tip."""
    scores = step.fit.experiments
    return {name: one.angle_rmse_deg if one.tip_rmse_mm is None else one.tip_rmse_mm for name, one in scores.items()}


def _diagnosis(step: LadderStep, titles: Mapping[str, str]) -> dict[str, Any] | None:
    """The diagnosis of one rung as it is saved, with the titles of its effects; None where nobody has asked yet."""
    if step.diagnosis is None:
        return None
    record = step.diagnosis.model_dump(mode="json")
    for candidate in record.get("candidates", []):
        candidate["title"] = titles.get(candidate["effect"], candidate["effect"])
    return record


#: Over this time a change of pressure is told from the sensor's noise.
CHANGE_S = 0.02


def limits_of(evidence: Evidence) -> dict[str, float] | None:
    """Lowest and highest pressure (kPa) that the rig has had, and how fast (kPa/s) it has changed it; None without a log."""
    logs = [run.recording for run in evidence.experiments if run.recording is not None and "pressure" in run.recording]
    low, high, slope = 0.0, 0.0, 0.0
    for log in logs:
        time, pressure = log["log_time"].values, log["pressure"].values
        apart = max(1, round(CHANGE_S / float(np.median(np.diff(time)))))
        low, high = min(low, float(pressure.min())), max(high, float(pressure.max()))
        slope = max(slope, float(np.max(np.abs(pressure[apart:] - pressure[:-apart]) / (time[apart:] - time[:-apart]))))
    return {"low": low, "high": high, "slope": slope} if logs else None


#: Results that the page draws.
DRAWN = ("ladder.json", "*/track.nc", "*/recording.nc", "*/clip.json", "models/*/*.json", "models/*/prediction.nc")


def stamps(folder: Path, *patterns: str) -> tuple[tuple[str, int, int], ...]:
    """Files of a folder, each with its time of change (ns) and its size (bytes); what is still being written is no file yet."""
    found = []
    for file in {file for pattern in patterns for file in folder.glob(pattern) if not file.name.startswith(".")}:
        with suppress(FileNotFoundError):  # has just been taken away
            now = file.stat()
            found.append((str(file), now.st_mtime_ns, now.st_size))
    return tuple(sorted(found))
