"""What matters, how likely it is, and what is claimed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from rfea_vision.artefacts import Candidate, Diagnosis, ExperimentScore, ModelFit
from rfea_vision.artefacts.judgement import TRACK_UNCERTAIN, outcome_of, verdict_in_words
from rfea_vision.artefacts.rows import LEFT_BY_A_MODEL
from rfea_vision.critique.diagnosis import none_to_rest_on
from rfea_vision.critique.evidence import to_rule_out
from rfea_vision.critique.floors import left_by_a_model
from rfea_vision.critique.measures import Errors, RunErrors, matters, share, structure
from rfea_vision.critique.rule import RULE
from rfea_vision.critique.search import Search, Weighed
from rfea_vision.critique.verdict import _asks_less, _complete, _likely, _unexplained, decide, remainder_of
from rfea_vision.effects.catalogue import find_effects
from rfea_vision.stages.products import rung_of
from testing.claims import brier, calibration_error, claims


def _errors(held: float, line: float | None = None) -> Errors:
    return Errors({"run": RunErrors("validate", 100, held**2, None if line is None else line**2)})


def test_an_effect_matters_by_ten_per_cent_and_a_fifth_of_the_floor():
    at = _errors
    assert matters(at(1.0), at(0.85), 0.1)
    assert not matters(at(1.0), at(0.92), 0.1)  # less than a tenth
    assert not matters(at(0.12), at(0.105), 0.1)  # less than a fifth of the floor
    assert matters(at(1.0, 1.0), at(0.99, 0.8), 0.1)  # seen along the tube only
    assert not matters(at(1.0, 1.0), at(1.2, 0.8), 0.1)  # at the expense of the tip
    assert structure(at(0.1), 0.1) == 0.0
    assert structure(at(np.hypot(0.1, 0.3)), 0.1) == pytest.approx(3.0)
    assert share(at(np.hypot(0.1, 1.0)), at(np.hypot(0.1, 0.5)), 0.1) == pytest.approx(0.75)


def test_no_error_on_training_runs_is_told_as_one_on_validation_runs():
    trained = Errors({"run": RunErrors("train", 100, 0.04, None)})
    assert (
        trained.held == pytest.approx(0.2) and trained.validate is None and _errors(0.3).validate == pytest.approx(0.3)
    )


def _weight(share, effects, correlated=100.0):
    roles = {"a": "train", "b": "validate"}
    left, whole = dict.fromkeys(roles, 1 - share), dict.fromkeys(roles, 1.0)
    return RULE.evidence(left, whole, roles, 0.02, RULE.count(correlated)) - RULE.price(effects, 33)


def test_one_rule_weighs_shares_and_not_samples():
    """A lone 91 % is likely, two equal halves share, a long record of a structured remainder makes nothing surer."""

    def odds(shares, correlated):
        return RULE.posterior([_weight(0.0, 0, correlated), *(_weight(share, 1, correlated) for share in shares)])

    assert odds([0.91, 0.5, 0.4], 100)[1] > 0.9
    halves = odds([0.5, 0.5], 100)
    assert halves[1] == pytest.approx(halves[2]) and halves[1] < 0.5
    assert odds([0.3], 1e6)[1] < 0.5 and odds([0.3], 1e6)[1] == pytest.approx(odds([0.3], 1e3)[1], abs=0.05)
    assert RULE.price(2, 33) == 2 * RULE.price(1, 33) > 0


def test_a_second_effect_is_not_called_in_for_the_faults_of_the_first_ones_form():
    """Half of the last 0.4 % of the squared error is what the form of a law may miss; most of the last tenth is an effect."""
    faint = [_weight(0.996, 1), _weight(0.998, 2)]
    strong = [_weight(0.9, 1), _weight(0.999, 2)]
    assert RULE.posterior(faint)[1] < 0.5 and RULE.posterior(strong)[1] > 0.9


def test_something_is_left_for_causes_outside_of_the_catalogue_and_for_what_nothing_speaks_for():
    """No evidence among the sets makes a name surer than the share of causes that no set has."""
    sure = RULE.posterior([100.0, 0.0, 0.0])
    assert sum(sure) == pytest.approx(1 - RULE.outside)
    assert RULE.told([(sure[0], False)]) < 1 - RULE.outside / 2
    assert RULE.told([(sure[1], False)]) == pytest.approx(RULE.unseen)


def test_what_a_known_cause_outside_imitates_is_never_sure():
    """A side wind is a tilted gravity: it keeps its share of the sets that hold the tilt, and none of those with its rival."""
    (sure,) = RULE.posterior([0.0])
    assert RULE.likely < RULE.told([(sure, True)]) < 0.9 < RULE.told([(sure, False)])
    assert RULE.told([(sure, True)]) == pytest.approx(RULE.unseen + (1 - RULE.unseen) * (1 - RULE.imitated))
    tied = RULE.told([(sure / 2, True), (sure / 2, False)])
    assert RULE.told([(sure / 2, True)] * 2) < tied < RULE.told([(sure, False)])


def test_two_that_share_a_claim_do_not_lose_it():
    """A with B (0.3) and A with C (0.25) do alike: A with one of them is likelier than A alone (0.4)."""
    sets = {("A",): (0.0, 0.4), ("A", "B"): (-0.3, 0.3), ("A", "C"): (-0.5, 0.25), ("D",): (-9.0, 1e-4)}
    weighed = [Weighed(None, added, *values, 0.5) for added, values in sets.items()]  # type: ignore[arg-type]
    search: Any = SimpleNamespace(without=lambda item, own: item, _alike=lambda *_: True)
    search.tied = lambda rows: Search.tied(search, rows)
    led = Search._led(search, weighed)
    assert [item.added for item in led] == [("A", "B"), ("A",), ("A", "C"), ("D",)]
    assert [row.added for row in search.tied(led)["B"]] == [("A", "C")]
    search._alike = lambda *_: False
    assert Search._led(search, weighed)[0].added == ("A",)


def test_a_rung_of_an_unfinished_ladder_tells_how_sure_its_effect_was():
    def model(*effects: str) -> ModelFit:
        name = "+".join(("base", *effects))
        return ModelFit(name=name, segments=6, effects=list(effects), parameters={}, metrics={}, experiments={})

    rows = [
        Candidate(effect="mullins", form="linear", probability=0.9, share=0.7),
        Candidate(effect="drag", probability=0.2, share=0.4),
    ]
    said = Diagnosis(model="base", verdict="missing", named=["mullins"], candidates=rows)
    rungs = [(rung_of(model(), said, []), said)]
    assert (rungs[0][0].added, rungs[0][0].grade, rungs[0][0].probability) == (None, None, None)
    expected = {
        ("mullins:linear",): ("mullins", "named", 0.9),
        ("mullins:linear", "drag"): ("drag", "stand-in", 0.2),
    }
    for effects, added in expected.items():
        rungs.append((rung_of(model(*effects), said, rungs), said))
        rung = rungs[-1][0]
        assert (rung.added, rung.grade, rung.probability) == added
        assert rung.share is None, "what was foretold is not what is gone"


def test_a_claim_is_counted_once_for_a_tie_and_a_hidden_law_that_was_never_tried_as_missed():
    line = {
        "plant": "other",
        "hidden": {"tilt": 0.1, "spectrum": 0.02, "spot": 0.3, "spot_at": 0.5},
        "right": ["gravity_tilt", "maxwell", "maxwell_2", "stiffness_profile"],
        "tied": [["gravity_tilt", "com_offset"]],
        "probability": {"gravity_tilt": 0.8, "com_offset": 0.8, "maxwell": 0.1, "maxwell_2": 0.6, "drag": 0.95},
    }
    found = claims(line)
    assert [(p, right) for _, p, right in found] == [(0.8, True), (0.6, True), (0.0, True), (0.95, False)]
    assert brier(found) == pytest.approx((0.04 + 0.16 + 1 + 0.9025) / 4)
    assert calibration_error(found) == pytest.approx((2 * 0.3 + 1 + 0.95) / 4)


def test_what_the_odds_do_not_decide_is_claimed_together(monkeypatch):
    """Three effects of one kind, each with a quarter of the odds, are no reason to say that nothing is likely."""
    search: Any = object.__new__(Search)
    search.effects = ()
    search.rule = RULE
    monkeypatch.setattr(Search, "matters", lambda *_: True)
    monkeypatch.setattr(Search, "without", lambda *_: None)  # so that none of them does alike
    shares = {
        ("hysteresis",): 0.3,
        ("mullins",): 0.22,
        ("maxwell",): 0.1,
        ("maxwell", "drag"): 0.15,
        (): 0.1,
        ("payload",): 0.01,
    }
    rows: list[Any] = [
        Weighed(SimpleNamespace(), own, float(np.log(share)), share, 0.0)  # type: ignore[arg-type]
        for own, share in sorted(shares.items(), key=lambda item: -item[1])
    ]
    assert _likely(search, rows, search.tied(rows)) == ({}, pytest.approx(search.probabilities(rows, {})), [])
    ties, probability, likely = _likely(search, rows, search.as_likely(rows))
    assert likely == ["hysteresis"] and [row.added for row in ties["hysteresis"]] == [("maxwell",), ("mullins",)]
    assert probability["hysteresis"] == probability["mullins"] == pytest.approx(RULE.told([(0.77, False)]))


def test_where_many_do_alike_all_of_them_are_claimed_together(monkeypatch):
    """Eight laws with a tenth of the odds each are likely together, though no three of them are."""
    search: Any = object.__new__(Search)
    search.rule = RULE
    search.floors = SimpleNamespace(unit="deg", calibration=0.0)
    search.floor, search.present = 0.1, SimpleNamespace()
    ids = ["maxwell", "time_offset", "pressure_offset", "pressure_lag", "rest_curvature", "damping_direction", "drag"]
    search.effects = find_effects(ids)
    monkeypatch.setattr(Search, "matters", lambda *_: True)
    monkeypatch.setattr(Search, "without", lambda *_: None)
    monkeypatch.setattr(Search, "structure", lambda *_: 2.0)
    monkeypatch.setattr("rfea_vision.critique.verdict._missing", lambda *_: "so")
    monkeypatch.setattr("rfea_vision.critique.verdict.stand_ins_of", lambda *_: ())

    def verdict(each: float) -> Any:
        shares = [each - 0.001 * place for place in range(len(ids))]
        rows: list[Any] = [
            Weighed(SimpleNamespace(), (own,), float(np.log(share)), share, 0.7)  # type: ignore[arg-type]
            for own, share in zip(ids, shares, strict=True)
        ]
        return decide(search, rows)

    monkeypatch.setattr("rfea_vision.critique.verdict._matters_at_all", lambda *_: True)
    monkeypatch.setattr("rfea_vision.critique.verdict._unexplained", lambda *_: "not so")
    found = verdict(0.1)
    assert (found.verdict, found.named) == ("missing", ("maxwell",))
    assert set(found.tied[0].effects) == set(ids)
    assert found.probability["drag"] == pytest.approx(found.probability["maxwell"], abs=1e-9)
    assert verdict(0.05).verdict == "unexplained"  # a third together


def test_a_named_fault_of_the_measurement_says_what_to_rule_out():
    """Logs in psi called kPa in every run: the scale of the sensor was named, and not the key to look at."""
    names = ["coulomb", "pressure_gain"]
    (said,) = to_rule_out(find_effects(names), names, {"pressure_gain.g": 6.8948, "coulomb.w": 0.1})
    assert said.startswith("pressure_gain (g = 6.89) is easily mistaken for") and "a wrong pressure.unit" in said


def test_the_nearest_of_an_unexplained_model_is_one_that_helps():
    rows: list[Any] = [
        Weighed(SimpleNamespace(), (name,), 0.0, 0.1, share)  # type: ignore[arg-type]
        for name, share in (("drag", -0.3), ("payload", 0.2))
    ]
    search: Any = object.__new__(Search)
    search.floors, search.floor, search.present = SimpleNamespace(unit="mm"), 0.1, SimpleNamespace(errors=_errors(1.0))
    search.rule = RULE
    found: Any = SimpleNamespace(weighed=rows, probability={"drag": 0.03, "payload": 0.1})
    said = _unexplained(search, found)
    assert "that takes a probability of 50 %" in said
    assert "payload (probability 10 %), removes 20 % of the squared error above the floor." in said and "drag" not in said
    found.weighed = rows[:1]
    assert "nearest" not in _unexplained(search, found)
    search.present = SimpleNamespace(errors=_errors(0.09, 0.5))  # at the floor at the tip: what is left is seen along the tube only
    assert "Structure of 0.490 mm is left along the tube" in _unexplained(search, found)


def test_the_torque_that_a_model_lacks_is_not_told_of_what_a_better_one_leaves():
    """What is left once an effect is added was laid to the rate of the joint, which that effect had just taken away."""
    present, better = SimpleNamespace(errors=_errors(2.4)), SimpleNamespace(errors=_errors(0.14))
    search: Any = SimpleNamespace(
        floors=SimpleNamespace(unit="mm"), floor=0.07, present=present, held=2.4,
        trials=SimpleNamespace(problem=SimpleNamespace(validate=["run"])),
    )  # fmt: skip
    rate: Any = [{"what": "the joint's rate", "r2": 0.28}]
    named: Any = SimpleNamespace(best=better, share=0.997, sufficient=False)
    left = remainder_of(search, named, rate)
    assert left.goes_with == [] and "the joint's rate" not in left.sentence
    assert left.sentence.startswith("Less than 1 % of the squared error above the floor is left: about 0.14 mm")
    nothing: Any = SimpleNamespace(best=present, share=0.0, sufficient=False)
    left = remainder_of(search, nothing, rate)
    assert left.goes_with == rate and "28 % of its torque goes with the joint's rate" in left.sentence
    assert left.sentence.startswith("What is left is 2.40 mm on held-out runs, where the floor is 0.0700 mm.")


@pytest.mark.parametrize(
    ("error", "floor", "verdict"),
    [(17.3, 16.1, "uncertain"), (20.0, 16.1, "uncertain"), (40.0, 16.1, "unexplained"), (6.6, 6.5, "complete"), (0.1, 0.1, "complete")],
)
def test_a_model_is_complete_only_where_what_matters_could_be_seen(monkeypatch, error, floor, verdict):
    """A leg's tip moved by 33 mm over a floor of 16: nothing that matters was missing, at an error of a fifth of its length."""
    tip = 33.0 * np.array([[1.0, 0.0], [-1.0, 0.0]])
    still = SimpleNamespace(name="hold", has_tip=True, tip_or_angle=0 * tip, repeat_of=None)
    run = SimpleNamespace(name="steps", has_tip=True, tip_or_angle=tip, repeat_of=None)
    search: Any = object.__new__(Search)
    search.rule, search.effects, search.floors, search.floor = RULE, (), SimpleNamespace(unit="mm", calibration=0.0), floor
    search.present, search.scored = SimpleNamespace(errors=_errors(error)), None
    search.trials = SimpleNamespace(problem=SimpleNamespace(train=[run], validate=[still]))
    nothing: Any = Weighed(search.present, (), 0.0, 0.97, 0.0)
    search.floors.source, search.floors.irreproducible, search.floors.measurement = "", None, floor
    search.trials.problem.scored = [run, still]
    found = decide(search, [nothing])
    assert outcome_of(found.verdict, bool(found.uncertain_because)) == verdict
    assert found.verdict in get_args(Diagnosis.model_fields["verdict"].annotation)
    if verdict == "uncertain":
        said = "The track is too uncertain: whether something is missing cannot be said"
        assert found.sentence.startswith(f"{said}; the held-out error is")
        assert "what half of that hides, 8.05 mm, is 24 % of the motion (33 mm" in found.sentence.replace("33.0", "33")


