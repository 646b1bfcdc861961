"""Many campaigns on one page, two side by side, and the notebook."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import ModelFit
from rfea_vision.report import render, render_comparison, render_index, render_notebook
from rfea_vision.report.batch import _side
from rfea_vision.report.collect import collect
from rfea_vision.report.pack import Pack
from rfea_vision.stages.publishing import _labels, _page_beside
from testing.readable import FAINT_TEXT
from testing.report.browser import Browser
from testing.report.sample import RUNGS, write_sample

TWO = ("steps-270kPa", "steps-180kPa")


@pytest.fixture(scope="module")
def tube_a(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sample(tmp_path_factory.mktemp("a") / "tube-A" / "rfea", seconds=1.5, video=False, names=TWO)


def test_index_has_a_row_per_experiment_and_a_column_per_rung(tube_a: Path, tmp_path: Path) -> None:
    broken = tmp_path / "tube-B" / "rfea"
    (tube_a / "report").mkdir(exist_ok=True)
    (tube_a / "report" / "index.html").write_text("made before")
    html = render_index([tube_a, broken], beside=tube_a.parent.parent)
    first = ModelFit.load(tube_a / "models" / RUNGS[0] / "model.json").experiments["steps-270kPa"].tip_rmse_mm
    assert first is not None
    assert f"{first:.2f}" in html
    assert html.count('<th scope="row">steps-') == 2
    ladder = json.loads((tube_a / "ladder.json").read_text())
    run = write_sample(tmp_path / "tube-T" / "rfea", seconds=1.5, video=False)
    tested = render_index([run])
    assert ladder["test"]["model"] == RUNGS[-1]
    row = tested.split('<th scope="row">mixed-250kPa')[1].split("</tr>")[0]
    assert row.count("–") == len(RUNGS) - 2  # scored once, on the first rung and the last
    assert len(re.findall(r"Rung \d", html)) == 3
    assert 'href="tube-A/rfea/report/index.html"' in html
    assert "tube-B" in html
    assert "no command has written results for this campaign yet" in html


def test_one_broken_folder_does_not_stop_the_index(tube_a: Path, tmp_path: Path) -> None:
    """Artefacts of the wrong kind are a sentence, and a name with signs of its own keeps its link."""
    broken = tmp_path / "tube #2?" / "rfea"
    shutil.copytree(tube_a, broken)
    (broken / "report").mkdir(exist_ok=True)
    (broken / "report" / "index.html").write_text("made before")
    (broken / TWO[0] / "clip.json").write_text("[]")
    (broken / "models" / RUNGS[0] / "timings.json").write_text("[1, 2]")
    evidence = collect(broken)
    run = next(run for run in evidence.experiments if run.name == TWO[0])
    assert "clip.json could not be read (it holds a list" in run.absent["clip"]
    assert "timings.json could not be read (it holds a list" in evidence.steps[0].absent["timings"]
    html = render_index([broken], beside=tmp_path)
    assert 'href="tube%20%232%3F/rfea/report/index.html"' in html


def test_a_folder_that_nobody_foresaw_is_listed_with_the_reason(tube_a: Path, monkeypatch) -> None:
    monkeypatch.setattr("rfea_vision.report.batch.collect", lambda folder: {}["surprise"])
    assert "its results cannot be read (KeyError(&#39;surprise&#39;))" in render_index([tube_a])


def test_notebook_runs_as_it_stands(tube_a: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = json.loads(render_notebook(tube_a, title="tube-A"))
    assert book["nbformat"] == 4
    (tube_a / "report").mkdir(exist_ok=True)
    monkeypatch.chdir(tube_a / "report")
    space: dict = {}
    for cell in book["cells"]:
        if cell["cell_type"] == "code":
            exec(cell["source"], space)
    assert (
        space["recording"].attrs["experiment"] == "steps-180kPa"
        or space["recording"].attrs["experiment"] == "steps-270kPa"
    )
    assert "midline" in space["prediction"]


def test_notebook_of_an_empty_folder(tmp_path: Path) -> None:
    assert json.loads(render_notebook(tmp_path, title="nothing"))["cells"]


def test_a_campaigns_name_leads_no_page_elsewhere(tmp_path: Path) -> None:
    page = _page_beside(SimpleNamespace(out=tmp_path), "../../evil")  # type: ignore[arg-type]
    assert page.parent == tmp_path / "report"
    assert page.name == "beside-..-..-evil.html"


def test_campaigns_of_one_name_are_told_apart() -> None:
    def called(*folders: str) -> list[str]:
        works = [SimpleNamespace(campaign=SimpleNamespace(name="tube", root=Path(folder))) for folder in folders]
        return _labels(works)  # type: ignore[arg-type]

    assert called("/a/first") == ["tube"]
    assert called("/a/first", "/a/second") == ["first", "second"]
    assert called("/a/run", "/b/run") == ["/a/run", "/b/run"]


def test_pair_without_models(tube_a: Path, tmp_path: Path) -> None:
    other = tmp_path / "tube-C" / "rfea"
    shutil.copytree(tube_a, other)
    shutil.rmtree(other / "models")
    html = render_comparison(tube_a, other)
    assert "tube-C" in html
    assert "is named in ladder.json but is not there" in html
    absent = [re.sub(r"<[^>]+>", "", text) for text in re.findall(r'<p class="absent">(.*?)</p>', html)]
    for why in ("no model has been fitted", "has no steady state", "no elongation along the tube"):
        assert len([text for text in absent if text.startswith("tube-C is not drawn: ") and why in text]) == 1, absent
    assert not [text for text in absent if text.startswith("tube-A is not drawn")]


def test_a_pair_says_that_no_angle_was_measured_and_asks_for_nothing(tube_a: Path) -> None:
    """Of a tip alone: 'run rfea sync' was said though it had run, and that no rest was found though there were eight."""
    recording = SimpleNamespace(name="a", role="train", recording=xr.Dataset({"tip": (("time", "xy"), np.zeros((3, 2)))}))
    rest = {"pressure_kPa": [0.0, 50.0], "angle_deg": [None, None], "fitted_angle_deg": [0.0, 30.0]}
    fit = SimpleNamespace(steady_state=rest)
    evidence: Any = SimpleNamespace(experiments=[recording], last=SimpleNamespace(fit=fit, comparison=None))
    absent = _side(evidence, Pack())["absent"]
    assert absent["loops"] == absent["steady"] == "no bend angle was measured."
    fit.steady_state, recording.recording = {}, None
    absent = _side(evidence, Pack())["absent"]
    assert "run `rfea sync`" in absent["loops"] and "no rest at a pressure was found" in absent["steady"]


def test_parameters_are_compared_by_tube_and_a_missing_one_is_said(tube_a: Path, tmp_path: Path) -> None:
    other = tmp_path / "tube-C" / "rfea"
    shutil.copytree(tube_a, other)
    last = other / "models" / RUNGS[-1] / "model.json"
    model = json.loads(last.read_text())
    model["segments"] *= 2
    del model["parameters"]["r_hyd"]
    last.write_text(json.dumps(model))
    html = render_comparison(tube_a, other)
    manifest = json.loads(re.search(r'id="manifest">(.*?)</script>', html, re.DOTALL)[1])
    rows = {row["name"]: row["sides"] for row in manifest["parameters"]}
    stiffness = rows["k_ref, whole tube"]
    assert stiffness[0]["value"] == pytest.approx(2 * stiffness[1]["value"])
    ladder = other / "ladder.json"
    rungs = json.loads(ladder.read_text())
    ladder.write_text(json.dumps(rungs | {"rungs": rungs["rungs"][:-1]}))
    assert '<th scope="row">With ' not in render_comparison(tube_a, other)  # a fit beside the ladder is no rung
    assert rows["r_hyd"][1] == {"value": None, "interval": None, "text": "not in its model"}


@pytest.mark.chromium
def test_pair_in_a_browser(chromium: Browser, tube_a: Path, sample: Path, tmp_path: Path) -> None:
    page = tmp_path / "pair.html"
    page.write_text(render_comparison(sample, tube_a, names=("long", "short")), encoding="utf-8")
    chromium.complaints.clear()
    chromium.requests.clear()
    chromium.resize(1440, 900)
    chromium.open(page)
    chromium.wait("[...document.querySelectorAll('[data-figure]')].slice(0, 1).every(f => f.dataset.state === 'drawn')")
    chromium.run(
        "(s => { s.value = 1; s.dispatchEvent(new Event('change')); })(document.querySelector('select[data-side]'))"
    )
    assert chromium.run("document.querySelectorAll('.figure.empty').length") == 0
    assert chromium.complaints == []
    assert [r for r in chromium.requests if not r.startswith("data:")] == [page.resolve().as_uri()]


def test_many_tubes_on_one_page(sample):
    from rfea_vision.report.collect import collect
    from rfea_vision.report.group import GroupMember, group_plates, parameters_of, render_group

    pytest.importorskip("matplotlib")
    evidence = collect(sample)
    turns = {"A": 12.0, "B": 24.0, "<C>": 36.0}
    tubes = [GroupMember(name, {"turns": (count, ""), "load": (30.0, "g")}, evidence) for name, count in turns.items()]
    plates = group_plates(tubes)
    assert {plate.name.split("-over-")[1] for plate in plates} == {"turns"}  # the load is the same in all
    stiffness = next(plate for plate in plates if plate.name.startswith("k_ref"))
    fit = tubes[0].last.fit
    assert stiffness.table()["k_ref [N m/rad]"].tolist() == pytest.approx(
        [fit.parameters["k_ref"].value / fit.segments] * 3
    )
    assert parameters_of(tubes[0])["r_hyd"] == fit.parameters["r_hyd"]
    page = render_group(tubes)
    assert "bending stiffness of the whole tube at" in page and "of a joint" not in page
    assert "bending stiffness of a joint at" in render(sample, title="A", commands=())  # a joint's, as k_ref is there
    assert "<C>" not in page and "&lt;C&gt;" in page
    assert all(effect in page for effect in ("in the model", "36", "30 g"))
    assert page.count("<svg") == len(plates) and "http://" not in page.replace("http://www.w3.org", "")
    assert "Not in it" not in page
    assert "Nobody has asked" not in page and "not asked" not in page
    unasked = [
        replace(step, diagnosis=None, rung=step.rung.model_copy(update={"verdict": ""})) for step in evidence.steps
    ]
    page = render_group([*tubes, GroupMember("E", {}, replace(evidence, steps=unasked))])
    assert "what the last model of E lacks" in page and page.count(">not asked<") > 1
    lacking = GroupMember("D", {"load": (3.0, "mm")}, evidence)
    page = render_group([*tubes, lacking])
    assert page.count("Not in it: D (no turns in its design).") == len(plates)
    assert "load is given in g and mm: write it in one unit" in page


@pytest.mark.chromium
def test_pages_with_drawings_on_white_can_be_read_in_the_dark_and_on_a_phone(sample, chromium, tmp_path):
    from rfea_vision.report.group import GroupMember, group_plates, render_group
    from rfea_vision.report.paper import render_paper
    from rfea_vision.stages.reproducing import MODELS, table_one

    pytest.importorskip("matplotlib")
    evidence = collect(sample)
    tubes = [GroupMember(name, {"turns": (count, "")}, evidence) for name, count in {"A": 12.0, "B": 24.0}.items()]
    fits = dict.fromkeys(MODELS, tubes[0].last.fit)
    table = table_one(fits)
    names = {str(row["parameter"]): "Damper coefficient, negative direction" for row in table}
    runs, peaks = {"train": "steps", "validate": "sine"}, {"train": 270.0, "validate": 220.0}
    pages = {"group": render_group(tubes), "paper": render_paper("tube", group_plates(tubes), table, fits, runs, peaks, names)}
    for name, text in pages.items():
        (tmp_path / f"{name}.html").write_text(text, encoding="utf-8")
        chromium.call("Page.navigate", url=(tmp_path / f"{name}.html").as_uri())
        chromium.wait("document.readyState === 'complete' && document.querySelectorAll('.figs svg').length > 0")
        for width in (1280, 400):
            chromium.resize(width, 900, mobile=width == 400)
            for theme in ("light", "dark"):
                chromium.run(f"document.documentElement.dataset.theme = '{theme}'")
                assert chromium.run(FAINT_TEXT) == [], f"{name}, {theme}, {width} px"
                assert chromium.run("document.documentElement.scrollWidth") <= width, f"{name}, {width} px"
