"""The report of six filmed runs in Chromium: size, time to open, work per picture while scrubbing."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from rfea_vision.report import render
from testing.report.browser import Browser, find_chromium
from testing.report.sample import write_sample

RUNS = ("steps-270kPa", "ramps-220kPa", "steps-180kPa", "mixed-250kPa", "ramps-150kPa", "steps-120kPa")
SECONDS = 20.0
PICTURES = 240
SCRUB = f"""(async () => {{ const s = document.getElementById('scrub');
  document.getElementById('see').scrollIntoView({{behavior: 'instant'}});
  await new Promise(done => setTimeout(done, 500));
  const start = performance.now();
  for (let i = 0; i < {PICTURES}; i++) {{ s.value = i; s.dispatchEvent(new Event('input')); await new Promise(requestAnimationFrame); }}
  return (performance.now() - start) / {PICTURES}; }})()"""


def run() -> list[dict[str, Any]]:
    """Rows for a made-up campaign of six runs of 20 s at 240 frames a second, three rungs, every run with its film."""
    executable = find_chromium()
    if executable is None:
        raise SystemExit("benchmarks/report.py: no Chromium on this machine; install the package chromium")
    with tempfile.TemporaryDirectory() as room, Browser(executable) as browser:
        folder = write_sample(Path(room) / "rfea", seconds=SECONDS, names=RUNS)
        started = time.perf_counter()
        text = render(folder, title="six runs", commands=())
        rendering = time.perf_counter() - started
        page = Path(room) / "index.html"
        page.write_text(text, encoding="utf-8")
        browser.resize(1440, 900)
        browser.open(page)  # the first start of a browser is not the page's
        started = time.perf_counter()
        browser.open(page)
        opening = time.perf_counter() - started
        picture_ms = float(browser.run(SCRUB))
        films = text.count('<script type="text/plain" data-clip=')
        size_mb = page.stat().st_size / 1e6
    about = f"{len(RUNS)} runs of {SECONDS:.0f} s with film, 3 rungs"
    return [
        _row(f"size of the report, {films} films in it", size_mb, "MB", 10.0, about),
        _row("the report opens", opening, "s", 2.0, about),
        _row("a picture while scrubbing", picture_ms, "ms", 33.3, about),
        _row("writing the report", rendering, "s", None, about),
    ]


def _row(name: str, value: float, unit: str, most: float | None, about: str) -> dict[str, Any]:
    target = {"target": f"at most {most:g} {unit}", "met": value <= most} if most is not None else {}
    return {"name": f"{name} ({about})", "value": round(value, 2), "unit": unit, **target}
