"""Random runs inside the bounds of the fit, none of which may fail: `testing.random_runs` draws them."""

from __future__ import annotations

import sys
from typing import Any

from testing.random_runs import failures

RUNS = 2000


def run() -> list[dict[str, Any]]:
    """Rows of the table: how many of the random runs fail."""
    failed = failures(range(RUNS))
    return [
        {
            "name": f"runs that cannot be simulated, of {RUNS} random ones inside the fit's bounds",
            "value": len(failed),
            "unit": "runs",
            "target": 0,
            "met": not failed,
            "against": "version 0.5: see CHANGELOG",
        }
    ]


if __name__ == "__main__":
    first, last = (int(value) for value in sys.argv[1:3])
    for seed, why in failures(range(first, last)).items():
        sys.stdout.write(f"{seed}: {why}\n")
