"""The page as text: complete or absent with a reason, every number from an artefact, nothing from outside."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import Recording, Track
from rfea_vision.artefacts.rows import LEFT_BY_A_MODEL, UNUSED_BY_BEAMS
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.calibration.storage import save_calibration
from rfea_vision.effects.catalogue import catalogue
from rfea_vision.files import read_dataset, write_datasets
from rfea_vision.report import render
from rfea_vision.report.collect import collect
from rfea_vision.report.formatting import inner_title
from testing.report.sample import RUNGS
from testing.report.small import TWO


@pytest.fixture
def copy(small: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small, tmp_path / "rfea"))


def page_of(folder: Path) -> str:
    return render(folder, title="tube-A", commands=("rfea improve tube-A",))


def words(html: str) -> str:
    """What a reader sees, without styles, scripts and tags."""
    bare = re.sub(r"<(style|script|noscript|math).*?</\\1>".replace("\\\\", "\\"), " ", html, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", bare))


def numbers_in(value: object) -> set[float]:
    if isinstance(value, dict):
        return set().union(*map(numbers_in, value.values()), set())
    if isinstance(value, list):
        return set().union(*map(numbers_in, value), set())
    return {float(value)} if isinstance(value, int | float) and not isinstance(value, bool) else set()


def test_a_rung_whose_model_is_gone_is_said(copy: Path) -> None:
    shutil.rmtree(copy / "models" / RUNGS[-1])
    for name in RUNGS[:-1]:
        (copy / "models" / name / "diagnosis.json").unlink()
    assert f"models/{RUNGS[-1]} is named in ladder.json but is not there" in words(page_of(copy))


def test_no_drift_is_told_where_none_was_found(copy: Path) -> None:
    """"Drift 0 ± 93075 ppm" stood there for a run whose clock had been given no drift."""
    path = next(iter(sorted(copy.glob("*/recording.nc"))))
    recording = read_dataset(path)
    for drift, told in ((3.0, "3.0 2.0"), (0.0, "\N{EN DASH} \N{EN DASH}")):
        recording.attrs |= {"drift_ppm": drift, "drift_stderr_ppm": 2.0}
        Recording(recording).save(path)
        row = page_of(copy).split(f'<th scope="row">{path.parent.name}</th><td>motion')[1].partition("</tr>")[0]
        assert told in words(row)


def test_the_methods_do_not_tell_how_another_tools_track_was_made(copy: Path) -> None:
    assert "sides of the silhouette" in page_of(copy)
    for path in copy.glob("*/recording.nc"):
        Recording(read_dataset(path).drop_vars("edges")).save(path)
    assert "sides of the silhouette" not in page_of(copy)


def test_the_methods_of_other_tools_tracks_tell_of_no_camera(copy: Path) -> None:
    """They said that a camera was brought onto the log's clock, and referred to its calibration and to the reader of films."""
    assert "zhang2000" in page_of(copy)
    shutil.rmtree(copy / "calibration")
    text = words(page_of(copy))
    assert "Track and pressure log were brought onto one clock" in text and "Camera and pressure log" not in text
    assert "zhang2000" not in text and "opencv" not in text and "kelageri2018" in text and "kennedy2001" in text
    assert "Every frame of every run was used" not in text


def test_a_beams_report_tells_nothing_of_a_bore(copy: Path) -> None:
    """A methods text said "k_slope (change of the stiffness with the inner radius) = 0" of a rod, and a table k at no inner radius."""
    assert "with the inner radius" in words(page_of(copy)) and "In the units of the paper's table" in words(page_of(copy))
    for path in copy.glob("models/*/model.json"):
        fit = json.loads(path.read_text())
        fit["actuator"] |= {"kind": "rod"}
        for name in UNUSED_BY_BEAMS:
            fit["parameters"][name] |= {"value": 0.0, "fixed": True, "stderr": None}
        path.write_text(json.dumps(fit))
    text = words(page_of(copy))
    assert "with the inner radius" not in text and "In the units of the paper's table" not in text and "bending stiffness" in text


def test_why_there_is_no_test_score_is_said(copy: Path) -> None:
    """'No experiment has role: test, or the search was stopped before the end' left the reader to find out which."""
    path = copy / "ladder.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"test": None}))
    assert "No test score: no experiment has role: test ." in words(page_of(copy))
    recording = next(copy.glob("*/recording.nc"))
    dataset = read_dataset(recording)
    dataset.attrs["role"] = "test"
    Recording(dataset).save(recording)
    assert "No test score: the search was stopped before the end." in words(page_of(copy))


