"""A small campaign of the twin that hides one effect, the workbench opened on it, and a Chromium that Playwright drives."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rfea_vision.stages import open_campaign
from rfea_vision.twin import TwinOptions, parse_hidden, simulate
from tests.once import made_once

SEGMENTS = 4
HIDDEN = {"k1": 0.2, "T": 0.5}


@dataclass(frozen=True)
class Served:
    """A workbench that runs: its address, and the folder that it was opened on."""

    address: str
    folder: Path
    process: subprocess.Popen[str]


@pytest.fixture(scope="session")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two training runs and a held-out one of 2 s as tracks, and the paper's model fitted to them."""
    return Path(
        shutil.copytree(made_once(tmp_path_factory, "fitted", _fitted), tmp_path_factory.mktemp("twin") / "tube-A")
    )


def _fitted(place: Path) -> Path:
    folder = place / "tube-A"
    options = TwinOptions(
        hidden=parse_hidden([f"maxwell.{name}={value}{'s' if name == 'T' else ''}" for name, value in HIDDEN.items()]),
        roles=("train", "train", "validate"), duration_s=2.0, rate_Hz=60, noise_mm=0.03, sync="common_clock", seed=3,
    )  # fmt: skip
    simulate(folder, options)
    open_campaign(folder).fit(segments=SEGMENTS)
    return folder


@pytest.fixture
def campaign(fitted: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(fitted, tmp_path / "tube-A"))


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Served]]:
    """Open the workbench on a folder; it is ended after the tests of a file. Laws are written to no real person's folder."""
    open_ones: list[subprocess.Popen[str]] = []
    environment = {**os.environ, "XDG_DATA_HOME": str(tmp_path_factory.mktemp("home"))}

    def begin(folder: Path) -> Served:
        code = "import sys; from rfea_vision.cli import main; main(sys.argv[1:])"
        process = subprocess.Popen(
            [sys.executable, "-c", code, "open", str(folder), "--no-browser"],
            stdout=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
        open_ones.append(process)
        assert process.stdout is not None
        return Served(process.stdout.readline().strip(), folder, process)

    yield begin
    for process in open_ones:
        process.send_signal(signal.SIGINT)
    assert [process.wait(timeout=60) for process in open_ones] == [0] * len(open_ones), "Ctrl-C did not end it cleanly"


def idle(page: Any) -> None:
    """Wait until nothing that was asked for is under way."""
    page.wait_for_selector("html:not([data-busy])", timeout=300_000)
    assert page.locator("#fault").is_hidden(), page.text_content("#fault")


def at_rest(page: Any, selector: str) -> dict[str, float]:
    """Where something is once it stays there: a sentence above it that changes may move it by a line."""
    box = None
    for _ in range(100):
        before, box = box, page.locator(selector).bounding_box()
        if box == before:
            break
        page.wait_for_timeout(150)
    assert box is not None
    return box


def until(page: Any, condition: Callable[[], object], seconds: float = 120) -> None:
    """Wait for the page; its policy forbids the evaluation of text that Playwright's own waiting needs."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "never came true"
        page.wait_for_timeout(50)


def hold(page: Any, pattern: str) -> list[Any]:
    """Requests to these addresses, kept back until a test lets them go: an answer that comes as late as one likes."""
    held: list[Any] = []

    def keep(route: Any) -> None:
        held.append(route)

    page.route(pattern, keep)
    return held


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    executable = next(
        (path for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if path), None
    )
    if executable is None:
        if os.environ.get("CI"):
            pytest.fail("CI is set but there is no Chromium: install the package chromium")
        pytest.skip("no Chromium on this machine: install the package chromium to run these tests")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def visit(chromium: Any) -> Iterator[Callable[..., Any]]:
    """Open an address; at the end the page must not have complained, nor asked anybody else for anything."""
    pages: list[tuple[Any, list[str], list[str]]] = []

    def go(address: str, *, width: int = 1280, height: int = 900, wait: bool = True) -> Any:
        page = chromium.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(300_000)
        complaints: list[str] = []
        requests: list[str] = []
        # a refusal that the page says in a sentence (422) stands in the console, too
        page.on(
            "console",
            lambda message: (
                complaints.append(message.text) if message.type == "error" and "422" not in message.text else None
            ),
        )
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        pages.append((page, complaints, requests))
        page.goto(address)
        if wait:
            page.wait_for_selector("html[data-ready=yes]")
        return page

    yield go
    for page, complaints, requests in pages:
        page.close()
        assert complaints == []
        assert {url.split("/")[2] for url in requests if url.startswith("http")} <= {requests[0].split("/")[2]}
