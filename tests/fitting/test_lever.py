"""The lever of the pressure beyond the bounds of the paper's tube: found where the runs tell it, said, and kept by what follows."""

from dataclasses import replace

import numpy as np
import pytest

from rfea_vision.fitting import fit_model
from rfea_vision.fitting.fit import fit, make_problem
from rfea_vision.fitting.scoring import options_of
from rfea_vision.options import FitOptions

OPTIONS = FitOptions(segments=8, starts=0)
#: Less than half of the pressure that is logged bends the tube: the wall takes the rest.
SHARE = 0.42


@pytest.fixture(scope="module")
def stiff_wall(complete_campaign):
    recordings, actuator, truth = complete_campaign
    weak = {}
    for name, recording in recordings.items():
        dataset = recording.dataset.copy()
        dataset["pressure"] = dataset["pressure"] / SHARE
        weak[name] = replace(recording, dataset=dataset)
    return weak, actuator, truth


def test_a_lever_far_beyond_its_bounds_is_found_and_said(stiff_wall):
    recordings, actuator, truth = stiff_wall
    model = fit_model(recordings, actuator, OPTIONS)
    lever = model.parameters["r_hyd"]
    assert lever.value == pytest.approx(SHARE * truth["base"]["r_hyd"], rel=0.02)
    assert lever.interval_95 is not None
    assert model.metrics["validate"].tip_rmse_mm < 1.3 * model.noise_floor_mm
    assert any("less than the geometry says" in sentence for sentence in model.warnings)
    low, high = options_of(model).bounds["r_hyd"]  # for what starts from the file
    assert low < lever.value < high


def test_bounds_that_were_given_stay(stiff_wall):
    recordings, actuator, _ = stiff_wall
    problem = make_problem(recordings, actuator)
    fitted = fit(problem, replace(OPTIONS, bounds={"r_hyd": (3e-3, 5e-3)}))
    assert fitted.par[6] >= 3e-3 and np.isfinite(fitted.solution.cost)


def test_within_the_usual_bounds_nothing_is_said(complete_campaign):
    recordings, actuator, _ = complete_campaign
    model = fit_model(recordings, actuator, OPTIONS)
    assert "r_hyd" not in options_of(model).bounds
    assert not any("geometry" in sentence for sentence in model.warnings)
