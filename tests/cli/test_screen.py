"""What commands show: tables, verdicts and ladders, in terminals of any width."""

import re
from types import SimpleNamespace

import rich.console
from rich.progress import Progress

from rfea_vision.artefacts import Diagnosis, Ladder, Rung
from rfea_vision.artefacts.judgement import Floors, Remainder, WorstPlace
from rfea_vision.cli import batch, console, model
from rfea_vision.distributed.tasks import BatchResult, told_of
from rfea_vision.stages.products import describe_rung


def test_a_narrow_terminal_breaks_no_word(monkeypatch, capsys):
    monkeypatch.setattr(console, "shutil", SimpleNamespace(get_terminal_size=lambda: SimpleNamespace(columns=34)))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    words = ("visco-elastic", "rest_curvature_profile", "unexplained")
    console.print_table("", ["candidate", "validate mm", "verdict"], [[words[1], 0.00651, words[2]]], left=1)
    console.print_table("", ["parameter", "value", "note"], [["b_neg_slope", 0.1, "at its lower bound: no interval"]])
    console.say(" ".join(words))
    shown = capsys.readouterr().out
    assert all(word in shown for word in words) and "0.0065" in shown
    assert "b_neg_slope" in shown and "…" not in shown
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    console.print_error(f"there is no effect of this name: {' '.join(words)}", 2, as_json=False)
    told = capsys.readouterr().err.splitlines()
    assert max(map(len, told)) <= 34 and all(any(word in line for line in told) for word in words)


def test_a_terminal_that_can_do_little_is_as_wide_as_it_is(monkeypatch):
    monkeypatch.setattr(rich.console.Console, "is_terminal", True)
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setenv("COLUMNS", "60")
    assert console.ConsoleListener().console.width == 60


def test_the_verdict_and_its_tie_fit_a_narrow_terminal(tmp_path, monkeypatch, capsys):
    tie = {"effects": ["gravity_tilt", "rest_curvature_profile", "rest_curvature"], "split_by": "a plumb line"}
    diagnosis = Diagnosis(model="base", verdict="missing", named=["gravity_tilt"], tied=[tie])
    monkeypatch.setattr(console, "shutil", SimpleNamespace(get_terminal_size=lambda: SimpleNamespace(columns=40)))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    model.print_diagnosis(diagnosis, tmp_path, tmp_path)
    first = capsys.readouterr().out.split("cannot tell)")[0].splitlines()
    assert len(first) > 1 and max(map(len, first)) <= 40


def test_the_table_shows_what_ranks_the_candidates(tmp_path, capsys):
    rows = [
        {"effect": "maxwell", "probability": 0.99, "share": 0.98, "score_p": 1.0, "refitted": True},
        {"effect": "drag", "probability": 0.01, "share": 0.12, "score_p": 1.0, "refitted": True, "delta_bic": -0.3},
        {"effect": "mullins", "probability": 0.01, "share": -0.001, "refitted": True},
    ]
    model.print_diagnosis(Diagnosis(model="base", verdict="missing", candidates=rows), tmp_path, tmp_path)
    table = capsys.readouterr().out
    assert "score" not in table and " -0 " not in table and re.search(r"mullins +1 % +0 %", table), table
    assert re.search(r"maxwell +99 % +98 %", table) and re.search(r"drag +1 % +12 %", table), table


def test_what_nothing_explains_is_told_with_the_place_that_shows_it(tmp_path, capsys):
    place = {"experiment": "steps", "from_s": 0.8, "to_s": 1.3, "from_sigma": 0.34, "to_sigma": 0.47, "rmse_mm": 1.0}
    where = [WorstPlace(**place, phase="hold", sentence="steps: 1 mm RMS, from 34 to 47 % along the tube.")]
    model.print_diagnosis(Diagnosis(model="base", verdict="unexplained", where=where), tmp_path, tmp_path)
    said = capsys.readouterr().out
    assert said.index("34 to 47 % along the tube") < said.index("next: rfea propose") and said.count("34 to 47 %") == 1


def test_what_is_left_is_said_once(tmp_path, capsys):
    left = Remainder(sentence="What is left, 0.2 mm, is at the floor (0.3 mm).")
    model.print_diagnosis(Diagnosis(model="base", verdict="complete", remainder=left), tmp_path, tmp_path)
    assert capsys.readouterr().out.lower().count("what is left") == 1


def test_the_pressure_to_play_is_that_of_the_model_asked_about(tmp_path, capsys):
    file = "next-experiment-coulomb-drag.csv"
    for name in ("a", "base", "z"):
        (tmp_path / "models" / name).mkdir(parents=True)
        (tmp_path / "models" / name / file).touch()
    planned = {"for": ["coulomb", "drag"], "pressure": file, "sentence": "A slow ramp."}
    for name in ("a", "base", "z"):
        model.print_diagnosis(Diagnosis(model=name, verdict="missing", next_experiment=planned), tmp_path, tmp_path)
        assert str(tmp_path / "models" / name / file) in capsys.readouterr().out.replace("\n", "")


