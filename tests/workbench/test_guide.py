"""The next step: one at a time, and none past a doubt without its being said."""

from __future__ import annotations

import pytest
import xarray as xr
import yaml

from rfea_vision.files import write_dataset
from rfea_vision.workbench.app_state import in_words
from rfea_vision.workbench.guide import next_step
from rfea_vision.workbench.state import _clock, state_of


def run(doubts="", *, good=100, pictures=True):
    tracked, recorded = {"good": good, "frames": 100}, {"doubts": doubts}
    measured = {"logged": True, "changed": False, "tracked": tracked, "recorded": recorded}
    return {"name": "steps", "role": "train", "pictures": pictures, **measured}


def model(**more):
    return {"name": "base", "effects": [], "segments": 4, "verdict": None, "named": []} | more


def test_more_segments_are_no_law_but_a_finer_chain():
    coarse = model(verdict="missing", named=["maxwell", "segments"])
    assert next_step([run()], [coarse])["options"] == {"add": ["maxwell"], "segments": 8}
    coarse["named"] = ["segments"]
    assert next_step([run()], [coarse])["options"] == {"add": [], "segments": 8}
    assert next_step([run()], [coarse, model(name="base-2", segments=8)])["options"] == {"model": "base-2"}


def test_what_is_lacking_is_said_in_words_too():
    titles = [{"effect": "maxwell", "title": "Visco-elastic relaxation"}, {"effect": "kink", "title": "A kink"}]
    lacking = model(verdict="missing", named=["maxwell"], candidates=titles)
    assert next_step([run()], [lacking])["say"] == "base lacks maxwell: visco-elastic relaxation."
    said = "film.mp4: 3 of 90 frames could be measured (edge_lost); give camera.tip (in pixels)"
    assert in_words(said) == said.replace("edge_lost", "an edge of the tube was not to be seen")


def test_a_constant_pressure_stands_in_place_of_a_log(campaign):
    file = next(campaign.glob("*/experiment.yaml"))
    written = yaml.safe_load(file.read_text())
    file.write_text(yaml.safe_dump(written | {"pressure": {"value": "100 kPa"}}))
    assert all(item["logged"] for item in state_of(campaign, None)["experiments"])


def test_a_measured_campaign_is_fitted():
    step = next_step([run()], [])
    assert step["do"] == "fit" and "otherwise" not in step


def test_a_length_that_the_film_contradicts_is_a_doubt_here_too(tmp_path):
    kept = "the inextensible side keeps its length within 0.004 % over all postures"
    for length, doubts in ((kept, ""), (f"{kept}; it measures +5.0 %: check the board's square", "check the board's")):
        attributes = {"offset_s": 0.1, "sync_method": "motion", "length_check": length}
        write_dataset(tmp_path / "recording.nc", xr.Dataset(attrs=attributes))
        clock = _clock(tmp_path / "recording.nc")
        assert clock is not None and bool(clock["doubts"]) == bool(doubts) and doubts in clock["doubts"]


def test_a_report_that_is_written_is_said_with_its_place():
    models = [model(verdict="complete")]
    assert next_step([run()], models)["do"] == "report"
    step = next_step([run()], models, "rfea/report/index.html")
    assert "report is written" in step["say"] and step["file"] == "rfea/report/index.html"
    assert step["do"] is None and not step["label"]
    less = next_step([run()], [model(verdict="complete", asks_less=True)])
    assert less["say"] == "Nothing that matters is missing as far as the held-out runs ask."


def test_where_no_law_is_found_either_there_is_a_way_on():
    unsure = next_step([run()], [model(verdict="complete", uncertain=True)])
    assert "too uncertain: whether something is missing cannot be said. A board" in unsure["say"] and unsure["do"] == "report"
    away = next_step([run()], [model(verdict="complete", uncertain=True, uncertain_because="the fit ran away, k_ref is large")])
    assert away["say"] == "The fit ran away, k_ref is large: whether something is missing cannot be said."
    step = next_step([run()], [model(verdict="unexplained")])
    assert step["do"] == "propose" and step["otherwise"]["do"] == "report"
    written = next_step([run()], [model(verdict="unexplained")], "rfea/report/index.html")
    assert "report is written" in written["say"] and "otherwise" not in written


@pytest.mark.parametrize(
    ("item", "panel", "says"),
    [
        (run("is it the right tube?"), "setup", "steps: is it the right tube?"),
        (run("is it in Pa?", pictures=False), "clock", "steps: is it in Pa?"),
        (run(good=50), "setup", "Many frames of steps were refused"),
    ],
)
def test_what_is_doubted_is_looked_at_first_and_may_be_fitted_all_the_same(item, panel, says):
    step = next_step([item], [])
    assert step["panel"] == panel and says in step["say"] and step["experiment"] == "steps" and step["do"] is None
    assert step["otherwise"]["do"] == "fit"
    assert next_step([item], [model()])["do"] == "diagnose"


def lost(name, **hints):
    item = {"name": name, "role": "train", "pictures": True, "logged": True, "changed": False, "hints": hints}
    return item | {"tracked": None, "recorded": None}


def test_where_no_tube_was_found_one_points_at_each_film_in_turn():
    """It had said "measure the runs" again, for ever."""
    films = [lost("a", clamp=[[0, 0], [1, 0]]), lost("b")]
    assert next_step(films, [])["do"] == "sync"
    said = "a/film.mp4: 3 of 90 frames could be measured (edge_lost)"
    for name, tool in (("a", "tip"), ("b", "clamp"), ("b", "tip")):
        step = next_step(films, [], failed=said)
        assert (step["experiment"], step["tool"], step["do"]) == (name, tool, None) and name in step["say"]
        assert step["otherwise"]["do"] == "sync"
        next(item for item in films if item["name"] == name)["hints"][tool] = [0, 0]
    assert next_step(films, [], failed=said)["do"] == "sync"
    assert next_step([lost("b")], [], failed="b/film.mp4: is no video; check it")["do"] == "sync"


def test_an_offset_that_was_not_found_is_given_by_hand():
    item = run() | {"recorded": None}
    assert next_step([item], [])["do"] == "sync"
    step = next_step([item], [], failed="steps: sync: the motion explains only 3 %")
    assert step["panel"] == "clock" and step["do"] is None and step["otherwise"]["do"] == "sync"
