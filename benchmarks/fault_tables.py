"""The tables of docs/faults.md, from the rows that the fault benchmarks have kept: ``python -m benchmarks.fault_tables``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks.damage.rows import rows
from benchmarks.faults import FAULTS
from benchmarks.fuzzing import by_target
from benchmarks.kills import between_rungs

PAGE = Path(__file__).resolve().parents[1] / "docs" / "faults.md"


def _table(head: Iterable[str], lines: Iterable[Iterable[object]]) -> str:
    every = [list(head), ["---"] * len(list(head)), *lines]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "/") for cell in line) + " |" for line in every)


def _of_latest_code(group: str) -> list[dict[str, Any]]:
    """The rows that were counted on the code that was counted last."""
    every = rows(group)
    return [row for row in every if row["code"] == every[-1]["code"]] if every else []


def _code(found: list[dict[str, Any]]) -> str:
    return f"Counted on {found[-1]['code']}, commit {found[-1]['commit']}." if found else "Not counted yet."


def fuzzing() -> str:
    """Inputs by reader."""
    found = _of_latest_code("fuzzing")
    total: Counter[str] = Counter()
    lines = []
    for name, counts in by_target(found).items():
        total.update(counts)
        lines.append([name, *(counts[key] for key in ("inputs", "accepted", "refused", "faults"))])
    lines.append(["**all**", *(total[key] for key in ("inputs", "accepted", "refused", "faults"))])
    most = f"Longest reading {max((row['longest_s'] for row in found), default=0):.1f} s, most memory "
    most += f"{max((row['most_MB'] for row in found), default=0) / 1e3:.2f} GB."
    return f"{_code(found)} {most}\n\n{_table(['reader', 'inputs', 'read', 'refused', 'faults'], lines)}"


def kills() -> str:
    """Kills by command."""
    found = _of_latest_code("kills")
    lines = []
    for command in dict.fromkeys((row["command"], row["what"]) for row in found):
        mine = [row for row in found if (row["command"], row["what"]) == command]
        counts = [sum(bool(row[key]) for row in mine) for key in ("different", "half_written", "redone")]
        late = sum(row["too_late"] for row in mine)
        name = command[0] if command[1] == "command" else f"{command[0]}, of it a worker"
        lines.append([name, len(mine) - late, between_rungs(mine) or "", *counts, late])
    head = ["command", "kills", "of them between rungs", "other results", "half written", "done again", "ended before"]
    return f"{_code(found)}\n\n{_table(head, lines)}"


def faults() -> str:
    """Disks, folders, clocks, files: each as it ended when it was tried last."""
    last = {row["fault"]: row for row in rows("faults")}
    lines = []
    for fault in FAULTS:
        row = last.get(fault, {"right": None, "said": "", "commit": ""})
        ended = {True: "right", False: "**wrong**", None: "not tried"}[row["right"]]
        lines.append([fault, ended, row["commit"], row["said"]])
    return _table(["fault", "ended", "commit", "what was said"], lines)


def batches() -> str:
    """Thirty campaigns, eight, and foreign schedulers: each as it ended when it was tried last."""
    last = {row["what"]: row for row in rows("batches")}
    lines = [
        [row["what"], "right" if not row["wrong"] else f"**{', '.join(row['wrong'])}**", row["commit"], row["said"]]
        for row in last.values()
    ]
    return _table(["what", "ended", "commit", "what was said"], lines)


def main() -> None:
    """Write the tables into the page."""
    page = PAGE.read_text(encoding="utf-8")
    for name, make in (("fuzzing", fuzzing), ("kills", kills), ("faults", faults), ("batches", batches)):
        mark = f"<!-- {name} -->"
        head, _, rest = page.partition(f"{mark}\n")
        page = f"{head}{mark}\n{make()}\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
