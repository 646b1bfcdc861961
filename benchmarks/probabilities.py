"""Are the critique's probabilities right as often as they say? ``python -m benchmarks.probabilities --plant other``.

Every finished campaign is one line of ``probabilities/results.jsonl``, with the commit that it was run with; an interrupted run
goes on where it stopped. ``--tables`` writes docs/probabilities.md from these lines, and from nothing else.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._commit import commit
from benchmarks.probability_sweep import imitations, sweep
from benchmarks.probability_tables import DOCUMENT, diagram, document
from benchmarks.probable_campaigns import Case, draw, recordings_of
from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.critique.diagnosis import Judgement, judge
from rfea_vision.critique.trials import Trial
from rfea_vision.errors import RfeaError
from rfea_vision.files import write_text
from rfea_vision.fitting import FitOptions
from rfea_vision.fitting.fit import fit, stiff_start
from rfea_vision.fitting.problem import make_problem

FOLDER = Path(__file__).parent / "probabilities"
RESULTS = FOLDER / "results.jsonl"
#: Counts made since an imitated effect keeps less than 0.9: its number comes from those before.
SINCE_IMITATED = (
    *("imitated.jsonl", "rivals.jsonl", "steps.jsonl", "third_order.jsonl", "exact_starts.jsonl", "single_leaps.jsonl"),
    "every_form.jsonl",
)
#: Seeds that the rule was calibrated on, and those that are run once. All below the latter were looked at since.
CALIBRATED, UNSEEN = range(1301, 1341), range(2932, 3182)


def run_case(
    case: Case, made: Callable[[Case], tuple[dict[str, Recording], Actuator]] = recordings_of
) -> dict[str, Any]:
    """Make one campaign, diagnose its base model, and note what was said beside the truth."""
    started, processor = time.perf_counter(), time.process_time()
    recordings, actuator = made(case)
    problem = make_problem(recordings, actuator)
    judgement = judge(problem, fit(problem, FitOptions(segments=8, starts=0)))
    return {
        "key": case.key,
        "plant": case.plant,
        "seed": case.seed,
        "kind": case.kind,
        "hidden": {k: float(f"{v:.4g}") for k, v in case.hidden.items()},
        "right": list(case.right),
        "angle_only": case.angle_only,
        **_said(judgement),
        **_told(judgement, case),
        "seconds": round(time.perf_counter() - started, 1),
        "processor_s": round(time.process_time() - processor, 1),
    }


def _said(judgement: Judgement) -> dict[str, Any]:
    diagnosis, search = judgement.diagnosis, judgement.search
    now = search.present
    return {
        "verdict": diagnosis.verdict,
        "named": diagnosis.named,
        "tied": [tie.effects for tie in diagnosis.tied],
        "sufficient": diagnosis.sufficient,
        "floors": round(now.errors.held / search.floor, 3),
        "left": round(judgement.verdict.best.errors.held / search.floor, 3),
        "share": judgement.verdict.share,
        "probability": {name: round(p, 5) for name, p in judgement.verdict.probability.items()},
        "untried": [
            row.effect
            for row in diagnosis.candidates
            if not row.refitted and row.effect not in judgement.verdict.probability
        ],
        # What the rule weighs, so that another rule can be tried on the same refits:
        "floor": search.floor,
        "room": search._room,
        "independent": search.independent,
        "sets": [
            {
                "effects": list(item.added),
                "excess": {name: float(f"{v:.5g}") for name, v in item.trial.errors.excess(search.floor).items()},
                "parameters": item.trial.free - now.free,
                "at_bound": item.trial.at_bound,
            }
            for item in judgement.verdict.weighed
        ],
    }


def _told(judgement: Judgement, case: Case) -> dict[str, Any]:
    """Held-out errors of what was named and of a fit that is told the truth, in the catalogue's own laws.

    And what that leaves, in floors, without each of the hidden effects: an effect that leaves less than one cannot be found.
    """
    search, best = judgement.search, judgement.verdict.best
    start = stiff_start(search.trials.problem, search.present.fitted)  # also where the base model is bent out of shape
    names = [own[0] for own in case.laws]

    def told(effects: Sequence[str]) -> Trial | None:
        return search.trials.refit(search.present, effects, start) if effects else search.present

    truth = told(names)
    if not names or truth is None or set(truth.errors.runs) != set(best.errors.runs):
        return {}
    without = [told([one for one in names if one != own]) for own in names]
    return {
        "named_error": float(f"{best.errors.held:.4g}"),
        "told_error": float(f"{truth.errors.held:.4g}"),
        "without": [None if one is None else round(one.errors.held / search.floor, 3) for one in without],
    }


def read_results(path: Path = RESULTS) -> list[dict[str, Any]]:
    """Lines of finished campaigns."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def run_all(plant: str, seeds: Sequence[int], path: Path = RESULTS) -> None:
    """Run campaigns that are not done yet, each kept as soon as it is finished."""
    done = {line["key"] for line in read_results(path)}
    path.parent.mkdir(exist_ok=True)
    version = commit()
    for seed in seeds:
        case = draw(plant, seed)
        if case.key in done:
            continue
        try:
            line = run_case(case)
        except (RfeaError, np.linalg.LinAlgError) as error:  # the latter where the second plant itself runs away
            line = {"key": case.key, "plant": plant, "seed": seed, "kind": "failed", "error": str(error)}
        line["commit"] = version
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        said = (
            line.get("error") or f"{line['verdict']} {line['named']} {line['floors']} floors, {line['processor_s']} s"
        )
        sys.stderr.write(f"{case.key} {case.kind} {case.right}: {said}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.probabilities", description=__doc__)
    parser.add_argument("--plant", choices=("twin", "other"), default="other")
    parser.add_argument("--calibrate", action="store_true", help="the seeds that the rule is calibrated on")
    parser.add_argument("--count", type=int, default=40, help="campaigns to get to")
    parser.add_argument("--to", type=Path, default=RESULTS, help="file of the lines")
    parser.add_argument(
        "--tables", action="store_true", help="write docs/probabilities.md from the lines, and run nothing"
    )
    parser.add_argument(
        "--sweep", action="store_true", help="print what another n_s or f would have said, and run nothing"
    )
    given = parser.parse_args(arguments)
    if given.sweep:
        before = sorted(path for path in FOLDER.glob("*.jsonl") if path.name not in SINCE_IMITATED)
        every = [line for path in before for line in read_results(path)]
        sys.stdout.write(sweep(read_results(FOLDER / "calibration.jsonl")) + "\n" + imitations(every) + "\n")
        return 0
    if given.tables:
        write_text(DOCUMENT, document(read_results(given.to), given.to.name))
        diagram(read_results(given.to))
        return 0
    run_all(given.plant, (CALIBRATED if given.calibrate else UNSEEN)[: given.count], given.to)
    return 0


if __name__ == "__main__":
    sys.exit(main())
