"""The parts of the critique on their own: what matters, the search, the rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from rfea_vision.artefacts import Candidate, Diagnosis, ModelFit
from rfea_vision.critique import screening
from rfea_vision.critique.diagnosis import judge
from rfea_vision.critique.evidence import effect_parameters, to_rule_out
from rfea_vision.critique.ladder import _look_back
from rfea_vision.critique.measures import Errors, RunErrors, matters, share, structure
from rfea_vision.critique.rule import RULE
from rfea_vision.critique.screening import Sensitivity
from rfea_vision.critique.search import Search, Weighed
from rfea_vision.critique.subsets import Combinations
from rfea_vision.critique.trials import Trials
from rfea_vision.critique.verdict import _likely, _unexplained, decide
from rfea_vision.effects.catalogue import catalogue, find_effects
from rfea_vision.fitting.fit import fit, make_problem
from rfea_vision.fitting.refit import refit_from
from rfea_vision.fitting.residuals import evaluate
from rfea_vision.options import FitOptions
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


def test_looking_back_drops_what_earns_nothing(campaign):
    problem = make_problem(*campaign((("gravity_tilt.angle", -0.08),)))
    options = FitOptions(segments=6, starts=0, effects=("damping_profile", "gravity_tilt"), name="both")
    fitted = fit(problem, options)
    assert _look_back(problem, fitted, 0.085, keep="gravity_tilt").options.effects == ("gravity_tilt",)
    assert "gravity_tilt" in _look_back(problem, fitted, 0.085, keep="damping_profile").options.effects


def test_a_claim_about_a_better_model_is_weighed_against_the_model_without_effects(campaign):
    """What the first effect has taken away counts as the motion of its law, on the second rung as on the first."""
    problem = make_problem(*campaign((("gravity_tilt.angle", -0.08),)))
    options = FitOptions(segments=6, starts=0)
    base = judge(problem, fit(problem, options), candidates=("payload",)).search
    better = judge(problem, fit(problem, replace(options, effects=("gravity_tilt",))), candidates=("payload",)).search
    assert base.base is None and better.base is not None
    assert better.base.held == pytest.approx(base.present.errors.held, rel=0.02)
    assert better.present.errors.held < 0.2 * better.base.held


@pytest.mark.parametrize("observe", ["angle", "tip_y"])
def test_a_refit_is_carried_from_thinned_runs_to_all_frames_of_any_kind(campaign, monkeypatch, observe):
    monkeypatch.setattr("rfea_vision.fitting.refit.ROUGH_FRAMES", 80)
    problem = make_problem(*campaign((("gravity_tilt.angle", -0.08),)), FitOptions(observe=observe))
    options = FitOptions(segments=4, starts=0, observe=observe)
    trials = Trials(problem)
    base = trials.stands(fit(problem, options))
    assert trials.rough[0].time.size < problem.train[0].time.size
    found = trials.refit(base, ("gravity_tilt",), {})
    whole = refit_from(problem, replace(options, effects=("gravity_tilt",)), base.fitted)
    # Fitted to half of the 237 frames: what some ten parameters make of the noise of the other half stays.
    assert found is not None and found.cost == pytest.approx(whole.solution.cost, rel=0.06)


def test_a_set_that_comes_to_the_top_last_has_its_rivals_refitted_too(monkeypatch):
    """Leaving members out may bring up a set that no round has looked from."""
    tops, against = ["first", "first", "last"], []
    weighed = {name: SimpleNamespace(trial=SimpleNamespace(effects=frozenset({name}))) for name in tops}
    search: Any = object.__new__(Search)
    search.present, search._against_rivals = weighed["first"].trial, set()

    def rivals() -> None:
        against.append(tops[0])
        search._against_rivals.add(frozenset({tops[0]}))

    steps = {"_look_from": lambda *_: None, "_forms": lambda: None, "_rivals": rivals, "_led": lambda found: found}
    monkeypatch.setattr(search, "weigh", lambda: [weighed[tops[0]]], raising=False)
    monkeypatch.setattr(search, "_leave_one_out", lambda: tops.pop(0) if len(tops) > 1 else None, raising=False)
    for name, step in steps.items():
        monkeypatch.setattr(search, name, step, raising=False)
    assert search.run()[0].trial.effects == {"last"} and against == ["first", "last"]


def test_what_an_earlier_search_has_fitted_is_taken_up_and_not_begun_anew(campaign, monkeypatch):
    problem = make_problem(*campaign((("gravity_tilt.angle", -0.08),)))
    options = FitOptions(segments=4, starts=0)
    fitted = fit(problem, options)
    first = judge(problem, fitted, candidates=("gravity_tilt", "payload")).diagnosis
    assert [row["effects"] for row in first.refits if "payload" not in row["effects"]] == [[], ["gravity_tilt"]]
    (tilted,) = (row["values"] for row in first.refits if row["effects"] == ["gravity_tilt"])
    monkeypatch.setattr(Trials, "_from", lambda *_: pytest.fail("begun anew"))
    trials = Trials(problem, known={frozenset({"gravity_tilt"}): tilted})
    found = trials.refit(trials.stands(fitted), ("gravity_tilt",), {})
    assert found is not None and found.fitted.values["gravity_tilt.angle"] == pytest.approx(-0.08, rel=0.1)
    assert [row["effects"] for row in trials.refits()] == [[], ["gravity_tilt"]]


@pytest.mark.study
def test_a_score_test_that_fails_for_all_at_once_is_run_in_halves(campaign, monkeypatch):
    problem = make_problem(*campaign((("maxwell.k1", 0.1), ("maxwell.T", 0.5))))
    fitted = fit(problem, FitOptions(segments=4, starts=0))
    effects = find_effects(("maxwell", "payload", "drag", "gravity_tilt", "coulomb"))

    def screen():
        return screening.screened_rows(list(screening.sensitivities(problem, fitted, effects)), effects)

    whole = {s.effect: s.explained for s in screen()}

    def fails_with(model, *rest):
        ids = {effect.id for effect in model.effects}
        return None if len(ids) > 3 or "drag" in ids else evaluate(model, *rest)

    monkeypatch.setattr(screening, "evaluate", fails_with)
    halves = {s.effect: s.explained for s in screen()}
    assert set(halves) == set(whole) - {"drag"}
    assert all(halves[name] == pytest.approx(whole[name], rel=1e-3, abs=1e-6) for name in halves)


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


def test_a_step_within_bounds_lets_the_other_amplitudes_make_up_for_the_one_that_is_held():
    """Clipping every amplitude by itself leaves a third of the fall behind here; the truth is from a general solver."""
    hessian = np.array([[1.0, 0.9], [0.9, 1.0]])
    gradient = np.array([1.9, 1.7])  # the free step is (1.95, -0.05)
    step, fall = screening.bounded_step(gradient, hessian, np.array([0.0, 0.0]), np.array([1.0, 5.0]))
    root = np.linalg.cholesky(hessian).T
    truth = lsq_linear(root, np.linalg.solve(root.T, gradient), ([0, 0], [1.0, 5.0])).x
    assert step == pytest.approx(truth, abs=1e-6) and step[0] == 1.0
    clipped = np.array([1.0, 0.0])
    assert fall > 2 * gradient @ clipped - clipped @ hessian @ clipped + 0.5


def test_a_pair_is_found_whose_members_are_too_weak_alone():
    """Two columns that all but cancel: neither lowers the residual by much, both together remove it."""
    rng = np.random.default_rng(0)
    common, own = rng.standard_normal(400), 0.1 * rng.standard_normal(400)
    effects = find_effects(("payload", "gravity_tilt", "pressure_offset"))
    columns = [common + own, -common, rng.standard_normal(400)]
    scales = [1e-3, 0.05, 1e3]
    rows = [
        Sensitivity(effect, {}, [effect.amplitudes()[0]], -(column / scale)[:, None], own + 0.0, (), (slice(0, 400),))
        for effect, column, scale in zip(effects, columns, scales, strict=True)
    ]
    singles, pairs = Combinations(rows).best(frozenset(), 2, 3)
    assert max(p.fall for p in singles) < 0.1
    assert set(pairs[0].effects) == {"payload", "gravity_tilt"} and pairs[0].fall > 0.99
    assert pairs[0].start["payload.m"] == pytest.approx(1e-3, rel=1e-3)


def test_sets_that_could_not_be_among_the_best_are_passed_over_and_no_others(monkeypatch):
    rng, made = np.random.default_rng(3), []
    shared = rng.standard_normal((300, 6))
    item: Any = SimpleNamespace(observe="angle", time=np.arange(300) / 100)
    for effect in find_effects(sorted(catalogue())):
        slopes = np.column_stack([shared @ rng.standard_normal(6) for _ in effect.amplitudes()])
        made.append(Sensitivity(effect, {}, list(effect.amplitudes()), slopes, shared[:, 0], (item,), (slice(0, 300),)))
    step, solved = Combinations._step, []
    monkeypatch.setattr(Combinations, "_step", lambda self, picks: solved.append(picks) or step(self, picks))
    monkeypatch.setattr("rfea_vision.critique.subsets.BEAM", 10)
    found, few = Combinations(made).best(frozenset(), 3, 3), len(solved)
    monkeypatch.setattr(Combinations, "_ceilings", lambda self, keys: [np.inf] * len(keys))
    assert found == Combinations(made).best(frozenset(), 3, 3) and few < (len(solved) - few) / 3


def test_a_linear_step_sets_out_from_where_an_effect_is_absent():
    """A gain is absent at one: a step of two hundredths starts at 1.02, not at the lowest that physics allows."""
    (gain,) = find_effects(("pressure_gain",))
    slope = np.random.default_rng(0).standard_normal((400, 1))
    time = np.arange(400) / 100
    item: Any = SimpleNamespace(observe="angle", time=time)
    row = Sensitivity(gain, {}, ["g"], -slope, 0.02 * slope[:, 0], (item,), (slice(0, 400),))
    ((best,),) = Combinations([row]).best(frozenset(), 1, 1)
    assert best.start["pressure_gain.g"] == pytest.approx(1.02)
    (screened,) = screening.screened_rows([row], (gain,))
    assert screened.amplitudes["g"] == pytest.approx(1.02)


def test_a_larger_set_is_never_worse_than_one_that_it_holds(campaign):
    problem = make_problem(*campaign((("gravity_tilt.angle", -0.08),)))
    trials = Trials(problem)
    base = trials.stands(fit(problem, FitOptions(segments=4, starts=0)))
    one = trials.refit(base, ("gravity_tilt",), {"gravity_tilt.angle": -0.05})
    astray = {"gravity_tilt.angle": 0.4, "payload.m": 0.01}
    both = trials.refit(base, ("gravity_tilt", "payload"), astray)
    assert one.cost < 0.5 * base.cost and both.cost <= one.cost


def test_a_fit_of_thinned_runs_is_carried_over_to_all_frames_without_their_slopes(campaign):
    problem = make_problem(*campaign((("gravity_tilt.angle", -0.08),)))
    trials = Trials(problem)
    base = trials.stands(fit(problem, FitOptions(segments=4, starts=0)))
    one = trials.refit(base, ("gravity_tilt",), {"gravity_tilt.angle": -0.05})
    exact = refit_from(problem, one.fitted.options, one.fitted)
    assert one.cost == pytest.approx(exact.solution.cost, rel=1e-3)
    assert one.fitted.values["gravity_tilt.angle"] == pytest.approx(exact.values["gravity_tilt.angle"], rel=0.01)
    assert one.fitted.solution.evaluation.jacobian.shape[1] == len(problem.train)  # of the clocks alone
    found = effect_parameters(problem, one.fitted, "gravity_tilt")["gravity_tilt.angle"]
    wanted = effect_parameters(problem, exact, "gravity_tilt")["gravity_tilt.angle"]
    assert found.stderr == pytest.approx(wanted.stderr, rel=0.02)


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
        ("mullins:linear",): ("mullins", "named", 0.9, 0.7),
        ("mullins:linear", "drag"): ("drag", "stand-in", 0.2, 0.4),
    }
    for effects, added in expected.items():
        rungs.append((rung_of(model(*effects), said, rungs), said))
        rung = rungs[-1][0]
        assert (rung.added, rung.grade, rung.probability, rung.share) == added


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


def test_a_second_branch_without_the_first_is_no_claim_of_its_own():
    """It is the law of the first one, fitted where members of a set are left out in turn; it had taken two thirds of its claim."""
    search: Any = object.__new__(Search)
    search.effects = find_effects(["maxwell", "maxwell_2", "drag"])
    search.present = SimpleNamespace(effects=frozenset({"drag"}))
    for added, claim in (({"maxwell"}, True), ({"maxwell_2"}, False), ({"maxwell:logarithmic", "maxwell_2"}, True)):
        assert search._offered(SimpleNamespace(effects=frozenset(added | {"drag"}))) == claim
    search.present = SimpleNamespace(effects=frozenset({"maxwell"}))
    assert search._offered(SimpleNamespace(effects=frozenset({"maxwell", "maxwell_2"})))


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


def _asked_in_other_forms(weighed: list[Any], structure: float) -> set[tuple[str, ...]]:
    """Sets that a search asks to be refitted in other forms, where these were weighed."""
    asked = set[tuple[str, ...]]()
    searching = SimpleNamespace(
        weigh=lambda: weighed,
        structure=lambda _: structure,
        rule=RULE,
        present=SimpleNamespace(effects=frozenset()),
        effects=[kind() for kind in catalogue().values()],
        trials=SimpleNamespace(refit=lambda base, added, start: asked.add(tuple(added))),
    )
    searching._in_other_forms = lambda *given: Search._in_other_forms(searching, *given)
    Search._forms(searching)
    return asked


def _weighed(members: Sequence[str], share: float) -> Any:
    fitted = SimpleNamespace(values={"com_offset.a": 0.3})
    trial = SimpleNamespace(effects=frozenset(members), at_bound=False, fitted=fitted)
    return SimpleNamespace(added=tuple(members), share=share, trial=trial)


@pytest.mark.parametrize(("structure", "tried"), [(9.0, {("com_offset",), ()}), (0.0, set())])
def test_another_form_may_do_for_two(structure, tried):
    """A load beside the centre line bends the tube at rest: with it the effect that did that goes, whether or not it looks alike."""
    asked = _asked_in_other_forms([_weighed(["com_offset", "payload"], 0.999)], structure)
    assert asked == {(*others, "payload:beside") for others in tried}


def test_a_smaller_set_is_tried_in_its_other_forms_before_more_effects_are_believed():
    """A load on the hinge line leaves 0.8 % of the squares: a fault of its form, for which two other effects made up."""
    best = _weighed(["fluid_inertia", "pressure_gain"], 0.9999)
    smaller = [_weighed(["payload"], 0.992), _weighed(["mullins"], 0.97), _weighed([], 0.0)]
    assert _asked_in_other_forms([best, *smaller], 0.0) == {("payload:beside",)}
