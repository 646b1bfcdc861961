"""A fixed small part of the benchmark: campaigns of the twin whose hidden effect is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rfea_vision import open_campaign
from rfea_vision.artefacts import Ladder, Recording
from rfea_vision.critique import improve, power_study
from rfea_vision.critique.diagnosis import Judgement, judge
from rfea_vision.fitting import fit_model
from rfea_vision.fitting.fit import BENT, fit
from rfea_vision.fitting.problem import make_problem
from rfea_vision.fitting.solver import farthest
from rfea_vision.options import CritiqueOptions, FitOptions
from rfea_vision.twin import TwinOptions, simulate

OPTIONS = FitOptions(segments=6, starts=0)
RIVALS = ("payload", "gravity_tilt", "maxwell", "stiffness_profile")


def judged(campaign: Any, candidates: tuple[str, ...] = RIVALS) -> Judgement:
    recordings, actuator = campaign
    problem = make_problem(recordings, actuator)
    return judge(problem, fit(problem, OPTIONS), candidates=candidates)


def climbed(campaign: Any, candidates: tuple[str, ...] = RIVALS, **options: Any) -> tuple[Ladder, list[Any]]:
    rungs: list[Any] = []
    recordings, actuator = campaign
    ladder = improve(
        recordings,
        actuator,
        OPTIONS,
        candidates=candidates,
        on_rung=lambda m, p, c, d, _: rungs.append((m, p, c, d)),
        **options,
    )
    return ladder, rungs


def test_nothing_hidden_is_complete(campaign):
    ladder, rungs = climbed(campaign())
    assert [rung.verdict for rung in ladder.rungs] == ["complete"]
    diagnosis = rungs[0][3]
    assert diagnosis.named == [] and diagnosis.tied == []


@pytest.mark.parametrize("bends", ["left", pytest.param("right", marks=pytest.mark.study)])
def test_a_tilt_is_named_with_its_sign_and_added(campaign, bends):
    found = campaign((("gravity_tilt.angle", -0.08),), bends=bends)
    ladder, rungs = climbed(found)
    assert rungs[0][3].named == ["gravity_tilt"]
    assert [rung.added for rung in ladder.rungs] == [None, "gravity_tilt"]
    assert ladder.rungs[-1].verdict == "complete"
    assert rungs[-1][0].parameters["gravity_tilt.angle"].value == pytest.approx(-0.08, rel=0.1)
    before, after = (rung.validate_tip_rmse_mm / ladder.noise_floor_mm for rung in ladder.rungs)
    assert before > 2 and after < 1.2


def test_what_looks_alike_is_tied_and_an_experiment_proposed(campaign):
    judgement = judged(
        campaign((("rest_curvature.angle", 0.06),)), ("rest_curvature", "pressure_offset", "payload", "maxwell")
    )
    diagnosis = judgement.diagnosis
    assert diagnosis.verdict == "missing"
    assert set(diagnosis.tied[0].effects) == {"rest_curvature", "pressure_offset"}
    assert diagnosis.named[0] in diagnosis.tied[0].effects
    assert diagnosis.sentence.endswith(f"What would: {diagnosis.tied[0].split_by}.")  # "... hysteresis does not would." was said
    assert diagnosis.next_experiment is not None and judgement.next_pressure is not None
    assert set(diagnosis.next_experiment.separates) == {"rest_curvature", "pressure_offset"}
    assert "RMS apart, less than a noise floor of 0.0" in diagnosis.next_experiment.sentence


@pytest.mark.study
def test_a_load_beside_the_centre_line_is_named_with_its_place(campaign):
    """On the centre line, where the usual form holds it, it bends the tube at rest otherwise."""
    hidden = (("payload.m", 2e-3), ("payload.offset", -1.0))
    diagnosis = judged(campaign(hidden), ("payload", "fluid_inertia", "com_offset", "maxwell")).diagnosis
    assert diagnosis.named == ["payload"]
    row = next(row for row in diagnosis.candidates if row.effect == "payload")
    assert row.form == "beside" and row.share > 0.99
    assert row.values["payload.m"] == pytest.approx(2e-3, rel=0.1)
    assert row.values["payload.a"] == pytest.approx(-1.0, abs=0.2)


def test_what_no_effect_explains_is_called_unexplained(campaign):
    diagnosis = judged(campaign((("fan.F", 0.1),))).diagnosis
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.named == []


def test_two_effects_are_found_together(campaign):
    found = campaign((("gravity_tilt.angle", -0.06), ("stiffness_profile.a1", 0.06)))
    ladder, _ = climbed(found)
    assert {rung.added for rung in ladder.rungs[1:]} == {"gravity_tilt", "stiffness_profile"}


def test_choosing_does_not_look_at_test_runs(campaign):
    """A test run full of nonsense changes nothing but its own score."""
    recordings, actuator = campaign((("gravity_tilt.angle", -0.08),), roles="train validate test")
    name = next(n for n, r in recordings.items() if r.role == "test")
    spoilt = recordings[name].dataset.copy(deep=True)
    for key in ("midline", "tip"):
        spoilt[key] = spoilt[key] + np.linspace(0, 40, spoilt.sizes["time"]).reshape(-1, *[1] * (spoilt[key].ndim - 1))
    clean, rungs = climbed((recordings, actuator), ("gravity_tilt", "payload"))
    dirty, others = climbed(({**recordings, name: Recording(spoilt)}, actuator), ("gravity_tilt", "payload"))
    assert clean.rungs == dirty.rungs
    assert [r[3].candidates for r in rungs] == [r[3].candidates for r in others]
    assert name not in rungs[0][1] and "test" not in rungs[-1][0].metrics
    assert dirty.test["tip_rmse_mm"] > 5 * clean.test["tip_rmse_mm"]


def test_a_budget_ends_a_climb_only_after_what_is_named_was_added(campaign):
    found = campaign((("gravity_tilt.angle", -0.08),))
    said: list[str] = []
    ladder, _ = climbed(found, ("gravity_tilt",), critique=CritiqueOptions(budget_s=0), say=said.append)
    assert said == [
        "The time budget of 0 s was used up after 1 rung: the climb goes on only for what is named (gravity_tilt), "
        "which no budget leaves out"
    ]
    assert any(text.startswith("The time budget of 0 s was used up after 1 rung: what was named") for text in ladder.findings)
    assert [rung.added for rung in ladder.rungs] == [None, "gravity_tilt"] and ladder.rungs[1].grade == "named"


@pytest.mark.study
def test_power_study_foretells_what_is_found(campaign):
    """Twice the least strength is named; a quarter of it is not called missing."""
    recordings, actuator = campaign()
    (row,) = power_study(fit_model(recordings, actuator, OPTIONS), recordings, candidates=("gravity_tilt",))
    assert row.amplitude is not None and 0.001 < row.amplitude < 0.1 and "gravity_tilt" in row.sentence
    strong = judged(campaign((("gravity_tilt.angle", 2 * row.amplitude),)), ("gravity_tilt",)).diagnosis
    weak = judged(campaign((("gravity_tilt.angle", 0.25 * row.amplitude),)), ("gravity_tilt",)).diagnosis
    assert (strong.verdict, weak.verdict) == ("missing", "complete")


@pytest.mark.study
def test_a_member_of_a_pair_that_has_a_twin_is_tied_with_it(campaign):
    """Rest curvature and the zero of the sensor are one torque: beside another effect no less than alone."""
    hidden = (("rest_curvature.angle", 0.03), ("stiffness_profile.a1", 0.12))
    diagnosis = judged(campaign(hidden), ("rest_curvature", "pressure_offset", "stiffness_profile")).diagnosis
    assert diagnosis.verdict == "missing" and "stiffness_profile" in diagnosis.named
    assert [set(tie.effects) for tie in diagnosis.tied] == [{"rest_curvature", "pressure_offset"}]


@pytest.mark.study
def test_a_rest_curvature_that_varies_is_found_behind_its_twin(campaign):
    """The zero of the sensor fits alone as well as the rest curvature; its profile is found from either."""
    hidden = (("rest_curvature.angle", 0.2), ("rest_curvature_profile.a1", 0.3))
    offered = ("rest_curvature", "rest_curvature_profile", "pressure_offset", "gravity_tilt")
    diagnosis = judged(campaign(hidden), offered).diagnosis
    assert "rest_curvature_profile" in diagnosis.named and len(diagnosis.named) == 2
    assert [set(tie.effects) for tie in diagnosis.tied] == [{"rest_curvature", "pressure_offset"}]


@pytest.mark.study
def test_a_tube_that_widens_is_told_though_the_base_model_is_bent_out_of_shape(tmp_path):
    """The base model absorbs it in values from which neither a linear step nor a refit finds back."""
    options = TwinOptions(
        hidden={"radial_expansion.c": 7e-8}, seed=1273, roles=("train", "train", "validate"), duration_s=6.0, rate_Hz=60.0,
        joints=16, sync="common_clock", noise_mm=0.1, write_truth=False,
    )  # fmt: skip
    simulate(tmp_path / "tube", options)
    problem = make_problem(dict(open_campaign(tmp_path / "tube").sync()), options.actuator)
    bent = {"k_ref": 0.195, "k_slope": -1441.0, "b_pos_ref": 2.8e-3, "b_pos_slope": -30.0, "r_hyd": 4.59e-3}
    fitted = fit(problem, FitOptions(segments=8, start=bent))
    assert farthest(problem.train, fitted.solution, options.actuator.length) > BENT
    found = judge(problem, fitted, candidates=("radial_expansion", "pressure_stiffening"))
    assert found.diagnosis.named == ["radial_expansion"] and found.verdict.share > 0.99
    assert found.verdict.best.fitted.values["radial_expansion.c"] == pytest.approx(7e-8, rel=0.05)
