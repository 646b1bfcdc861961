"""A body that a tendon pulls, its tension logged in newtons: read as a force, kept apart from pressures, and bending by its lever."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml

from rfea_vision.artefacts import Actuator
from rfea_vision.artefacts.judgement import Diagnosis, NextExperiment
from rfea_vision.artefacts.measurement import TENDON_AREA, TENSION_kPa
from rfea_vision.campaign import PressureSpec, load_campaign, read_campaign
from rfea_vision.campaign.check import check_campaign
from rfea_vision.campaign.from_files import write_campaign_from
from rfea_vision.campaign.plausibility import of_pressure
from rfea_vision.campaign.schema import PressurePart
from rfea_vision.critique.next_experiment import _Design
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.errors import InputError
from rfea_vision.fitting.coordinates import base_reference, build
from rfea_vision.readers.pressure import read_pressure
from rfea_vision.stages.products import save_diagnosis

from .campaigns import write_campaign

TIME_S = np.arange(400) * 0.0125
TENSION_N = 3.0 - 2.7 * np.cos(2 * np.pi * 0.5 * TIME_S)
ARM = Actuator(kind="rod", outer_radius=0.005, inner_radius=(TENDON_AREA / np.pi) ** 0.5, length=0.18, tendon=0.009)


def a_log(path, head, values=TENSION_N, decimal=","):
    """As a load cell's amplifier writes it: junk above, semicolons, a decimal comma."""
    rows = pd.DataFrame({"Zeit [ms]": 1e3 * TIME_S, head: values, "Temp [°C]": 22.5}).to_csv(sep=";", decimal=decimal, index=False)
    path.write_text("Messprotokoll HX711 v2.3\nBediener;Weiß\n\n" + rows)
    return path


def read(path, head, *, tendon=True, **keys):
    return read_pressure(PressureSpec(path, PressurePart(time="Zeit [ms]", pressure=head, **keys), path.parent, tendon=tendon))


@pytest.mark.parametrize(("head", "per_N", "keys"), [("Kraft [N]", 1.0, {}), ("F (mN)", 1e3, {}), ("Kraft", 1e3, {"unit": "mN"})])
def test_a_tension_is_read_in_its_own_unit(tmp_path, head, per_N, keys):
    log = read(a_log(tmp_path / "log.csv", head, per_N * TENSION_N), head, **keys)
    np.testing.assert_allclose(log.pressure_kPa, TENSION_kPa * TENSION_N, rtol=1e-6)
    assert log.tendon and of_pressure(log) == []


def test_several_tendons_are_several_forces(tmp_path):
    pulled = PressurePart(time="Zeit [ms]", pressure="F [N]", chamber="a")
    back = pulled.model_copy(update={"chamber": "b", "sign": -1})
    first, second = a_log(tmp_path / "a.csv", "F [N]", 2 * TENSION_N), a_log(tmp_path / "b.csv", "F [N]")
    further = (PressureSpec(second, back, tmp_path, tendon=True),)
    log = read_pressure(PressureSpec(first, pulled, tmp_path, further, tendon=True))
    np.testing.assert_allclose(log.pressure_kPa, TENSION_kPa * TENSION_N, rtol=1e-6)
    assert log.tendon


@pytest.mark.parametrize(
    ("head", "tendon", "says"),
    [
        ("Kraft [N]", False, "is in N by its own head, which is a force and no pressure; where a tendon pulls, write its distance"),
        ("Druck [V]", False, "is in V by its own head, which is what a sensor gives out; convert it"),
        ("Signal (mA)", True, "is in mA by its own head, which is what a sensor gives out"),
        ("Druck [bar]", True, "is in bar by its own head, which is a pressure, where actuator.section.tendon says"),
    ],
)
def test_what_is_no_measurement_of_the_kind_is_refused(tmp_path, head, tendon, says):
    """A column in newtons, or volts, had been taken for kPa, and nothing was said."""
    with pytest.raises(InputError) as caught:
        read(a_log(tmp_path / "log.csv", head), head, tendon=tendon)
    assert says in str(caught.value)


@pytest.mark.parametrize("head", ["p (A)", "p [raw]", "pressure (left)", "p(t)"])
def test_brackets_that_hold_no_such_unit_are_a_name(tmp_path, head):
    assert read(a_log(tmp_path / "log.csv", head), head, tendon=False).pressure_kPa == pytest.approx(TENSION_N, abs=1e-6)


def test_the_column_of_a_force_is_meant_by_its_unit(tmp_path):
    with pytest.raises(InputError, match="no column 'tension_N'") as caught:
        read(a_log(tmp_path / "log.csv", "Kraft [N]"), None)
    assert 'pressure: "Kraft [N]"' in str(caught.value)


@pytest.mark.parametrize(("values", "says"), [(-TENSION_N, "a tendon only pulls"), (np.full(400, 2.0), "is flat")])
def test_a_tension_is_doubted_as_a_force(tmp_path, values, says):
    (text,) = of_pressure(read(a_log(tmp_path / "log.csv", "Kraft [N]", values), "Kraft [N]"))
    assert says in text and "kPa" not in text


