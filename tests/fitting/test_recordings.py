"""Recordings as they come from a bench: the outcome is a useful fit or one clear sentence."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from rfea_vision.artefacts import Recording
from rfea_vision.errors import DataError, InputError
from rfea_vision.fitting import fit_model, predict
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.noise import noise_floor_mm
from rfea_vision.fitting.nuisance import eliminate
from rfea_vision.fitting.observation import _without_jumps, observe_recording
from rfea_vision.fitting.problem import make_model, make_problem
from rfea_vision.fitting.refit import refit_from
from rfea_vision.fitting.residuals import by_clock, evaluate, predict_observed
from rfea_vision.fitting.solver import at_own_clock, fit_clocks
from rfea_vision.options import FitOptions
from tests.fitting.runs import NOISE_MM, OPTIONS, changed, noisy

FLOOR_MM = NOISE_MM * np.sqrt(2)


@pytest.fixture(scope="module")
def runs(exact):
    clean, actuator, truth = exact
    return noisy(clean, 2), actuator, truth


def gaps(data):
    data["tip"].values[40:70] = np.nan
    valid = data["valid"].values.copy()
    valid[150:160] = 0
    data["valid"] = ("time", valid)


def rows_without_numbers(data):
    data["tip"].values[np.random.default_rng(1).random(data.sizes["time"]) < 0.1] = np.nan


def wrong_tips(data):
    generator = np.random.default_rng(1)
    bad = generator.choice(data.sizes["time"], 3, replace=False)
    data["tip"].values[bad] += generator.normal(0, 20, (3, 2))


@pytest.mark.parametrize("damage", [gaps, rows_without_numbers, wrong_tips])
def test_a_damaged_track_still_gives_the_parameters(runs, damage):
    recordings, actuator, truth = runs
    damaged = changed(recordings, damage)
    model = fit_model(damaged, actuator, OPTIONS)
    assert model.metrics["validate"].tip_rmse_mm < 1.15 * FLOOR_MM
    assert model.parameters["k_ref"].value == pytest.approx(truth["k_ref"], rel=2e-3)
    for name, dataset in predict(model, damaged).items():
        assert dataset.sizes["time"] == recordings[name].dataset.sizes["time"]


def test_bursts_of_wrong_frames_call_for_the_robust_loss(runs):
    recordings, actuator, truth = runs

    def bursts(data):
        for first in (60, 170, 240):
            data["tip"].values[first : first + 6] += 15

    damaged = changed(recordings, bursts)
    model = fit_model(damaged, actuator, OPTIONS)
    assert model.loss == model.given["loss"] == "huber" and any("robust loss" in warning for warning in model.warnings)
    plain = fit_model(damaged, actuator, replace(OPTIONS, loss="linear"))

    def worst(fit):
        return max(abs(fit.parameters[name].value / truth[name] - 1) for name in ("k_ref", "b_pos_ref", "b_neg_ref"))

    assert worst(model) < 0.01 < worst(plain)
    undamaged = fit_model(recordings, actuator, OPTIONS)
    assert undamaged.loss == "linear" and "loss" not in undamaged.given


def test_the_robust_loss_reaches_the_data(runs):
    """Not only the last step: what `solve` itself ends at is not drawn away by wrong frames."""
    recordings, actuator, truth = runs

    def bursts(data):
        data["tip"].values[60:90] += 15

    problem = make_problem(changed(recordings, bursts), actuator)
    plain = fit(problem, replace(OPTIONS, loss="linear"))
    robust = refit_from(problem, replace(OPTIONS, loss="huber"), plain)

    def off(fitted):
        return max(abs(fitted.values[name] / truth[name] - 1) for name in ("k_ref", "b_pos_ref", "b_neg_ref"))

    assert off(robust) < 0.02 < off(plain)
    assert robust.solution.cost < plain.solution.cost


def test_a_repeat_is_compared_at_the_same_instants_of_its_log(runs):
    """A track that begins a tenth of a second later is the same motion all the same."""
    recordings, _, _ = runs
    name, other = "one", "again"
    data = recordings[next(iter(recordings))].dataset
    later = data.isel(time=slice(12, None)).assign_attrs(experiment=other, repeat_of=name)
    pair = {name: Recording(data.assign_attrs(experiment=name)), other: Recording(later)}
    items = [observe_recording(one) for one in pair.values()]
    assert noise_floor_mm(items, pair) == (pytest.approx(0.0, abs=1e-9), "repeated runs")


def test_a_repeat_that_begins_between_two_steps_of_the_search_is_no_noisier(runs):
    """4.3 ms late on its log, half a frame: taken for 0 or 10 ms, or for a chord, its floor would be many times the noise."""
    recordings, _, _ = runs
    data = recordings[next(iter(recordings))].dataset.assign_attrs(experiment="one")
    time, late_s = data["time"].values, 0.0043
    tip = CubicSpline(time, data["tip"].values)(np.maximum(time - late_s, time[0]))
    late = data.assign(tip=(("time", "xy"), tip)).assign_coords(log_time=data["log_time"] + late_s)
    pair = {"one": Recording(data), "again": Recording(late.assign_attrs(experiment="again", repeat_of="one"))}
    floor, source = noise_floor_mm([observe_recording(one) for one in pair.values()], pair)
    assert source == "repeated runs" and floor < NOISE_MM


def test_a_held_out_clock_is_found_as_far_off_as_sync_leaves_it(runs):
    recordings, actuator, truth = runs
    problem = make_problem(recordings, actuator)
    model = make_model(actuator, OPTIONS, problem.mirror)
    par = np.array([truth[name] for name in model.names])
    item = replace(problem.train[0], clock_sigma=0.5)
    late = replace(item, excitation=replace(item.excitation, start_s=item.excitation.start_s + 0.4))
    clock = fit_clocks(model, [late], par)[0]
    assert clock == pytest.approx(0.4, abs=2e-3)
    simulated = predict_observed(model, par, late, (), clock)
    for read in (by_clock(model, par, late)(clock), at_own_clock(model, late, par)):
        assert np.allclose(read.points, simulated.points, rtol=0, atol=1e-10)
        assert np.allclose(read.dpoints, simulated.dpoints, rtol=1e-6, atol=1e-9)


def late(data):
    """Track and log begin in the middle of a motion."""
    start = data["time"].values[0] + 0.95
    return data.isel(time=data["time"].values >= start, log_time=data["log_time"].values >= start - 0.05)


@pytest.mark.study
def test_a_run_that_begins_in_motion(runs):
    recordings, actuator, truth = runs
    two = {name: recording for name, recording in recordings.items() if not name.startswith("steps")}
    model = fit_model(changed(two, late), actuator, OPTIONS)
    for score in model.experiments.values():
        assert score.tip_rmse_mm < 1.15 * FLOOR_MM
    assert model.parameters["k_ref"].value == pytest.approx(truth["k_ref"], rel=3e-3)
    assert any("moves when the log begins" in warning for warning in model.warnings)

    def log_kept(data):
        return data.isel(time=data["time"].values >= data["time"].values[0] + 0.95)

    known = fit_model(changed(recordings, log_kept), actuator, OPTIONS)
    assert not any("moves when the log begins" in warning for warning in known.warnings)
    assert known.metrics["train"].tip_rmse_mm < 1.15 * FLOOR_MM


@pytest.mark.study
def test_the_zero_of_a_sensor_is_found_for_each_run(runs):
    recordings, actuator, truth = runs
    off = dict(zip(recordings, (2.0, -1.5, 1.0), strict=True))

    def shifted(data):
        data["pressure"] = data["pressure"] + off[data.attrs["experiment"]]

    model = fit_model(changed(recordings, shifted), actuator, replace(OPTIONS, pressure_zero_sd=2e3))
    for name, kilopascal in off.items():
        assert model.experiments[name].nuisance["pressure_zero_kPa"] == pytest.approx(-kilopascal, abs=0.02)
    assert model.parameters["k_ref"].value == pytest.approx(truth["k_ref"], rel=3e-3)
    assert model.parameters["r_hyd"].interval_95 is not None


def angles_alone(recordings):
    return {
        name: Recording(r.dataset.drop_vars([v for v in r.dataset.data_vars if v.startswith(("tip", "midline"))]))
        for name, r in recordings.items()
    }


GYROSCOPE = """
from rfea_vision.effects.base import Effect, EffectParameter

