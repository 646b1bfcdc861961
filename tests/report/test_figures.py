"""Figures for papers: all that the page shows, with the numbers drawn, the same bytes twice."""

import builtins
import io
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from rfea_vision.errors import InputError
from rfea_vision.figures import Lines, Map, Series, save_plates
from rfea_vision.figures.models import _study, plates
from rfea_vision.figures.plates import Axis, Bars
from rfea_vision.figures.runs import _trust
from rfea_vision.figures.saving import _drawing, as_svg
from rfea_vision.report.collect import collect
from rfea_vision.report.figures import FIGURES

pytest.importorskip("matplotlib")

# Drawn by the moment on the page, or the same data again: those of the torque against a chosen quantity, the profile at the cursor, ...
ON_THE_PAGE_ONLY = {"torque-cloud", "profile-now", "study-path", "study-seconds"}


@pytest.fixture(scope="module")
def drawn(sample):
    return plates(collect(sample))


def test_every_figure_of_the_page_has_its_file(drawn):
    names = " ".join(plate.name for plate in drawn)
    lacking = {name for name in FIGURES if name not in names} - ON_THE_PAGE_ONLY
    only_if_asked_for = {"study", "likelihood", "next"}
    assert lacking <= only_if_asked_for, lacking
    assert len({plate.name for plate in drawn}) == len(drawn)


def test_a_fit_beside_the_ladder_is_none_of_its_figure(sample):
    evidence = collect(sample)
    beside = replace(evidence.steps[-1], on_ladder=False)
    found = plates(replace(evidence, steps=(*evidence.steps[:-1], beside)))
    (ladder,) = [plate for plate in found if plate.name == "ladder"]
    assert len(ladder.table()) == len(evidence.steps) - 1


def test_an_inclinometers_study_of_segments_is_drawn_in_degrees():
    rows = [{"segments": n, "train_tip_rmse_mm": None, "train_angle_rmse_deg": 1.0 / n} for n in (2, 4)]
    (study,) = _study(rows)
    assert list(study.table()["angle error [deg]"].dropna()) == [0.5, 0.25]


def test_the_standard_error_of_the_tip_is_in_the_norm_of_its_error():
    data = xr.Dataset({"tip_sigma": (("time", "xy"), [[0.3, 0.4], [0.6, 0.8]])}, coords={"time": [0.0, 1.0]})
    (plate,) = _trust("run", data)
    assert list(plate.table()["standard error of the tip [mm]"]) == pytest.approx([0.5, 1.0])


def test_the_numbers_drawn_stand_beside_with_units(drawn, tmp_path):
    chosen = [plate for plate in drawn if re.search("tip-y$|carpet$|ladder|steady", plate.name)][:5]
    save_plates(chosen, tmp_path, formats=["svg"])
    for plate in chosen:
        frame = pd.read_csv(tmp_path / f"{plate.name}.csv")
        again = pd.read_csv(io.StringIO(plate.table().to_csv(index=False, float_format="%.9g")))
        pd.testing.assert_frame_equal(frame, again)
        assert any(re.search(r"\[.+\]", column) for column in frame.columns)
    tip = next(plate for plate in chosen if plate.name.endswith("tip-y"))
    assert isinstance(tip, Lines) and [item.name for item in tip.series] == ["measured", "modelled"]


def test_a_wild_value_leaves_the_colours_of_all_others():
    """The torque at the ends of a smoothed run is forty times the usual one: the whole map had been pale."""
    values = np.random.default_rng(0).uniform(-1, 1, (10, 100))
    values[0, 0] = -48.0
    time, place = np.arange(100.0), np.arange(10.0)
    plate = Map("torque", "T", Axis("time", "s"), Axis("place"), Axis("torque", "mN m"), time, place, values, True)
    with _drawing("paper") as draw:
        (mesh,) = draw(plate).axes[0].collections
        assert mesh.norm.vmax == -mesh.norm.vmin == pytest.approx(1.0, abs=0.02)
        (mesh,) = draw(replace(plate, values=np.abs(values), signed=False, most=3.0)).axes[0].collections
        assert mesh.norm.vmax == 3.0
    assert plate.table()["torque [mN m]"].min() == -48.0


