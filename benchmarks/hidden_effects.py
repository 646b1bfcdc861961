"""How often does the critique find the effect that hides in a campaign? ``python -m benchmarks.hidden_effects``.

Every finished campaign is one line of ``hidden_effects/results.jsonl``; a run that was interrupted goes on with
``--resume``. The tables of ``docs/hidden_effects.md`` are written from these lines, and from nothing else.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden_campaigns import (
    FOLDER,
    OUTSIDE,
    Case,
    cases,
    hidden_of,
    keep_strength,
    recordings_of,
    twin_options,
)
from benchmarks.hidden_tables import rows, write_document
from rfea_vision import __version__
from rfea_vision.artefacts import Comparison, Diagnosis, ModelFit
from rfea_vision.critique import improve
from rfea_vision.errors import RfeaError
from rfea_vision.fitting.fit import Problem, fit, make_problem
from rfea_vision.fitting.scoring import score
from rfea_vision.options import FitOptions

RESULTS = FOLDER / "results.jsonl"
ROLES = ("train", "train", "validate", "test")
COMMAND = "python -m benchmarks.hidden_effects --resume"


def read_results(path: Path = RESULTS) -> list[dict[str, Any]]:
    """Lines of finished campaigns."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]


def _test_error(problem: Problem, fitted: Any) -> float | None:
    _, parts, _ = score(problem, fitted.model, fitted.par, problem.test)
    tips = [part.tip for part in parts.values() if part.tip is not None]
    return float(np.sqrt(np.mean(np.concatenate(tips)))) if tips else None


def _told_the_truth(recordings: Any, actuator: Any, effects: tuple[str, ...]) -> float | None:
    """Tip error on the test run of a fit that is given the hidden effects by name."""
    problem = make_problem(recordings, actuator)
    try:
        return _test_error(problem, fit(problem, FitOptions(effects=effects)))
    except RfeaError:
        return None


def run_case(case: Case) -> dict[str, Any]:
    """Generate one campaign, let `improve` loose on it, and note what it said beside the truth."""
    truth = hidden_of(case)
    options = twin_options(case, truth["hidden"], roles=ROLES)
    recordings, actuator = recordings_of(options)
    rungs: list[tuple[ModelFit, Diagnosis]] = []

    def on_rung(
        model: ModelFit, _predictions: Any, _comparison: Comparison, diagnosis: Diagnosis, _pressure: Any
    ) -> None:
        rungs.append((model, diagnosis))

    started = time.perf_counter()
    processor = time.process_time()
    ladder = improve(recordings, actuator, FitOptions(), on_rung=on_rung)
    seconds, processor_s = time.perf_counter() - started, time.process_time() - processor
    first, last = rungs[0], rungs[-1]
    reached = ladder.test["tip_rmse_mm"] if ladder.test else None
    told = reached
    in_catalogue = not any(effect in OUTSIDE for effect in case.effects)
    if in_catalogue and set(last[0].effects) != set(case.effects):
        told = _told_the_truth(recordings, actuator, case.effects)
    floor = first[0].noise_floor_mm or float("nan")
    return {
        "key": case.key,
        "version": __version__,
        "kind": case.kind,
        "effects": list(case.effects),
        "hidden": truth["hidden"],
        "floors_expected": truth["expected_floors"],
        "floors_wanted": case.floors,
        "floors": round((first[0].metrics["train"].tip_rmse_mm or 0.0) / floor, 2),
        "verdict": first[1].verdict,
        "named": first[1].named,
        "tied": [tie.effects for tie in first[1].tied],
        "explained": first[1].explained_fraction,
        "found": last[0].effects,
        "final_verdict": last[1].verdict,
        "test_mm": reached,
        "test_told_mm": told,
        "intervals": _intervals(last[0], truth["hidden"]),
        "candidates": _shortened(first[1]),
        "seconds": round(seconds, 1),
        "processor_s": round(processor_s, 1),
    }


def _intervals(model: ModelFit, hidden: dict[str, float]) -> dict[str, Any]:
    """True value, 95 % interval and whether it covers, for each hidden parameter that the last model fits."""
    out = {}
    for name, value in hidden.items():
        parameter = model.parameters.get(name)
        if parameter is not None and parameter.interval_95 is not None:
            low, high = parameter.interval_95
            out[name] = {"true": value, "low": low, "high": high, "covers": bool(low <= value <= high)}
    return out


def _shortened(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    return [
        {
            "effect": c.effect,
            "train": c.train_rmse_mm and round(c.train_rmse_mm, 4),
            "validate": c.validate_rmse_mm and round(c.validate_rmse_mm, 4),
            "matters": c.matters,
            "note": c.note,
        }
        for c in diagnosis.candidates
        if c.refitted
    ]


def _attempt(case: Case) -> dict[str, Any]:
    try:
        return run_case(case)
    except RfeaError as error:
        return {"key": case.key, "kind": "failed", "effects": list(case.effects), "error": str(error)}


def run_all(limit: int | None = None, *, resume: bool = True, only: str = "", workers: int = 1) -> list[dict[str, Any]]:
    """Run campaigns that are not done yet, each kept as soon as it is finished; what they find does not depend on `workers`."""
    if not resume:
        RESULTS.unlink(missing_ok=True)
    done = {line["key"] for line in read_results()}
    todo = [case for case in cases() if case.key not in done and only in case.key][:limit]
    FOLDER.mkdir(exist_ok=True)
    with ProcessPoolExecutor(workers) as pool:
        for index, future in enumerate(as_completed([pool.submit(_attempt, case) for case in todo])):
            line = future.result()
            if line.get("hidden"):
                keep_strength(line["key"], {"hidden": line["hidden"], "expected_floors": line["floors_expected"]})
            with RESULTS.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
            sys.stderr.write(f"{index + 1}/{len(todo)} {_sentence(line)}\n")
    return read_results()


def _sentence(line: dict[str, Any]) -> str:
    if line["kind"] == "failed":
        return f"{line['key']}: failed: {line['error']}"
    return (
        f"{line['key']} ({line['floors']} floors): {line['verdict']} {line['named']} tied {line['tied']}, "
        f"found {line['found']} ({line['final_verdict']}), {line['seconds']:.0f} s"
    )


def run() -> list[dict[str, Any]]:
    """Rows for the benchmark runner, from the campaigns that were run so far."""
    return rows(read_results(), COMMAND)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden_effects", description=__doc__)
    parser.add_argument("--limit", type=int, help="run at most this many campaigns")
    parser.add_argument("--resume", action="store_true", help="go on where an earlier run stopped (else start afresh)")
    parser.add_argument("--only", default="", help="only campaigns whose name contains this text")
    parser.add_argument("--workers", type=int, default=1, help="campaigns at a time")
    parser.add_argument("--tables", action="store_true", help="run nothing; write the tables from what is there")
    given = parser.parse_args(arguments)
    lines = (
        read_results()
        if given.tables
        else run_all(given.limit, resume=given.resume, only=given.only, workers=given.workers)
    )
    write_document(lines, rows(lines, COMMAND), len(cases()))
    return 0


__all__ = ["main", "run", "run_all", "run_case"]

if __name__ == "__main__":
    sys.exit(main())
