"""The paper's recipe on a twin whose truth is the paper's 8-DoF table, and what a person may say beforehand."""

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner

from rfea_vision.cli.root import rfea
from rfea_vision.errors import InputError
from rfea_vision.fitting.coordinates import stiffness_per_modulus
from rfea_vision.options import FitOptions
from rfea_vision.stages import open_campaign
from rfea_vision.stages.recipes import load_recipe, run_recipe


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    pytest.importorskip("mujoco", reason="the twin needs MuJoCo: pip install 'rfea-vision[twin]'")
    from rfea_vision.twin import paper_campaign, simulate

    folder = tmp_path_factory.mktemp("paper") / "paper"
    truth = simulate(folder, replace(paper_campaign(), duration_s=2.0, rate_Hz=240, seed=1, step_s=0.0005))
    work = open_campaign(folder)
    results = run_recipe(work, load_recipe("paper"))
    return work, truth["base"], results


def test_the_recipe_returns_the_table_of_the_paper(campaign):
    from rfea_vision.dynamics.parameters import PUBLISHED

    work, truth, _ = campaign
    model = work.model("paper-8dof")
    assert model.observe == "tip_y" and model.joints == "start" and model.segments == 8
    for name, value in truth.items():
        found = model.parameters[name]
        assert found.interval_95[0] <= value <= found.interval_95[1], name
    for name in ("k_ref", "r_hyd"):
        assert model.parameters[name].value == pytest.approx(truth[name], rel=0.01)
    table = PUBLISHED["8-DoF"]
    for name, found in model.paper_parameters.items():
        assert found.interval_95[0] <= getattr(table, name) <= found.interval_95[1], name
    validate = model.metrics["validate"]
    assert validate.tip_rmse_mm < 0.1 and validate.tip_y_rmse_mm < 0.07
    assert work.model("paper-2dof").metrics["validate"].tip_rmse_mm > 10 * validate.tip_rmse_mm


def test_the_recipe_reports_path_and_study(campaign):
    work, _, results = campaign
    rows = work.model("paper-8dof").segments_study
    assert [row["segments"] for row in rows] == [2, 4, 8, 16, 32]
    assert min(rows, key=lambda row: row["validate_tip_rmse_mm"])["segments"] == 8
    assert all(len(row["tip_path_mm"]["x"]) > 50 for row in rows)
    seconds = json.loads((work.out / "models" / "paper-8dof" / "timings.json").read_text(encoding="utf-8"))
    assert set(seconds["segments_study_s"]) == {"2", "4", "8", "16", "32"}
    assert "segments_study_s" not in (work.out / "models" / "paper-8dof" / "model.json").read_text(encoding="utf-8")
    assert results["report"].is_file() and set(results["compare"]) == {"paper-2dof", "paper-8dof"}


@pytest.mark.study
def test_the_command_line_takes_what_is_known(campaign):
    work, _, _ = campaign
    words = "--segments 8 --joints start --name known --fix r_hyd=3.5644mm --prior modulus=6.7MPa±0.5MPa"
    words += " --bound k_slope=-900..-700N/rad --pressure-zero 1kPa --profile k_ref --loss linear --json"
    words = words.replace("-900..-700N/rad", "-900N/rad..-700N/rad")
    done = CliRunner().invoke(rfea, ["fit", str(work.campaign.root), *words.split()])
    assert done.exit_code == 0, done.output
    model = json.loads(done.stdout)
    assert model["parameters"]["r_hyd"]["fixed"] and model["parameters"]["r_hyd"]["value"] == pytest.approx(3.5644e-3)
    assert model["parameters"]["k_slope"]["lower"] == -900
    assert model["given"]["priors"]["modulus"] == [6.7e6, 5e5] and model["given"]["pressure_zero_sd"] == 1e3
    assert model["given"]["loss"] == "linear" and "k_ref" in model["profiles"]
    assert all("pressure_zero_kPa" in item["nuisance"] for item in model["experiments"].values())
    again = CliRunner().invoke(rfea, ["fit", str(work.campaign.root), *words.split()])
    assert "unchanged" in again.stderr and again.stdout == done.stdout


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"fix": ["r_hid=3mm"]}, "did you mean r_hyd"),
        ({"fix": ["r_hyd=3"]}, "has no unit"),
        ({"fix": ["r_hyd=3kPa"]}, "r_hyd=3kPa"),
        ({"fix": ["r_hyd"]}, "parameter=value"),
        ({"fix": ["r_hyd=3mm", "r_hyd=4mm"]}, "given twice"),
        ({"prior": ["payload.m=2g"]}, "payload.m=2g±0.1g"),
        ({"prior": ["payload.m=2g±0g"]}, "use --fix"),
        ({"bound": ["r_hyd=4mm..3mm"]}, "below the second"),
        ({"bound": ["r_hyd=4mm"]}, "lowest and highest"),
    ],
)
def test_what_is_written_wrongly_is_said(given, says):
    with pytest.raises(InputError, match=says):
        FitOptions(**given)


def test_units_stop_at_the_door():
    given = {
        "fix": ["maxwell.k1=3%"],
        "prior": ["payload.m=2g+-0.1g", "modulus=2MPa±0.3MPa"],
        "bound": ["r_hyd=3mm..4mm"],
    }
    options = FitOptions(**given)
    assert options.fixed == {"maxwell.k1": pytest.approx(0.03)}
    assert options.priors == {"payload.m": pytest.approx((2e-3, 1e-4)), "modulus": pytest.approx((2e6, 3e5))}
    assert options.bounds == {"r_hyd": pytest.approx((3e-3, 4e-3))}
    assert FitOptions(segments="auto").auto_segments


def test_a_modulus_is_that_of_a_ring_that_bends_about_its_side():
    """Against the integral of y^2 over the ring, y from the hinge line, by quadrature."""
    import numpy as np

    from rfea_vision.artefacts import Actuator

    tube = Actuator()
    radius = np.linspace(tube.inner_radius, tube.outer_radius, 401)
    angle = np.linspace(0, 2 * np.pi, 401)
    integrand = (tube.outer_radius + radius[:, None] * np.cos(angle)) ** 2 * radius[:, None]
    moment = np.trapezoid(np.trapezoid(integrand, angle, axis=1), radius)
    assert stiffness_per_modulus(tube, 8) == pytest.approx(moment * 8 / tube.length, rel=1e-4)


def test_the_papers_own_table_lies_within_the_bounds():
    import numpy as np

    from rfea_vision.artefacts import Actuator
    from rfea_vision.dynamics.parameters import PUBLISHED
    from rfea_vision.fitting.coordinates import build
    from rfea_vision.fitting.problem import make_model

    model = make_model(Actuator(), FitOptions(segments=8, joints="start"))
    for bend in (0.5, 1.5, 2.2):  # rad; 270 kPa with its overshoot is below the last
        coordinates = build(model, Actuator(), 8, bend)
        y = np.linalg.solve(coordinates.matrix, PUBLISHED["8-DoF"].vector())
        assert np.all(y > coordinates.lower) and np.all(y < coordinates.upper)
