"""A valve that fills and drains at rates of its own: what one lag for both does not explain, one of each does."""

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.critique.diagnosis import judge
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.problem import make_problem
from rfea_vision.options import FitOptions
from testing.other_plant import OtherTube, centre_line, simulate
from testing.recordings import recording_of
from testing.valves import behind_a_valve

STEP_S, NOISE_MM = 2e-3, 0.06


def run(name: str, role: str, seed: int) -> Recording:
    """Steps of pressure at the sensor, and the line (frames, 5) of a tube of the second plant behind its valve."""
    rng = np.random.default_rng(seed)
    log_s = np.arange(0.0, 5.0, STEP_S)
    steps_s = np.cumsum(rng.uniform(0.3, 1.0, 12))
    pressure = np.interp(log_s, np.repeat(steps_s, 2)[1:] + np.tile([0.0, 0.1], 12)[1:], np.repeat(rng.uniform(0, 1.8e5, 12), 2)[:-1])
    pressure *= np.clip(log_s / 0.3, 0.0, 1.0)
    every = 8
    phi = simulate(OtherTube(1.0, 1.0, 1.0, {}), behind_a_valve(pressure, STEP_S, 0.02, 0.25), STEP_S, every)
    time_s = log_s[::every][: len(phi)]
    line = 1e3 * centre_line(phi, np.linspace(0.0, 1.0, 5))
    line[:, 1:] += NOISE_MM * rng.standard_normal(line[:, 1:].shape)
    return recording_of(name, role, time_s, line, phi[:, -1], log_s, pressure, noise_mm=NOISE_MM)


def test_a_valve_is_named_as_the_line_and_leaves_nothing():
    """One lag for both rates took next to nothing away, so that no form of it was ever tried, and nothing was named."""
    runs = {name: run(name, role, seed) for seed, (name, role) in enumerate({"a": "train", "b": "train", "c": "validate"}.items())}
    problem = make_problem(runs, Actuator())
    candidates = ("pressure_lag", "maxwell", "payload", "coulomb")
    judgement = judge(problem, fit(problem, FitOptions(segments=6, starts=0)), candidates=candidates)
    best = judgement.verdict.best
    assert judgement.diagnosis.named == ["pressure_lag"] and best.effects == {"pressure_lag:valve"}
    assert best.errors.held < 1.3 * judgement.search.floor < 0.2 * judgement.search.present.errors.held
    assert best.fitted.values["pressure_lag.T"] == pytest.approx(0.02, abs=0.01)
    assert best.fitted.values["pressure_lag.T_drain"] == pytest.approx(0.25, rel=0.1)
