"""A made-up campaign for every test of the report, and a real browser for some."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from rfea_vision.report import render
from testing.report.browser import Browser, find_chromium
from testing.report.sample import write_sample
from testing.report.small import write_small
from tests.once import made_once

COMMANDS = ("rfea improve tube-A", "rfea report tube-A")


@pytest.fixture(scope="session")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole `rfea/` folder: four runs of 6 s with film, three rungs."""
    made = made_once(tmp_path_factory, "sample", lambda folder: write_sample(folder / "rfea"))
    return Path(shutil.copytree(made, tmp_path_factory.mktemp("tube-A") / "rfea"))


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short campaign of two runs without film; copy it before it is changed."""
    return write_small(tmp_path_factory.mktemp("small") / "rfea")


@pytest.fixture(scope="session")
def page(sample: Path) -> Path:
    """The report of the sample, as a file."""
    path = sample / "report" / "index.html"
    path.parent.mkdir()
    path.write_text(render(sample, title="tube-A", commands=COMMANDS), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    executable = find_chromium()
    if executable is None:
        if os.environ.get("CI"):
            pytest.fail("CI is set but there is no Chromium: install the package chromium")
        pytest.skip("no Chromium on this machine: install the package chromium to run these tests")
    with Browser(executable) as browser:
        yield browser


@pytest.fixture
def opened(chromium: Browser, page: Path) -> Browser:
    """The page, freshly opened on a wide screen."""
    chromium.resize(1440, 900)
    chromium.open(page)
    return chromium
