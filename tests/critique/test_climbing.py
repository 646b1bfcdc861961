"""The ladder as people climb it: interrupted and resumed, with a lower bar for a name, with an inclinometer alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rfea_vision.artefacts import Candidate, Diagnosis, ExperimentScore, Ladder, ModelFit, Recording
from rfea_vision.artefacts.judgement import WorstPlace
from rfea_vision.critique import diagnose, evidence, improve
from rfea_vision.critique import diagnosis as diagnosing
from rfea_vision.critique.diagnosis import judge
from rfea_vision.critique.findings import findings_of, finer_of, titles_of
from rfea_vision.critique.ladder import Step, _Climb, next_step, rest_of_set
from rfea_vision.critique.rule import RULE
from rfea_vision.critique.screening import available
from rfea_vision.critique.verdict import decide, split_by
from rfea_vision.effects.base import BASE_PARAMETERS
from rfea_vision.effects.catalogue import find_effects
from rfea_vision.fitting import fit_model
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.problem import make_problem
from rfea_vision.options import FitOptions

OPTIONS = FitOptions(segments=6, starts=0)
TILT = (("gravity_tilt.angle", -0.08),)
RIVALS = ("payload", "gravity_tilt")


@pytest.mark.study
def test_an_interrupted_climb_goes_on_to_the_same_ladder(campaign, tmp_path):
    """To the last digit, wherever it was interrupted; its rungs are read back from their files."""
    recordings, actuator = campaign((*TILT, ("maxwell.k1", 0.05), ("maxwell.T", 0.4)))

    def climb(finished: Any = ()) -> tuple[Ladder, list[tuple[ModelFit, Diagnosis]]]:
        made: list[tuple[ModelFit, Diagnosis]] = []
        ladder = improve(
            recordings, actuator, OPTIONS, candidates=(*RIVALS, "maxwell"), finished=finished,
            on_rung=lambda model, _p, _c, diagnosis, _n: made.append((model, diagnosis)),
        )  # fmt: skip
        return ladder, made

    ladder, whole = climb()
    assert len(whole) == 3, "two effects are hidden"
    assert whole[0][0].steady_state and all(model.steady_state == whole[0][0].steady_state for model, _ in whole)
    for model, diagnosis in whole:
        model.save(tmp_path / f"{model.name}.json")
        diagnosis.save(tmp_path / f"{model.name}-diagnosis.json")
    kept = [
        (ModelFit.load(tmp_path / f"{m.name}.json"), Diagnosis.load(tmp_path / f"{m.name}-diagnosis.json"))
        for m, _ in whole
    ]
    for done in (1, 2, 3):
        resumed, made = climb(kept[:done])
        assert [model.name for model, _ in made] == [model.name for model, _ in whole[done:]], "nothing is done again"
        assert resumed.model_dump() == ladder.model_dump()
        for (model, diagnosis), (same_model, same_diagnosis) in zip(whole[done:], made, strict=True):
            assert same_diagnosis.model_dump() == diagnosis.model_dump()
            assert same_model.model_dump(exclude={"timings"}) == model.model_dump(exclude={"timings"})


def test_a_part_is_named_with_its_share_and_what_is_left_is_said(campaign):
    recordings, actuator = campaign((("fan.F", 0.004), *TILT))
    diagnosis, _ = diagnose(fit_model(recordings, actuator, OPTIONS), recordings, candidates=RIVALS)
    assert diagnosis.verdict == "missing" and diagnosis.named == ["gravity_tilt"] and diagnosis.sufficient is False
    row = next(c for c in diagnosis.candidates if c.effect == "gravity_tilt")
    assert row.probability > 0.5 and 0.6 < row.share < 0.999
    assert diagnosis.remainder.share == pytest.approx(1 - row.share) and "left" in diagnosis.remainder.sentence
    assert sum(s.probability for s in diagnosis.sets) == pytest.approx(1 - RULE.outside, abs=0.01)


def test_a_ladder_says_where_its_model_is_worse_than_a_tube_that_never_moves(monkeypatch):
    """Its verdict is about a model that tells nothing of the runs; only the fit had said so."""
    model = ModelFit(
        name="base", segments=2, parameters={}, metrics={},
        experiments={name: ExperimentScore(role="train", normalised_fit_percent=fit) for name, fit in (("a", -5.0), ("b", 60.0))},
    )  # fmt: skip
    monkeypatch.setattr("rfea_vision.critique.ladder.in_its_steps", lambda problem, model: problem)
    monkeypatch.setattr("rfea_vision.critique.ladder.refit_artefact", lambda model, problem: None)
    climb = _Climb(SimpleNamespace(), (), model)  # type: ignore[arg-type]
    place = {"experiment": "a", "from_s": 0.8, "to_s": 1.3, "from_sigma": 0.34, "to_sigma": 0.47, "rmse_mm": 1.0, "phase": "hold"}
    where = [WorstPlace(**place, sentence="a: from 34 to 47 % of the tube's length.")]
    climb.note(Diagnosis(model="base", verdict="unexplained", sentence="so", noise_floor_deg=22.9, where=where))
    said = findings_of(climb.rungs, [], "", None, climb.floor, "deg", "so", climb.doubts)
    assert said[0] == "The noise floor is 22.9 deg: an error below it says nothing about the model."
    assert said[1] == "Where it shows: a: from 34 to 47 % of the tube's length."
    climb.note(Diagnosis(model="base", verdict="unexplained", sentence="so", noise_floor_deg=22.9))
    assert climb.doubts[0] == "Where it showed before anything was added: a: from 34 to 47 % of the tube's length."
    assert said[2].startswith("a: the model is farther from the track than a tube that never moves") and len(said) == 4


def test_what_was_dropped_again_is_not_told_as_added():
    """A rung may take the place of an effect that an earlier one had added; a finer chain is no missing effect."""
    added = (None, "pressure_offset", "maxwell", "segments", "segments")
    rungs: list[Any] = [
        SimpleNamespace(added=name, tied=["drag"] * (name == "segments"), outcome="complete", grade="named") for name in added
    ]
    first: Any = SimpleNamespace(options=SimpleNamespace(segments=8))
    last: Any = SimpleNamespace(
        options=SimpleNamespace(effects=("maxwell:logarithmic",), segments=32),
        model=SimpleNamespace(effects=find_effects(["maxwell"])),
    )
    assert [title.split("(")[-1] for title in titles_of(last, rungs)] == ["maxwell)"]
    for rung in rungs:
        rung.validate_tip_rmse_mm = None
    said = findings_of(rungs, titles_of(last, rungs), finer_of(first, last, rungs), None, None, "mm", "so")
    assert said[0].count("segments") == 0 and said[1] == (
        "The chain was made finer: 32 segments in place of 8; these data cannot tell what that does from drag."
    )
    assert finer_of(first, first, rungs) == ""
    assert said[2].startswith("No run was held out: the tip error was weighed on the runs that were fitted.")


@pytest.mark.parametrize(
    ("verdict", "grade", "begins"),
    [
        ("complete", "named", "Missing from the paper's model, and added in this order: "),
        ("complete", "stand-in", "Added in this order: "),
        ("uncertain", "named", "Added, and too uncertain to say whether more is missing: "),
        ("missing", "named", "Added so far, and not yet enough: "),
        ("unexplained", "stand-in", "Added so far, and not yet enough: "),
    ],
)
def test_what_was_added_is_called_missing_only_where_it_is_named_and_the_last_verdict_is_complete(verdict, grade, begins):
    """As after an effect of one's own, which stands beside two of the catalogue."""
    grades = {None: None, "soft_ring": "named", "maxwell": "named", "coulomb": grade}
    rungs: list[Any] = [
        SimpleNamespace(added=name, tied=[], outcome=verdict, grade=one, validate_tip_rmse_mm=None) for name, one in grades.items()
    ]
    own: Any = SimpleNamespace(id="soft_ring", title="A soft ring")
    effects = ("soft_ring", "maxwell", "coulomb:sharp")
    last: Any = SimpleNamespace(
        options=SimpleNamespace(effects=effects), model=SimpleNamespace(effects=[own, *find_effects(["maxwell", "coulomb"])])
    )
    said = findings_of(rungs, titles_of(last, rungs), "", None, None, "mm", "so")[0]
    assert said.startswith(begins + "A soft ring (soft_ring); ") and said.count("stand-in") == (grade == "stand-in")


