"""Fifty hostile names and sentences among a campaign's results: the report shows them, and does nothing that they say."""

from __future__ import annotations

import json
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

from rfea_vision.report import render, render_index
from testing.report.browser import Browser
from testing.report.sample import write_sample
from tests.hostile import HOSTILE

NAMED = ("effect", "effects", "named", "at", "title", "unit")


def spoilt(value: Any, hostile: Any, key: str = "") -> Any:
    """Every sentence, and every name of an effect, with another hostile text in its place."""
    if isinstance(value, dict):
        return {name: spoilt(item, hostile, name) for name, item in value.items()}
    if isinstance(value, list):
        return [spoilt(item, hostile, key) for item in value]
    return next(hostile) if isinstance(value, str) and (" " in value or key in NAMED) else value


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    name = HOSTILE[1].replace("/", "")
    place = tmp_path_factory.mktemp("hostile") / name / "rfea"
    out = write_sample(place, seconds=1.5, video=False, names=("steps-270kPa", "steps-180kPa"))
    hostile = cycle(HOSTILE)
    for file in sorted(out.rglob("*.json")):
        content = json.loads(file.read_text())
        file.write_text(json.dumps(spoilt(content, hostile)))
    return out


def test_they_stand_on_the_page_as_text(folder: Path) -> None:
    page = render(folder, title=HOSTILE[0], commands=HOSTILE[:2])
    assert "<script>window.done" not in page and "<img src=x" not in page and "<iframe" not in page
    assert "&lt;script&gt;window.done=1" in page


@pytest.mark.chromium
def test_fifty_hostile_names_do_nothing(chromium: Browser, folder: Path, tmp_path: Path) -> None:
    report, index = tmp_path / "report.html", tmp_path / "index.html"
    report.write_text(render(folder, title=HOSTILE[0], commands=HOSTILE), encoding="utf-8")
    index.write_text(render_index([folder], beside=tmp_path), encoding="utf-8")
    chromium.complaints.clear()
    chromium.requests.clear()
    chromium.open(report)
    everything = "document.documentElement.textContent"
    shown = chromium.run(everything)
    assert sum(text.replace("\x00", "\ufffd") in shown or text.replace("\x00", "") in shown for text in HOSTILE) == len(
        HOSTILE
    )
    made = "document.querySelectorAll('[onerror], [onload], [onclick], iframe, object, embed, [href*=evil], [href^=javascript]').length"
    assert chromium.run(made) == 0
    chromium.call("Page.navigate", url=index.resolve().as_uri())
    chromium.wait("document.readyState === 'complete'")
    assert chromium.run(made) == 0 and chromium.run("window.done === undefined")
    assert chromium.complaints == []
    assert [address for address in chromium.requests if not address.startswith(("data:", "file:", "blob:"))] == []
