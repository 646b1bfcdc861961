"""Tubes of the second plant behind valves that fill and drain at rates of their own: is the line named, and what is left?"""

from __future__ import annotations

import sys
from typing import Any

from benchmarks.probable_campaigns import Case, recordings_of
from rfea_vision.critique.diagnosis import judge
from rfea_vision.fitting import FitOptions
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.problem import make_problem
from testing.valves import behind_a_valve

#: Time constants (s) while they fill and while they drain, by seed; all were looked at when the search was taught to try every form.
SEEN = {
    9000: (0.03, 0.12), 9001: (0.1, 0.02), 9002: (0.05, 0.09), 9003: (0.15, 0.05), 9004: (0.02, 0.3), 9005: (0.08, 0.08),
    9100: (0.04, 0.16), 9101: (0.2, 0.06), 9102: (0.06, 0.12), 9103: (0.12, 0.03), 9104: (0.015, 0.08), 9105: (0.25, 0.1),
}  # fmt: skip
#: Drawn before, and run once.
UNSEEN = {9200: (0.05, 0.1), 9201: (0.03, 0.2), 9202: (0.1, 0.05), 9203: (0.18, 0.09), 9204: (0.07, 0.02), 9205: (0.04, 0.07)}


def run() -> list[dict[str, Any]]:
    """Rows of both sets."""
    return [_row("seen", SEEN), _row("unseen", UNSEEN)]


def _row(which: str, valves: dict[int, tuple[float, float]]) -> dict[str, Any]:
    told, right = [], 0
    for seed, (fill_s, drain_s) in valves.items():
        case = Case("other", seed, "single", {}, (("pressure_lag",),), angle_only=False)
        recordings, actuator = recordings_of(
            case, felt=lambda pressure, step_s: behind_a_valve(pressure, step_s, fill_s, drain_s)  # noqa: B023 - called at once
        )
        problem = make_problem(recordings, actuator)
        judgement = judge(problem, fit(problem, FitOptions(segments=8, starts=0)))
        search, best = judgement.search, judgement.verdict.best
        before, left = (one.errors.held / search.floor for one in (search.present, best))
        named = " and ".join(judgement.diagnosis.named) or "nothing"
        right += judgement.diagnosis.named == ["pressure_lag"]
        told.append(f"{fill_s:g} and {drain_s:g} s: {named}, {before:.1f} to {left:.2f} floors")
        sys.stderr.write(f"{told[-1]}\n")
    return {
        "name": f"valves, {which} ({len(valves)}): the line alone is named",
        "value": right,
        "unit": "campaigns",
        "target": str(len(valves)),
        "met": right == len(valves),
        "against": "; ".join(told),
    }