def _at_floor(monkeypatch, error, floor, source, named=()):
    """A search of a tip that moves by 33 mm, at such an error and floor; and its rows, of which the first holds what is named."""
    tip = 33.0 * np.array([[1.0, 0.0], [-1.0, 0.0]])
    run = SimpleNamespace(name="steps", has_tip=True, tip_or_angle=tip, repeat_of=None)
    search: Any = object.__new__(Search)
    search.rule, search.effects, search.floor, search.scored = RULE, find_effects(["maxwell"]), floor, None
    search.floors = SimpleNamespace(unit="mm", calibration=0.0, source=source, measurement=floor, irreproducible=None)
    search.present = SimpleNamespace(errors=_errors(error))
    search.trials = SimpleNamespace(problem=SimpleNamespace(train=[run], validate=[run], scored=[run]))
    monkeypatch.setattr(Search, "matters", lambda *_: True)
    monkeypatch.setattr(Search, "without", lambda *_: None)
    better = SimpleNamespace(errors=_errors(0.1 * error))
    rows: list[Any] = [Weighed(search.present, (), 0.0, 0.03 if named else 0.97, 0.0)]
    return search, [Weighed(better, named, 3.0, 0.97, 0.9), *rows] if named else rows


@pytest.mark.parametrize(("error", "floor"), [(3.2, 3.4), (40.0, 3.4)])
def test_of_a_fit_that_was_refused_nothing_is_said(monkeypatch, error, floor):
    """A fit had run away, b_neg_ref to fifty times what such a tube has, and was called complete."""
    message = "Refused: the fit ran away, b_neg_ref is 50 times what a tube of this size has; is the body a tube?"
    search, rows = _at_floor(monkeypatch, error, floor, "standard errors of the track")
    monkeypatch.setattr("rfea_vision.critique.verdict.stand_ins_of", lambda *_: ())
    found = decide(search, rows, message)
    assert outcome_of(found.verdict, bool(found.uncertain_because)) == "uncertain"
    reason = "the fit ran away, b_neg_ref is 50 times what a tube of this size has"
    assert found.uncertain_because == reason
    assert found.sentence == f"T{reason[1:]}: whether something is missing cannot be said. Is the body a tube?"
    assert decide(search, rows).verdict == found.verdict and not decide(search, rows).uncertain_because


