# ruff: noqa: E501 (scripts read better whole)
"""What is not there says why: the page of a campaign of which a part is missing, in a real browser."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rfea_vision.report import render
from testing.report.browser import VISIT_ALL, Browser
from testing.report.sample import RUNGS
from testing.report.small import only_angles

pytestmark = pytest.mark.chromium


def angle_only(folder: Path) -> None:
    """What an inclinometer gives: no camera, no film, no shape."""
    only_angles(folder)
    shutil.rmtree(folder / "calibration")


def measured_only(folder: Path) -> None:
    shutil.rmtree(folder / "models")
    (folder / "ladder.json").unlink()


def tracked_only(folder: Path) -> None:
    measured_only(folder)
    for path in folder.glob("*/recording.nc"):
        path.unlink()


def empty(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def one_fit(folder: Path) -> None:
    (folder / "ladder.json").unlink()
    for name in RUNGS[1:]:
        shutil.rmtree(folder / "models" / name)
    for name in ("comparison.json", "diagnosis.json"):
        (folder / "models" / "base" / name).unlink()


@pytest.mark.parametrize("take_away", [angle_only, measured_only, tracked_only, empty, one_fit])
def test_absent_panels_say_why(
    chromium: Browser, tmp_path: Path, small: Path, take_away: Callable[[Path], None]
) -> None:
    folder = Path(shutil.copytree(small, tmp_path / "rfea"))
    take_away(folder)
    page = tmp_path / "index.html"
    page.write_text(render(folder, title="bare", commands=()), encoding="utf-8")
    chromium.complaints.clear()
    chromium.resize(1440, 900)
    chromium.open(page)
    chromium.run(VISIT_ALL)
    for key in ("ArrowRight", "]", "2", "b", "+", "0", "s"):
        chromium.key(key)
    chromium.run("dispatchEvent(new Event('beforeprint')), dispatchEvent(new Event('afterprint'))")
    assert chromium.complaints == []
    silent = chromium.run(
        "[...document.querySelectorAll('.figure.empty')].filter(f => !(f.querySelector('.why')?.textContent.length > 20)).map(f => f.dataset.figure)"
    )
    assert silent == []
    over_time = chromium.run("[...document.querySelectorAll('.linked .figure')].map(f => f.dataset.figure)")
    assert ("tip-x" in over_time) == (take_away is not angle_only and bool(over_time)), "a tip that no run has needs no panel"
    assert "undefined" not in chromium.run("document.body.innerText")
