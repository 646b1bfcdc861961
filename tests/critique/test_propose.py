"""A law is found in what a model leaves, written as an effect file, and is what was there."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from rfea_vision.critique import propose
from rfea_vision.critique.propose import regress
from rfea_vision.critique.terms import Trajectory, effect_source, library
from rfea_vision.effects.catalogue import load_effect_file
from rfea_vision.effects.permission import name_files
from rfea_vision.errors import DataError
from rfea_vision.fitting import fit_model
from rfea_vision.options import FitOptions


def _trajectory(seed: int) -> Trajectory:
    """A run of made-up motion of eight joints."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 4, 0.02)
    angle = (
        (1 + np.sin(2 * np.pi * rng.uniform(0.3, 0.8) * time + rng.uniform(0, 6)))[:, None]
        * np.linspace(0.9, 1.1, 8)
        / 8
    )
    return Trajectory(time, angle, np.gradient(angle, time, axis=0), 1e5 * rng.uniform(0, 1, 20).repeat(10))


def _parts(terms, trajectories, residual):
    """Normal equations of each run, of what angle and rate can make nothing."""
    basis, _ = np.linalg.qr(
        np.stack([np.concatenate([getattr(c, key).ravel() for c in trajectories]) for key in ("theta", "rate")], axis=1)
    )
    columns = [np.concatenate([values.ravel() for values in term.values]) for term in terms]
    wide = np.column_stack([*columns, np.concatenate([values.ravel() for values in residual])])
    wide -= basis @ (basis.T @ wide)
    return [part.T @ part for part in np.split(wide, len(trajectories))]


@pytest.mark.parametrize(
    "law", ["r * Abs(r)", "(a - z1)", "a**3 * s", "m * a", "p**2", "t * a * exp(-((s - 0.5) / 0.1)**2)", "h1"]
)
def test_the_law_that_made_a_torque_is_proposed_and_its_file_is_an_effect(tmp_path, law):
    trajectories = [_trajectory(seed) for seed in (1, 2, 3)]
    terms = library(trajectories)
    rng = np.random.default_rng(0)
    truth = next(term for term in terms if term.law == law)
    size = 2e-4 / np.std(np.concatenate(truth.values))
    residual = [
        size * values + 3e-3 * trajectory.theta + 1e-5 * rng.standard_normal(values.shape)
        for values, trajectory in zip(truth.values, trajectories, strict=True)
    ]
    best = regress(terms, _parts(terms, trajectories, residual))[0]
    assert [term.law for term in best.terms] == [law]
    assert best.coefficients[0] == pytest.approx(size, rel=0.05) and best.r2 > 0.9
    file = tmp_path / "own.py"
    file.write_text(effect_source("own", best.terms, best.coefficients), encoding="utf-8")
    name_files([file])
    (effect,) = load_effect_file(file)  # which checks symbols, units and derivatives
    assert effect.id == "own" and effect.parameters["c1"].start == pytest.approx(best.coefficients[0], rel=1e-5)


def test_no_law_is_proposed_for_noise():
    trajectories = [_trajectory(seed) for seed in (1, 2)]
    rng = np.random.default_rng(1)
    noise = [1e-4 * rng.standard_normal(trajectory.theta.shape) for trajectory in trajectories]
    terms = library(trajectories)
    assert regress(terms, _parts(terms, trajectories, noise)) == []


@pytest.mark.study
def test_a_soft_ring_is_found_in_the_motion_of_the_tube(campaign, tmp_path, monkeypatch):
    """The twin's kink: a tenth of the tube is softer by a half, at a third of its length."""
    file = tmp_path / "ring.py"
    file.write_text("# mine\n", encoding="utf-8")
    recordings, actuator = campaign((("kink.c", 0.5), ("kink.at", 0.35)))
    model = fit_model(recordings, actuator, FitOptions(segments=10, starts=0))
    with monkeypatch.context() as patch, pytest.raises(DataError, match="does not lower"):
        patch.setattr(sys.modules["rfea_vision.critique.propose"], "_refitted", lambda *_: None)
        propose(model, recordings, file)
    assert file.read_text(encoding="utf-8") == "# mine\n"  # no law helps: what stood there stays
    found = propose(model, recordings, file)
    assert any("exp(-((s - 0.35)" in law for law in found.terms)
    assert found.held_after < 0.5 * found.held_before and found.regression_r2 > 0.5
    (effect,) = load_effect_file(file)
    assert effect.parameters["c1"].start == pytest.approx(found.coefficients[0], rel=1e-5)
