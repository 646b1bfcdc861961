"""Intervals that cover, refusals in place of inventions, and what was known beforehand."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rfea_vision.artefacts import ExperimentScore, Parameter
from rfea_vision.errors import DataError, InputError
from rfea_vision.fitting import fit_model
from rfea_vision.fitting.alarms import alarms, runaway
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.intervals import intervals
from rfea_vision.fitting.prediction import predict
from rfea_vision.fitting.problem import make_model, make_problem
from rfea_vision.fitting.profile import _scale_and_step
from rfea_vision.fitting.ratio import about_ratio
from rfea_vision.fitting.refit import refit
from rfea_vision.fitting.residual_tests import examine_residuals
from rfea_vision.fitting.scoring import as_artefact, gaps, options_of, pooled, worse_than_nothing
from rfea_vision.fitting.studies import enough_segments, leave_one_out, segments_study
from rfea_vision.options import FitOptions
from tests.fitting.runs import OPTIONS, SEGMENTS, noisy


@pytest.fixture(scope="module")
def fitted(exact):
    runs, actuator, _ = exact
    problem = make_problem(noisy(runs, 0), actuator)
    return problem, fit(problem, OPTIONS)


@pytest.mark.parametrize("correlation", [pytest.param(0.0, marks=pytest.mark.study), 0.8])
def test_intervals_cover_the_truth(exact, correlation):
    """25 draws of the noise: a right 95 % interval misses 3 or more of 25 with probability 0.13, 6 or more with 0.001."""
    runs, actuator, truth = exact
    misses = dict.fromkeys(truth, 0)
    errors = []
    for draw in range(25):
        problem = make_problem(noisy(runs, draw, correlation), actuator)
        one = refit(problem, OPTIONS, truth, SEGMENTS)
        found = intervals(one, problem.train, actuator).parameters
        for name, value in truth.items():
            interval = found[name].interval_95
            assert interval is not None
            misses[name] += not interval[0] <= value <= interval[1]
        errors.append([(found[name].value - truth[name]) / found[name].stderr for name in truth])
    assert max(misses.values()) <= 5
    spread = np.std(errors)  # an interval that is far too wide would cover as well
    assert 0.8 < spread < 1.3


def test_the_integrator_leaves_no_bias(exact, monkeypatch):
    runs, actuator, truth = exact
    problem = make_problem(noisy(runs, 0, noise_mm=0.0), actuator)
    bias = {}
    for order in (2, 3):
        model = partial(replace, order=order)
        monkeypatch.setattr("rfea_vision.fitting.refit.make_model", lambda *what, model=model: model(make_model(*what)))
        bias[order] = abs(refit(problem, OPTIONS, truth, SEGMENTS).values["r_hyd"] / truth["r_hyd"] - 1)
    assert bias[3] < 0.5 * bias[2]


def test_what_is_held_and_bounded_stays_there(fitted, exact):
    problem, _ = fitted
    truth = exact[2]
    options = replace(
        OPTIONS, fixed={"r_hyd": truth["r_hyd"]}, bounds={"k_slope": (1.2 * truth["k_slope"], 1.1 * truth["k_slope"])}
    )
    model = as_artefact(problem, fit(problem, options))
    assert model.parameters["r_hyd"].fixed and model.parameters["r_hyd"].value == truth["r_hyd"]
    assert model.parameters["k_slope"].value == pytest.approx(1.1 * truth["k_slope"], rel=1e-3)
    assert "bound" in model.parameters["k_slope"].note and model.parameters["k_slope"].interval_95 is None
    again = options_of(model)
    assert again.fixed == options.fixed and again.bounds == options.bounds


def test_what_is_given_per_joint_goes_with_the_number_of_segments():
    options = FitOptions(
        segments=16, fixed={"k_ref": 1.6, "r_hyd": 3e-3}, priors={"b_pos_ref": (0.16, 0.016), "modulus": (1e6, 1e5)}
    )
    half = options.with_segments(8)
    assert half.fixed == {"k_ref": 0.8, "r_hyd": 3e-3}
    assert half.priors == {"b_pos_ref": (0.08, 0.008), "modulus": (1e6, 1e5)}


def test_a_prior_pulls_by_its_weight(fitted, exact):
    problem, free = fitted
    before = as_artefact(problem, free).parameters["r_hyd"]
    mean, error = before.value + before.stderr, 0.5 * before.stderr
    one = fit(problem, replace(OPTIONS, priors={"r_hyd": (mean, error)}))
    after = as_artefact(problem, one).parameters["r_hyd"]
    share = error**-2 / (error**-2 + before.stderr**-2)
    assert after.value - before.value == pytest.approx(share * (mean - before.value), rel=0.1)
    assert after.stderr < before.stderr


def test_a_tie_is_said_and_its_intervals_refused(fitted, exact):
    problem, free = fitted
    options = replace(OPTIONS, name="tied", effects=("pressure_gain",))
    known = dict(zip(free.model.names, free.par, strict=True))
    model = as_artefact(problem, refit(problem, options, known, SEGMENTS))
    for name in ("r_hyd", "pressure_gain.g"):
        assert model.parameters[name].interval_95 is None and model.parameters[name].stderr is None
    assert any("r_hyd" in w and "pressure_gain.g" in w and "cannot be told apart" in w for w in model.warnings)
    assert model.parameters["b_pos_ref"].interval_95 is not None


def test_a_runaway_is_refused(fitted, exact):
    (_, free), (runs, actuator, truth) = fitted, exact
    problem = make_problem(noisy(runs, 0), actuator)
    far = 12 * 0.004
    known = {name: value * far / truth["r_hyd"] for name, value in truth.items()}
    options = replace(OPTIONS, bounds={"r_hyd": (0.9 * far, far)})
    model = as_artefact(problem, refit(problem, options, known, SEGMENTS))
    assert model.status == "refused" and "ran away" in model.message and "fix it (--fix r_hyd" in model.message
    assert all(p.interval_95 is None for p in model.parameters.values())
    par = free.par.copy()
    par[free.model.names.index("b_pos_ref")] *= 1000
    said = runaway(replace(free, solution=replace(free.solution, par=par)), actuator)
    assert "b_pos_ref is" in said and "actuator.section" in said and "r_hyd" not in said


def test_values_that_no_tube_has_raise_an_alarm(fitted, exact):
    problem, free = fitted
    heavy = replace(problem, actuator=replace(problem.actuator, material="PDMS", density=6000.0))
    assert any("6000 kg/m^3" in warning for warning in as_artefact(heavy, free).warnings)
    thin = replace(problem, actuator=replace(problem.actuator, material="PDMS", inner_radius=0.00395))
    assert any("Young's modulus" in warning for warning in as_artefact(thin, free).warnings)
    assert not any("modulus" in warning or "density" in warning for warning in as_artefact(problem, free).warnings)
    # a log in mbar that was taken for kPa: ten times the pressure, and so ten times the stiffness
    stiff = free.par.copy()
    stiff[0] *= 10.0
    unnamed = replace(problem.actuator, material="")
    assert any("mbar taken for kPa" in said for said in alarms(replace(free, solution=replace(free.solution, par=stiff)), unnamed))
    assert not any("modulus" in said for said in alarms(free, unnamed))


def test_a_start_that_no_fit_may_have_is_named(fitted, exact):
    """Three metres for three millimetres: the fit begins at its bound, and says so; a start inside is begun from in silence."""
    problem, free = fitted
    for lever, moved in ((3.0, ["start r_hyd = 3 "]), (exact[2]["r_hyd"], [])):
        one = replace(free, options=replace(free.options, start={**exact[2], "r_hyd": lever}))
        assert [said[:16] for said in alarms(one, problem.actuator) if "start" in said] == moved


def test_profile_likelihood_agrees_where_the_error_is_a_parabola(exact):
    runs, actuator, _ = exact
    model = fit_model(noisy(runs, 0), actuator, replace(OPTIONS, profile=("k_ref",)))
    low, high = model.profiles["k_ref"]["interval_95"]
    expected = model.parameters["k_ref"].interval_95
    assert low == pytest.approx(expected[0], rel=1e-4) and high == pytest.approx(expected[1], rel=1e-4)
    assert min(model.profiles["k_ref"]["delta"]) == 0.0
    with pytest.raises(InputError, match="payload"):
        fit_model(noisy(runs, 0), actuator, replace(OPTIONS, profile=("payload.m",)))


def test_study_over_segments(fitted):
    problem, one = fitted
    rows, seconds = segments_study(problem, one, (1, 2, 4))
    assert [row["segments"] for row in rows] == [1, 2, 4] and set(seconds) == {"1", "2", "4"}
    tips = [row["validate_tip_rmse_mm"] for row in rows]
    assert tips[0] > tips[1] > tips[2] and tips[2] < 0.1
    for row in rows:
        parts = row["validate_tip_x_rmse_mm"] ** 2 + row["validate_tip_y_rmse_mm"] ** 2
        assert parts == pytest.approx(row["validate_tip_rmse_mm"] ** 2, rel=1e-9)
        assert len(row["tip_path_mm"]["x"]) == len(row["tip_path_mm"]["y"]) > 50
    assert enough_segments(rows, 0.085) == 4
    assert enough_segments(rows, 1e3) == 1
    with pytest.raises(DataError, match="segments auto"):
        enough_segments([], 0.1)


def test_the_number_of_segments_is_chosen(exact):
    runs, actuator, _ = exact
    model = fit_model(noisy(runs, 0), actuator, replace(OPTIONS, segments=8, auto_segments=True))
    assert model.segments == 4  # the truth has four joints, at the start of their bodies
    assert [row["segments"] for row in model.segments_study] == [2, 4, 8, 16, 32]
    assert "timings" not in model.model_dump() and set(model.timings) == {"2", "4", "8", "16", "32"}


def test_each_run_is_left_out_in_turn(fitted):
    problem, one = fitted
    out = leave_one_out(problem, one)
    assert set(out["experiments"]) == {o.name for o in problem.train}
    assert 0.9 < out["tip_rmse_mm"] / 0.085 < 1.2
    assert 0 < out["relative_spread"]["b_pos_slope"] < 0.3
    with pytest.raises(DataError, match="one training run"):
        leave_one_out(replace(problem, train=problem.train[:1]), one)


def test_the_run_without_which_a_parameter_moves_farthest_is_named(fitted, monkeypatch):
    """Of three runs, one of them with a log in psi for kPa, the parameter was named and not the run."""
    problem, one = fitted
    first = problem.train[0]
    three = replace(problem, train=tuple(replace(first, name=name) for name in ("a", "b", "c")))

    def without(*_args, items):
        moved = 1.0 if any(item.name == "b" for item in items) else 1.45
        return SimpleNamespace(model=one.model, par=one.par * np.array([moved, *np.ones(len(one.par) - 1)]), values=one.values)

    monkeypatch.setattr("rfea_vision.fitting.studies.refit", without)
    clocks = replace(one, solution=replace(one.solution, clocks=np.zeros(3)))
    said = leave_one_out(three, clocks)["sentence"]
    assert said.startswith("k_ref moves most when a run is left out: by 45 %, farthest without b;")


@pytest.mark.parametrize("period_s", [1 / 240, 1 / 30])
def test_a_tube_that_rings_is_not_called_noise(period_s):
    """However few frames show it: at 30 a second, 3 Hz that die away after every step have lost their memory in one and a half."""
    time = np.arange(150) * period_s
    after = time % 1.0
    ringing = np.exp(-2 * after) * np.sin(2 * np.pi * 3 * after)
    noise = np.random.default_rng(0).normal(0.0, 0.01, 150)
    points = np.zeros((150, 1, 2))
    points[:, 0, 0] = ringing + noise
    still = SimpleNamespace(points=np.zeros((150, 1, 2)), angle=time, motion=SimpleNamespace(rate=np.ones((150, 1))))
    excitation = SimpleNamespace(at=lambda t: t)
    found = []
    for seen in (points, np.repeat(noise[:, None, None], 2, axis=2)):
        item = SimpleNamespace(time=time, period_s=time[1] - time[0], has_tip=True, points=seen, excitation=excitation)
        found.append(examine_residuals([item], [still])["whiteness"]["sentence"])
    assert "not noise alone" in found[0] and found[1] == "the residual is white"


def test_residuals_are_white_where_the_noise_is(exact):
    runs, actuator, _ = exact
    for correlation, white in ((0.0, True), (0.9, False)):
        model = fit_model(noisy(runs, 1, correlation), actuator, OPTIONS)
        assert ("white" in model.residual_tests["whiteness"]["sentence"]) is white
        for on in ("pressure", "angle", "rate"):
            assert model.residual_tests[f"independence_of_{on}"]["share"] < 0.2
        train = model.metrics["train"]
        assert train.tip_rmse_percent_of_length == pytest.approx(100 * train.tip_rmse_mm / 155)
        assert train.normalised_fit_percent > 99


def test_a_prediction_carries_what_the_error_of_a_parameter_does_to_it(fitted, exact):
    problem, free = fitted
    runs = noisy(exact[0], 0)
    artefact = as_artefact(problem, free)
    alone = {
        name: item.model_copy(update={"stderr": None, "interval_95": None, "fixed": True})
        for name, item in artefact.parameters.items()
    }
    known = artefact.parameters["r_hyd"]
    one = artefact.model_copy(update={"parameters": {**alone, "r_hyd": known}})
    more = known.model_copy(update={"value": known.value + known.stderr})
    name = next(iter(runs))
    before = predict(one, {name: runs[name]})[name]
    after = predict(artefact.model_copy(update={"parameters": {**alone, "r_hyd": more}}), {name: runs[name]})[name]
    moved = np.abs(after["tip"].values - before["tip"].values)
    seen = moved > 1e-3  # mm; below it single precision counts
    assert seen.any()
    np.testing.assert_allclose(before["tip_stderr"].values[seen], moved[seen], rtol=0.1)
    assert before["tip_stderr"].attrs["quantile_95"] == pytest.approx(np.ptp(known.interval_95) / 2 / known.stderr)
    coarse = known.model_copy(update={"stderr": 7 * known.stderr})  # what a finer chain would move leaves the curves
    again = predict(one.model_copy(update={"parameters": {**alone, "r_hyd": coarse}}), {name: runs[name]})[name]
    np.testing.assert_array_equal(again["tip_stderr"], before["tip_stderr"])
    assert "tip_stderr" not in predict(one.model_copy(update={"parameters": alone}), {name: runs[name]})[name]


def test_a_parameter_of_no_interval_counts_in_the_errors_of_a_prediction(fitted, exact):
    """A lever that the data do not determine was left out: the stiffness that it makes up for blew the band up to the whole motion."""
    artefact = as_artefact(*fitted)
    refused = artefact.parameters["r_hyd"].model_copy(update={"stderr": None, "interval_95": None, "note": "not determined"})
    told = artefact.model_copy(update={"parameters": artefact.parameters | {"r_hyd": refused}})
    name, run = next(iter(noisy(exact[0], 0).items()))
    all_told, without = (predict(model, {name: run})[name]["tip_stderr"].values for model in (artefact, told))
    np.testing.assert_array_equal(without, all_told)


def test_a_model_that_does_worse_than_no_motion_is_said_in_mm_and_in_deg():
    time_s = np.arange(0.0, 5.0, 0.02)
    bent = np.deg2rad(20.0 + 10.0 * np.sin(time_s))
    tip = 100.0 * np.stack([-np.sin(bent), -np.cos(bent)], axis=1) / 1e3
    for has_tip in (True, False):
        shown = 1e3 * tip if has_tip else np.rad2deg(bent)[:, None]
        item = SimpleNamespace(has_tip=has_tip, has_midline=False, angle=bent, points=tip[:, None], tip_or_angle=shown)
        for off, worse in ((0.1, False), (1.5, True)):
            predicted = SimpleNamespace(angle=bent + off * np.std(bent), points=tip[:, None] + off * 0.0123)
            metrics = pooled([gaps(item, predicted)], 100.0)
            assert (metrics.normalised_fit_percent < 0) == worse
            said = worse_than_nothing({"steps": ExperimentScore(role="train", **metrics.model_dump())})
            assert len(said) == worse and all("steps: the model is farther from the track" in text for text in said)


def test_a_profile_under_the_robust_loss_counts_wrong_frames_no_more_than_the_fit_does():
    residual = np.append(np.ones(99), 1000.0)

    def scale(row_weight):
        evaluation = SimpleNamespace(residual=residual)
        solution = SimpleNamespace(
            scaled_jacobian=np.ones((100, 1)), prior_jacobian=np.zeros((0, 1)), row_weight=row_weight, evaluation=evaluation
        )  # fmt: skip
        coordinates, model = SimpleNamespace(free=(0,), matrix=np.eye(1)), SimpleNamespace(names=("k_ref",))
        fitted: Any = SimpleNamespace(solution=solution, coordinates=coordinates, model=model)
        untold: Any = SimpleNamespace(stderr=None, value=1.0)
        return _scale_and_step(fitted, "k_ref", untold)[0]

    assert scale(np.minimum(1.0, 5.0 / residual)) == pytest.approx(scale(np.ones(100)) / 200, rel=0.05)


def test_an_interval_of_hundreds_is_written_out():
    assert "= 554.2 ± 102 N/rad" in about_ratio(Parameter(value=22.168, unit="N*m/rad", interval_95=(0.0, 8.2)), 0.04)
    assert "= 34.4 ± 2.0 N/rad" in about_ratio(Parameter(value=0.43, unit="N*m/rad", interval_95=(0.0, 0.05)), 0.0125)
