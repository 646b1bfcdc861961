"""What limits a batch: stages measured on this machine, and a model of 1 to 64 workers and 10,000 campaigns made of them."""

from __future__ import annotations

import heapq
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from rfea_vision.distributed import dask_client, run_batch
from testing.kills import small_campaign

CAMPAIGNS, WORKERS = 10_000, (1, 2, 4, 16, 64)
RUNS_PER_CAMPAIGN = 6
FILM_MB = 100.0  # a run filmed for a minute at 240 frames per second
DISK_MB_PER_S = 110.0  # a network folder behind gigabit Ethernet
_TASKS = 400
_RECIPE = "format: rfea-recipe/1\nsteps:\n  - fit: {segments: 2}\n  - compare\n"


def makespan_s(
    campaigns: int, runs: int, measure_s: float, finish_s: float, workers: int, overhead_s: float, mb: float
) -> dict[str, float]:
    """Time of a batch by list scheduling: runs are measured in any order, a campaign's recipe follows its last run.

    Each task also passes the scheduler (one after the other, `overhead_s` each), and each run's film the disk (`mb` each).
    """
    free = [0.0] * workers
    scheduler = disk = 0.0
    ready: list[float] = []
    for _ in range(campaigns):
        last = 0.0
        for _ in range(runs):
            scheduler += overhead_s
            disk += mb / DISK_MB_PER_S
            begin = max(heapq.heappop(free), scheduler)
            end = max(begin + measure_s, disk)
            heapq.heappush(free, end)
            last = max(last, end)
        heapq.heappush(ready, last)
        scheduler += overhead_s
        worker = heapq.heappop(free)
        end = max(worker, heapq.heappop(ready), scheduler) + finish_s
        heapq.heappush(free, end)
    return {"makespan_s": max(free), "scheduler_s": scheduler, "disk_s": disk}


def _overhead_s() -> float:
    """Time that the scheduler needs per task, with tasks that do nothing."""
    with dask_client(None, 2) as client:
        client.gather([client.submit(abs, number, pure=False) for number in range(50)])
        begun = time.perf_counter()
        client.gather([client.submit(abs, number, pure=False) for number in range(_TASKS)])
        return (time.perf_counter() - begun) / _TASKS


def _batch_s(campaign: Path, folder: Path, workers: int, count: int = 4) -> float:
    """Time of a real batch of small campaigns, workers started and their libraries loaded before."""
    recipe = folder / "recipe.yaml"
    recipe.write_text(_RECIPE)
    folders = [shutil.copytree(campaign, folder / f"w{workers}-{number}") for number in range(count + workers)]
    with dask_client(None, workers) as client:
        run_batch(folders[count:], client=client, recipe=str(recipe))
        begun = time.perf_counter()
        run_batch(folders[:count], client=client, recipe=str(recipe))
        return time.perf_counter() - begun


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    overhead = _overhead_s()
    with tempfile.TemporaryDirectory(prefix="scaling-") as name:
        campaign = small_campaign(Path(name) / "tube")
        one, two = (_batch_s(campaign, Path(name), workers) for workers in (1, 2))
    rows: list[dict[str, Any]] = [
        {"name": "scheduler, per task", "value": round(1e3 * overhead, 2), "unit": "ms"},
        {"name": "four small campaigns, one worker", "value": round(one, 1), "unit": "s"},
        {
            "name": "four small campaigns, two workers",
            "value": round(two, 1),
            "unit": "s",
            "against": f"{one:.1f} s with one",
        },
    ]
    for measure_s, finish_s, what in ((60.0, 300.0, "filmed campaigns"), (0.5, 30.0, "campaigns of tracks")):
        for workers in WORKERS:
            mb = FILM_MB if measure_s > 1 else 0.1
            found = makespan_s(CAMPAIGNS, RUNS_PER_CAMPAIGN, measure_s, finish_s, workers, overhead, mb)
            name = f"model: {CAMPAIGNS} {what}, {workers} workers"
            rows.append({"name": name, "value": round(found["makespan_s"] / 3600, 1), "unit": "h"})
        rows.append(
            {"name": f"model: {what}, scheduler alone", "value": round(found["scheduler_s"] / 3600, 2), "unit": "h"}
        )
        rows.append({"name": f"model: {what}, disk alone", "value": round(found["disk_s"] / 3600, 2), "unit": "h"})
    return rows
