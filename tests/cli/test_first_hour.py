"""What a beginner meets: sentences that end in the right place, whatever was typed or filled in wrongly."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from types import ModuleType, SimpleNamespace

import click
import pandas as pd
import pytest
from campaign.campaigns import write_campaign, write_experiment
from click.shell_completion import ShellComplete

from rfea_vision.cli import console, root
from rfea_vision.cli.twin import _played
from rfea_vision.critique import verdict
from rfea_vision.errors import DataError
from rfea_vision.stages import mechanics, open_campaign
from rfea_vision.stages.publishing import commands
from rfea_vision.stages.warnings import warnings_of

from .console import rfea


def test_the_package_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "rfea_vision", "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and "rfea" in done.stdout


def test_a_terminal_that_cannot_show_a_name_is_no_fault(tmp_path):
    campaign = write_campaign(tmp_path / "Prüfstand 日本", {"größer": "train"})
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    command = [sys.executable, "-m", "rfea_vision", "sync", str(campaign)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=ascii_only, check=False)
    assert done.returncode == 0 and "gr\\xf6\\xdfer" in done.stdout, done.stderr


def test_diameters_given_as_radii_are_doubted(tmp_path):
    campaign = write_campaign(tmp_path / "c")
    file = campaign / "campaign.yaml"
    file.write_text(
        file.read_text().replace("outer_radius: 4 mm, inner_radius: 3 mm", "outer_radius: 8 mm, inner_radius: 6 mm")
    )
    answer = rfea("check", campaign)
    assert answer.out.count("8 and 6 mm are the diameters that the paper prints") == 1


@pytest.mark.parametrize("name", ["steps/experiment.yaml", "steps", "steps/track.csv"])
def test_who_checks_a_part_of_a_campaign_is_sent_to_the_campaign(tmp_path, name):
    """`rfea init DIR` was proposed, which writes another one."""
    campaign = write_campaign(tmp_path / "c")
    answer = rfea("check", campaign / name)
    assert answer.code == 2 and answer.out.splitlines()[-1].startswith(f"next: rfea check {campaign} ")


def test_a_run_that_stands_alone_and_trains_nothing_is_told(tmp_path):
    """Only `fit` refused it, once it was tracked."""
    run = write_experiment(tmp_path / "alone", "alone", "validate")
    answer = rfea("check", run)
    assert answer.code == 0 and "experiment.yaml:3: role: 'validate' of a run that stands alone leaves none to fit" in answer.out
    assert "rfea improve" not in answer.out


@pytest.mark.parametrize(
    ("header", "given", "remedy"),
    [
        ("Zeit [s],Druck [bar]", "", 'write \'pressure: {file: pressure.csv, time: "Zeit [s]", pressure: "Druck [bar]"}\''),
        ("t,valve,p1", ", reference: absolute, ambient: 980 mbar", "reference: absolute, ambient: 98 kPa, time: t, pressure: p1}'"),
        ("time_s,valve,lamp", "", "say which one it is with 'pressure: {file: pressure.csv, pressure: NAME}'"),
    ],
)
def test_a_column_is_advised_as_the_line_that_is_to_be_written(tmp_path, header, given, remedy):
    """Of its name alone nobody knew where it belongs; and the time is never guessed to be the pressure."""
    campaign = write_campaign(tmp_path / "c")
    rows = [",".join([str(0.01 * i), str(i), "2"][: header.count(",") + 1]) for i in range(5)]
    (campaign / "steps" / "pressure.csv").write_text("\n".join([header, *rows]) + "\n")
    file = campaign / "steps" / "experiment.yaml"
    file.write_text(file.read_text().replace("{file: pressure.csv", "{file: pressure.csv" + given))
    answer = rfea("check", campaign)
    assert answer.code == 2 and remedy in " ".join(answer.out.split())
    line = re.search("'(pressure: .*})'", " ".join(answer.out.split()))
    assert line is not None
    if "NAME" not in line[1]:
        file.write_text(re.sub("^pressure: .*$", lambda _: line[1], file.read_text(), flags=re.MULTILINE))
        assert "no column" not in rfea("check", campaign).out


def test_the_column_of_a_chamber_and_that_of_an_angle_are_advised_likewise(tmp_path):
    campaign = write_campaign(tmp_path / "c")
    file, rows = campaign / "steps" / "experiment.yaml", "".join(f"{0.01 * i},{i},0.1\n" for i in range(9))
    (campaign / "steps" / "pressure.csv").write_text(f"time_s,p1,p2\n{rows}")
    (campaign / "steps" / "track.csv").write_text(f"t,Winkel,sigma_deg\n{rows}")
    text = file.read_text().replace("{file: pressure.csv}", "[{chamber: left, file: pressure.csv}, {chamber: right, value: 0 kPa}]")
    file.write_text(text)
    said = " ".join(rfea("check", campaign).out.split())
    assert "write '- {chamber: left, file: pressure.csv, pressure: p1}' in the list 'pressure'" in said
    assert "no column 'time_s' (track.time)" in said and "write 'track: {file: track.csv, time: t}'" in said
    file.write_text(text.replace("{file: track.csv}", "{file: track.csv, time: t}"))
    assert "write 'track: {file: track.csv, time: t, angle: Winkel}'" in " ".join(rfea("check", campaign).out.split())


def test_a_missing_extra_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    answer = rfea("batch", write_campaign(tmp_path / "c"))
    assert answer.code == 2 and "pip install 'rfea-vision[batch]'" in answer.err and "Traceback" not in answer.err


def test_the_twin_plays_a_given_pressure(tmp_path):
    log = tmp_path / "next.csv"
    log.write_text("time_s,pressure_kPa\n0,0\n0.2,0\n0.3,90\n0.8,90\n")
    answer = rfea("simulate", tmp_path / "twin", "--pressure", log, "--rate", "60Hz")
    assert answer.code == 0, answer.err
    rows = (tmp_path / "twin" / "given-1" / "pressure.csv").read_text().splitlines()[1:]
    played = [float(row.split(",")[1]) for row in rows]
    assert max(played) == pytest.approx(90, abs=1) and played[0] == pytest.approx(0, abs=1)


@pytest.mark.parametrize("text", ["1.5bar", "0.15 MPa", "150kPa"])
def test_a_highest_pressure_may_have_a_point_in_it(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    assert _played(text) == (pytest.approx(150.0), None)


def test_every_command_that_ends_well_says_what_comes_next(tmp_path):
    campaign = write_campaign(tmp_path / "c")
    for arguments in (
        ["init", tmp_path / "new"],
        ["check", campaign],
        ["effects"],
        ["effects", "show", "maxwell"],
        ["board"],
    ):
        answer = rfea(*arguments)
        assert answer.out.rstrip().splitlines()[-1].startswith("next: rfea "), arguments
    shutil.rmtree(campaign)


@pytest.mark.parametrize(
    ("line", "begun", "offered"),
    [
        (["fit", "FOLDER", "--add"], "maxw", ["maxwell", "maxwell_2"]),
        (["effects", "show"], "gravity", ["gravity_tilt"]),
        (["diagnose", "FOLDER"], "base+", ["base+maxwell"]),
        (["compare", "FOLDER", "base"], "", ["base", "base+maxwell"]),
        (["diagnose", "nowhere"], "", []),
        (["fit", "FOLDER"], "--seg", ["--segments"]),
    ],
)
def test_a_shell_completes_effects_and_models(tmp_path, line, begun, offered):
    for model in ("base", "base+maxwell"):
        folder = tmp_path / "rfea" / "models" / model
        folder.mkdir(parents=True)
        (folder / "model.json").touch()
    words = [str(tmp_path) if word == "FOLDER" else word for word in line]
    found = ShellComplete(root.rfea, {}, "rfea", "_RFEA_COMPLETE").get_completions(words, begun)
    assert [item.value for item in found] == offered


def test_the_next_command_is_none_that_would_refuse(tmp_path):
    """A run without a pressure cannot be fitted: what comes next is to say it, and then to improve."""
    campaign = write_campaign(tmp_path / "c")
    file = next(campaign.glob("*/experiment.yaml"))
    whole = file.read_text()
    file.write_text("".join(line for line in whole.splitlines(keepends=True) if not line.startswith("pressure")))
    answer = rfea("check", campaign)
    assert answer.code == 0 and answer.out.splitlines()[-1].startswith("next: rfea check")
    file.write_text(whole)
    assert rfea("check", campaign).out.splitlines()[-1].startswith("next: rfea improve")


def test_the_next_command_can_be_typed_as_it_stands(tmp_path):
    campaign = write_campaign(tmp_path / "my tube's runs")
    next_one = rfea("check", campaign).out.splitlines()[-1].removeprefix("next: ").partition("   (")[0]
    assert shlex.split(next_one)[2] == str(campaign)


@pytest.mark.parametrize(("command", "following"), [("improve", "rfea propose"), ("report", "rfea figures"), ("fit", "rfea sync")])
def test_the_next_command_names_the_laws_without_which_it_would_refuse(tmp_path, monkeypatch, capsys, command, following):
    law = tmp_path / "my law.py"
    law.write_text("")
    found = root.rfea.get_command(click.Context(root.rfea), command)
    monkeypatch.setattr(found, "callback", lambda **given: console.say_next(following, "tube"))
    root.rfea.main([command, str(write_campaign(tmp_path / "c")), "--effect-file", str(law)], standalone_mode=False)
    takes = following != "rfea sync"
    assert capsys.readouterr().out == f"next: {following} tube" + (f" --effect-file '{law}'" if takes else "") + "\n"


def test_a_clock_in_ms_is_named_where_the_clocks_do_not_meet(tmp_path):
    campaign = write_campaign(tmp_path / "c", {"steps": "train"})
    run = campaign / "steps" / "experiment.yaml"
    run.write_text(run.read_text().replace("common_clock", "motion"))
    track = pd.read_csv(campaign / "steps" / "track.csv")
    track.assign(time_s=1000 * track["time_s"]).to_csv(campaign / "steps" / "track.csv", index=False)
    answer = rfea("sync", campaign)
    assert answer.code == 2 and "steps: pressure: the log lasts 0.499 s" in answer.err
    assert "is the time of the pictures in ms?" in answer.err and "motion and log belong" not in answer.err


def test_an_interrupt_that_the_compiler_swallows_is_no_fault(monkeypatch, capsys):
    def swallowed(*arguments, **options):
        root._interrupted.append(2)
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr(root.rfea, "main", swallowed)
    monkeypatch.setattr(root, "_interrupted", [])
    assert root.run(["fit", "x"]) == root.INTERRUPTED
    assert "interrupted" in capsys.readouterr().err


def test_the_next_command_and_those_of_the_report_look_where_the_results_are(tmp_path):
    campaign, results = write_campaign(tmp_path / "c"), tmp_path / "the results"
    said = rfea("sync", campaign, "--out", results, "--trust").out.splitlines()[-1]
    assert said.startswith("next: rfea improve") and f"--out '{results}' --trust" in said, said
    assert "--out" not in rfea("sync", campaign).out.splitlines()[-1]
    assert commands(open_campaign(campaign, results)) == ["rfea report c --out 'the results'"]
    assert commands(open_campaign(campaign)) == ["rfea report c"]


@pytest.mark.parametrize("name", ["figures", "reproduce", "Report", "ladder.json"])
def test_a_run_cannot_be_called_as_results_are(tmp_path, name):
    campaign = write_campaign(tmp_path / "c", {name: "train"})
    answer = rfea("check", campaign)
    assert answer.code == 2 and f"'{name}' is what rfea calls results of its own; choose another name" in answer.out


def test_slips_of_a_first_hour_end_where_they_should(tmp_path):
    first, second = write_campaign(tmp_path / "a"), write_campaign(tmp_path / "b")
    assert "One campaign at a time; 'rfea batch' runs many" in rfea("fit", first, second).err
    answer = rfea("fit", first, "--fix", "r_hyd=36mm")
    assert (
        answer.code == 2 and "r_hyd=36mm: is longer than the tube is wide (actuator.outer_radius: 4 mm)" in answer.err
    )
    assert not list(first.rglob("*.nc"))  # it is told before anything is measured
    assert rfea("improve", first, "--fix", "r_hyd=36mm").code == 2 and not list(first.rglob("*.nc"))
    (second / "runs").mkdir()
    for name in ("steps", "sine"):
        shutil.move(second / name, second / "runs" / name)
    assert "and one in runs/sine: move such folders up beside campaign.yaml" in rfea("check", second).out


@pytest.mark.parametrize("command", ["track", "sync"])
def test_what_is_done_is_told_without_reading_it(tmp_path, command):
    """A table of four runs took 2.3 to 4 s, nearly all of it to open their files."""
    folder = write_campaign(tmp_path / "tube")
    first = rfea(command, folder, "--json")
    code = (
        "import sys; from rfea_vision.cli.root import run; run([sys.argv[1], sys.argv[2], '--json']); "
        "print({'xarray', 'pandas', 'numba', 'cv2'} & set(sys.modules), file=sys.stderr)"
    )
    again = subprocess.run([sys.executable, "-c", code, command, folder], capture_output=True, text=True, timeout=120)
    assert again.stderr.strip().endswith("set()")
    assert json.loads(again.stdout) == json.loads(first.out.replace('"done"', '"unchanged"'))


def test_a_command_with_nothing_to_do_prints_one_line(tmp_path):
    folder = write_campaign(tmp_path / "tube")
    rfea("sync", folder, "--json")
    table = rfea("sync", folder).out  # nothing to do, but not seen yet
    assert table.count("\n") > 3
    again = rfea("sync", folder)
    assert again.err == "" and re.fullmatch(
        r"nothing changed since \d{4}-\d\d-\d\d \d\d:\d\d: up to date \('--again' shows it\); next: rfea improve \S+\n", again.out
    )
    assert rfea("sync", folder, "--again").out == table
    (folder / "steps" / "pressure.csv").touch()
    assert rfea("sync", folder).out == again.out
    assert rfea("sync", folder, "--force").out == table


def test_compiling_is_said_before_it_begins(tmp_path, monkeypatch):
    """Loading the critique compiles: `improve` sat for a minute, and then found that nothing was to be compiled."""
    order = []

    class Critique(ModuleType):
        @property
        def improve(self):
            order.append("loaded")
            raise DataError("enough")

    monkeypatch.setattr(mechanics, "compiling", lambda room: order.append(room) or "")
    monkeypatch.setitem(sys.modules, "rfea_vision.critique", Critique("critique"))
    with pytest.raises(DataError, match="enough"):
        open_campaign(write_campaign(tmp_path / "tube")).improve()
    assert order == ["dynamics", "loaded"]


def test_improve_says_what_it_does_before_its_first_model_stands(tmp_path, monkeypatch):
    """For a minute it had shown a bar that says nothing."""

    def improve(*_, **__):
        raise DataError("enough")

    monkeypatch.setitem(sys.modules, "rfea_vision.critique", SimpleNamespace(improve=improve))
    said = rfea("improve", write_campaign(tmp_path / "tube")).err
    assert said.index("weighs every effect against what it leaves") < said.index("enough")


def test_a_batch_says_what_is_to_do_before_and_after(tmp_path):
    folder = write_campaign(tmp_path / "tube")
    assert [rfea("batch", folder, "--dry-run").code, rfea("sync", folder, "--json").code] == [0, 0]
    answer = rfea("batch", folder, "--dry-run", "--json")
    states = {item["stage"]: item["state"] for item in json.loads(answer.out)["plan"][str(folder)]}
    assert states["sync"] == "unchanged" and states["improve"] == "to do", answer
    asked = ("--recipe", "paper", "--workers", "1")
    assert f"next: rfea batch {folder} --workers 1 --recipe paper   (" in rfea("batch", folder, "--dry-run", *asked).out


@pytest.mark.parametrize("sufficient", [True, False])
def test_without_validation_runs_no_error_is_called_held_out(sufficient):
    problem = SimpleNamespace(trials=SimpleNamespace(problem=SimpleNamespace(validate=())), held=0.0905, floor=0.11)
    problem.floors = SimpleNamespace(unit="mm", source="repeated runs")
    said = verdict._complete(problem, SimpleNamespace(sufficient=sufficient, asks_less=False))
    assert "held-out" not in said and "the training error (there are no validation runs)" in said.lower()


def test_a_run_of_which_hardly_a_frame_has_a_pressure_does_not_end_as_done(tmp_path):
    """Its times in ms, 4 of 720 frames lay within the log: a warning, and the next command was to fit it."""
    folder = write_campaign(tmp_path / "tube")
    table = pd.read_csv(folder / "steps" / "track.csv")
    table["time_s"] *= 1000
    table.to_csv(folder / "steps" / "track.csv", index=False)
    answer = rfea("sync", folder, "-e", "steps")
    assert answer.code == 2 and "next:" not in answer.out
    assert answer.err.strip().splitlines()[-1].endswith("is the time of the pictures in ms?")


def test_a_fit_repeats_what_a_track_holds_against_its_scale(tmp_path):
    """The track of an earlier command had said so; the error of every fit is off by it."""
    folder = write_campaign(tmp_path / "tube")
    work = open_campaign(folder)
    recordings = work.sync()
    said = "the inextensible side keeps its length within 0.1 % over all postures; it measures +20.0 % against actuator.length: check"
    for name, recording in recordings.items():
        assert not any("measures" in text for text in warnings_of(recording)), name
        recording.dataset.attrs["length_check"] = said
        assert any("measures +20.0 %" in text for text in warnings_of(recording))
