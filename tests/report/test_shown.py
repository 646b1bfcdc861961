"""Degrees where only an angle was measured, words instead of ids, and what gives way when a page grows too large."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import pytest
import xarray as xr

from rfea_vision.artefacts import Comparison, Diagnosis, Ladder, ModelFit, Recording
from rfea_vision.artefacts.judgement import WorstPlace
from rfea_vision.files import read_dataset, write_datasets
from rfea_vision.report import page, render, render_index
from rfea_vision.report.collect import collect
from rfea_vision.report.films import fit_films
from rfea_vision.report.formatting import as_added
from rfea_vision.report.formatting import number as shown_number
from rfea_vision.report.pack import Pack
from rfea_vision.report.prose import _missing, _shows, effect_titles, how_it_ended, in_words
from rfea_vision.report.series import pack_prediction
from testing.report.sample import RUNGS
from testing.report.small import TWO, only_angles
from tests.report.test_render import page_of, words

DRAWN = (
    *((0, "left", None), (30, "left", None), (180, "left", "up"), (-170, "right", "up")),
    *((90, "left", "to the left"), (90, "right", "to the right"), (-90, "left", "to the right")),
)


@pytest.mark.parametrize(("gravity_deg", "bends", "way"), DRAWN)
def test_a_rig_that_does_not_hang_is_said_to_be_drawn_as_if_it_did(small: Path, tmp_path: Path, gravity_deg, bends, way) -> None:
    """A finger that stood on a bench was shown head down, and no word said so."""
    folder = Path(shutil.copytree(small, tmp_path / "tube" / "rfea"))
    for path in folder.glob("*/recording.nc"):
        data = read_dataset(path)
        Recording(data.assign_attrs(gravity_deg=float(gravity_deg), bends=bends)).save(path)
    manifest = json.loads(re.search(r"id=\"manifest\">(.*?)</script>", page_of(folder), re.S)[1])  # type: ignore[index]
    told = {run["turned"] for run in manifest["experiments"]}
    assert told == {f"Drawn with the tube at rest pointing down: gravity points {way} here." if way else ""}


def test_an_angle_campaign_is_shown_in_degrees(small: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(small, tmp_path / "tube" / "rfea"))
    in_mm = page_of(folder)
    only_angles(folder)
    html = page_of(folder)
    text = words(html)
    assert "Held out, mm" in in_mm
    assert "Held out, deg" in text
    assert "Predicted, deg" in text
    assert "Held out, mm" not in text
    assert "Tip error" not in text
    worst = Comparison.load(folder / "models" / "base" / "comparison.json").where[0]
    assert worst.rmse_mm is None and re.search(rf"<b>{shown_number(worst.rmse_deg)}.deg</b>", html)
    assert "0.0417 deg" in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "off by 0.123 deg , the model of the paper by 4.56 deg" in text.replace("\N{NO-BREAK SPACE}", " ")
    rungs = json.loads(re.search(r"id=\"manifest\">(.*?)</script>", html, re.S)[1])["rungs"]  # type: ignore[index]
    assert [rung["unit"] for rung in rungs] == ["deg"] * 3
    assert rungs[0]["floor"] == 0.0417
    candidates = html.split('data-csv="candidates-base"')[1].split("</table>")[0]
    assert candidates.count('class="n strong">–') == 0
    index = render_index([folder])
    angle = ModelFit.load(folder / "models" / "base" / "model.json").experiments["steps-270kPa"].angle_rmse_deg
    assert f"{angle:.2f}" in index
    assert "errors in deg" in index


def test_one_page_knows_one_noise_floor(small: Path, tmp_path: Path) -> None:
    """Every rung has what its own fit took for noise; the page tells that by which the last rung was judged."""
    folder = Path(shutil.copytree(small, tmp_path / "rfea"))
    for number, rung in enumerate(RUNGS):
        room = folder / "models" / rung
        found = Diagnosis.load(room / "diagnosis.json")
        found.model_copy(update={"noise_floor_mm": 0.0901 + 0.001 * number}).save(room / "diagnosis.json")
    html = page_of(folder)
    rungs = json.loads(re.search(r"id=\"manifest\">(.*?)</script>", html, re.S)[1])["rungs"]  # type: ignore[index]
    assert [rung["floor"] for rung in rungs] == [0.0921] * 3
    text = words(html).replace("\N{NO-BREAK SPACE}", " ")
    assert "0.0921 mm" in text
    assert not re.search(r"0\.09[01]\d* mm|0\.085 mm", text)


def test_sentences_of_artefacts_speak_the_readers_words(small: Path) -> None:
    evidence = collect(small)
    titles = effect_titles(evidence)
    assert in_words("The tip of model base is off.", evidence, titles) == "The tip of the model of the paper is off."
    assert (
        in_words("The tip of model base+maxwell is off.", evidence, titles)
        == "The tip of the model with visco-elastic relaxation (Maxwell branch) is off."
    )
    made_up = "b_neg_ref had moved to make up for maxwell: 0.1 before."
    assert "for visco-elastic relaxation (Maxwell branch): 0.1" in in_words(made_up, evidence, titles)
    assert in_words("The data call for maxwell.", evidence, titles).endswith(
        "for visco-elastic relaxation (Maxwell branch)."
    )
    assert in_words("maxwell.T lies far off", evidence, titles).startswith("maxwell.T")
    assert in_words("creep (maxwell)", evidence, titles) == "creep (maxwell)"
    own = titles | {"maxwell": "A maxwell branch: it creeps"}
    assert in_words("A maxwell branch: it creeps (maxwell); model base+maxwell, not maxwell.", evidence, own) == (
        "A maxwell branch: it creeps (maxwell); the model with a maxwell branch, not a maxwell branch."
    )
    assert "falls into the rises of the pressure" in in_words("2 % falls into the phase 'rise'.", evidence, titles)
    assert how_it_ended(evidence, titles) == "The search ended because what is left is at the noise floor."


def test_of_more_than_two_effects_the_headline_alone_has_the_names() -> None:
    step: Any = SimpleNamespace(outcome="complete", asks_less=False, comparison=None)
    two, three = (_missing(names, step, "", False) for names in (["a", "b"], ["a", "b", "c"]))
    assert two.value == "a; b" and three.value == "3 effects"


def test_a_rung_appends_its_parameters_to_those_of_the_one_before() -> None:
    of_a_fit = dict.fromkeys(["k_ref", "r_hyd", "maxwell.k1", "pressure_gain@right.g", "rest_curvature.angle"])
    added = ["rest_curvature:kinked", "maxwell", "pressure_gain@right"]
    assert list(as_added(of_a_fit, added)) == ["k_ref", "r_hyd", "rest_curvature.angle", "maxwell.k1", "pressure_gain@right.g"]


def test_what_no_effect_explains_is_not_called_nothing(small: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(small, tmp_path / "rfea"))
    ladder = Ladder.load(folder / "ladder.json").model_dump(mode="json")
    Ladder.model_validate(ladder | {"rungs": ladder["rungs"][:1]}).save(folder / "ladder.json")
    for rung in RUNGS[1:]:
        shutil.rmtree(folder / "models" / rung)
    found = Diagnosis.load(folder / "models" / "base" / "diagnosis.json").model_dump(mode="json", by_alias=True)
    changed = found | {"verdict": "unexplained", "named": []}
    Diagnosis.model_validate(changed).save(folder / "models" / "base" / "diagnosis.json")
    text = words(page_of(folder))
    assert "Something is missing that no effect in the catalogue explains" in text
    assert "Not in the catalogue" in text
    assert "nothing had to be added" not in text


def test_calibration_study_profile_and_runs_left_out_are_told(small: Path) -> None:
    html = page_of(small)
    text = words(html)
    assert "of the tube's length" in text.replace("&#39;", "'")  # an apostrophe comes through OpenCV's YAML
    assert "10 photos are few" in text
    assert html.count("data:image/jpeg;base64,") == 9
    assert "k_ref lies between 0.0831 and 0.0859 N m/rad" in text
    assert "k_ref moves most when a run is left out" in text
    assert "pinhole with Brown distortion" in text
    study = html.split('data-csv="segments-base"')[1].split("</table>")[0]
    fit = ModelFit.load(small / "models" / "base" / "model.json")
    assert study.count("<tr") == 1 + len(fit.segments_study)
    assert f'data-value="{fit.segments_study[0]["validate_tip_y_rmse_mm"]}"' in study
    assert ">6.4<" in study.replace("6.40", "6.4")  # seconds of 32 segments, from timings.json


def test_series_thin_out_before_the_page_grows_too_large(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = re.search(r"id=\"series\">(.*?)</script>", page_of(small), re.S)
    assert whole is not None
    monkeypatch.setattr(page, "SERIES_LIMIT_BYTES", len(whole[1]) // 3)
    html = render(small, title="thin", commands=())
    thin = re.search(r"id=\"series\">(.*?)</script>", html, re.S)
    assert thin is not None
    assert len(thin[1]) <= len(whole[1]) // 3
    manifest = json.loads(re.search(r"id=\"manifest\">(.*?)</script>", html, re.S)[1])  # type: ignore[index]
    assert manifest["experiments"][0]["t"]["shape"][0] > 30


def test_films_shrink_to_fit(sample: Path) -> None:
    experiments = collect(sample).experiments
    records: list[dict] = [{"clip": {}, "why": {}} for _ in experiments]
    whole = sum(len(e.clip or b"") for e in experiments) * 4 // 3
    films = fit_films(experiments, records, whole // 2)
    assert len(films) == len(experiments)
    assert sum(len(text) for _, text in films) <= whole // 2
    frames = {e.name: len(e.clip_info["times_s"]) for e in experiments}
    for name, text in films:
        with av.open(io.BytesIO(base64.b64decode(text)), "r") as film:
            assert sum(1 for _ in film.decode(video=0)) == frames[name]


def test_a_film_that_cannot_shrink_enough_is_left_out_with_a_word(sample: Path) -> None:
    experiments = collect(sample).experiments[:1]
    records: list[dict] = [{"clip": {}, "why": {}}]
    assert fit_films(experiments, records, 500) == []
    assert "was left out to keep this page below" in records[0]["why"]["clip"]


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("ink", ["ink", "muted", "measured", "modelled-text", "accent", "bad"])
@pytest.mark.parametrize("paper", ["paper", "sunk", "wash"])
def test_text_stands_out_from_its_paper(theme: str, ink: str, paper: str) -> None:
    """Contrast as WCAG 2.1 computes it, 4.5 for text (https://www.w3.org/TR/WCAG21/#contrast-minimum)."""
    block = page.static("style.css").split(f'[data-theme="{theme}"] {{')[1].split("}")[0]
    tokens = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block))
    high, low = sorted((luminance(tokens[ink]), luminance(tokens[paper])), reverse=True)
    assert (high + 0.05) / (low + 0.05) >= 4.5