def test_without_a_held_out_run_the_verdict_says_so(copy: Path) -> None:
    """Of one run that was fitted the page said without more ado that nothing that matters is missing."""
    path = copy / "ladder.json"
    ladder = json.loads(path.read_text())
    ladder["rungs"][-1]["verdict"] = "complete"
    path.write_text(json.dumps(ladder))
    text = words(page_of(copy))
    assert "No run was held out" not in text and "on training and on held-out runs" in text
    for recording in copy.glob("*/recording.nc"):
        dataset = read_dataset(recording)
        dataset.attrs["role"] = "train"
        Recording(dataset).save(recording)
    for model in copy.glob("models/*/model.json"):
        fit = json.loads(model.read_text())
        fit["experiments"] = {name: score | {"role": "train"} for name, score in fit["experiments"].items()}
        model.write_text(json.dumps(fit))
    text = words(page_of(copy))
    assert "No run was held out: the runs that were fitted say so, and no other." in text
    assert "on the training runs (none was held out)" in text


def test_the_methods_say_which_loss_was_minimised(copy: Path) -> None:
    assert "training runs by least squares. " in words(page_of(copy))
    for path in copy.glob("models/*/model.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"loss": "huber"}))
    text = words(page_of(copy))
    assert "training runs by the robust loss of Huber" in text
    assert "training runs by least squares" not in text


def test_the_methods_say_what_an_effect_cannot_be_told_from(copy: Path) -> None:
    path = copy / "ladder.json"
    ladder = json.loads(path.read_text())
    ladder["rungs"][1]["tied"] = ["drag"]
    path.write_text(json.dumps(ladder))
    title = catalogue()[ladder["rungs"][1]["added"]].title
    assert f"cannot tell {inner_title(title)} from drag" in words(page_of(copy)), words(page_of(copy))[-9000:]


def test_a_run_that_was_set_aside_since_is_not_shown(small: Path) -> None:
    html = render(small, title="tube-A", runs=TWO[:1])
    manifest = json.loads(re.search(r"id=\"manifest\">(.*?)</script>", html, re.S)[1])  # type: ignore[index]
    assert [run["name"] for run in manifest["experiments"]] == list(TWO[:1])


def test_says_what_was_found(small: Path) -> None:
    text = words(page_of(small))
    lacked = (
        "The model of the paper lacked 2 things: visco-elastic relaxation (Maxwell branch); gravity tilted in the plane"
    )
    assert f"{lacked}, or " in text  # never without what it cannot be told from
    assert "cannot be told apart by these data" in text
    assert "rfea improve tube-A" in text
    for name in TWO:
        assert name in text


def test_a_scale_without_a_board_is_told_as_such(copy: Path) -> None:
    scale = scaled_by_distance((360, 640), [[180.0, 100.0], [180.0, 372.0]], 155.0)
    save_calibration(copy / "calibration" / "camera.yaml", scale)
    text = words(page_of(copy))
    assert "by a scale from 155 mm over 272 px; lens and tilt of the camera are assumed" in text
    assert "was calibrated as" not in text and "What is assumed" in text and "photos cannot be judged" not in text
    assert "Corners of the board" not in text and "Places of the board" not in text  # told to come from another tool


def test_asks_nothing_of_the_network(small: Path) -> None:
    html = page_of(small)
    assert re.findall(r"(?:src|href)=\"(?!#|data:|\$)[^\"]*\"", html) == []
    assert set(re.findall(r"https?://[\w./]+", html)) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1998/Math/MathML",
    }
    assert "@import" not in html
    assert "url(" not in html.split("</style>")[0]


def test_every_number_in_a_table_stands_in_an_artefact(small: Path) -> None:
    known: set[float] = set()
    for path in small.rglob("*.json"):
        known |= numbers_in(json.loads(path.read_text()))
    for path in small.glob("*/recording.nc"):
        attributes = read_dataset(path).attrs
        known |= {
            scale * v for v in attributes.values() if isinstance(v, float) for scale in (1, 1000)
        }  # s shown as ms
    known |= numbers_in(dict(collect(small).camera or {}))
    shown = [float(value) for value in re.findall(r"data-value=\"([-\d.e]+)\"", page_of(small))]
    assert len(shown) > 100
    assert [value for value in shown if value not in known] == []


def test_same_artefacts_same_page(small: Path) -> None:
    assert page_of(small) == page_of(small)


def test_without_a_model_the_measurement_is_shown(copy: Path) -> None:
    shutil.rmtree(copy / "models")
    (copy / "ladder.json").unlink()
    text = words(page_of(copy))
    assert "no model has been fitted yet" in text
    assert "run rfea fit" in text.replace("  ", " ")
    assert "steps-270kPa" in text


def test_a_single_fit_without_ladder(copy: Path) -> None:
    (copy / "ladder.json").unlink()
    for name in RUNGS[1:]:
        shutil.rmtree(copy / "models" / name)
    (copy / "models" / "base" / "diagnosis.json").unlink()
    text = words(page_of(copy))
    assert "what it lacks has not been looked for yet" in text
    assert "base has no diagnosis yet: run rfea diagnose" in text
    assert "No ladder yet" in text


