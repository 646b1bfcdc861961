"""Take the pictures of the documents from a campaign with a report: `python docs/pictures.py demo/hidden-effect [FOLDER]`.

The report and the workbench are opened in Chromium by Playwright (extra `dev`); nothing in the pictures is drawn by hand.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

WIDE, NARROW = {"width": 1280, "height": 800}, {"width": 400, "height": 860}
#: Steps of the workbench, and what is there once a step has drawn.
STEPS = {
    "setup": "#frame-clock:not(:empty)",
    "clock": "[data-figure=offsets][data-state=drawn]",
    "play": "html[data-look=exact]",
    "add": "[data-figure=rungs][data-state=drawn]",
    "law": "#law-said.better",
}
#: What the documents show; with a folder, all steps are taken in all windows, to be looked at.
IN_DOCUMENTS = ("report", "workbench-setup", "workbench-clock", "workbench-play", "workbench-add")


@contextmanager
def workbench(folder: Path) -> Iterator[str]:
    """The address of a workbench that is open on a folder while the block runs."""
    command = [sys.executable, "-m", "rfea_vision", "open", folder.name, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder.parent) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.send_signal(signal.SIGINT)


def take(
    browser: Any, address: str, target: Path, window: dict[str, int], theme: str = "light", ready: str = ""
) -> None:
    """One picture of an address, once the page has drawn."""
    page = browser.new_page(viewport=window, color_scheme=theme)
    page.goto(address)
    page.wait_for_selector("html[data-ready=yes]", timeout=60_000)
    if ready:
        page.wait_for_selector(ready, timeout=120_000)
    page.wait_for_timeout(3000)  # films are decoded and the first look is simulated
    page.screenshot(path=str(target))
    page.close()


def windows() -> Iterator[tuple[str, str, dict[str, int]]]:
    """Ending of a picture's name, theme and window; that of the documents first."""
    for size, window in (("", WIDE), ("-narrow", NARROW)):
        for theme in ("light", "dark"):
            yield size + ("-dark" if theme == "dark" else ""), theme, window


def main(campaign: Path, target: Path | None) -> None:
    """Report, steps of the workbench, and its page of many campaigns."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    report = f"file://{(campaign / 'rfea' / 'report' / 'index.html').resolve()}"
    with sync_playwright() as playwright, workbench(campaign) as address:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        pages = {"report": (report, "")}
        pages |= {f"workbench-{step}": (f"{address}c/0/#/{step}", ready) for step, ready in STEPS.items()}
        for name, (page, ready) in pages.items():
            for ending, theme, window in windows():
                if target is not None or (name in IN_DOCUMENTS and not ending):
                    place = (target or Path(__file__).parent) / f"{name}{ending}.png"
                    take(browser, page, place, window, theme, ready)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
