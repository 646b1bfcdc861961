"""Fifty hostile names and sentences among a campaign's results: the report shows them, and does nothing that they say."""

from __future__ import annotations

import base64
import json
import shutil
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


@pytest.mark.parametrize("spoilt", ["{}", '{"file": "clip.mp4", "times_s": 3}', '{"file": "../../secret.txt"}'])
def test_a_clips_record_leads_nowhere_and_breaks_no_page(sample: Path, tmp_path: Path, spoilt: str) -> None:
    """Nobody writes the record of a run that the campaign does not have but whoever made the folder."""
    run = Path(shutil.copytree(sample / "steps-270kPa", tmp_path / "tube" / "rfea" / "ghost"))
    (tmp_path / "tube" / "secret.txt").write_text("a key of mine")
    told = json.loads((run / "clip.json").read_text()) if "secret" in spoilt else {}
    (run / "clip.json").write_text(json.dumps(told | json.loads(spoilt)))
    (run / "clip.mp4").unlink()
    page = render(run.parent, title="tube", commands=())
    assert base64.b64encode(b"a key of mine").decode() not in page
    assert ("could not be read" in page) == ("secret" not in spoilt)


def test_a_record_that_would_never_end_is_said(small: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(small, tmp_path / "rfea"))
    bomb = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    bomb += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    (folder / "calibration" / "camera.yaml").write_text(
        "camera_matrix: 1\n" + "\n".join(bomb) + "\nquality: {coverage: *a8}\n"
    )
    (folder / "models" / "base" / "timings.json").write_text("[" * 100_000)
    page = render(folder, title="tube", commands=())
    assert "it has aliases, which OpenCV does not write" in page


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
