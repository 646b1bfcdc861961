"""Run the comparisons of speed and accuracy: ``python -m benchmarks [GROUP ...]``, or ``make benchmarks ONLY=tracking``.

A group is a file of this folder with a function ``run() -> list of rows``, each row
``{"name", "value", "unit", "target", "met", "against", "command", "commit"}``. Results of groups that are not run are kept: each row
names the commit that it was run with (rows of before 0.6 the one that they were committed with). The head of ``results.json``
says which commits its rows are of, and which groups have none.
"""

from __future__ import annotations

import difflib
import importlib
import json
import pkgutil
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks._commit import commit
from rfea_vision.files import write_text

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results.json"
KEYS = ("name", "value", "unit", "target", "met", "against", "command")


def groups() -> dict[str, Any]:
    """Return the run functions by the name of their file."""
    found = {}
    for info in sorted(pkgutil.iter_modules([str(HERE)]), key=lambda item: item.name):
        if info.name.startswith("_"):
            continue
        module = importlib.import_module(f"benchmarks.{info.name}")
        if hasattr(module, "run"):
            found[info.name] = module.run
    return found


def checked(group: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with the command that makes them; a row that lacks a key is a fault of the benchmark."""
    made = []
    for row in rows:
        full = {"command": f"make benchmarks ONLY={group}", "target": None, "met": None, "against": None, **row}
        lacking = [key for key in KEYS if key not in full]
        if lacking:
            raise ValueError(f"benchmarks/{group}.py: the row {row} lacks {', '.join(lacking)}")
        made.append({"group": group, **full, "commit": commit()})
    return made


def with_head(rows: list[dict[str, Any]], known: Iterable[str]) -> dict[str, Any]:
    """Return rows below what a reader must know of them: of which commits each group is, and the groups that were not run."""
    of: dict[str, set[str]] = {}
    for row in rows:
        of.setdefault(row["group"], set()).add(row["commit"])
    head = {"commits": {group: sorted(of[group]) for group in sorted(of)}, "not_run": sorted(set(known) - set(of))}
    return {**head, "rows": rows}


def main(chosen: list[str]) -> int:
    """Run the chosen groups, all by default, and write results.json after each."""
    available = groups()
    for name in chosen:
        if name not in available:
            close = difflib.get_close_matches(name, available, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"there are {', '.join(available)}"
            sys.stderr.write(f"benchmarks: no group '{name}'; {hint}\n")
            return 2
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))["rows"] if RESULTS.is_file() else []
    for name in chosen or list(available):
        sys.stderr.write(f"{name} ...\n")
        begun = time.perf_counter()
        rows = checked(name, available[name]())
        kept = [row for row in kept if row.get("group") != name] + rows
        write_text(RESULTS, json.dumps(with_head(kept, available), indent=1) + "\n")
        sys.stderr.write(f"{name}: {time.perf_counter() - begun:.0f} s\n")
        for row in rows:
            verdict = {True: "met", False: "NOT met", None: ""}[row["met"]]
            against = f" against {row['against']}" if row["against"] else ""
            sys.stdout.write(
                f"  {row['name']}: {row['value']} {row['unit']} (target {row['target']}{against}) {verdict}\n"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