def test_a_test_run_is_drawn_after_the_end_and_a_curve_with_its_band(small: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(small, tmp_path / "rfea"))
    room = folder / "models" / RUNGS[0]
    groups: dict[str | None, xr.Dataset] = {name: read_dataset(room / "prediction.nc", group=name) for name in TWO}
    last = groups.pop(TWO[1])
    write_datasets(room / "prediction.nc", groups)

    def drawn() -> dict[str, Any]:
        evidence = collect(folder)
        run = next(run for run in evidence.experiments if run.name == TWO[1])
        return pack_prediction(evidence.steps[0], run, Pack())

    assert "tip" not in drawn() and "prediction" in drawn()["why"]
    error = xr.ones_like(last["tip"]).assign_attrs(quantile_95=1.96)
    write_datasets(room / "prediction-test.nc", {TWO[1]: last.assign(tip_stderr=error)})
    assert {"tip", "tip_band"} <= drawn().keys()


@pytest.mark.parametrize(
    ("low", "high", "says"),
    [
        (0.88, 1.0, "; the model is off most in the last 12 % of the way to the tip"),
        (0.0, 0.2, "; the model is off most in the first 20 % of the way from the clamp"),
        (0.34, 0.47, "; the model is off most between 34 and 47 % of the way from clamp to tip"),
        (0.2, 0.9, ""),
    ],
)
def test_where_a_model_is_off_most_is_said_in_words(low, high, says):
    """It was said to 'show 88 to 100 % along the tube'."""
    place = WorstPlace(experiment="a", from_s=0.0, to_s=1.0, from_sigma=low, to_sigma=high, rmse_mm=1.0, phase="hold", sentence="")
    step: Any = SimpleNamespace(comparison=SimpleNamespace(where=[place]))
    assert _shows(step) == says
