"""Adding an effect and watching the error fall; a law of one's own; one clock: as a person does them, in a real Chromium."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rfea_vision.campaign import load_campaign
from rfea_vision.critique.terms import Term, effect_source

from .conftest import at_rest, hold, idle, until
from .everyone import highlighted, unfit

pytestmark = pytest.mark.chromium


@pytest.fixture(scope="module")
def work(fitted, tmp_path_factory):
    """A copy of the campaign with what a diagnosis says of it: asking takes longer than a test may."""
    import shutil

    folder = shutil.copytree(fitted, tmp_path_factory.mktemp("adding") / "tube-A")
    candidates = [
        {"effect": "maxwell", "title": "Relaxation", "probability": 0.93, "share": 0.98, "validate_rmse_mm": 0.1, "refitted": True},
        {"effect": "hysteresis", "title": "Hysteresis", "probability": 0.05, "share": 0.3, "predicted_rmse_mm": 0.9, "refitted": True},
        {"effect": "drag", "title": "Drag", "predicted_rmse_mm": 1.2},
    ]  # fmt: skip
    tied = [{"effects": ["maxwell", "hysteresis"], "split_by": "a step held for long"}]
    following = {"for": ["maxwell", "hysteresis"], "pressure": "next_pressure.csv", "sentence": "Hold 150 kPa for 4 s."}
    diagnosis = {
        "model": "base",
        "verdict": "missing",
        "named": ["maxwell"],
        "candidates": candidates,
        "tied": tied,
        "next_experiment": following,
    }
    model = folder / "rfea" / "models" / "base"
    (model / "diagnosis.json").write_text(json.dumps({"format": "rfea-diagnosis/1", **diagnosis}))
    (model / "next_pressure.csv").write_text("time_s,pressure_kPa\n0,0\n1,0\n1.2,150\n5,150\n5.2,0\n6,0\n")
    return folder


@pytest.fixture(scope="module")
def served(serve, work):
    return serve(work)


def test_a_command_that_fails_says_why_and_the_sentence_stays(served, visit):
    page = visit(served.address)
    main = "import(document.querySelector('script[type=module]').src)"
    page.evaluate(f"{main}.then(main => main.begin('diagnose', {{model: 'nope'}}))")
    page.wait_for_selector("#fault:has-text(\"no model 'nope'\")")
    page.wait_for_selector("html:not([data-busy])")
    assert "no model 'nope'" in page.text_content("#fault") and page.locator("#fault").is_visible()


def test_a_fit_beside_the_ladder_hangs_from_what_it_was_made_of(served, visit):
    """In the order of fitting base, base + a, base + b, base + a + c: the line had gone from one to the next."""
    page = visit(served.address)
    add = "import(new URL('add.js', document.querySelector('script[type=module]').src).href)"
    assert page.evaluate(f"{add}.then(add => add.standsOn([[], ['a'], ['b'], ['a', 'c'], []]))") == [-1, 0, 0, 1, -1]


def test_every_panel_can_be_used_by_everyone(served, visit):
    assert unfit(visit(served.address), "clock", "play", "add", "law", "batch") == {}


def test_an_effect_is_ticked_its_rung_appears_and_unticked_it_is_back(work, served, visit):
    page = visit(served.address)
    assert (
        "lacks maxwell" in page.text_content("#next-say") and page.text_content("#next-do") == "Add maxwell and watch"
    )
    assert "rfea fit" in page.text_content("#next-command") and "--add maxwell" in page.text_content("#next-command")
    page.click('.places a[href="#/add"]')
    row = page.locator('#candidates tr:has(input[value="maxwell"])')
    assert "93 %" in row.text_content() and "98 %" in row.text_content()
    assert "cannot be told apart" in page.text_content("#ties")
    assert highlighted(page) == ["Add maxwell and watch"]
    page.check('#candidates input[value="maxwell"]')
    assert highlighted(page) == ["Fit with maxwell"] == [page.text_content("#fit-ticked")]
    page.click("#fit-ticked")
    page.wait_for_selector('[data-rung="base+maxwell"][aria-checked="true"]', timeout=300_000)
    idle(page)
    first, last = (page.text_content(f'[data-rung="{name}"] .error').split()[-2] for name in ("base", "base+maxwell"))
    assert float(last) < float(first) / 3
    page.click('.places a[href="#/batch"]')
    page.wait_for_selector("#batch tr.on")
    told = page.locator("#batch tr.on td").all_text_contents()
    assert told[:4] == [f"{first} → {last} mm", "not asked", "maxwell", "3 of 3 runs"]
    page.click('.places a[href="#/add"]')
    page.uncheck('#candidates input[value="maxwell"]')
    page.wait_for_selector('[data-rung="base"][aria-checked="true"]')
    assert "rfea fit" in page.text_content("#log")
    model = json.loads((work / "rfea" / "models" / "base+maxwell" / "model.json").read_text())
    assert model["effects"] == ["maxwell"]


def test_the_next_experiment_is_edited_within_the_rigs_limits_and_saved(work, served, visit):
    page = visit(served.address + "#/add")
    page.click('[data-rung="base"]')
    holder = page.locator('[data-figure="curve"] .canvas')
    holder.focus()
    for key in ("ArrowRight", "ArrowRight", "Shift+ArrowUp", *["Shift+ArrowUp"] * 60):
        holder.press(key)
    page.click("#save-curve")
    page.wait_for_selector("#saved:has-text('written')")
    rows = (work / "rfea" / "models" / "base" / "next-experiment-edited.csv").read_text().splitlines()
    pressures = [float(row.split(",")[1]) for row in rows[1:]]
    highest = float(page.text_content("#limits").split(" to ")[1].split()[0])
    assert rows[0] == "time_s,pressure_kPa" and 150 < max(pressures) <= highest + 0.5


def test_a_law_is_checked_while_it_is_typed_and_fitted(work, served, visit, tmp_path):
    page = visit(served.address + "#/law")
    page.wait_for_selector("#law-said:has-text('Units fit')", timeout=300_000)
    assert "Θ" in page.text_content("#law-effects math")  # the law is set, not spelled
    good = page.input_value("#law-text")
    file = tmp_path / "mine.py"
    page.fill("#law-file", str(file))
    with page.expect_response("**/law/new"):
        page.click("#law-save")
    page.fill("#law-text", good.replace("joint.tube_angle**2", "joint.rate"))
    page.wait_for_selector("#law-said.worse", timeout=300_000)
    assert "unit" in page.text_content("#law-said") and page.locator("#law-fit").is_disabled()
    page.fill("#law-text", good.replace("def stiffness(", "def stiffness["))
    page.wait_for_selector("#law-said:has-text('line ')", timeout=300_000)
    page.fill("#law-text", good.replace("my_effect", "my_stiffening"))
    page.wait_for_selector("#law-said.better", timeout=300_000)
    assert file.is_file()
    page.click("#law-fit")
    page.wait_for_selector('[data-rung*="my_stiffening"]', timeout=300_000)
    idle(page)
    assert f"--effect-file {file}" in page.text_content("#log")


def opened_law(page, file) -> None:
    """What the editor shows is this file, checked, and fitting it is the next thing to do."""
    page.wait_for_selector("#law-said.better:has-text('held-out error falls')")
    assert page.input_value("#law-file") == str(file) and page.input_value("#law-text") == Path(file).read_text()
    assert page.text_content("#law-effects h4") and page.locator("#law-effects math").count()
    until(page, lambda: highlighted(page) == ["Fit with this law"])


def test_a_law_that_the_worker_proposes_opens_in_the_editor_if_nothing_was_typed(served, visit, tmp_path):
    """What the worker tells is told here: looking for a law takes half a minute (below)."""
    page = visit(served.address + "#/law")
    lines = hold(page, "**/events")
    page.route("**/job", lambda route: route.fulfill(json={"begun": True}))
    page.reload()
    page.wait_for_selector("#law-said:has-text('Units fit')")
    assert highlighted(page) == [page.text_content("#next-do")], "nothing has been typed yet"
    page.click("#law-propose")
    file = tmp_path / "proposed_1.py"
    file.write_text(effect_source("proposed_1", [Term("a**3", "the cube of the bend", ())], [0.01]))
    result = {"file": str(file), "sentence": "With that law refitted the held-out error falls from 2 to 1 mm."}
    told = {"event": "finished", "index": 0, "do": "propose", "result": result}
    page.unroute("**/events")
    lines.pop(0).fulfill(content_type="text/event-stream", body=f"data: {json.dumps(told)}\n\n")
    opened_law(page, file)


@pytest.mark.study
def test_a_law_is_proposed_for_what_is_left(work, served, visit):
    page = visit(served.address + "#/law")
    page.click('[data-rung="base"]')
    page.wait_for_selector("#law-said:has-text('Units fit')")
    page.click("#law-propose")
    idle(page)
    until(page, lambda: "proposed" in page.input_value("#law-file"))  # it is opened once the search is over
    file = page.input_value("#law-file")
    assert not Path(file).is_relative_to(work)
    opened_law(page, file)


def test_what_is_dragged_or_typed_stays_when_the_campaign_is_read_anew(work, served, visit):
    page = visit(served.address + "#/add")
    page.click('[data-rung="base"]')
    holder = page.locator('[data-figure="curve"] .canvas')
    holder.focus()
    for key in ("ArrowRight", "ArrowRight", *["Shift+ArrowDown"] * 3):
        holder.press(key)
    page.click('.places a[href="#/clock"]')
    page.fill("#offset", "12.5")
    page.evaluate("import(document.querySelector('script[type=module]').src).then(main => main.reload())")
    assert page.input_value("#offset") == "12.5"
    page.click('.places a[href="#/add"]')
    page.click("#save-curve")
    page.wait_for_selector("#saved:has-text('written')")
    saved = np.loadtxt(
        work / "rfea" / "models" / "base" / "next-experiment-edited.csv", delimiter=",", skiprows=1, unpack=True
    )
    assert np.interp([1.2, 5.0], *saved) == pytest.approx([120, 150], abs=1)


def test_a_file_that_comes_late_does_not_go_over_what_was_typed(work, served, visit, tmp_path):
    page = visit(served.address + "#/law")
    page.wait_for_selector("#law-said:has-text('Units fit')", timeout=300_000)
    (tmp_path / "other.py").write_text("# another law")
    held = hold(page, "**/law/open")
    file = page.input_value("#law-file")
    page.fill("#law-file", str(tmp_path / "other.py"))
    page.click("#law-open")
    until(page, lambda: held)
    page.fill("#law-file", file)
    page.fill("#law-text", "# mine")
    with page.expect_response("**/law/open"):
        held.pop().continue_()
    page.wait_for_timeout(500)
    assert page.input_value("#law-text") == "# mine" and page.input_value("#law-file") == file


def test_a_name_in_the_field_is_no_order_to_write_there(work, served, visit, tmp_path):
    mine, other = tmp_path / "mine.py", tmp_path / "other.py"
    mine.write_text("# mine")
    other.write_text("# another law")
    page = visit(served.address + "#/law")
    page.wait_for_selector("#law-said:has-text('Units fit')", timeout=300_000)
    for file in (other, mine):
        page.fill("#law-file", str(file))
        page.click("#law-open")
        until(page, lambda file=file: page.input_value("#law-text") == file.read_text())
    page.fill("#law-file", str(other))
    page.fill("#law-text", "# mine, typed on")
    until(page, lambda: mine.read_text() == "# mine, typed on")
    assert other.read_text() == "# another law"
    page.click("#law-save")
    page.wait_for_selector("#fault:has-text('is there already')")


def test_a_job_that_the_page_has_not_heard_begin_is_shown_and_one_that_it_has_not_heard_end_goes(served, visit):
    page = visit(served.address)
    again = "import(document.querySelector('script[type=module]').src).then(main => main.reload())"

    def with_job(route) -> None:
        answer = route.fetch()
        route.fulfill(response=answer, json=answer.json() | {"job": {"index": 0, "do": "improve", "label": "Climb"}})

    page.route("**/state", with_job)
    page.evaluate(again)
    assert page.text_content("#job-label") == "Climb" and page.locator("#job-stop").is_visible()
    page.unroute("**/state")
    page.evaluate(again)
    assert page.locator("#job").is_hidden()
    idle(page)


def test_a_law_that_never_ends_or_lies_in_a_campaign_is_refused(work, served, visit):
    page = visit(served.address + "#/law")
    page.wait_for_selector("#law-said:has-text('Units fit')", timeout=300_000)
    (work / "law.py").write_text("raise SystemExit")
    page.fill("#law-file", str(work / "law.py"))
    page.click("#law-open")
    page.wait_for_selector("#fault:has-text('lies in a campaign')")


def test_an_offset_is_dragged_and_kept(work, served, visit):
    page = visit(served.address + "#/clock")
    page.wait_for_selector("#clock-say:has-text('ms')")
    run = page.text_content("#clock-runs [aria-selected=true]")
    box = at_rest(page, '[data-figure="sync"] .canvas')
    before = float(page.input_value("#offset"))
    page.mouse.move(box["x"] + 200, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 240, box["y"] + 60, steps=3)
    page.mouse.up()
    after = float(page.input_value("#offset"))
    assert after > before + 5
    page.click("#keep-offset")
    idle(page)
    sync = load_campaign(work).experiment(run).sync
    assert sync.method == "offset" and 1e3 * sync.value == pytest.approx(after, abs=0.01)
    report = "import(new URL('../../report/report.js', location))"
    shown, span = page.evaluate(f"{report}.then(r => [r.state.window, r.experiment().span])")
    assert shown == pytest.approx(span), "a run whose clock was moved is shown in part"
