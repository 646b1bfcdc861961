"""The workbench: what a look costs while a slider moves and what its long steps lose, and how soon the page is there and follows."""

from __future__ import annotations

import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
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
        return [*_looks(folder), _start(folder), *_page(folder)]


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


@contextmanager
def _opened(folder: Path) -> Iterator[tuple[str, float]]:
    """Address of a workbench while the block runs, and the instant at which its command was given."""
    code = "import sys; from rfea_vision.cli import main; main(sys.argv[1:])"
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", code, "open", str(folder), "--no-browser"], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip(), begun
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)


def _start(folder: Path) -> dict[str, Any]:
    times = []
    for _ in range(3):
        with _opened(folder) as (_, begun):
            times.append(time.perf_counter() - begun)
    value = round(statistics.median(times), 2)
    return {"name": "From rfea open to an address", "value": value, "unit": "s", "target": 2, "met": value <= 2}


#: From the event of a slider to the frame after the one in which its answer was drawn.
PAINTED = """
let from = 0;
addEventListener("input", () => { from = performance.now(); }, true);
addEventListener("DOMContentLoaded", () => new MutationObserver(() => {
  const root = document.documentElement, told = from, painted = () => { root.dataset.painted = performance.now() - told; };
  if (root.dataset.look === "quick") requestAnimationFrame(() => setTimeout(painted));
}).observe(document.documentElement, {attributes: true, attributeFilter: ["data-look"]}));
"""


def _page(folder: Path) -> list[dict[str, Any]]:
    """What a person waits for in Chromium, wall time: the first page, and the picture after a slider; needs the extra `dev`."""
    from playwright.sync_api import sync_playwright

    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    with sync_playwright() as playwright:
        page = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"]).new_page()
        page.add_init_script(PAINTED)
        with _opened(folder) as (address, begun):
            page.goto(f"{address}c/0/#/play", wait_until="commit")
            page.wait_for_selector("html[data-ready=yes][data-look=exact]")
            first = round(time.perf_counter() - begun, 2)
            slider = page.locator("[data-name=k_ref]")
            slider.focus()
            waits = []
            for number in range(LOOKS):
                slider.press(("ArrowRight", "ArrowLeft")[number % 2])
                page.wait_for_selector("html[data-painted]")
                waits.append(float(page.get_attribute("html", "data-painted") or "nan"))
                page.wait_for_selector("html[data-look=exact]")
                page.evaluate("delete document.documentElement.dataset.painted")
    value = round(statistics.median(waits[1:]), 1)  # the first one loads the law
    return [
        {"name": "From rfea open to the first page, with the browser running", "value": first, "unit": "s"},
        {
            "name": "From a slider to the painted picture",
            "value": value,
            "unit": "ms",
            "target": 100,
            "met": value <= 100,
        },
    ]