def test_an_empty_folder(tmp_path: Path) -> None:
    text = words(page_of(tmp_path))
    assert "No experiment has been tracked yet" in text
    assert "No model yet" in text


@pytest.mark.parametrize("name", ["comparison.json", "diagnosis.json", "prediction.nc"])
def test_a_missing_piece_is_named(copy: Path, name: str) -> None:
    (copy / "models" / "base" / name).unlink()
    html = page_of(copy)
    assert f"base has no {name.split('.')[0]}" in html


@pytest.mark.parametrize(
    "name", ["ladder.json", "models/base/model.json", "models/base/prediction.nc", "steps-270kPa/recording.nc"]
)
def test_a_broken_piece_is_named_and_the_rest_stands(copy: Path, name: str) -> None:
    (copy / name).write_text("not what it should be")
    html = page_of(copy)
    assert Path(name).name in html
    assert "gravity" in html


def test_an_inclinometer_has_only_angles(copy: Path) -> None:
    for name in TWO:
        kept = ["valid", "reason", "bend_angle", "bend_angle_sigma"]
        recording = read_dataset(copy / name / "recording.nc")
        Recording(recording[[*kept, "pressure"]]).save(copy / name / "recording.nc")
        Track(read_dataset(copy / name / "track.nc")[kept]).save(copy / name / "track.nc")
    for rung in RUNGS:
        path = copy / "models" / rung / "prediction.nc"
        groups: dict[str | None, xr.Dataset] = {
            name: read_dataset(path, group=name)[["bend_angle", "angle_residual", "phase"]] for name in TWO
        }
        write_datasets(path, groups)
    html = page_of(copy)
    manifest = json.loads(re.search(r"id=\"manifest\">(.*?)</script>", html, re.S)[1])  # type: ignore[index]
    first = manifest["experiments"][0]
    assert "angle" in first
    assert "tip" not in first
    assert "has no tip" in first["why"]["tip"]
    assert manifest["rungs"][0]["experiments"]["steps-270kPa"]["unit"] == "deg"


def test_all_frames_lost(copy: Path) -> None:
    path = copy / TWO[0] / "recording.nc"
    data = read_dataset(path)
    for name, variable in data.data_vars.items():
        if variable.dtype.kind == "f" and name != "pressure":
            data[name] = variable * np.nan
    data["valid"] = data["valid"] * 0
    data["reason"] = ("time", np.full(data.sizes["time"], "the tube was not found"))
    Recording(data).save(path)
    html = page_of(copy)
    assert "the tube was not found" in html


def test_hostile_names_stay_text(copy: Path) -> None:
    html = render(copy, title="</title><script>alert(1)</script>", commands=("rm -rf <b>",))
    assert "<script>alert(1)" not in html
    assert "<b>" not in html.split("<main>")[1].split("Commands that made")[1].split("</section>")[0]


def test_runs_come_in_the_order_of_their_roles(small: Path) -> None:
    assert [experiment.role for experiment in collect(small).experiments] == ["train", "validate"]