@pytest.mark.parametrize(("shared_mm", "length_mm", "told"), [(1.7, 172.0, True), (0.2, 172.0, False), (1.7, 2000.0, False)])
def test_a_floor_that_is_a_ruler_s_is_said_to_hide_what_is_below_it(monkeypatch, shared_mm, length_mm, told):
    """A tendon's friction, 2 mm at a tip, lay below what a ruler is worth, and nothing that matters was missing."""
    search, rows = _at_floor(monkeypatch, 2.2, 2.1, "standard errors of the track")
    search.floors.calibration = 2e-4 * length_mm
    data = SimpleNamespace(dataset=SimpleNamespace(attrs={"calibration_sigma_mm": shared_mm}))
    search.trials.problem.recordings = {"steps": data}
    found = decide(search, rows)
    assert found.verdict == "complete" and found.sentence.startswith("Nothing is missing that matters: the held-out error is 2.20 mm")
    assert ("may be off by, 1.70 mm, alike in every frame: effects that" in found.sentence) == told


@pytest.mark.parametrize(
    ("agree_mm", "source", "told"), [(0.15, LEFT_BY_A_MODEL, True), (1.2, LEFT_BY_A_MODEL, False), (0.15, "", False)]
)
def test_repeats_that_agree_far_below_a_models_own_error_are_told(monkeypatch, agree_mm, source, told):
    """A finger's model was complete at 1.49 mm, what it left itself, with a gain of ten; two runs alike agreed to 0.15 mm."""
    search, rows = _at_floor(monkeypatch, 1.29, 1.49, source)
    search.floors.irreproducible = agree_mm
    search.trials.problem.scored[0].repeat_of = "steps"
    found = decide(search, rows)
    assert found.verdict == "complete" and ("Runs that repeat agree to 0.150 mm, and that floor is" in found.sentence) == told


