"""One parameter per joint: nested, placed where it says, exact, and able to leave as C."""

import numpy as np
import pytest

from rfea_vision.dynamics.segments import per_segment
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.errors import InputError
from rfea_vision.export import c_files

KINDS = ("stiffness", "damping", "rest_angle")


def _tube(actuator, what, n, joints="middle"):
    return Model(Chain.tube(actuator, n, joints), (per_segment(what, n),), tolerance=1e-13)


@pytest.mark.parametrize("what", KINDS)
@pytest.mark.parametrize("joints", ["middle", "start"])
def test_exact_and_nested(what, joints, actuator, published, excitation, frames):
    model = _tube(actuator, what, 8, joints)
    frames = frames[:72]
    base = Model(model.chain, tolerance=1e-13).simulate(published, excitation, frames)
    par = np.append(published, np.zeros(8))
    absent = model.simulate(par, excitation, frames, range(7, 15))
    assert np.abs(absent.phi - base.phi).max() < 1e-9
    for column in (0, 3, 7):
        ends = []
        for sign in (1, -1):
            moved = par.copy()
            moved[7 + column] += sign * 1e-5
            ends.append(model.simulate(moved, excitation, frames).phi)
        difference = (ends[0] - ends[1]) / 2e-5
        exact = absent.sensitivity[..., column]
        assert np.abs(difference).max() > 1e-5
        assert np.abs(exact - difference).max() < 1e-4 * np.abs(difference).max()


@pytest.mark.parametrize("joints", ["middle", "start"])
@pytest.mark.parametrize("n", [1, 12])
def test_each_parameter_is_of_its_joint(n, joints, actuator, published):
    model = Model(Chain.tube(actuator, n, joints), (per_segment("rest_angle", n),), gravity=0.0)
    par = published.copy()
    par[:6] *= n / 8
    wanted = np.linspace(0.01, 0.02, n)
    rest = model.steady(np.append(par, wanted), 0.0)
    assert np.diff(rest.phi) == pytest.approx(wanted, abs=1e-12)


def test_the_same_share_everywhere_is_a_stiffer_tube(actuator, published):
    stiffer = published.copy()
    stiffer[:2] *= 1.2
    model = _tube(actuator, "stiffness", 8)
    one = model.steady(np.append(published, np.full(8, 0.2)), 150e3).phi
    assert one == pytest.approx(Model(model.chain).steady(stiffer, 150e3).phi, abs=1e-11)


def test_segments_leave_as_c_and_wrong_kinds_are_refused(actuator, published):
    model = _tube(actuator, "stiffness", 4)
    _, source = c_files(model, np.append(published, [0.1, 0.2, 0.3, 0.4]), "tube", 1e-3)
    assert "segment_stiffness.s4" in source
    with pytest.raises(InputError, match="use stiffness, damping, rest_angle"):
        per_segment("length", 4)
