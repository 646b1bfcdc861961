"""A law is read from a residual torque, written as an effect file, and is what was there."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rfea_vision.critique.propose import effect_source, library, regress
from rfea_vision.dynamics.simulation import Excitation
from rfea_vision.effects.catalogue import load_effect_file
from rfea_vision.effects.permission import name_files


def _run(seed: int):
    """A run of made-up motion: joint angles and rates (frames, 8), pressure on a grid, and no torque yet."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 4, 0.02)
    angle = (
        (1 + np.sin(2 * np.pi * rng.uniform(0.3, 0.8) * time + rng.uniform(0, 6)))[:, None]
        * np.linspace(0.9, 1.1, 8)
        / 8
    )
    result = SimpleNamespace(theta=angle, rate=np.gradient(angle, time, axis=0))
    pressure = 1e5 * rng.uniform(0, 1, 20).repeat(20)
    item = SimpleNamespace(time=time, excitation=Excitation(0.0, 0.01, pressure))
    return result, item, 0.0


@pytest.mark.parametrize(
    "law", ["r * Abs(r)", "(a - z1)", "a**3 * s", "m * a", "p**2", "t * a * exp(-((s - 0.5) / 0.1)**2)"]
)
def test_the_law_that_made_a_torque_is_proposed_and_its_file_is_an_effect(tmp_path, law):
    runs = [_run(seed) for seed in (1, 2, 3)]
    terms = library(runs)
    rng = np.random.default_rng(0)
    truth = next(term for term in terms if term.law == law)
    size = 2e-4 / np.std(np.concatenate(truth.values))
    base = [tuple(result.theta for result, *_ in runs), tuple(result.rate for result, *_ in runs)]
    torque = [
        size * values + 3e-3 * result.theta + 1e-5 * rng.standard_normal(values.shape)
        for values, (result, *_) in zip(truth.values, runs, strict=True)
    ]
    best = regress(terms, base, torque)[0]
    assert [term.law for term in best.terms] == [law]
    assert best.coefficients[0] == pytest.approx(size, rel=0.05) and best.r2 > 0.9
    file = tmp_path / "own.py"
    file.write_text(effect_source("own", best.terms, best.coefficients), encoding="utf-8")
    name_files([file])
    (effect,) = load_effect_file(file)  # which checks symbols, units and derivatives
    assert effect.id == "own" and effect.parameters["c1"].start == pytest.approx(best.coefficients[0], rel=1e-5)


def test_no_law_is_proposed_for_noise():
    runs = [_run(seed) for seed in (1, 2)]
    rng = np.random.default_rng(1)
    base = [tuple(result.theta for result, *_ in runs)]
    assert regress(library(runs), base, [1e-4 * rng.standard_normal(r.theta.shape) for r, *_ in runs]) == []