def test_a_tie_stands_wherever_its_member_does(tmp_path, capsys):
    tie = {"effects": ["gravity_tilt", "pressure_offset"], "split_by": "a slow ramp"}
    diagnosis = Diagnosis(model="base", verdict="missing", named=["gravity_tilt"], tied=[tie])
    model.print_diagnosis(diagnosis, tmp_path, tmp_path)
    rungs = [
        Rung(
            model="base", added=None, train_tip_rmse_mm=1.0, validate_tip_rmse_mm=1.0, delta_bic=None, verdict="missing"
        ),
        Rung(
            model="base+gravity_tilt",
            added="gravity_tilt",
            tied=diagnosis.rivals_of("gravity_tilt"),
            train_tip_rmse_mm=0.1,
            validate_tip_rmse_mm=0.1,
            delta_bic=-9.0,
            verdict="complete",
        ),
    ]
    model.print_ladder(Ladder(rungs=rungs))
    first, ladder = capsys.readouterr().out.split("error ladder")
    assert "gravity_tilt (or pressure_offset: these data cannot tell)" in first
    assert "pressure_offset" in ladder


def test_many_rivals_leave_the_figures_of_a_ladder_their_room(capsys):
    """Eight laws that do alike stood in one cell, and the errors were cut to '0.…'."""
    rivals = [f"rest_curvature_profile_{letter}" for letter in "abcdefgh"]
    rung = Rung(
        model="base+coulomb",
        added="coulomb",
        tied=rivals,
        train_tip_rmse_mm=0.123,
        validate_tip_rmse_mm=0.456,
        delta_bic=-90.0,
        verdict="complete",
    )
    model.print_ladder(Ladder(rungs=[rung]))
    said = capsys.readouterr().out
    (row,) = [line for line in said.splitlines() if line.startswith("base+coulomb ")]
    assert "0.123" in row and "0.456" in row and "6 more" in row and rivals[7] not in row
    assert all(name in said for name in rivals)


def test_a_ladder_of_angles_is_in_degrees(capsys):
    angles = {"train_angle_rmse_deg": 0.31, "validate_angle_rmse_deg": 0.42}
    rung = Rung(
        model="base",
        added=None,
        train_tip_rmse_mm=None,
        validate_tip_rmse_mm=None,
        delta_bic=None,
        verdict="complete",
        **angles,
    )
    model.print_ladder(Ladder(rungs=[rung]))
    shown = capsys.readouterr().out
    assert "validate deg" in shown and "0.42" in shown and " mm" not in shown


def test_a_bar_tells_a_count_once_it_is_known():
    bars = Progress(console._Count())
    bars.add_task("fit base", total=None)
    (task,) = bars.tasks
    assert console._Count().render(task).plain == ""
    bars.update(task.id, completed=3, total=8)
    assert console._Count().render(task).plain == "3/8"


def test_what_is_complete_for_its_held_out_runs_alone_says_no_more(tmp_path, capsys):
    far = "complete as far as the held-out runs ask"
    errors = {"train_tip_rmse_mm": 0.3, "validate_tip_rmse_mm": 0.1, "delta_bic": None}
    rung = Rung(model="base", added=None, verdict="complete", asks_less=True, **errors)
    model.print_diagnosis(Diagnosis(model="base", verdict="complete", asks_less=True), tmp_path, tmp_path)
    assert f"base: {far}" in capsys.readouterr().out and far in describe_rung(rung)
    assert rung.model_dump()["verdict"] == "complete"  # what programs read
    batch._print_batch([BatchResult("tube", "done", {}, [told_of(rung)], None)])
    model.print_ladder(Ladder(rungs=[rung]))
    assert " ".join(capsys.readouterr().out.split()).count("held-out") == 2


def test_a_batch_tells_ties_too(capsys):
    figures = {"train_tip_rmse_mm": 0.1, "validate_tip_rmse_mm": 0.2, "delta_bic": -9.0}
    rung = Rung(model="base+drag", added="drag", tied=["payload", "com_offset"], verdict="complete", **figures)
    batch._print_batch([BatchResult("tube", "done", {}, [told_of(rung)], None)])
    assert "tube: drag cannot be told from payload or com_offset by its data" in capsys.readouterr().out


def test_a_refused_fit_is_followed_by_a_look_at_what_was_declared_and_no_calibration_is_made_up(capsys, tmp_path):
    """Two ten-thousandths of the length were printed as the calibration's error, of a track whose own said seventy times as much."""
    floors = Floors(measurement=3.4, calibration=0.0136, source="standard errors of the track")
    because = "the fit ran away, b_neg_ref is 50 times what a tube of this size has"
    away = Diagnosis(model="base", verdict="complete", uncertain=True, uncertain_because=because, floors=floors)
    model.print_diagnosis(away, tmp_path, tmp_path)
    said = capsys.readouterr()
    said = said.out + said.err
    assert "base: uncertain" in said and "next: rfea check" in said and "calibration" not in said
    assert "measurement 3.40 mm (from standard errors of the track)" in said
