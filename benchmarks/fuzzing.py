"""Fuzzing: files that were cut, flipped, swapped, blown up or made up, given to every reader and to the artefacts fed back.

A reader may return, or raise one sentence meant for people. Anything else is a fault: another exception, a traceback on the
standard error, a process that ends, more than 20 s of processor time, more than 2 GB, or numbers that are not finite or out of order.

``python -m benchmarks.fuzzing`` reads in a process that is watched, so that a hang or a crash is a fault like others and
the next input follows. Each shard (all readers, `SHARD` inputs each, here or apart) is a line of `ROWS` with the code that
it ran on; a run that was stopped goes on where it stood, and rows of other code do not count.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.damage.rows import ROWS, add_row, rows_of_this_code
from testing.damage.files import targets
from testing.damage.watched import MOST_BYTES, MOST_S, Shard, Watched, inputs_of

ENOUGH = 22_000


def fuzz(inputs: int, file: Path = ROWS) -> None:
    """Read so many inputs in all, those of earlier runs of the same code counted, each shard a row of `file`."""
    with tempfile.TemporaryDirectory(prefix="fuzzing-") as name:
        names = [target.name for target in targets(Path(name))]
    watched = Watched()
    done = {(row["target"], row["apart"], row["number"]) for row in rows_of_this_code("fuzzing", file)}
    count = sum(row["inputs"] for row in rows_of_this_code("fuzzing", file))
    number = 0
    try:
        while count < inputs:
            for target in names:
                for apart in (False, True):
                    if (target, apart, number) in done:
                        continue
                    shard = Shard(target, apart, number)
                    watched.read(shard, inputs_of(2 * number + apart))
                    count += shard.inputs
                    add_row("fuzzing", asdict(shard), file)
                    for fault in shard.faults:
                        sys.stderr.write(f"  {fault}\n")
            number += 1
            sys.stderr.write(f"  {count} inputs\n")
    finally:
        watched.end()


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    fuzz(ENOUGH)
    rows = rows_of_this_code("fuzzing")
    faults = [text for row in rows for text in row["faults"]]
    total = sum(row["inputs"] for row in rows)
    longest, most = max(row["longest_s"] for row in rows), max(row["most_MB"] for row in rows)
    return [
        {"name": "damaged and made up inputs", "value": total, "unit": "inputs", "target": ">= 20000", "met": total >= 20_000},
        {"name": "inputs that were no single sentence, or a wrong number accepted", "value": len(faults), "unit": "inputs",
         "target": "0", "met": not faults},
        {"name": "longest reading", "value": longest, "unit": "s", "target": "< 20", "met": longest < MOST_S},
        {"name": "most memory", "value": round(most / 1e3, 2), "unit": "GB", "target": "< 2", "met": 1e6 * most < MOST_BYTES},
    ]  # fmt: skip


def by_target(rows: list[dict[str, Any]]) -> dict[str, Counter[str]]:
    """Inputs, and what became of them, by reader."""
    found: dict[str, Counter[str]] = {}
    for row in rows:
        counts = {key: row[key] for key in ("inputs", "accepted", "refused")}
        found.setdefault(row["target"], Counter()).update({**counts, "faults": len(row["faults"])})
    return found


if __name__ == "__main__":
    fuzz(int(sys.argv[1]) if len(sys.argv) > 1 else ENOUGH, Path(sys.argv[2]) if len(sys.argv) > 2 else ROWS)
