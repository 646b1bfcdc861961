"""Two hundred kills (`testing.kills`), each a line of `ROWS` with the code that it was made on."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.damage.rows import ROWS, add_row, rows_of_this_code
from testing.kills import kill_often, load_commands, small_campaign

ENOUGH = 200  # kills of the whole group
SHARES = {"improve": 40, "batch": 10, "fit": 70, "track": 80}
RUNGS = 3  # at least, of the climb that is killed
BETWEEN = 8  # kills of it, at least, that leave a rung finished and another to climb


def kill_all(file: Path = ROWS) -> None:
    """Make the kills of every command that are not in `file` yet."""
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        campaign = small_campaign(Path(name) / "tube")
        load_commands(campaign)
        for command, share in SHARES.items():
            done = [row for row in rows_of_this_code("kills", file) if row["command"] == command]
            first = 1 + max((row["number"] for row in done), default=-1)
            while (left := share - sum(not row["too_late"] for row in done)) > 0:
                made = kill_often(
                    command,
                    campaign,
                    range(first, first + left),
                    heard=lambda kill: add_row("kills", asdict(kill), file),
                )
                done += [asdict(kill) for kill in made]
                first += left
            sys.stderr.write(f"  {command}: {share} kills\n")
    _check_climbs(rows_of_this_code("kills", file))


def between_rungs(rows: list[dict[str, Any]]) -> int:
    """How many kills of a climb left a rung finished and another to climb."""
    return sum(0 < row["rungs"] < row["of_rungs"] for row in rows if not row["too_late"])


def _check_climbs(rows: list[dict[str, Any]]) -> None:
    """Make sure that the kills of `improve` could meet what goes wrong between two rungs.

    Raises
    ------
    AssertionError
        If the undisturbed climb is too short, or too few kills fell between its rungs.
    """
    shortest = min(row["of_rungs"] for row in rows if row["command"] == "improve" and not row["too_late"])
    between = between_rungs(rows)
    if shortest < RUNGS or between < BETWEEN:
        raise AssertionError(
            f"the climb has {shortest} rungs, and {between} kills fell between them; {RUNGS} and {BETWEEN} are needed"
        )


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    kill_all()
    rows = rows_of_this_code("kills")
    kills = sum(not row["too_late"] for row in rows)
    rows_with = {key: sum(bool(row[key]) for row in rows) for key in ("different", "half_written", "redone")}
    return [
        {"name": "kills (track, fit, improve, batch)", "value": kills, "unit": "kills", "target": f">= {ENOUGH}",
         "met": kills >= ENOUGH},
        {"name": "of them between two rungs of a climb", "value": between_rungs(rows), "unit": "kills",
         "target": f">= {BETWEEN}", "met": between_rungs(rows) >= BETWEEN},
        {"name": "re-runs that ended with other results", "value": rows_with["different"], "unit": "runs", "target": "0",
         "met": not rows_with["different"]},
        {"name": "kills that left a file half written", "value": rows_with["half_written"], "unit": "kills", "target": "0",
         "met": not rows_with["half_written"]},
        {"name": "re-runs that did again what was finished", "value": rows_with["redone"], "unit": "runs", "target": "0",
         "met": not rows_with["redone"]},
    ]  # fmt: skip


if __name__ == "__main__":
    kill_all(Path(sys.argv[1]) if len(sys.argv) > 1 else ROWS)