def test_an_axis_of_decades_has_no_bars_and_plain_numbers(tmp_path):
    sets = (("training", np.array([1.46, 0.085])), ("held out", np.array([1.46, 0.086])))
    plate = Bars("ladder", "Ladder", ("base", "drag"), Axis("error", "mm"), sets, log_y=True)
    (file, _) = save_plates([plate], tmp_path, formats=["svg"])
    drawing = file.read_text()
    assert len(re.findall(r'clip-path="[^"]*">\s*<use ', drawing)) == 2  # a set of dots each: no bar has a foot there
    assert "10^{" not in drawing and re.search(r"\b0\.5\b", drawing)


def test_the_names_of_bars_stand_side_by_side():
    bands = ("0 to 45", "45 to 90", "90 to 135", "135 to 180", "180 to 225", "225 to 270")
    plate = Bars("pressures", "By pressure", bands, Axis("error", "deg"), (("error", np.ones(6)),), Axis("pressure", "kPa"))
    for style in ("paper", "screen"):
        with _drawing(style) as draw:
            figure = draw(plate)
            figure.canvas.draw()
            boxes = [name.get_window_extent() for name in figure.axes[0].get_xticklabels()]
            assert all(left.x1 < right.x0 for left, right in pairwise(boxes)), style


def test_twice_the_same_bytes(drawn, tmp_path):
    chosen = [drawn[0], next(plate for plate in drawn if isinstance(plate, Map)), drawn[-1]]
    for folder in ("a", "b"):
        save_plates(chosen, tmp_path / folder)
    for file in sorted((tmp_path / "a").iterdir()):
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name
        assert file.stat().st_size > 200
    assert (tmp_path / "a" / f"{drawn[0].name}.pdf").read_bytes().startswith(b"%PDF")


def test_two_drawings_in_one_page_share_no_mark():
    x = np.linspace(0.0, 1.0, 5)
    one, two = (
        as_svg(Lines(name, name, Axis("x"), Axis("y"), (Series("s", "dots", x, x),))) for name in ("one", "two")
    )
    marks = [set(re.findall(r'id="([^"]+)"', svg)) for svg in (one, two)]
    assert marks[0] and not marks[0] & marks[1]
    for svg, own in zip((one, two), marks, strict=True):
        assert set(re.findall(r'href="#([^"]+)"', svg)) <= own


def test_a_name_of_a_stranger_leads_nowhere(tmp_path):
    """A key of a campaign's `design` becomes part of a figure's name, which stands in markup and in paths."""
    x = np.linspace(0.0, 1.0, 5)
    for name in ('k-over-"><script>alert(1)</script>', "../../../evil", "a run (2)"):
        plate = Lines(name, "t", Axis("x"), Axis("y"), (Series("s", "dots", x, x),))
        svg = as_svg(plate)
        assert "<script" not in svg
        marks = set(re.findall(r'id="([^"]+)"', svg))
        assert set(re.findall(r"url\(#([^)]+)\)", svg)) <= marks
        assert all(re.fullmatch(r"[\w.-]+", mark) for mark in marks)
        assert {path.parent for path in save_plates([plate], tmp_path / "a" / "b", formats=["svg"])} == {
            tmp_path / "a" / "b"
        }


def test_runs_whose_names_differ_in_signs_alone_have_their_own_files(tmp_path):
    x = np.linspace(0.0, 1.0, 5)
    series = (Series("s", "dots", x, x),)
    pair = [Lines(f"{run}-path", "t", Axis("x"), Axis("y"), series) for run in ("run (1)", "run [1]", "Run-1-")]
    assert len(set(save_plates(pair, tmp_path, formats=["svg"]))) == 6


def test_what_is_wrong_is_said(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="'gif' is unknown; choose of pdf, svg, png"):
        save_plates([], tmp_path, formats=["gif"])
    usual = builtins.__import__

    def without(name, *rest):
        if name.startswith("matplotlib"):
            raise ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")
        return usual(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install 'rfea-vision\[figures\]'"):
        save_plates([], tmp_path)
