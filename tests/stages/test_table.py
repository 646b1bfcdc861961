"""`rfea table`: the models of many campaigns, as pandas reads them again."""

import json
import sys

import pandas as pd
import pytest

from rfea_vision.artefacts import Diagnosis, ExperimentScore, Ladder, Metrics, ModelFit, Parameter, Rung
from rfea_vision.cli.root import run

BASE = {"k_ref": Parameter(value=0.17, unit="N*m/rad", stderr=0.002, interval_95=(0.166, 0.174))}
ADDED = {"maxwell.T": Parameter(value=1.2, unit="s", stderr=None, note="at its bound")}


def model(folder, name, effects, parameters, **errors):
    """One model in a campaign's results."""
    metrics = {role: Metrics(**errors) for role in ("train", "validate")}
    scores = {"steps": ExperimentScore(role="train", **errors)}
    place = folder / "rfea" / "models" / name
    place.mkdir(parents=True)
    floor = "noise_floor_deg" if "angle_rmse_deg" in errors else "noise_floor_mm"
    fit = ModelFit(name=name, segments=8, effects=effects, parameters=parameters, metrics=metrics, experiments=scores,
                   **{floor: 0.05})  # fmt: skip
    fit.save(place / "model.json")


@pytest.fixture
def campaigns(tmp_path):
    """A campaign of films with a ladder, one of an inclinometer, and one without results."""
    films, angles, empty = (tmp_path / name for name in ("films", "angles", "empty"))
    empty.mkdir()
    model(films, "base+maxwell", ["maxwell"], {**BASE, **ADDED}, tip_rmse_mm=0.1)
    model(films, "base", [], BASE, tip_rmse_mm=1.5)
    model(angles, "base", [], BASE, angle_rmse_deg=0.7)
    Diagnosis(model="base", verdict="missing", named=["maxwell"], noise_floor_mm=0.05).save(
        films / "rfea" / "models" / "base" / "diagnosis.json"
    )
    error = {"train_tip_rmse_mm": 1.0, "validate_tip_rmse_mm": 1.5, "delta_bic": None}
    first = Rung(model="base", added=None, verdict="missing", **error)
    second = Rung(model="base+maxwell", added="maxwell", verdict="complete", grade="named", probability=0.97, **error)
    Ladder(rungs=[first, second]).save(films / "rfea" / Ladder.FILE)
    return films, angles, empty


@pytest.mark.parametrize("name", ["all.csv", "all.parquet"])
def test_rows_come_back(campaigns, tmp_path, name, capsys):
    pytest.importorskip("pyarrow")
    path = tmp_path / name  # its ending says the format
    assert run(["table", *map(str, campaigns), "-o", str(path), "--json"]) == 1  # one campaign has no results
    said = json.loads(capsys.readouterr().out)
    assert said["rows"] == 3 and list(said["without_results"]) == [str(campaigns[2])]
    table = pd.read_csv(path) if name.endswith("csv") else pd.read_parquet(path)
    assert list(table.columns) == said["columns"]
    assert list(table["campaign"]) == ["films", "films", "angles"]
    assert list(table["model"]) == ["base", "base+maxwell", "base"]  # in the ladder's order
    assert list(table["last_rung"]) == [False, True, False]
    assert table["probability"][1] == 0.97 and table["added"][1] == "maxwell"
    assert table["verdict"][0] == "missing" and table["named"][0] == "maxwell"
    assert table["k_ref"][2] == 0.17 and table["k_ref_low_95"][2] == 0.166 and table["k_ref_unit"][2] == "N*m/rad"
    assert table["maxwell.T"][1] == 1.2 and pd.isna(table["maxwell.T_stderr"][1]) and pd.isna(table["maxwell.T"][0])
    assert pd.isna(table["validate_tip_rmse_mm"][2]) and table["validate_angle_rmse_deg"][2] == 0.7
    assert pd.isna(table["noise_floor_mm"][2]) and table["noise_floor_deg"][2] == 0.05


def test_what_there_is_one_of_is_in_the_singular(campaigns, tmp_path, capsys):
    assert run(["table", str(campaigns[2].parent / "angles"), "-o", str(tmp_path / "one.csv")]) == 0
    assert "one.csv: 1 row, " in capsys.readouterr().out


def test_a_folder_that_is_not_there_is_told_as_that_and_not_shown_next(campaigns, tmp_path, capsys):
    films, _, empty = campaigns
    gone = tmp_path / "gone"
    assert run(["table", str(films), str(empty), str(gone), "-o", str(tmp_path / "some.csv")]) == 1
    said = capsys.readouterr()
    assert f"{gone}: no such folder" in said.err and "empty: holds no model" in said.err
    shown = next(line for line in (said.out + said.err).splitlines() if line.startswith("next:"))
    assert str(films) in shown and str(gone) not in shown and str(empty) not in shown


def test_a_broken_result_and_a_missing_library_are_one_sentence(campaigns, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert run(["table", str(campaigns[0]), "-o", str(tmp_path / "a.parquet")]) == 2
    assert "rfea-vision[parquet]" in capsys.readouterr().err and not (tmp_path / "a.parquet").exists()
    (campaigns[1] / "rfea" / "models" / "base" / "model.json").write_text("{")
    assert run(["table", str(campaigns[1]), "-o", str(tmp_path / "a.csv")]) == 2
    assert "model.json: cannot be read" in capsys.readouterr().err and not (tmp_path / "a.csv").exists()
