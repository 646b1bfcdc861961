"""`rfea export`: from model.json to files, and one sentence where it cannot."""

import json
import re
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaign.campaigns import write_campaign

from rfea_vision.artefacts import Actuator, ModelFit, Track
from rfea_vision.cli.root import run
from rfea_vision.dynamics.parameters import PUBLISHED, scaled
from rfea_vision.dynamics.realtime import Stepper
from rfea_vision.effects.base import BASE_UNITS
from rfea_vision.export import fitted_model
from rfea_vision.export.tips import write_tip
from rfea_vision.readers.tracks import read_track


def _fit(name, effects=(), values=()):
    base = dict(zip(BASE_UNITS, scaled(PUBLISHED["8-DoF"].vector(), 8, 4), strict=True))
    parameters = {key: {"value": value, "unit": BASE_UNITS[key]} for key, value in base.items()}
    parameters |= {key: {"value": value, "unit": unit} for key, value, unit in values}
    return ModelFit.model_validate(
        {
            "name": name,
            "segments": 4,
            "effects": list(effects),
            "actuator": Actuator(bends="right").as_dict(),
            "parameters": parameters,
            "metrics": {},
            "experiments": {},
        }
    )


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "tube-A"
    (folder / "run").mkdir(parents=True)
    (folder / "campaign.yaml").write_text("format: rfea-campaign/1\nname: tube-A\n")
    files = "track: {file: track.csv}\npressure: {file: pressure.csv}\n"
    (folder / "run" / "experiment.yaml").write_text(f"format: rfea-experiment/1\nname: run\nrole: train\n{files}")
    (folder / "run" / "track.csv").write_text("time_s,tip_x_mm,tip_y_mm\n0,0,-155\n")
    (folder / "run" / "pressure.csv").write_text("time_s,pressure_kPa\n0,0\n")
    values = [("maxwell.k1", 0.1, "1"), ("maxwell.T", 0.4, "s")]
    _fit("soft", ["maxwell"], values).save(folder / "rfea" / "models" / "soft" / "model.json")
    scale = [("camera_scale.s", 0.01, "1")]
    _fit("wide", ["camera_scale"], scale).save(folder / "rfea" / "models" / "wide" / "model.json")
    return folder


def test_fit_becomes_a_model_that_runs(campaign):
    fit = ModelFit.load(campaign / "rfea" / "models" / "soft" / "model.json")
    model, par = fitted_model(fit)
    assert model.names[7:] == ("maxwell.k1", "maxwell.T") and list(par[7:]) == [0.1, 0.4]
    moment = Stepper(model, par, pressure_Pa=200e3).step(200e3)
    assert moment.tip_m[0] > 0.05  # bends right
    assert np.isfinite(par).all()


def test_c_and_fmu_are_written(campaign, cc, capsys):
    target = campaign.parent / "out" / "my tube.c"
    assert run(["export", str(campaign), "soft", str(target), "--json"]) == 0
    written = json.loads(capsys.readouterr().out)
    assert written["files"] == [str(target.with_name("my_tube.c")), str(target.with_name("my_tube.h"))]
    text = target.with_name("my_tube.c").read_text()
    assert "Model 'soft' of tube-A: 4 segments, maxwell" in text and "my_tube_step" in text
    assert run(["export", str(campaign), "soft", str(target.with_suffix("")), "--fmu", "--step", "0.5ms"]) == 0
    with zipfile.ZipFile(target.with_suffix(".fmu")) as archive:
        assert b'stepSize="0.0005"' in archive.read("modelDescription.xml")


