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
#: Name of the picture, step of the workbench, theme, and window.
STEPS = (
    ("workbench-play", "play", "light", WIDE),
    ("workbench-add", "add", "light", WIDE),
    ("workbench-law", "law", "dark", WIDE),
    ("workbench-dark", "play", "dark", WIDE),
    ("workbench-narrow", "play", "light", NARROW),
)


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


def main(campaign: Path, target: Path) -> None:
    """Report, steps of the workbench, and its page of many campaigns."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        report = f"file://{(campaign / 'rfea' / 'report' / 'index.html').resolve()}"
        for name, theme, window in (
            ("report", "light", WIDE),
            ("report-dark", "dark", WIDE),
            ("report-narrow", "light", NARROW),
        ):
            take(browser, report, target / f"{name}.png", window, theme)
        with workbench(campaign) as address:
            for name, step, theme, window in STEPS:
                take(browser, f"{address}c/0/#/{step}", target / f"{name}.png", window, theme)
        with workbench(campaign.parent) as address:
            take(browser, f"{address}c/all/", target / "workbench-folder.png", WIDE, ready="tr[data-campaign]")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent)