def test_what_is_named_over_a_refused_fit_stays_named_and_the_reason_comes_first(monkeypatch):
    search, rows = _at_floor(monkeypatch, 9.0, 0.1, "standard errors of the track", ("maxwell",))
    found = decide(search, rows, "Refused: the fit ran away, b_neg_ref is 50 times what a tube has; is it one?")
    assert (found.verdict, found.named) == ("missing", ("maxwell",)) and found.uncertain_because
    assert outcome_of(found.verdict, True) == "missing" and verdict_in_words("missing", False, True) == "missing, but uncertain"
    assert found.sentence.startswith("The fit ran away, b_neg_ref") and "so that this is uncertain: Visco-elastic" in found.sentence


def test_what_is_named_where_one_run_has_another_pressure_is_uncertain(monkeypatch):
    """Of five runs one log was 1.45 times too high, and a stiffening by pressure was named for it with nothing beside it."""
    score = ExperimentScore(role="train", pressure_times=1.45)
    why = none_to_rest_on(SimpleNamespace(refused="", experiments={"mixed": score}))  # type: ignore[arg-type]
    search, rows = _at_floor(monkeypatch, 9.0, 0.1, "standard errors of the track", ("maxwell",))
    found = decide(search, rows, why)
    assert found.named == ("maxwell",) and found.uncertain_because.startswith("run mixed is off as if its pressure")
    assert found.sentence.startswith("Run mixed is off as if") and "so that this is uncertain: Visco-elastic" in found.sentence


