"""Plant and model share no code: every effect must still mean the same thing, with the same numbers, in both."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from rfea_vision.dynamics.simulation import Excitation
from rfea_vision.fitting.camera_view import seen_by_camera
from rfea_vision.fitting.problem import make_model
from rfea_vision.fitting.refit import carried
from rfea_vision.options import FitOptions
from rfea_vision.twin import OUTSIDE, TwinOptions
from rfea_vision.twin.draw import build_plant, camera_times, draw_runs, highest_pressure, move, posture_at
from rfea_vision.twin.options import with_partners
from tests.twin.test_plant import MEASURED, STRENGTHS

JOINTS = 8
NODES = np.linspace(0, 1, 5)
#: The plant feels a wall at five points of a body, the model in its middle; water that flows in is spread over the bodies
#: there, and sits at the joints here.
SHARE = {"contact": 0.05, "variable_mass": 0.05}


def seen_and_predicted(hidden: dict[str, float], effects: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the centre line (frames, nodes, 2) in mm of the plant, and of the model told the truth."""
    options = TwinOptions(hidden=hidden, seed=3, joints=JOINTS, duration_s=0.3)
    plant, base = build_plant(options)
    run = draw_runs(options, highest_pressure(plant, options))[0]
    times = run.offset_s + camera_times(options)
    seen = posture_at(plant, move(plant, run, options.step_s), times).line(NODES)[0]
    model = replace(make_model(options.actuator, FitOptions(segments=JOINTS, effects=effects)), order=3)
    par = carried(model, options.actuator, JOINTS, {**asdict(base), **with_partners(hidden)}, 8)
    log = run.programme
    time, pressure = np.asarray(log.time_s, float), np.asarray(log.pressure_Pa, float)
    motion = model.simulate(par, Excitation.from_log(time, pressure, time[0], time[-1]), times)
    assert motion.ok
    points, _ = seen_by_camera(model, par, motion, NODES, [], np.interp(times, time, pressure))
    return seen, points * 1e3


@pytest.fixture(scope="module")
def plain() -> np.ndarray:
    seen, predicted = seen_and_predicted({}, ())
    assert np.abs(seen - predicted).max() < 0.02
    return seen


@pytest.mark.parametrize("effect", sorted(set(STRENGTHS) - set(OUTSIDE) - MEASURED))
def test_an_effect_is_the_same_in_plant_and_model(effect: str, plain: np.ndarray) -> None:
    seen, predicted = seen_and_predicted(STRENGTHS[effect], (effect,))
    size = np.abs(seen - plain).max()
    assert size > 0.3  # mm: it does something
    assert np.abs(seen - predicted).max() < max(0.02, SHARE.get(effect, 0.0) * size)
