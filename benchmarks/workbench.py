"""The workbench: how long a look takes while a slider moves, what its long steps cost in accuracy, and how soon the page answers."""

from __future__ import annotations

import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from rfea_vision.artefacts import ModelFit
from rfea_vision.report.collect import collect
from rfea_vision.stages import open_campaign
from rfea_vision.twin import TwinOptions, simulate
from rfea_vision.workbench.packets import packet
from rfea_vision.workbench.play import Chosen, Player

LOOKS = 21
SECONDS, RATE_HZ = 20.0, 120.0


def run() -> list[dict[str, Any]]:
    """Looks at a run of 20 s beside a held-out one of 20 s, n = 16; start of the command."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "tube"
        simulate(
            folder,
            TwinOptions(roles=("train", "validate"), duration_s=SECONDS, rate_Hz=RATE_HZ, seed=3, sync="common_clock"),
        )
        open_campaign(folder).fit(segments=16, starts=0)
        return [*_looks(folder), _start(folder)]


def _looks(folder: Path) -> list[dict[str, Any]]:
    fit = ModelFit.load(folder / "rfea" / "models" / "base" / "model.json")
    player = Player({item.name: item for item in collect(folder / "rfea").experiments})
    shown = next(iter(player.runs))
    rows = []
    for effects in ((), ("maxwell",), ("maxwell", "coulomb", "drag")):
        chosen = Chosen(fit, effects)
        packet(*player.play(chosen, {}, shown))
        times, busy = [], []
        for number in range(LOOKS):
            begun, worked = time.perf_counter(), time.process_time()
            packet(*player.play(chosen, {"k_ref": fit.parameters["k_ref"].value * (1 + 1e-3 * number)}, shown))
            times.append(time.perf_counter() - begun)
            busy.append(time.process_time() - worked)
        value = round(1e3 * statistics.median(times), 1)
        name = f"A look at 20 s and a held-out run of 20 s, n = 16, {' + '.join(effects) or 'the model of the paper'}"
        rows.append({"name": name, "value": value, "unit": "ms", "target": 100, "met": value <= 100})
        rows.append(
            {"name": f"{name}: time of the processor", "value": round(1e3 * statistics.median(busy), 1), "unit": "ms"}
        )
    quick, _ = player.play(Chosen(fit, ()), {}, shown)
    exact, _ = player.play(Chosen(fit, ()), {}, shown, exact=True)
    worst = max(abs(quick["runs"][name] - exact["runs"][name]) for name in quick["runs"])
    row = {"name": "What long steps of a look change in the tip's RMSE", "value": round(worst, 5), "unit": "mm"}
    return [*rows, {**row, "target": 0.002, "met": worst <= 0.002, "against": "the steps of a fit"}]


def _start(folder: Path) -> dict[str, Any]:
    code = "import sys; from rfea_vision.cli import main; main(sys.argv[1:])"
    times = []
    for _ in range(3):
        begun = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-c", code, "open", str(folder), "--no-browser"], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        process.stdout.readline()
        times.append(time.perf_counter() - begun)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
    value = round(statistics.median(times), 2)
    return {
        "name": "From rfea open to a page that answers",
        "value": value,
        "unit": "s",
        "target": 2,
        "met": value <= 2,
    }
