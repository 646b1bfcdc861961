"""What long runs have counted so far: a line of JSON each, with the version and the hash of the code that it was counted on."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks._commit import commit
from rfea_vision.distributed.tasks import fingerprint

ROWS = Path(__file__).resolve().parent / "rows.jsonl"


def add_row(group: str, row: dict[str, Any], file: Path = ROWS) -> None:
    """Keep a row."""
    about = {
        "group": group,
        "code": fingerprint(),
        "commit": commit(),
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps({**about, **row}) + "\n")


def rows(group: str, file: Path = ROWS) -> list[dict[str, Any]]:
    """Every row of a group."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    return [row for row in map(json.loads, lines) if row["group"] == group]


def rows_of_this_code(group: str, file: Path = ROWS) -> list[dict[str, Any]]:
    """The rows of a group that were counted on the code that is here."""
    return [row for row in rows(group, file) if row["code"] == fingerprint()]
