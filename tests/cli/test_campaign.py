"""The main job on a small campaign of the twin: raw folder in, ladder and report out, and what can go wrong on the way."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr
from campaign.campaigns import write_campaign

import rfea_vision
from rfea_vision.cli import root
from rfea_vision.distributed import cluster

from .console import rfea

HIDDEN = ("--hidden", "maxwell.k1=0.2", "--hidden", "maxwell.T=0.5s")
SMALL = (
    "--experiments",
    "3",
    "--duration",
    "2s",
    "--rate",
    "60Hz",
    "--noise",
    "0.03mm",
    "--sync",
    "common_clock",
    "--seed",
    "3",
)


@pytest.fixture(scope="session")
def raw(tmp_path_factory):
    """A campaign of tracks that hides one effect."""
    folder = tmp_path_factory.mktemp("twin") / "tube-A"
    assert rfea("simulate", folder, *HIDDEN, *SMALL).code == 0
    return folder


@pytest.fixture(scope="session")
def improved(raw, tmp_path_factory):
    """The same campaign after ``rfea improve``."""
    folder = tmp_path_factory.mktemp("improved") / "tube-A"
    shutil.copytree(raw, folder)
    answer = rfea("improve", folder, "--segments", "4", "--json")
    assert answer.code == 0, answer.err
    return folder, answer.json


@pytest.fixture
def campaign(raw, tmp_path):
    shutil.copytree(raw, tmp_path / "tube-A")
    return tmp_path / "tube-A"


def raw_files(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file() and "rfea" not in path.parts}


def test_improve_does_it_all(improved):
    _, ladder = improved
    assert ladder["format"] == "rfea-ladder/1"
    assert [rung["added"] for rung in ladder["rungs"]] == [None, "maxwell"]
    first, last = (ladder["rungs"][index]["validate_tip_rmse_mm"] for index in (0, -1))
    assert last < first / 3
    assert ladder["rungs"][-1]["verdict"] == "complete"
    assert ladder["test"]["tip_rmse_mm"] < ladder["test"]["first_model_tip_rmse_mm"] / 3
    assert Path(ladder["report"]).read_text(encoding="utf-8").lstrip().lower().startswith("<!doctype html>")


def test_every_promised_file_is_there(improved):
    folder, ladder = improved
    out = folder / "rfea"
    for name in ("steps-1", "multisine-2", "mixed-3"):
        with (
            xr.open_dataset(out / name / "track.nc") as track,
            xr.open_dataset(out / name / "recording.nc") as recording,
        ):
            assert {"valid", "reason", "midline", "tip", "tip_sigma", "bend_angle"} <= set(track)
            assert track["midline"].dims == ("time", "node", "xy") and track["midline"].attrs["units"] == "mm"
            assert {"offset_s", "offset_stderr_s", "drift_ppm"} <= set(recording.attrs) and "pressure" in recording
    for rung in ladder["rungs"]:
        model = json.loads((out / "models" / rung["model"] / "model.json").read_text())
        assert model["format"] == "rfea-model/1" and model["status"] == "converged"
        assert {"k_ref", "k_slope", "b_pos_ref", "b_pos_slope", "b_neg_ref", "b_neg_slope", "r_hyd"} <= set(
            model["parameters"]
        )
        assert set(model["metrics"]) >= {"train", "validate"} and "test" not in model["metrics"]
        assert {"steps-1/track.csv", "steps-1/pressure.csv"} <= set(model["inputs"])
        assert all(re.fullmatch("[0-9a-f]{64}", sha) for sha in model["inputs"].values())
        diagnosis = json.loads((out / "models" / rung["model"] / "diagnosis.json").read_text())
        assert diagnosis["format"] == "rfea-diagnosis/1"
        assert (out / "models" / rung["model"] / "prediction.nc").is_file()
    assert diagnosis["verdict"] == "complete" and diagnosis["named"] == []
    assert not [path for path in out.rglob("*") if path.name.startswith(".") and path.name != ".stages"]


def test_a_second_run_changes_nothing(improved):
    folder, ladder = improved
    before = {
        path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file() and ".stages" not in path.parts
    }
    answer = rfea("improve", folder, "--segments", "4", "--json")
    assert answer.json == ladder
    (line,) = answer.err.splitlines()
    assert re.fullmatch(r"report page: unchanged, as are \d+ results before it", line)
    for command in ("diagnose", "compare", "report"):
        again = rfea(command, folder)
        assert again.code == 0 and ": done" not in again.err, again.err
    after = {
        path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file() and ".stages" not in path.parts
    }
    assert after == before


def test_commands_print_for_people_and_for_programs(improved):
    folder, _ = improved
    fit = rfea("fit", folder, "--segments", "4", "--add", "maxwell", "--json")
    assert fit.code == 0 and fit.json["name"] == "base+maxwell" and fit.json["effects"] == ["maxwell"]
    shown = rfea("compare", folder, "base", "base+maxwell", "--again").out
    assert "noise floor mm" in shown and "base+maxwell" in shown
    diagnosis = rfea("diagnose", folder, "base", "--json").json
    assert diagnosis["verdict"] == "missing" and diagnosis["named"] == ["maxwell"]
    assert "maxwell" in rfea("diagnose", folder, "base").out


def test_the_fit_behind_the_figures_is_the_one_to_export(improved):
    folder, _ = improved
    last = json.loads((folder / "rfea" / "ladder.json").read_text())["rungs"][-1]["model"]
    assert f"next: rfea export --crate {folder} {last} OUT " in rfea("figures", folder, "--format", "svg").out


def test_two_campaigns_are_put_side_by_side_and_a_notebook_is_written(improved, tmp_path):
    folder, _ = improved
    shutil.copytree(folder, tmp_path / "tube-B")
    answer = rfea("report", folder, "--compare", tmp_path / "tube-B", "--notebook", "--json")
    assert answer.code == 0, answer.err
    assert "tube-B" in Path(answer.json["compare"]).read_text(encoding="utf-8")
    assert json.loads(Path(answer.json["notebook"]).read_text(encoding="utf-8"))["nbformat"] == 4
    with (tmp_path / "tube-B" / "campaign.yaml").open("a") as file:
        file.write("design: {turns: 24}\n")
    group = tmp_path / "group.html"
    assert rfea("report", folder, tmp_path / "tube-B", "--group", "--out", group).code == 0
    page = group.read_bytes()
    assert b"24" in page and b"turns" in page and b"tube-B" in page
    assert rfea("report", folder, tmp_path / "tube-B", "--group", "--out", group).code == 0 and group.read_bytes() == page


def test_python_does_what_the_command_line_does(improved):
    folder, ladder = improved
    work = rfea_vision.open_campaign(folder)
    recordings = work.sync()
    assert set(recordings) == {"steps-1", "multisine-2", "mixed-3"}
    model = work.fit(segments=4)
    assert model.metrics["validate"].tip_rmse_mm == ladder["rungs"][0]["validate_tip_rmse_mm"]
    assert work.diagnose(model.name).named == ["maxwell"]
    assert {item["outcome"] for item in work.outcomes} == {"unchanged"}
    assert work.report().is_file()


def test_the_ten_lines_of_the_readme_run(improved, root, capsys):
    folder, _ = improved
    code = re.search(r"```python\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    lines = [line for line in code[1].splitlines() if line.strip()]
    assert len(lines) == 10
    # four segments, as fitted above, so that nothing is fitted twice
    exec(code[1].replace('"tube-A"', repr(str(folder))).replace("segments=8", "segments=4"), {})
    printed = capsys.readouterr().out.splitlines()
    assert printed[1] == "missing ['maxwell']"
    assert float(printed[2]) < float(printed[0].split()[0]) / 3
    assert Path(printed[3]).is_file()


def test_the_effect_of_the_readme_can_be_added(improved, root, tmp_path):
    folder, _ = improved
    code = re.search(r"```py\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None and len([line for line in code[1].splitlines() if line.strip()]) <= 15
    own = tmp_path / "my_effect.py"
    own.write_text(code[1])
    arguments = ("--segments", "4", "--add", "steepening_spring", "--effect-file", own, "--out", tmp_path / "out")
    answer = rfea("fit", folder, *arguments, "--json")
    assert answer.code == 0, answer.err
    assert answer.json["name"] == "base+steepening_spring"
    assert "steepening_spring.c" in answer.json["parameters"]
    assert rfea("fit", folder, *arguments, "--again").err.startswith("fit base+steepening_spring: unchanged")


def test_raw_files_are_never_written_to(campaign):
    before = raw_files(campaign)
    assert rfea("sync", campaign).code == 0
    assert raw_files(campaign) == before
    assert {path.name for path in campaign.iterdir()} - {"rfea"} == {path.parent.name for path in before} - {
        "tube-A"
    } | {"campaign.yaml"}


def test_out_leaves_the_campaign_alone(campaign, tmp_path):
    assert rfea("sync", campaign, "--out", tmp_path / "elsewhere").code == 0
    assert not (campaign / "rfea").exists() and (tmp_path / "elsewhere" / "steps-1" / "recording.nc").is_file()


def test_a_changed_input_redoes_what_depends_on_it(campaign):
    rfea("sync", campaign)
    file = campaign / "steps-1" / "pressure.csv"
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:-5]) + "\n")
    answer = rfea("sync", campaign)
    assert "sync steps-1: done" in answer.err
    (rest,) = [line for line in answer.err.splitlines() if line.endswith(": unchanged")]
    assert "track steps-1" in rest and "sync multisine-2" in rest


def test_one_broken_experiment_does_not_keep_the_others_from_being_tracked(campaign):
    (campaign / "multisine-2" / "track.csv").write_text("time_s,tip_x_mm\n0,1\n")
    answer = rfea("track", campaign)
    assert answer.code == 2
    assert str(campaign / "multisine-2" / "track.csv") in answer.err and "2 of 3 experiments were tracked; 'role: ignore'" in answer.err
    assert (campaign / "rfea" / "steps-1" / "track.nc").is_file()
    assert not (campaign / "rfea" / "multisine-2").exists()


def test_unknown_effects_and_models_are_named(campaign):
    wrong = rfea("fit", campaign, "--segments", "2", "--add", "maxwel")
    assert wrong.code == 2 and "did you mean 'maxwell'?" in wrong.err and "Traceback" not in wrong.err
    assert not (campaign / "rfea" / "models" / "base+maxwel").exists()
    lost = rfea("diagnose", campaign, "mine")
    assert lost.code == 2 and "no model 'mine'" in lost.err
    gone = rfea("fit", campaign, "--effect-file", campaign / "gone.py")
    assert gone.code == 2 and "rfea effects new gone.py" in gone.err


def test_an_unreadable_video_is_one_sentence(tmp_path):
    campaign = write_campaign(tmp_path / "c")
    (campaign / "camera.yaml").write_text("%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n")
    (campaign / "steps" / "video.mp4").write_bytes(b"this is no video")
    file = campaign / "steps" / "experiment.yaml"
    text = file.read_text().replace("track: {file: track.csv}", "video: {file: video.mp4}\ncamera: {file: camera.yaml}")
    file.write_text(text)
    checked = rfea("check", campaign)
    assert checked.code == 2
    assert "camera_matrix is missing" in checked.out and "video.file is not a readable video" in checked.out


def test_an_interruption_keeps_what_is_finished(campaign):
    command = [
        sys.executable,
        "-c",
        "from rfea_vision.cli import main; main()",
        "improve",
        str(campaign),
        "--segments",
        "4",
    ]
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job is born deaf to it
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("sync") and len(list((campaign / "rfea").glob("*/recording.nc"))) == 3:
            process.send_signal(signal.SIGINT)
            break
    _, rest = process.communicate(timeout=120)
    assert process.returncode == 130, rest
    assert "interrupted; what was finished is kept, what was begun is not" in rest and "Traceback" not in rest
    assert len(list((campaign / "rfea").glob("*/recording.nc"))) == 3
    left = [path.name for path in (campaign / "rfea").rglob("*") if path.is_file() and path.name.startswith(".")]
    assert left == []
    assert "unchanged, as are 5 results before it" in rfea("sync", campaign, "--again").err


def test_a_recipe_of_ones_own(campaign, tmp_path):
    recipe = tmp_path / "mine.yaml"
    recipe.write_text("steps:\n  - fit: {name: two, segments: 2, joints: start, observe: tip_y}\n  - compare\n")
    answer = rfea("run", recipe, campaign, "--json")
    assert answer.code == 0, answer.err
    assert set(answer.json["models"]) == {"two"}
    model = json.loads((campaign / "rfea" / "models" / "two" / "model.json").read_text())
    assert (model["segments"], model["joints"], model["observe"]) == (2, "start", "tip_y")
    assert (campaign / "rfea" / "models" / "two" / "comparison.json").is_file()


def test_batch_goes_on_past_what_is_broken(campaign, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recipe = tmp_path / "measure.yaml"
    recipe.write_text("steps: [sync]\n")
    broken = write_campaign(tmp_path / "broken")
    (broken / "campaign.yaml").write_text("name: [\n")
    partly = write_campaign(tmp_path / "partly", {"good": "train", "bad": "train"})
    (partly / "bad" / "pressure.csv").write_text("time_s,pressure_kPa\n0,1\n0,2\n")
    answer = rfea("batch", broken, partly, tmp_path / "gone", campaign, "--recipe", recipe, "--workers", "1", "--json")
    assert answer.code == 1
    results = {Path(item["folder"]).name: item for item in answer.json["campaigns"]}
    assert {name: item["status"] for name, item in results.items()} == {
        "broken": "failed",
        "partly": "partly",
        "gone": "failed",
        "tube-A": "done",
    }
    assert "gone: no such folder" in results["gone"]["errors"]["campaign"]
    assert "not valid YAML" in results["broken"]["errors"]["campaign"]
    assert "repeats the row before" in results["partly"]["errors"]["bad"]
    index = (tmp_path / answer.json["index"]).read_text(encoding="utf-8")
    assert all(name in index for name in results)
    assert (partly / "rfea" / "good" / "recording.nc").is_file()
    answer = rfea("batch", broken, "--recipe", recipe, "--index", partly)
    assert answer.code == 1 and "Is a directory" in answer.err and "dashboard" not in answer.err
    assert (campaign / "rfea" / "steps-1" / "recording.nc").is_file()


@pytest.mark.study
def test_results_do_not_depend_on_the_number_of_workers(raw, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recipe = tmp_path / "fit.yaml"
    recipe.write_text("steps:\n  - fit: {segments: 2}\n")
    alone, batch = tmp_path / "alone", tmp_path / "batch"
    for arguments in (
        ("run", recipe, raw, "--out", alone),
        ("batch", raw, "--workers", "2", "--recipe", recipe, "--out", batch),
    ):
        answer = rfea(*arguments, "--json")
        assert answer.code == 0, answer.err
    none, two = (out / "models" / "base" / "model.json" for out in (alone, batch / raw.name))
    assert none.read_bytes() == two.read_bytes()
    assert not (raw / "rfea").exists()


def test_no_scheduler_at_the_address_is_said(campaign, monkeypatch):
    monkeypatch.setattr(cluster, "_ANSWER_S", 1.0)
    answer = rfea("batch", campaign, "--scheduler", "tcp://127.0.0.1:9")
    assert answer.code == 2 and "nothing answers there" in answer.err


def test_one_that_takes_the_call_and_says_nothing_is_said(campaign, monkeypatch):
    assert cluster._ANSWER_S <= 5.0, "twice that, for the call and the answer, are the ten seconds that a person waits"
    monkeypatch.setattr(cluster, "_ANSWER_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        answer = rfea("batch", campaign, "--scheduler", f"tcp://127.0.0.1:{silent.getsockname()[1]}")
    assert answer.code == 2 and "nothing answers there" in answer.err


@pytest.mark.parametrize(("before", "taken"), [(signal.SIG_DFL, True), (signal.SIG_IGN, False)])
def test_a_terminal_that_is_closed_interrupts_unless_nohup_was_asked_for(before, taken, monkeypatch):
    handlers: dict[int, object] = {}
    monkeypatch.setattr(root.signal, "signal", handlers.__setitem__)
    monkeypatch.setattr(root.signal, "getsignal", lambda number: before)
    monkeypatch.setattr(root, "run", lambda arguments: 0)
    with pytest.raises(SystemExit):
        root.main(["doctor"])
    assert (signal.SIGHUP in handlers) is taken and signal.SIGTERM in handlers
