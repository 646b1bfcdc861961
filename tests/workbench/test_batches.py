"""A folder of campaigns, run from the page on Dask, which says meanwhile what its workers do: in a real Chromium."""

from __future__ import annotations

import re
import shutil

import pytest

from .conftest import idle, until
from .everyone import highlighted, unfit

pytestmark = pytest.mark.chromium

#: Notes every sentence of the live view.
LISTEN = """(() => { window.told = [];
  const view = document.querySelector('#tasks');
  new MutationObserver(() => told.push(view.textContent)).observe(view, {childList: true}); })()"""


@pytest.fixture(scope="module")
def served(serve, fitted, tmp_path_factory):
    """One campaign that cannot be read, and one of whose runs none may be fitted: a batch of seconds."""
    folder = tmp_path_factory.mktemp("bench") / "tubes"
    shutil.copytree(fitted, folder / "held-out")
    shutil.rmtree(folder / "held-out" / "rfea")
    for file in folder.glob("held-out/*/experiment.yaml"):
        file.write_text(file.read_text().replace("role: train", "role: validate"))
    shutil.copytree(folder / "held-out", folder / "torn")
    (folder / "torn" / "campaign.yaml").write_text("format: rfea-campaign/1\nname: [")
    return serve(folder)


def test_what_the_workers_do_is_seen_while_a_folder_is_run(served, visit):
    page = visit(served.address)
    page.wait_for_selector("#batch tr[data-campaign]")
    assert page.text_content("#title") == "tubes" and highlighted(page) == ["Run all of them"]
    torn, held_out = (page.locator(f"[data-campaign]:has-text('{name}')") for name in ("torn", "held-out"))
    assert "valid YAML" in torn.text_content() and "no experiment has 'role: train'" in held_out.text_content()
    page.evaluate(LISTEN)
    page.click("#run-all")
    page.wait_for_selector("#job-label:has-text('Run 2 campaigns')")
    assert "rfea batch" in page.text_content("#job-command") and highlighted(page) == []
    until(page, lambda: "failed" in torn.text_content())
    until(page, lambda: "failed" in held_out.text_content())
    idle(page)
    told = page.evaluate("told")
    # one worker may have done it all before the second stood
    said = r"^(1 worker|2 workers); under way: \d x (measure|finish)\. Dask's own page: http://127"
    assert any(re.search(said, one) for one in told), told
    assert told[-1] == ""
    assert unfit(page, "batch") == {}