def test_all_of_a_floor_that_is_a_models_own_error_hides_what_may_matter(monkeypatch):
    """A model was complete at a floor of 5 mm, its own error, of a tip that moved by 33 mm: half of that is less than a tenth."""
    for source, because in ((LEFT_BY_A_MODEL, TRACK_UNCERTAIN), ("standard errors of the track", "")):
        search, rows = _at_floor(monkeypatch, 5.0, 5.0, source)
        found = decide(search, rows)
        assert (found.verdict, found.uncertain_because) == ("complete", because)
        hidden = "what all of that hides (it is what a model leaves of its worst run), 5.00 mm, is 15 % of"
        assert (hidden in found.sentence) == bool(because)
    search, rows = _at_floor(monkeypatch, 0.0065, 0.0065, LEFT_BY_A_MODEL)  # the example: nothing beside its motion
    assert decide(search, rows).sentence.startswith("Nothing is missing that matters")
    left = remainder_of(search, decide(search, rows), [])
    assert left.sentence == "What is left, 0.00650 mm, is at the floor (0.00650 mm, which is a model's own error)."
    repeated = SimpleNamespace(scored=[SimpleNamespace(repeat_of="steps")])
    floors: Any = SimpleNamespace(source=LEFT_BY_A_MODEL, measurement=5.0, irreproducible=5.1)
    assert not left_by_a_model(floors, repeated)  # a repeat has shown as much
    floors.irreproducible = 0.1
    assert left_by_a_model(floors, repeated)


def test_a_complete_model_that_its_training_runs_belie_says_so():
    """The held-out run was a slow ramp; fast steps were off by two floors, and a load at the tip would have halved that."""
    search: Any = SimpleNamespace(
        floors=SimpleNamespace(unit="mm", source="repeated runs"), floor=0.1, held=0.09,
        trials=SimpleNamespace(problem=SimpleNamespace(validate=["ramp"])),
    )  # fmt: skip
    for trained, less in ((0.12, False), (0.23, True)):
        runs = {"steps": RunErrors("train", 100, trained**2, None), "ramp": RunErrors("validate", 100, 0.09**2, None)}
        search.present = SimpleNamespace(errors=Errors(runs))
        assert _asks_less(search) is less
        for sufficient in (True, False):
            found: Any = SimpleNamespace(sufficient=sufficient, asks_less=less)
            assert ("The training runs are off by 0.230 mm: they ask more" in _complete(search, found)) is less
        far = ", as far as the held-out runs ask" if less else ""
        found = SimpleNamespace(sufficient=True, asks_less=less)
        told = f"Nothing is missing that matters{far}: the held-out error is 0.0900 mm, the floor 0.100 mm."
        assert _complete(search, found).startswith(told)