def test_an_effect_that_names_no_experiment_ends_no_sentence_in_nothing():
    search: Any = SimpleNamespace(effects=[SimpleNamespace(id="own", split_by="")])
    assert split_by(search, "own") == "another run"


def test_a_stand_in_is_taken_only_where_one_is_asked_for_and_called_so():
    helps = Candidate(effect="drag", probability=0.2, share=0.4, matters=True, refitted=True)
    more = Candidate(effect="coulomb", form="sharp", probability=0.3, share=0.6, matters=True, refitted=True)
    nothing = Diagnosis(
        model="base", verdict="unexplained", sentence="so", candidates=[helps, more], sufficient=False,
        stand_ins=["coulomb", "drag"],
    )  # fmt: skip
    assert next_step(nothing, (), stand_ins=False) == Step(why="the verdict is unexplained: so")
    assert next_step(nothing, (), stand_ins=True) == Step("coulomb:sharp", "stand-in", 0.3)
    assert next_step(nothing, ("coulomb",), stand_ins=True).added == "drag"
    assert next_step(nothing, (), stand_ins=True, begun=["drag"]).added == "drag"
    named = nothing.model_copy(update={"named": ["drag"], "verdict": "missing"})
    assert next_step(named, (), stand_ins=True) == Step("drag", "named", 0.2)
    assert next_step(named, ("drag",), stand_ins=False).added is None
    first = next_step(nothing, (), stand_ins=True)
    assert rest_of_set((), nothing, first) == ["drag"]
    assert rest_of_set(["drag"], named, next_step(named, (), stand_ins=True)) == []  # named meanwhile: not added again
    assert rest_of_set((), named, next_step(named, (), stand_ins=True)) == []


