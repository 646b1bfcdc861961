"""How long a verdict takes: four experiments of 20 s at 240 frames/s, 16 segments, one effect hidden, or one that no name fits."""

from __future__ import annotations

import time
from typing import Any

from benchmarks.probable_campaigns import by_twin
from rfea_vision.critique import improve
from rfea_vision.critique.diagnosis import judge
from rfea_vision.fitting.fit import fit, make_problem
from rfea_vision.options import FitOptions
from rfea_vision.twin import TwinOptions

CASES = {
    "maxwell hidden": {"maxwell.k1": 0.05, "maxwell.T": 0.9},
    "fan blowing, no name fits": {"fan.F": 0.05},
}


def run() -> list[dict[str, Any]]:
    """Wall-clock seconds of `diagnose` (from a fitted model) and of `improve` (from nothing)."""
    rows = []
    for label, hidden in CASES.items():
        options = TwinOptions(
            hidden=hidden, seed=5, duration_s=20.0, joints=24, roles=("train", "train", "train", "validate")
        )
        recordings, actuator = by_twin(options)
        problem = make_problem(recordings, actuator)
        fitted = fit(problem, FitOptions())
        begun = time.perf_counter()
        diagnosis = judge(problem, fitted).diagnosis
        diagnose_s = time.perf_counter() - begun
        begun = time.perf_counter()
        improve(recordings, actuator, FitOptions())
        improve_s = time.perf_counter() - begun
        said = f"{label}: {diagnosis.verdict} {', '.join(diagnosis.named)}".strip()
        rows += [_row(f"diagnose, {label}", diagnose_s, 60, said), _row(f"improve, {label}", improve_s, 300, said)]
    return rows


def _row(name: str, seconds: float, target: float, said: str) -> dict[str, Any]:
    return {
        "name": name,
        "value": round(seconds, 1),
        "unit": "s",
        "target": f"<= {target:g}",
        "met": seconds <= target,
        "against": f"four experiments of 20 s, 16 segments; {said}",
    }
