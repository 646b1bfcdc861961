"""Names and sentences from a campaign's files do nothing on the page but stand there."""

from __future__ import annotations

import json
import shutil

import pytest
import yaml

from tests.hostile import HOSTILE

from .conftest import until

pytestmark = pytest.mark.chromium


#: A report that somebody wrote who wants more than to be read.
REPORT = """<!doctype html><title>?</title><script>
fetch('state').then(() => 'reached', () => 'refused').then(said => { document.title = `${origin} ${said}`; });</script>"""


@pytest.fixture(scope="module")
def served(serve, fitted, tmp_path_factory):
    folder = shutil.copytree(fitted, tmp_path_factory.mktemp("hostile") / "tube-A")
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    (folder / "campaign.yaml").write_text(yaml.safe_dump({**campaign, "name": HOSTILE[0], "note": HOSTILE[1]}))
    candidates = [
        {
            "effect": text,
            "title": text,
            "at": text,
            "note": text,
            "probability": 0.5,
            "refitted": True,
            "validate_rmse_mm": 1.0,
        }
        for text in HOSTILE
    ]
    diagnosis = {
        "format": "rfea-diagnosis/1", "model": "base", "verdict": "missing", "sentence": HOSTILE[2], "named": HOSTILE[3:5],
        "candidates": candidates, "tied": [{"effects": HOSTILE[:2], "split_by": HOSTILE[5]}], "warnings": HOSTILE[6:8],
    }  # fmt: skip
    (folder / "rfea" / "models" / "base" / "diagnosis.json").write_text(json.dumps(diagnosis))
    model = folder / "rfea" / "models" / "base" / "model.json"
    other = model.parent.parent / HOSTILE[10].replace("/", "")
    shutil.copytree(model.parent, other)
    record = json.loads(model.read_text())
    (other / "model.json").write_text(json.dumps({**record, "name": HOSTILE[11], "effects": [HOSTILE[12]]}))
    (folder / "rfea" / "report").mkdir()
    (folder / "rfea" / "report" / "index.html").write_text(REPORT)
    return serve(folder)


def test_fifty_hostile_names_do_nothing(served, visit):
    page = visit(served.address)
    dialogs = []
    page.on("dialog", lambda dialog: (dialogs.append(dialog.message), dialog.dismiss()))
    for panel in ("setup", "clock", "play", "add", "law", "batch", "add"):
        page.click(f'.places a[href="#/{panel}"]')
        page.wait_for_timeout(200)
    page.click('[data-rung="base"]')
    shown = page.text_content("#candidates") + page.text_content("#ties") + page.text_content("#verdict")
    assert all(text in shown for text in HOSTILE[:6])
    assert page.text_content("#title") == HOSTILE[0]
    assert dialogs == [] and page.evaluate("window.done") is None
    markup = "#candidates :is(script, img, svg, iframe, math, b), #title *, #rungs :is(script, img, iframe)"
    assert page.locator(markup).count() == 0


def test_a_report_is_opened_where_it_can_ask_the_workbench_for_nothing(served, visit):
    page = visit(served.address)
    with page.expect_popup() as opened:
        page.click("#next-report")
    until(page, lambda: opened.value.title() == "null refused")