def test_effect_of_the_camera_is_refused_in_one_sentence(campaign, capsys):
    assert run(["export", str(campaign), "wide", str(campaign.parent / "tube")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "'camera_scale' belongs to the camera" in said
    assert f"; export soft, a model without it: rfea export {campaign} soft {campaign.parent / 'tube'}" in said
    assert not (campaign.parent / "tube.c").exists()
    assert run(["export", str(campaign), "a", "b", "c"]) == 2


def test_a_fit_that_was_refused_is_exported_with_a_warning(campaign, capsys):
    """It was exported without a word."""
    file = campaign / "rfea" / "models" / "soft" / "model.json"
    message = "Refused: the fit ran away, b_neg_ref is 50 times what a tube of this size has; is the body a tube?"
    ModelFit.load(file).model_copy(update={"status": "refused", "message": message}).save(file)
    assert run(["export", str(campaign), "soft", str(campaign.parent / "tube"), "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["model"] == "soft"
    assert "warning: soft was refused when it was fitted, and is no model of this tube: the fit ran away, b_neg_ref is 50" in said.err


def test_a_table_has_the_digits_that_its_errors_bear_out(tmp_path):
    """Nanometres were written of a tip that was known to 10 mm."""
    tip, sigma = np.array([[21.646614, -260.44903]]), np.array([[9.674259, 0.011744]])
    data = xr.Dataset(
        {"tip": (("time", "xy"), tip), "tip_sigma": (("time", "xy"), sigma), "reason": ("time", [""])}, coords={"time": [0.061234]}
    )
    write_tip(tmp_path / "tip.csv", data)
    assert (tmp_path / "tip.csv").read_text().splitlines()[1] == "0.061234,21.65,-260.449,6.8407,9.67,0.0117,"


def test_page_of_the_documents_does_what_it_says(campaign, cc):
    """The blocks of docs/export.md: the C compiles and moves the tube, the Python moves it to the same place."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    source = re.findall(r"```c\n(.*?)```", page, re.DOTALL)[0].partition('#include "tube.h"\n')[2]
    code = re.findall(r"```python\n(.*?)```", page, re.DOTALL)[0]
    assert run(["export", str(campaign), "soft", str(campaign.parent / "tube.c")]) == 0
    shows = 'printf("%d %d %.12f %.12f\\n", no_equilibrium, not_settled, seen.tip_x_m, seen.tip_y_m);'
    main = f'#include <stdio.h>\n#include "tube.h"\nint main(void) {{\n{source}\n{shows}\nreturn 0;\n}}\n'
    (campaign.parent / "main.c").write_text(main)
    files = [str(campaign.parent / name) for name in ("main.c", "tube.c")]
    program = str(campaign.parent / "main")
    subprocess.run([cc, "-std=c99", "-O2", "-o", program, *files, "-lm"], check=True)
    shown = subprocess.run([program], check=True, capture_output=True, text=True).stdout.split()
    place = str(campaign / "rfea" / "models" / "soft")
    names: dict = {}
    exec(code.replace("CAMPAIGN/rfea/models/base", place), names)
    assert shown[:2] == ["0", "0"]
    assert [float(value) for value in shown[2:]] == pytest.approx(names["moment"].tip_m, abs=1e-11)


def test_poses_of_every_run_whatever_its_role(tmp_path):
    folder = write_campaign(tmp_path / "tube")
    assert run(["export", str(folder), str(tmp_path / "poses"), "--poses"]) == 0
    assert sorted(path.name for path in (tmp_path / "poses").iterdir()) == ["sine.nc", "steps.nc"]


def test_nwb_of_every_run_is_read_as_the_page_of_the_documents_does(tmp_path, capsys):
    folder = write_campaign(tmp_path / "tube")
    assert run(["export", str(folder), str(tmp_path / "nwb"), "--nwb"]) == 0
    assert sorted(path.name for path in (tmp_path / "nwb").iterdir()) == ["sine.nwb", "steps.nwb"]
    page = (Path(__file__).resolve().parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    code = next(block for block in re.findall(r"```py\n(.*?)```", page, re.DOTALL) if "NWBHDF5IO" in block)
    names: dict = {}
    exec(code.replace("OUT/", f"{tmp_path}/nwb/"), names)
    assert names["tip"].data.shape == (120, 2) and names["run"].identifier == "steps"
    capsys.readouterr()
    assert run(["export", str(folder), "base", str(tmp_path / "nwb"), "--nwb"]) == 2
    assert "tracks have no MODEL" in " ".join(capsys.readouterr().err.split())


def _without_log(file):
    file.write_text("".join(line for line in file.read_text().splitlines(keepends=True) if not line.startswith("pressure")))


@pytest.mark.parametrize("logged", [True, False])
def test_tracks_are_taken_out_with_and_without_a_log(tmp_path, capsys, logged):
    """Poses had wanted a log that a track does not need; and the tip over time stood in no table."""
    folder = write_campaign(tmp_path / "tube", {"steps": "train"})
    rows = pd.read_csv(folder / "steps" / "track.csv")
    rows.loc[5, ["tip_x_mm", "tip_y_mm"]] = np.nan
    rows.to_csv(folder / "steps" / "track.csv", index=False)
    if not logged:
        _without_log(folder / "steps" / "experiment.yaml")
    assert run(["track", str(folder)]) == 0
    following = f"rfea sync {folder}" if logged else f"rfea export {folder} OUT --csv   (the tip over time; a model needs a log"
    assert capsys.readouterr().out.splitlines()[-1].startswith(f"next: {following}")
    for kind, ending in (("--poses", "nc"), ("--csv", "csv")):
        assert run(["export", str(folder), str(tmp_path / "out"), kind]) == 0
        assert (tmp_path / "out" / f"steps.{ending}").is_file()
    written = pd.read_csv(tmp_path / "out" / "steps.csv")
    columns = ["time_s", "tip_x_mm", "tip_y_mm", "sigma_mm", "sigma_x_mm", "sigma_y_mm", "reason"]
    assert list(written.columns) == columns and len(written) == len(rows)
    assert written["reason"][5] == "not_tracked" and written["reason"].isna().sum() == len(rows) - 1
    told = 0.01 * np.nanmax(written["sigma_mm"])  # as far as its standard errors bear it out
    np.testing.assert_allclose(written[columns[:3]], rows[columns[:3]], atol=told)
    tracked, again = Track.load(folder / "rfea" / "steps" / "track.nc"), read_track(tmp_path / "out" / "steps.csv")
    assert (again.valid == tracked.valid).all() and again.dataset.attrs["sigma_source"] == "given in the track"
    for name in ("tip", "tip_sigma"):
        np.testing.assert_allclose(again.dataset[name].values, tracked.dataset[name].values, atol=told)


def test_after_tracks_of_which_some_have_a_log_these_are_synchronised(tmp_path, capsys):
    folder = write_campaign(tmp_path / "tube")
    _without_log(folder / "sine" / "experiment.yaml")
    assert run(["track", str(folder)]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"next: rfea sync {folder} -e steps" and run(["sync", str(folder), "-e", "steps"]) == 0


def test_runs_that_are_not_synchronised_are_exported_by_the_times_of_their_tracks(tmp_path, capsys):
    """The same film exported without a log, and stopped with the error of the clocks where it had one."""
    folder = write_campaign(tmp_path / "c", {"steps": "train"})
    run_file = folder / "steps" / "experiment.yaml"
    run_file.write_text(run_file.read_text().replace("common_clock", "motion"))  # half a second is too short
    for kind, ending in (("--csv", "csv"), ("--poses", "nc")):
        assert run(["export", str(folder), str(tmp_path / "out"), kind]) == 0
        assert "steps: taken by the track's own times, without pressure, because of" in " ".join(capsys.readouterr().err.split())
        assert (tmp_path / "out" / f"steps.{ending}").is_file()
    assert run(["export", str(folder), str(tmp_path / "out"), "--nwb"]) != 0