def test_an_inclinometer_is_judged_in_degrees(campaign):
    recordings, actuator = campaign(TILT)
    inclined = {name: Recording(_angle_alone(r)) for name, r in recordings.items()}
    rungs: list[Any] = []
    ladder = improve(inclined, actuator, OPTIONS, candidates=RIVALS, on_rung=lambda m, p, c, d, _: rungs.append(d))
    assert rungs[0].noise_floor_mm is None and rungs[0].noise_floor_deg > 0
    for candidate in rungs[0].candidates:
        assert candidate.train_rmse_mm is None and candidate.predicted_rmse_deg is not None
    assert all(rung.train_tip_rmse_mm is None and rung.train_angle_rmse_deg > 0 for rung in ladder.rungs)
    assert " deg" in rungs[0].sentence and " mm" not in rungs[0].sentence


def _angle_alone(recording: Recording) -> Any:
    data = recording.dataset
    keep = [n for n in ("pressure", "bend_angle", "bend_angle_sigma", "valid", "reason") if n in data]
    out = data[keep].copy()
    rng = np.random.default_rng(3)
    out["bend_angle"] = out["bend_angle"] + 0.1 * rng.standard_normal(out["bend_angle"].shape)
    return out


def test_a_rung_tells_what_is_gone_with_its_own_fit(campaign):
    """Not what the search below had foretold: of a leg 100 % was told where three quarters were gone."""
    recordings, actuator = campaign(TILT)
    ladder = improve(recordings, actuator, OPTIONS, candidates=RIVALS)
    below, rung = ladder.rungs[:2]
    floor = ladder.noise_floor_mm
    assert below.share is None and floor is not None
    gone = 1 - (rung.validate_tip_rmse_mm**2 - floor**2) / (below.validate_tip_rmse_mm**2 - floor**2)
    assert rung.share == pytest.approx(gone, abs=0.05)  # of the tip alone; the share counts the line, too


def test_a_second_branch_is_a_candidate_only_beside_the_first():
    effects = find_effects(["maxwell", "maxwell_2", "payload"])
    assert {e.id for e in available(effects, set())} == {"maxwell", "payload"}
    assert {e.id for e in available(effects, {"maxwell"})} == {"maxwell_2", "payload"}


