"""What the camera sees of the centre line: derivatives by every parameter against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.realtime import Stepper
from rfea_vision.dynamics.simulation import Excitation
from rfea_vision.errors import InputError
from rfea_vision.export.c_source import check_exportable
from rfea_vision.fitting.camera_view import seen_by_camera, stretching
from rfea_vision.fitting.problem import make_model, start_vector
from rfea_vision.options import FitOptions

SEGMENTS = 4
NODES = np.array([0.0, 0.5, 1.0])
VALUES = {
    "radial_expansion.c": 1e-8,
    "radial_expansion.axis": 0.8,
    "stretch.c": 4e-7,
    "base_rotation.c": 3.0,
    "base_rotation.pivot": 0.7,
    "variable_mass.a": 1.3,
    "com_offset.a": 0.6,
    "camera_scale.s": 0.02,
}


@pytest.mark.parametrize(
    "effects",
    [
        ("radial_expansion", "base_rotation", "stretch", "camera_scale"),
        ("variable_mass", "com_offset", "base_rotation"),
    ],
)
@pytest.mark.parametrize("joints", ["middle", "start"])
def test_derivatives_are_those_of_the_line_that_is_seen(effects, joints):
    actuator = Actuator()
    model = replace(
        make_model(actuator, FitOptions(effects=effects, segments=SEGMENTS, joints=joints)), tolerance=1e-12
    )
    par = start_vector(model, actuator, SEGMENTS)
    for name, value in VALUES.items():
        if name in model.names:
            par[model.names.index(name)] = value
    time = np.arange(0, 0.3, 0.001)
    excitation = Excitation.from_log(time, 120e3 * np.clip(time / 0.08, 0, 1), 0, 0.299)
    frames = np.arange(0.02, 0.29, 0.02)

    def seen(values, free=()):
        motion = model.simulate(values, excitation, frames, free)
        assert motion.ok
        return seen_by_camera(model, values, motion, NODES, list(free), excitation.at(frames))

    free = list(range(par.size))
    _, slopes = seen(par, free)
    for k in free:
        step = np.zeros(par.size)
        step[k] = 1e-5 * max(abs(par[k]), 1e-9)
        difference = (seen(par + step)[0] - seen(par - step)[0]) / (2 * step[k])
        assert np.abs(difference).max() > 0, model.names[k]
        assert slopes[..., k] == pytest.approx(difference, rel=1e-4, abs=1e-5 * np.abs(difference).max())


def test_chambers_on_both_sides_stretch_the_body_together():
    """At one pressure in both the sum with signs is nothing: the body hangs straight, and longer."""
    rod = Actuator(outer_radius=0.02, kind="rod")
    model = make_model(rod, FitOptions(effects=("stretch",), segments=SEGMENTS))
    par = start_vector(model, rod, SEGMENTS)
    par[model.names.index("stretch.c")] = 8e-7
    time = np.arange(0, 0.1, 0.001)
    both = 100e3 * np.clip(time / 0.05, 0, 1)
    excitation = Excitation.from_log(
        time, 0.0 * time, 0, 0.099, chambers_Pa={"left": (1.0, both), "right": (-1.0, both)}
    )
    frames = np.array([0.0, 0.025, 0.08])
    motion = model.simulate(par, excitation, frames, ())
    total = sum(excitation.at(frames, own) for _, own in excitation.chambers.values())
    tip = seen_by_camera(model, par, motion, np.ones(1), [], excitation.at(frames), total)[0][:, 0]
    assert tip[:, 0] == pytest.approx(0.0, abs=1e-9)
    assert tip[:, 1] == pytest.approx(-rod.length * (1 + 8e-7 * np.array([0.0, 100e3, 200e3])), rel=1e-6)


def test_a_body_may_lengthen_later_than_the_pressure_comes():
    """After a step in both chambers 63 % of the stretch is there when its time constant is over; its derivatives are exact."""
    rod = Actuator(outer_radius=0.02, kind="rod")
    model = make_model(rod, FitOptions(effects=("stretch:late",), segments=SEGMENTS))
    par = start_vector(model, rod, SEGMENTS)
    c, lag = (model.names.index(f"stretch.{name}") for name in "cT")
    par[c], par[lag] = 8e-7, 0.05
    both = np.where(np.arange(400) < 100, 0.0, 1e5)
    excitation = Excitation(0.0, 1e-3, 0.0 * both, chambers={"left": (1.0, both), "right": (-1.0, both)})
    frames, free = np.array([0.05, 0.1495, 0.38]), [c, lag]
    still = model.simulate(par, excitation, frames, free)

    def seen(values):
        motion = replace(still, sensitivity=np.zeros_like(still.sensitivity))
        pressures = excitation.at(frames), *stretching(model, values, excitation, frames)
        return seen_by_camera(model, values, motion, np.ones(1), free, *pressures)

    points, slopes = seen(par)
    length = -points[:, 0, 1] / rod.length - 1
    np.testing.assert_allclose(length, 8e-7 * 2e5 * np.array([0.0, 1 - np.exp(-1), 1.0]), rtol=1e-2, atol=1e-12)
    for column, k in enumerate(free):
        step = 1e-5 * par[k] * np.eye(par.size)[k]
        difference = (seen(par + step)[0] - seen(par - step)[0]) / (2e-5 * par[k])
        np.testing.assert_allclose(slopes[..., column], difference, rtol=1e-4, atol=1e-6 * np.abs(difference).max())


def test_a_late_stretch_is_refused_where_time_steps():
    model = make_model(Actuator(), FitOptions(effects=("stretch:late",), segments=SEGMENTS))
    par = start_vector(model, Actuator(), SEGMENTS)
    with pytest.raises(InputError, match="late"):
        Stepper(model, par)
    with pytest.raises(InputError, match="late"):
        check_exportable(model)
