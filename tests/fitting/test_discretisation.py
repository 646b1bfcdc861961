"""Intervals of a coarse chain against a tube that is anything but coarse."""

from __future__ import annotations

import numpy as np
import pytest

from rfea_vision.fitting.discretisation import drift
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.intervals import intervals
from rfea_vision.fitting.problem import make_problem
from rfea_vision.fitting.refit import refit_from
from rfea_vision.options import FitOptions

SEGMENTS = 6


@pytest.fixture(scope="module")
def coarse(complete_campaign):
    recordings, actuator, _ = complete_campaign
    problem = make_problem(recordings, actuator)
    return problem, fit(problem, FitOptions(segments=SEGMENTS))


@pytest.mark.study
def test_the_interval_of_a_coarse_chain_covers_the_tube(coarse, complete_campaign):
    """Six bodies for a tube of 48: noise alone explains none of the error in stiffness, the drift does."""
    problem, fitted = coarse
    actuator, truth = complete_campaign[1], complete_campaign[2]["base"]
    change = drift(problem, fitted, problem.train)
    noise_only = intervals(fitted, problem.train, actuator).parameters
    found = intervals(fitted, problem.train, actuator, change)
    missed = []
    for name, value in truth.items():
        true = value * (1 if name == "r_hyd" else SEGMENTS / 8)
        low, high = found.parameters[name].interval_95
        assert low <= true <= high, name
        low, high = noise_only[name].interval_95
        missed += [name] if not low <= true <= high else []
    assert "k_ref" in missed
    assert any("bodies that stand for the tube" in sentence for sentence in found.sentences)


def test_the_drift_is_what_a_finer_chain_finds(coarse):
    """To first order, and to the continuous tube: a third more than from 6 to 12 bodies."""
    problem, fitted = coarse
    change = drift(problem, fitted, problem.train)
    finer = refit_from(problem, fitted.options.with_segments(2 * SEGMENTS), fitted)
    seen = finer.par * np.where(np.arange(7) < 6, 0.5, 1.0) - fitted.par
    for k in (0, 6):  # k_ref, r_hyd
        assert change[k] == pytest.approx(4 / 3 * seen[k], rel=0.25)


def test_a_chain_taken_at_its_word_has_no_drift(coarse):
    """With joints at the start the number of bodies is part of the paper's model."""
    problem, _ = coarse
    fitted = fit(problem, FitOptions(segments=4, joints="start"))
    assert not np.any(drift(problem, fitted, problem.train))