class Gyroscope(Effect):
    id = "gyroscope"
    title = "A rate gyroscope whose integral drifts"
    reference = "none"
    kind = "measurement"
    parameters = {"rate": EffectParameter("rad/s", 0.0, -1.0, 1.0, 0.01, "drift")}

    def angle_drift(self, time):
        return self.rate * time
"""


def test_an_angle_sensor_that_drifts_is_an_effect_of_ones_own(runs, tmp_path):
    recordings, actuator, _ = runs
    (tmp_path / "gyroscope.py").write_text(GYROSCOPE)

    def drifting(data):
        data["bend_angle"] = data["bend_angle"] + 3.0 * (data["time"] - data["time"].mean())

    own = replace(OPTIONS, effects=("gyroscope",), effect_files=(tmp_path / "gyroscope.py",))
    model = fit_model(angles_alone(changed(recordings, drifting)), actuator, own)
    assert model.parameters["gyroscope.rate"].value == pytest.approx(np.deg2rad(3.0), rel=0.01)
    assert model.metrics["validate"].angle_rmse_deg < 0.1


def test_each_run_has_the_zero_of_its_inclinometer(runs):
    recordings, actuator, truth = runs
    off = dict(zip(recordings, (2.0, -1.5, 1.0), strict=True))

    def inclined(data):
        data["bend_angle"] = data["bend_angle"] + off[data.attrs["experiment"]]

    angles = angles_alone(changed(recordings, inclined))
    model = fit_model(angles, actuator, replace(OPTIONS, angle_zero_sd=np.deg2rad(5)))
    for name, degrees in off.items():
        assert model.experiments[name].nuisance["angle_zero_deg"] == pytest.approx(degrees, abs=0.1)
    assert model.metrics["validate"].angle_rmse_deg < 0.1
    assert model.parameters["k_ref"].value / model.parameters["r_hyd"].value == pytest.approx(
        truth["k_ref"] / truth["r_hyd"], rel=0.01
    )
    ahead = predict(model, angles)
    for name, recording in angles.items():
        gap = recording.dataset["bend_angle"].values - ahead[name]["bend_angle"].values
        assert abs(np.nanmean(gap)) < 0.05


@pytest.mark.parametrize(("change", "zero_sd"), [(late, 0.0), (lambda data: None, 2e3)])
def test_jacobian_is_exact_with_nuisances_eliminated(runs, change, zero_sd):
    recordings, actuator, truth = runs
    item = make_problem(changed(recordings, change), actuator, FitOptions(pressure_zero_sd=zero_sd)).train[0]
    assert item.unknowns is not None
    model = make_model(actuator, OPTIONS)
    par = 1.001 * np.array(list(truth.values()))
    exact = evaluate(model, par, [item], range(7))
    assert exact is not None
    for k in (0, 2, 6):
        step = 1e-3 * par[k] * np.eye(7)[k]
        ahead, back = (evaluate(model, par + sign * step, [item], ()) for sign in (1, -1))
        assert ahead is not None and back is not None
        difference = (ahead.residual - back.residual) / (2e-3 * par[k])
        assert np.linalg.norm(exact.jacobian[:, k] - difference) < 0.03 * np.linalg.norm(difference)
    beside, sought_from_there = (evaluate(model, 1.01 * par, [item], (), near=near) for near in (None, exact))
    assert beside is not None and sought_from_there is not None
    assert np.abs(beside.residual - sought_from_there.residual).max() < 1e-3  # standard errors


def test_derivatives_that_run_away_are_no_fault():
    for size in (1e90, 1e170):  # their squares leave no digit of a one beside them, or no number
        columns = np.full((5, 2), size)
        found = eliminate(np.zeros(2), lambda amplitude, columns=columns: (np.ones(5), columns))
        assert found is not None and np.allclose(found, 0.0, atol=1e-60)


def in_metres(data):
    data["tip"] = data["tip"] / 1000


def other_side(data):
    data["tip"] = data["tip"] * np.array([-1.0, 1.0])


def in_bar(data):
    data["pressure"] = data["pressure"] / 100


def in_pascal(data):
    data["pressure"] = data["pressure"] * 1000


def constant(data):
    data["pressure"] = data["pressure"] * 0 + 100


def five_frames(data):
    return data.isel(time=slice(100, 105))


@pytest.mark.parametrize(
    ("damage", "kind", "says"),
    [
        (in_metres, InputError, "check the unit and the origin of the track"),
        (other_side, InputError, "actuator.bends"),
        (in_bar, DataError, "check its unit"),
        (in_pascal, InputError, "check the unit of the pressure log"),
        (constant, DataError, "moves no tube"),
        (five_frames, DataError, "only 5 valid frames"),
    ],
)
def test_what_cannot_be_is_one_sentence(runs, damage, kind, says):
    recordings, actuator, _ = runs
    with pytest.raises(kind, match=says) as caught:
        fit_model(changed(recordings, damage), actuator, OPTIONS)
    assert "\n" not in str(caught.value)


def test_markers_beside_the_line_are_no_other_side(runs):
    """A tip that stands on the other side at rest, and is driven to the side that is named."""
    recordings, actuator, _ = runs

    def beside(data):
        data["tip"] = data["tip"] * np.array([0.2, 1.0]) + np.array([0.3 * actuator.length * 1e3, 0.0])

    assert make_problem(changed(recordings, beside), actuator).train


def test_half_a_second_is_little_and_is_said_by_the_intervals(runs):
    recordings, actuator, truth = runs
    model = fit_model(changed(recordings, lambda data: data.isel(time=slice(0, 60))), actuator, OPTIONS)
    for name, parameter in model.parameters.items():
        if parameter.interval_95 is not None and "slope" not in name:
            low, high = parameter.interval_95
            assert low - 0.3 * (high - low) < truth[name] < high + 0.3 * (high - low)


def test_one_training_run_alone_will_do(runs):
    recordings, actuator, truth = runs
    name = next(n for n, r in recordings.items() if r.role == "train")
    model = fit_model({name: recordings[name]}, actuator, OPTIONS)
    assert model.parameters["k_ref"].value == pytest.approx(truth["k_ref"], rel=3e-3)
    assert list(model.metrics) == ["train"] and any("validate" in warning for warning in model.warnings)


def test_fewer_frames_tell_the_same_with_wider_intervals(runs):
    recordings, actuator, _ = runs
    every, few = (fit_model(recordings, actuator, replace(OPTIONS, frames=frames)) for frames in (None, 100))
    assert few.experiments.keys() == every.experiments.keys()
    assert all(score.frames_used == 100 for score in few.experiments.values()) and few.given["frames"] == 100
    for name, one in few.parameters.items():
        assert one.value == pytest.approx(every.parameters[name].value, abs=3 * one.stderr)
        assert one.stderr > every.parameters[name].stderr


def test_a_tube_that_shakes_while_it_is_held_does_not_jump():
    """An inclinometer at rest for most of a run, shaking for a quarter of it, and twice wrong for one frame."""
    rng = np.random.default_rng(3)
    angle = 1e-3 * rng.standard_normal(800)
    angle[300:500] += 0.5 + 0.02 * rng.standard_normal(200)
    angle[[120, 400]] += 1.5
    kept = _without_jumps(np.zeros((800, 0, 2)), angle, np.zeros((800, 0)))
    assert not kept[[120, 400]].any() and kept.mean() > 0.99
