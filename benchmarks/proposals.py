"""Does `propose` write a law that helps? ``python -m benchmarks.proposals``.

Campaigns of the twin and of the second plant that hide one thing each, outside of the catalogue or in another form, and campaigns
that hide nothing, for which no law may be proposed. A law helps where its refit at least halves the held-out error. Every
finished campaign is a line of ``probabilities/proposals.jsonl`` with the commit that it was run with; ``--tables`` writes
docs/proposals.md from these lines, and from nothing else.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._commit import commit
from benchmarks.probable_campaigns import OUTSIDE, UNKNOWN, Case, even, of_other, of_twin, recordings_of
from rfea_vision.critique.floors import binding, floors_of
from rfea_vision.critique.measures import errors_of
from rfea_vision.critique.propose import propose
from rfea_vision.errors import DataError, RfeaError
from rfea_vision.files import write_text
from rfea_vision.fitting import FitOptions
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.problem import make_problem
from rfea_vision.fitting.scoring import as_artefact

RESULTS = Path(__file__).parent / "probabilities" / "proposals.jsonl"
DOCUMENT = Path(__file__).parent.parent / "docs" / "proposals.md"
#: Of the second plant, beside what is outside of every catalogue: laws that the terms of `propose` were not written after.
OTHER = (
    "soften_capped",
    "soften_root",
    "spot",
    "stepped",
    "play",
    "stribeck",
    "spectrum",
    "stiffer_abs",
    "stiffer_pressure",
    "drag",
)
NOTHING = 6
#: First seeds: those below 3600 were looked at while the method was made.
SEED = 3600


def cases() -> list[Case]:
    """One campaign for each hidden thing, and some that hide nothing; seeds are those of no other benchmark."""
    out = []
    for k, name in enumerate(OUTSIDE):
        rng = np.random.default_rng(SEED + k)
        out.append(Case("twin", SEED + k, "outside", of_twin(name, rng)[0], (), angle_only=False))
    for k, name in enumerate((*UNKNOWN, *OTHER)):
        rng = np.random.default_rng(SEED + 100 + k)
        hidden = {name: even(rng, *UNKNOWN[name])} if name in UNKNOWN else of_other(name, rng)[0]
        out.append(Case("other", SEED + 100 + k, "outside", hidden, (), angle_only=False))
    out += [
        Case("twin" if k % 2 else "other", SEED + 200 + k, "nothing", {}, (), angle_only=False) for k in range(NOTHING)
    ]
    return out


def run_case(case: Case) -> dict[str, Any]:
    """Propose a law for the base model of one campaign."""
    recordings, actuator = recordings_of(case)
    problem = make_problem(recordings, actuator)
    fitted = fit(problem, FitOptions(segments=8, starts=0))
    held, floor = errors_of(problem, fitted).held, binding(floors_of(problem, fitted))
    line: dict[str, Any] = {"key": case.key, "hidden": case.hidden, "floors": held / floor, "before_mm": held}
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = propose(as_artefact(problem, fitted), recordings, Path(folder) / "proposed.py")
        except DataError as error:
            return {**line, "terms": [], "after_mm": held, "sentence": str(error)}
    said = found.sentence.replace(f"{folder}/", "")
    return {**line, "terms": list(found.terms), "after_mm": found.held_after, "sentence": said}


def document(lines: Sequence[dict[str, Any]]) -> str:
    """The whole page."""
    hidden = [line for line in lines if line["hidden"] and line["floors"] >= 2]
    helped = sum(line["after_mm"] <= 0.5 * line["before_mm"] for line in hidden)
    nothing = [line for line in lines if not line["hidden"]]
    out = [
        "# Proposed laws, counted\n",
        "Written by `python -m benchmarks.proposals --tables` from `benchmarks/probabilities/proposals.jsonl` and nothing else; commit "
        f"{', '.join(dict.fromkeys(line['commit'] for line in lines))}.\n",
        f"Where the base model leaves at least two floors, a law halves the held-out error in {helped} of {len(hidden)} campaigns.",
        f"Where nothing is hidden, a law is proposed in {sum(bool(line['terms']) for line in nothing)} of {len(nothing)}.\n",
        "| campaign | hidden | held-out error, floors | before, mm | after, mm | terms |",
        "|---|---|---|---|---|---|",
    ]
    for line in lines:
        what = ", ".join(f"{name} {value:.3g}" for name, value in line["hidden"].items()) or "nothing"
        figures = f"{line['floors']:.1f} | {line['before_mm']:.3f} | {line['after_mm']:.3f}"
        out.append(f"| {line['key']} | {what} | {figures} | {'; '.join(line['terms']) or '-'} |")
    return "\n".join([*out, ""])


def read_results(path: Path = RESULTS) -> list[dict[str, Any]]:
    """Lines of finished campaigns."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.proposals", description=__doc__)
    parser.add_argument("--to", type=Path, default=RESULTS, help="file of the lines")
    parser.add_argument("--tables", action="store_true", help="write docs/proposals.md from the lines, and run nothing")
    given = parser.parse_args(arguments)
    if given.tables:
        write_text(DOCUMENT, document(read_results(given.to)))
        return 0
    done, version = {line["key"] for line in read_results(given.to)}, commit()
    for case in cases():
        if case.key in done:
            continue
        try:
            line = run_case(case)
        except RfeaError as error:
            sys.stderr.write(f"{case.key}: {error}\n")
            continue
        line["commit"] = version
        with given.to.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        sys.stderr.write(
            f"{case.key} {case.hidden}: {line['before_mm']:.3f} -> {line['after_mm']:.3f} mm, {line['terms']}\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