def test_two_branches_are_the_sum_of_two(campaign):
    recordings, actuator = campaign()
    options = replace(OPTIONS, effects=("maxwell", "maxwell_2"))
    names = {"maxwell.k1": 0.05, "maxwell.T": 0.3, "maxwell_2.k1": 0.04, "maxwell_2.T": 2.0}
    model = fit_model(recordings, actuator, replace(options, fixed=names))
    assert {n: model.parameters[n].value for n in names} == pytest.approx(names)


def test_a_chain_that_is_too_coarse_is_made_finer(campaign):
    recordings, actuator = campaign()
    coarse = replace(OPTIONS, segments=1)
    model = fit_model(recordings, actuator, coarse)
    diagnosis, _ = diagnose(model, recordings)
    finer = next(c for c in diagnosis.candidates if c.effect == "segments")
    assert finer.refitted and finer.matters and finer.score_p is None and finer.parameters == {}
    assert finer.validate_rmse_mm < 0.85 * model.metrics["validate"].tip_rmse_mm
    assert diagnosis.named[:1] == ["segments"]
    fine, _ = diagnose(fit_model(recordings, actuator, replace(OPTIONS, segments=12)), recordings)
    assert "segments" not in {c.effect for c in fine.candidates}


def test_a_lever_that_was_held_by_rule_is_not_made_up_for_by_an_effect(campaign, monkeypatch):
    """What a misfit blurs (k / r_hyd alone is told) the better model tells: the lever is free again while effects are weighed.

    What had moved is told beside the values of the fit: 0.01218 had stood beside 0.01359 in the fit's table.
    """
    recordings, actuator = campaign()
    problem = make_problem(recordings, actuator)
    held = fit(problem, replace(OPTIONS, fixed={"r_hyd": 3.3e-3}))
    rivals = ("virtual_work", "pressure_gain")
    asked_for = judge(problem, held, candidates=rivals).diagnosis
    assert asked_for.named and asked_for.named[0] in rivals, "a person's value stands, and something makes up for it"
    seen: list[dict[str, float]] = []
    monkeypatch.setattr(diagnosing, "absorbed", lambda _problem, before, *_: seen.append(before.values) or [])
    monkeypatch.setattr(diagnosing, "decide", lambda *args: replace(decide(*args), named=("virtual_work",)))
    ruled = judge(problem, replace(held, ratio_only=True), candidates=rivals)
    assert ruled.diagnosis.verdict == "complete" and seen == [held.values]
    assert ruled.search.present.fitted.values["r_hyd"] > 3.5e-3, "of six bodies, towards the twin's 3.564 mm and beyond"


def test_what_a_base_parameter_had_absorbed_is_told_with_its_unit(monkeypatch):
    monkeypatch.setattr(evidence, "intervals", lambda *_: SimpleNamespace(covariance=1e-12 * np.eye(7)))
    par = np.array([0.2, 100.0, 0.002, 1.0, 0.002, 1.0, 0.0036])
    one: Any = SimpleNamespace(par=par, model=SimpleNamespace(names=BASE_PARAMETERS), options=SimpleNamespace(segments=8))
    one.ratio_only = False
    other: Any = SimpleNamespace(par=par * [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.1], options=one.options)
    problem: Any = SimpleNamespace(train=(), actuator=None)
    (said,) = evidence.absorbed(problem, one, other, ["maxwell"])
    assert said.startswith("r_hyd had moved to make up for maxwell: 0.0036 m before, 0.00396 with it (360 of")
    monkeypatch.setattr(evidence, "intervals", lambda *_: SimpleNamespace(covariance=np.diag([*np.full(6, 1e-12), 0.0])))
    one.ratio_only, other.par = True, np.append(par[:6] * [1.0, 1.0, 0.5, 1.0, 1.0, 1.0], par[6]) * 0.9  # its lever moved, too
    (said,) = evidence.absorbed(problem, one, other, ["coulomb"])
    assert "b_pos_ref had moved" in said and "0.002 N*m*s/rad before, 0.001 with it" in said and "at r_hyd = 3.60 mm" in said
