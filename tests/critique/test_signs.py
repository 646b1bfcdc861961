"""Effects with a sign mean the same in the twin as in the catalogue, on whichever side the tube bends."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from rfea_vision import open_campaign
from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.fitting.problem import make_model, make_problem
from rfea_vision.fitting.refit import carried
from rfea_vision.fitting.residuals import evaluate
from rfea_vision.options import FitOptions
from rfea_vision.twin import TwinOptions, simulate
from rfea_vision.twin.draw import draw_base

STRENGTHS = {
    "gravity_tilt.angle": 0.1,
    "com_offset.a": 0.8,
    "rest_curvature.angle": 0.1,
    "plane_tilt.a": 0.4,
    "camera_roll.angle": 0.02,
    "stiffness_profile.a1": 0.15,
    "pressure_offset.p0": 3e3,
}


@pytest.mark.parametrize("bends", ["left", "right"])
@pytest.mark.parametrize("key", STRENGTHS)
def test_true_parameters_predict_the_twin_and_the_opposite_sign_does_not(tmp_path: Path, key: str, bends: str):
    tube = Actuator(bends=bends)  # type: ignore[arg-type]
    options = TwinOptions(
        hidden={key: STRENGTHS[key]}, seed=3, roles=("train",), duration_s=0.8, rate_Hz=120.0, joints=16, actuator=tube,
        sync="common_clock", write_truth=False,
    )  # fmt: skip
    simulate(tmp_path / "tube", options)
    found = open_campaign(tmp_path / "tube").sync()
    problem = make_problem({name: Recording(r.dataset.load()) for name, r in found.items()}, tube)
    model = make_model(tube, FitOptions(segments=12, effects=(key.split(".")[0],)), problem.mirror)

    def cost(sign: float) -> float:
        known = {**asdict(draw_base(3)), key: sign * STRENGTHS[key]}
        par = carried(model, tube, 12, known, 8)
        for name in ("stiffness_profile.a2", "stiffness_profile.a3", "plane_tilt.b"):
            if name in model.names:
                par[model.names.index(name)] = 0.0
        result = evaluate(model, par, problem.train, ())
        assert result is not None
        return float(np.sqrt(result.cost / result.residual.size))

    assert cost(1.0) < 2.0
    assert cost(-1.0) > 3 * cost(1.0)
