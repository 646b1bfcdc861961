"""How long a verdict takes, at 16 segments.

Four experiments of 20 s at 240 frames/s, one effect hidden, or one that no name fits; and three of 60 s of which an inclinometer
of 25 Hz has seen the angle alone, of a tube that is bent at rest, creeps and follows its pressure late.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from benchmarks.probable_campaigns import by_twin
from rfea_vision.critique import improve
from rfea_vision.critique.diagnosis import judge
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.problem import make_problem
from rfea_vision.options import FitOptions
from rfea_vision.twin import TwinOptions

FILMED = TwinOptions(seed=5, duration_s=20.0, joints=24, roles=("train", "train", "train", "validate"))
ANGLE_ALONE = TwinOptions(seed=4, duration_s=60.0, rate_Hz=25.0, observe="angle", roles=("train", "train", "validate"))
CASES = {
    "maxwell hidden": replace(FILMED, hidden={"maxwell.k1": 0.05, "maxwell.T": 0.9}),
    "fan blowing, no name fits": replace(FILMED, hidden={"fan.F": 0.05}),
    "angle alone, three effects hidden": replace(
        ANGLE_ALONE,
        hidden={"maxwell.k1": 0.3, "maxwell.T": 1.2, "pressure_lag.T": 0.06, "rest_curvature.angle": 0.5},
    ),
}


def run() -> list[dict[str, Any]]:
    """Wall-clock seconds of `diagnose` (from a fitted model) and of `improve` (from nothing)."""
    rows = []
    for label, options in CASES.items():
        recordings, actuator = by_twin(options)
        problem = make_problem(recordings, actuator)
        fitted = fit(problem, FitOptions())
        begun = time.perf_counter()
        diagnosis = judge(problem, fitted).diagnosis
        diagnose_s = time.perf_counter() - begun
        begun = time.perf_counter()
        ladder = improve(recordings, actuator, FitOptions())
        improve_s = time.perf_counter() - begun
        runs = f"{len(options.roles)} experiments of {options.duration_s:g} s, 16 segments"
        said = f"{runs}; {diagnosis.verdict} {', '.join(diagnosis.named)}".strip()
        last = ladder.rungs[-1]
        rows += [
            _row(f"diagnose, {label}", diagnose_s, 60, said),
            _row(f"improve, {label}", improve_s, 300, f"{runs}; {last.model}: {last.verdict}"),
        ]
    return rows


def _row(name: str, seconds: float, target: float, said: str) -> dict[str, Any]:
    return {
        "name": name,
        "value": round(seconds, 1),
        "unit": "s",
        "target": f"<= {target:g}",
        "met": seconds <= target,
        "against": said,
    }
