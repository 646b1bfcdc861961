"""All campaigns of a folder on Dask, with what each worker does said once a second."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from rfea_vision.distributed import dask_client, run_batch
from rfea_vision.units import counted
from rfea_vision.workbench.app_state import shown

EVERY_S = 1.0  # between two looks at the folders


def run_all(folders: list[Path], say: Callable[[dict[str, Any]], None]) -> dict[str, int]:
    """Run the default recipe over campaigns; each is told as it ends."""
    over = threading.Event()
    with dask_client(None) as client:

        def watch() -> None:
            while not over.wait(EVERY_S):
                with suppress(OSError, ValueError):
                    say({"event": "tasks", "sentence": _tasks(client)})

        threading.Thread(target=watch, daemon=True).start()
        try:
            results = run_batch(
                folders,
                client=client,
                on_result=lambda result: say(
                    {"event": "campaign", "folder": shown(Path(result.folder)), "status": result.status}
                ),
            )
        finally:
            over.set()
    return dict(Counter(result.status for result in results))


def _tasks(client: Any) -> str:
    """What is computed now: tasks by kind, and where Dask's own page is."""
    kinds = Counter(str(key).rsplit("-", 5)[0].lstrip("_") for keys in client.processing().values() for key in keys)
    now = ", ".join(f"{count} x {kind}" for kind, count in sorted(kinds.items())) or "nothing yet"
    workers = counted(len(client.scheduler_info()["workers"]), "worker")
    return f"{workers}; under way: {now}. Dask's own page: {client.dashboard_link}"
