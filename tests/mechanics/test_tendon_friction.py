"""Friction of a tendon along its guides, beside its closed form: what a slow pull leaves out and back."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.artefacts.measurement import TENDON_AREA, TENSION_kPa
from rfea_vision.critique.screening import offered
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.catalogue import find_effects

ARM = Actuator(
    kind="rod", outer_radius=0.005, inner_radius=(TENDON_AREA / np.pi) ** 0.5, length=0.18, tendon=0.009, mass_per_length=0.01
)
K, MU, COUNT = 0.2, 0.4, 4
TIME_S = np.arange(0.0, 8.0, 0.02)


def _pulled(tension_N, mu=MU):
    """The joints' angles (times, joints) of an arm without weight under a tension (N) over 8 s."""
    model = Model(Chain.tube(ARM, COUNT), find_effects(["tendon_friction"]), gravity=0.0)
    par = np.array([K, 0.0, 2e-3, 0.0, 2e-3, 0.0, ARM.tendon, mu, 0.01])
    log_s = np.arange(0.0, 8.01, 1e-3)
    motion = model.simulate(par, Excitation(0.0, 1e-3, 1e3 * TENSION_kPa * tension_N(log_s)), TIME_S)
    assert motion.ok
    return np.diff(motion.phi, axis=1, prepend=0.0)[:, -COUNT:]


def _slowly(log_s):
    return np.interp(log_s, [0.0, 4.0, 8.0], [0.0, 4.0, 0.0])


@pytest.mark.parametrize(("at_s", "way"), [(1.5, 1.0), (6.5, -1.0)])
def test_what_a_slow_pull_bends_is_less_on_the_way_out_and_more_on_the_way_back(at_s, way):
    """k theta = F r (1 -+ mu sigma n theta) at every joint, once it slides."""
    drive = 1.5 * ARM.tendon  # far enough from the turn that all of it slides
    sigma = (np.arange(COUNT) + 0.5) / COUNT
    expected = drive / (K + way * MU * sigma * COUNT * drive)
    found = _pulled(_slowly)[np.searchsorted(TIME_S, at_s)]
    assert found == pytest.approx(expected, rel=0.03)


def test_without_friction_the_way_back_is_the_way_out():
    there, back = (_pulled(_slowly, 0.0)[np.searchsorted(TIME_S, at_s)] for at_s in (3.0, 5.0))
    assert there == pytest.approx(3.0 * ARM.tendon / K, rel=0.02) and back == pytest.approx(there, rel=0.03)


@pytest.mark.parametrize("tendon", [None, 0.009])
def test_it_is_looked_for_where_a_tendon_pulls(tendon, monkeypatch):
    monkeypatch.setattr("rfea_vision.critique.screening.pushed", lambda items: True)
    run = SimpleNamespace(clock_sigma=0.0, excitation=SimpleNamespace(chambers={}))
    problem: Any = SimpleNamespace(actuator=Actuator(kind="rod", tendon=tendon), train=[run])
    fitted: Any = SimpleNamespace(
        model=SimpleNamespace(effects=()),
        coordinates=SimpleNamespace(names=(), inside=lambda y: np.zeros(0, dtype=bool)),
        solution=SimpleNamespace(y=np.zeros(0)),
    )
    assert ("tendon_friction" in {effect.id for effect in offered(problem, fitted, None, ())}) == (tendon is not None)
