"""The experiment that is proposed: within what the rig has shown, to both sides of two chambers, none where no pressure is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Diagnosis
from rfea_vision.cli import model
from rfea_vision.critique.next_experiment import STEP_S, design_next, limits, profiles, shaped
from rfea_vision.fitting.problem import make_problem


def test_the_next_experiment_stays_within_what_the_rig_has_shown(campaign):
    problem = make_problem(*campaign())
    low, high, rate = limits(problem)
    seen = np.concatenate([o.excitation.pressure for o in problem.train])
    assert low >= 0 and high == seen.max()
    _within(low, high, rate)


def test_the_next_experiment_of_two_chambers_goes_to_both_sides(campaign):
    problem = make_problem(*campaign())
    turned = [
        replace(o, excitation=replace(o.excitation, pressure=-0.6 * o.excitation.pressure)) for o in problem.train
    ]
    low, high, rate = limits(replace(problem, train=(*problem.train, *turned)))
    assert low == pytest.approx(-0.6 * high, rel=0.01)
    _within(low, high, rate)
    names = profiles(low, high, rate, seed=3)
    there = {name: pressure for name, pressure in names.items() if name.endswith("to the other side")}
    assert all(pressure.max() < 1e-6 for pressure in there.values())
    assert names["triangles to one side and to the other"].min() < -0.5 * high
    one_sided = limits(replace(problem, train=tuple(turned)))
    assert one_sided[1] == 0.0 and all(p.max() <= 1e-6 for p in profiles(*one_sided, seed=3).values())


def _within(low, high, rate):
    for pressure in profiles(low, high, rate, seed=3).values():
        assert pressure.min() >= low - 1e-6 and pressure.max() <= high + 1e-6
        assert np.abs(np.diff(pressure)).max() <= rate * STEP_S * (1 + 1e-9)
        assert np.ptp(pressure) > 0.2 * min(high - low, max(high, -low))
        for amplitude, pace in ((0.5, 2.0), (1.0, 0.5), (0.7, 4.0)):
            other = shaped(pressure, amplitude, pace, rate)
            assert other.min() >= low - 1e-6 and np.ptp(other) <= amplitude * np.ptp(pressure) + 1e-6
            assert np.abs(np.diff(other)).max() <= rate * STEP_S * (1 + 1e-9)


def test_a_slower_run_is_played_to_its_end_and_its_length_is_told(monkeypatch):
    """'The same cycle twice, 2 times as slow' was cut after 8 s, in which there is one cycle."""
    cycles = profiles(0.0, 9e4, 1e6, seed=3)["the same cycle twice after a rest"]
    slow = shaped(cycles, 1.0, 0.5, 1e6)
    assert slow.size == 2 * cycles.size and slow[-1] == 0
    peaks = np.flatnonzero(np.diff(np.sign(np.diff(slow))) < 0)
    assert peaks.size == 2 and np.ptp(slow[slow.size // 2 :]) == pytest.approx(9e4, rel=0.01)
    still = SimpleNamespace(excitation=SimpleNamespace(pressure=np.linspace(0, 9e4, 500), step_s=1e-3), has_tip=True)
    longer = [SimpleNamespace(lag=0.0), SimpleNamespace(lag=1.0)]  # the farther apart, the longer the run
    monkeypatch.setattr(
        "rfea_vision.critique.next_experiment._seen", lambda fitted, like, pressure, unit: np.full((9, 4), fitted.lag * pressure.size)
    )
    planned, pressure = design_next(SimpleNamespace(train=[still], actuator=Actuator()), longer, ("maxwell", "coulomb"), 0, 0.1)  # type: ignore[arg-type]
    assert planned is not None and pressure is not None
    assert f"kPa, {pressure.log_time.values[-1] + STEP_S:.3g} s)" in planned.sentence


def test_no_pressure_is_proposed_for_a_rig_that_has_none():
    """Of rivals that ring-downs cannot tell apart: a run 'up to 0 kPa' would tell nothing."""
    still = SimpleNamespace(excitation=SimpleNamespace(pressure=np.zeros(500), step_s=1e-3))
    rival: Any = SimpleNamespace()
    assert design_next(SimpleNamespace(train=[still]), (rival, rival), ("maxwell", "base_rotation"), 0, 0.1) == (None, None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("floor", "decides"), [(0.5, True), (6.54, False)])
def test_a_run_that_would_not_decide_is_not_proposed(campaign, monkeypatch, tmp_path, capsys, floor, decides):
    """Tips 4.2 mm apart over a floor of 6.5 mm: a pressure to play was the next step all the same."""
    problem = make_problem(*campaign())
    monkeypatch.setattr("rfea_vision.critique.next_experiment._seen", lambda fitted, *_: np.full((100, 4), fitted))
    one, other, names = 0.0, 3.0, ("plane_tilt", "camera_scale")  # mm
    planned, pressure = design_next(problem, (one, other), names, 0, floor)  # type: ignore[arg-type]
    assert planned is not None and pressure is not None and planned.decides is decides
    assert ("No run within the pressures and slopes of this rig tells plane_tilt from camera_scale" in planned.sentence) != decides
    assert f"4.24 mm RMS apart, {'beside' if decides else 'less than'} a noise floor of {floor:.3g}" in planned.sentence
    model.print_diagnosis(Diagnosis(model="base", verdict="missing", next_experiment=planned), tmp_path, tmp_path)
    said = capsys.readouterr().out
    assert ("Pressure to play" in said) == ("next experiment:" in said) == decides and "RMS apart" in said.replace("\n", " ")