def test_a_tendon_is_an_actuator_without_a_chamber(tmp_path):
    folder = write_campaign(tmp_path / "arm")
    page = yaml.safe_load((folder / "campaign.yaml").read_text())

    def said(section, **more):
        page["actuator"] = {"outer_radius": "5 mm", "length": "155 mm", "mass": "22 g", "bends": "left", "section": section, **more}
        (folder / "campaign.yaml").write_text(yaml.safe_dump(page))
        return [problem.message for problem in read_campaign(folder).problems if problem.severity == "error"]

    assert "write its distance from the middle, 'tendon: 8 mm'" in said({"kind": "rod"})[0]
    assert "keep that of what acts" in said({"kind": "rod", "tendon": "9 mm", "chamber_area": "60 mm^2"})[0]
    assert "of the kind 'tube'" in said({"kind": "tube", "tendon": "9 mm"})[0]
    assert said({"kind": "rod", "tendon": "9 mm"}) == []
    (steps,) = load_campaign(folder).with_role("train")
    assert steps.pressure.tendon and steps.actuator.tendon == pytest.approx(0.009)
    assert steps.actuator.inner_radius == pytest.approx(ARM.inner_radius, rel=1e-3)


def test_a_tension_bends_by_its_lever(tmp_path):
    """Without gravity every joint is turned by F times the lever over its stiffness, whatever area the force is kept on."""
    par = np.array([0.5, 0.0, 1e-3, 0.0, 1e-3, 0.0, ARM.tendon])
    model = Model(Chain.tube(ARM, 6), (), gravity=0.0)
    log = read(a_log(tmp_path / "log.csv", "Kraft [N]"), "Kraft [N]")
    pulled = float(log.pressure_kPa[40])
    bent = model.steady(par, 1e3 * pulled).phi[-1]
    assert bent == pytest.approx(6 * TENSION_N[40] * ARM.tendon / 0.5, rel=1e-5)


def test_the_lever_is_looked_for_about_its_measure():
    assert base_reference(ARM, 6)[6] == ARM.tendon
    model = Model(Chain.tube(ARM, 6), ())
    coordinates = build(model, ARM, 6, 1.0)
    at = coordinates.names.index("r_hyd")
    span = np.array([coordinates.lower[at], coordinates.upper[at]]) * coordinates.matrix[6, at]
    np.testing.assert_allclose(span, [0.00675, 0.01125])


def test_a_log_in_newtons_is_guessed_to_be_a_tendons(tmp_path):
    """Its campaign had no log: 'no column looks like a pressure, a tip or an angle'."""
    track = pd.DataFrame({"time_s": TIME_S, "tip_x_mm": -20 * TENSION_N, "tip_y_mm": -170 + 4 * TENSION_N})
    for run in ("one", "two"):
        a_log(tmp_path / f"{run}.csv", "Kraft [N]")
        track.assign(tip_x_mm=track["tip_x_mm"] + (run == "one")).to_csv(tmp_path / f"{run}_track.csv", index=False)
    written = write_campaign_from(tmp_path / "arm", sorted(tmp_path.glob("*.csv")))
    assert written.left_out == ()
    page = yaml.safe_load((tmp_path / "arm" / "campaign.yaml").read_text())
    assert page["actuator"]["section"] == {"kind": "rod", "tendon": "4 mm"} and "inner_radius" not in page["actuator"]
    assert any("actuator.section" in guess and "measure yours" in guess for guess in written.guesses)
    run = yaml.safe_load((tmp_path / "arm" / "one" / "experiment.yaml").read_text())
    assert run["pressure"] == {"file": "one.csv", "time": "Zeit [ms]", "pressure": "Kraft [N]"}
    assert not [problem for problem in check_campaign(tmp_path / "arm").problems if problem.severity == "error"]


def test_the_run_to_play_next_is_told_in_newtons():
    said = _Design("steps").words(np.array([0.0, 4.83e5, 0.0]), tension=True)
    assert said.startswith("steps (up to 4.8 N, ")


def test_the_run_to_play_next_is_written_in_newtons_too(tmp_path):
    planned = {"for": ["a", "b"], "pressure": "next.csv", "sentence": "", "decides": True}
    played = {"pressure": ("log_time", [0.0, 480.0], {"units": "kPa"}), "tension": ("log_time", [0.0, 4.8], {"units": "N"})}
    diagnosis = Diagnosis.model_construct(next_experiment=NextExperiment.model_validate(planned), model="base", verdict="complete")
    save_diagnosis(tmp_path, diagnosis, xr.Dataset(played, coords={"log_time": [0.0, 1.0]}))
    table = pd.read_csv(tmp_path / "next.csv")
    assert list(table["tension_N"]) == [0.0, 4.8] and list(table["pressure_kPa"]) == [0.0, 480.0]