def test_films_beyond_the_size_limit_are_left_out_with_a_word(
    sample: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rfea_vision.report import page

    whole = len(page_of(sample))
    films = sum(4 * path.stat().st_size / 3 for path in sample.glob("*/clip.mp4"))
    monkeypatch.setattr(page, "SIZE_LIMIT_BYTES", whole - int(films / 2))
    html = page_of(sample)
    assert len(html) < page.SIZE_LIMIT_BYTES
    assert "was left out to keep this page below" in html


def test_the_ladder_remembers_its_verdict(copy: Path) -> None:
    headline = re.search(r"<h1>(.*?)</h1>", page_of(copy))[1]
    (copy / "models" / RUNGS[-1] / "diagnosis.json").write_text("of an older version")
    assert re.search(r"<h1>(.*?)</h1>", page_of(copy))[1] == headline
    assert "lacked" in headline


def test_what_is_complete_for_its_held_out_runs_alone_says_no_more(copy: Path) -> None:
    """The held-out run was a slow ramp, and fast steps were off by two floors: the headline said that nothing was missing."""
    for file in (copy / "models" / RUNGS[-1] / "diagnosis.json", copy / "ladder.json"):
        told = json.loads(file.read_text())
        (told["rungs"][-1] if "rungs" in told else told).update(asks_less=True, verdict="complete")
        file.write_text(json.dumps(told))
    html = page_of(copy)
    headline = words(re.search(r"<h1>(.*?)</h1>", html)[1])
    assert "nothing that matters is missing as far as the held-out runs ask; the training runs, which ask more" in headline
    assert "complete as far as the held-out runs ask" in words(html.split('id="ladder"')[1])
    assert "as far as the held-out runs ask" in words(html.split("Missing physics")[1].split("Tip error")[0])


def test_a_track_that_cannot_tell_is_not_called_complete(copy: Path) -> None:
    for file in (copy / "models" / RUNGS[-1] / "diagnosis.json", copy / "ladder.json"):
        told = json.loads(file.read_text())
        (told["rungs"][-1] if "rungs" in told else told).update(uncertain=True, verdict="complete")
        file.write_text(json.dumps(told))
    html = page_of(copy)
    headline = words(re.search(r"<h1>(.*?)</h1>", html)[1])
    assert headline.startswith("The track is too uncertain: whether something is missing cannot be said; ") and "lacked" not in headline
    assert "too uncertain to say" in words(html.split('id="ladder"')[1])
    assert "perhaps more" in words(html.split("Missing physics")[1].split("Tip error")[0])


def test_a_refused_fit_gives_its_reason_before_anything_else(copy: Path) -> None:
    """A fit had run away, and the headline said that nothing that matters was missing."""
    because = "the fit ran away, b_neg_ref is 50 times what a tube of this size has"
    for verdict in ("complete", "missing"):
        for file in (copy / "models" / RUNGS[-1] / "diagnosis.json", copy / "ladder.json"):
            told = json.loads(file.read_text())
            at = told["rungs"][-1] if "rungs" in told else told
            at.update(uncertain=True, uncertain_because=because, verdict=verdict)
            file.write_text(json.dumps(told))
        headline = words(re.search(r"<h1>(.*?)</h1>", page_of(copy))[1])
        assert headline.startswith(f"T{because[1:]}: ") and "lacked" not in headline
        assert ("the model still lacks" in headline) == (verdict == "missing")


def test_where_nothing_stands_out_the_page_says_from_which_floor(copy: Path) -> None:
    """A floor that is the fit's own error is none: then it is said what that leaves."""
    comparison, model = (copy / "models" / RUNGS[0] / name for name in ("comparison.json", "model.json"))
    comparison.write_text(json.dumps(json.loads(comparison.read_text()) | {"where": []}))
    for source, said in (
        ("standard errors of the track", "the noise floor of this fit, 10.6 mm: standard errors of the track."),
        (LEFT_BY_A_MODEL, "the rest of it: of its worst run this fit leaves 10.6 mm."),
    ):
        model.write_text(json.dumps(json.loads(model.read_text()) | {"noise_floor_mm": 10.6, "noise_floor_source": source}))
        assert f"No stretch of any run stands out from {said}" in words(page_of(copy))


def test_a_finer_chain_is_not_called_missing_physics(copy: Path) -> None:
    file = copy / "ladder.json"
    ladder = json.loads(file.read_text())
    ladder["rungs"][-1] |= {"added": "segments", "tied": ["drag"]}
    file.write_text(json.dumps(ladder))
    model = copy / "models" / RUNGS[-1] / "model.json"
    fit = json.loads(model.read_text())
    model.write_text(json.dumps(fit | {"segments": 2 * fit["segments"], "effects": fit["effects"][:1]}))
    html = page_of(copy)
    text = words(html)
    assert "lacked one thing: visco-elastic relaxation (Maxwell branch). With it and" in text
    assert f"{2 * fit['segments']} segments in place of {fit['segments']} (these data cannot tell the finer chain from drag)" in text
    tile = words(html.split("Missing physics")[1].split("Tip error")[0])
    assert "segments" not in tile, tile
    assert "relaxation (Maxwell branch) was added. The chain was made finer once" in text
    assert f"More segments in the chain ({2 * fit['segments']}), or drag" in text  # each of several such rungs by its own number


def test_a_fit_beside_the_ladder_has_its_id_once_in_the_table(copy: Path) -> None:
    """The table shows the id below the name, and so does the file that its button saves."""
    beside = shutil.copytree(copy / "models" / RUNGS[0], copy / "models" / "base-2") / "model.json"
    beside.write_text(json.dumps(json.loads(beside.read_text()) | {"name": "base-2"}))
    names = [before.rpartition(">")[2] for before in page_of(copy).split("<br><code>base-2</code>")[:-1]]
    assert names == ["The model of the paper"]


def test_stand_ins_are_not_called_missing(copy: Path) -> None:
    """The headline and the tile name what is likely to be there; what only helps is counted."""
    file = copy / "ladder.json"
    ladder = json.loads(file.read_text())
    ladder["rungs"][-1] |= {"verdict": "unexplained", "grade": "stand-in"}
    file.write_text(json.dumps(ladder))
    (copy / "models" / RUNGS[-1] / "diagnosis.json").write_text("of an older version")
    headline = words(re.search(r"<h1>(.*?)</h1>", page_of(copy))[1])
    assert headline.startswith("Something is missing that no effect in the catalogue explains")
    assert "one stand-in lowers the error without being its likely cause" in headline
