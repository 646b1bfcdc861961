"""Fits of other rigs and runs: conditions that are known, runs that are let go, and what is held by rule."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import Actuator, ModelFit, Recording
from rfea_vision.artefacts.judgement import ExperimentScore
from rfea_vision.critique.next_experiment import _shared
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.base import BASE_PARAMETERS
from rfea_vision.effects.catalogue import catalogue, find_effects
from rfea_vision.errors import InputError
from rfea_vision.fitting import FitOptions, fit_model
from rfea_vision.fitting.coordinates import base_reference, build
from rfea_vision.fitting.observation import observe_recording
from rfea_vision.fitting.prediction import as_dataset, observe_as_scored
from rfea_vision.fitting.problem import make_model, make_problem
from rfea_vision.fitting.refit import refit
from rfea_vision.fitting.residuals import predict_observed
from rfea_vision.fitting.rules import pushed
from testing.steady import bending_angle

BEAM = Actuator(outer_radius=0.015, inner_radius=0.0075, length=0.1, density=1070.0, kind="rectangle", width=0.03)
SEGMENTS = 4
TRUTH = np.array([0.75, 0.0, 2.2e-3, 0.0, 1.4e-3, 0.0, 0.015])
LET_GO_S = 0.3047


def _captured(time, tip, **attrs):
    """A recording of motion capture: the path of the tip (mm) and a log of no pressure."""
    data = xr.Dataset(
        {
            "valid": ("time", np.ones(time.size, np.int8)),
            "reason": ("time", np.full(time.size, "", dtype=object)),
            "tip": (("time", "xy"), tip),
            "pressure": ("log_time", np.zeros(400)),
        },
        coords={"time": time, "log_time": np.arange(400) * 0.01 - 0.5},
        attrs={"bends": "left", **attrs},
    )
    return Recording(data)


def _let_go(name, role, load_kg, *, known=None, seed=0, truth=TRUTH):
    """A beam that hangs across gravity, held straight and let go, with or without a load, as motion capture sees it."""
    model = Model(Chain.tube(BEAM, SEGMENTS), (catalogue()["payload"](),), mounting=np.pi / 2)
    time = np.arange(0, 2.5, 0.01)
    free = time[time >= LET_GO_S]
    excitation = Excitation(LET_GO_S, 1e-3, np.zeros(2301))
    motion = model.simulate(np.append(truth, load_kg), excitation, free, held=np.zeros(SEGMENTS))
    tip = np.tile([0.0, -100.0], (time.size, 1))
    tip[time >= LET_GO_S] = model.centre_line(motion, np.array([1.0]))[0][:, 0] * 1e3
    tip += np.random.default_rng(seed).normal(0, 0.02, tip.shape)
    conditions = {} if known is None else {"conditions": json.dumps({"payload.m": known})}
    return _captured(time, tip, experiment=name, role=role, gravity_deg=90.0, held_until_s=np.nan, **conditions)


@pytest.fixture(scope="module")
def runs():
    made = [
        _let_go("bare", "train", 0.0, known=0.0),
        _let_go("loaded", "train", 0.05, seed=1),
        _let_go("loaded-again", "validate", 0.05, seed=2),
    ]
    return {recording.name: recording for recording in made}


def test_the_moment_of_letting_go_is_found(runs):
    item = observe_recording(runs["loaded"])
    assert item.held is not None and item.held.until_s == pytest.approx(LET_GO_S, abs=0.01)
    assert item.time[0] >= item.held.until_s and np.abs(item.held.line[0] - [0, -0.1]).max() < 2e-5


def test_a_load_that_is_known_to_be_absent_in_one_run_is_found_in_the_others(runs):
    found = fit_model(runs, BEAM, FitOptions(segments=SEGMENTS, effects=("payload",)))
    assert found.parameters["payload.m"].value == pytest.approx(0.05, rel=0.01)
    assert found.parameters["k_ref"].value == pytest.approx(TRUTH[0], rel=0.005)
    assert found.experiments["loaded-again"].tip_rmse_mm < 0.04
    said = " ".join(found.warnings)
    assert said.count("r_hyd") == 1 and "held at 15 mm" in said and "k_slope" in said
    assert all(found.parameters[name].fixed for name in ("r_hyd", "k_slope", "b_pos_slope", "b_neg_slope"))


def test_no_moment_of_letting_go_is_moved_beyond_what_was_seen(runs):
    """A beam that swings at the wrong frequency pulls at the clocks: they stay within their bounds."""
    runs = {"bare": runs["bare"], "heavy": _let_go("heavy", "train", 0.3)}
    options = FitOptions(segments=SEGMENTS, fixed=dict(zip(BASE_PARAMETERS, TRUTH, strict=True)))
    problem = make_problem(runs, BEAM, options)
    clocks = np.array([0.0, 1.0])  # one clock, and one that is off from the start
    fitted = refit(problem, options, {}, SEGMENTS, clocks)
    assert fitted.solution.clocks[1] == pytest.approx(0.04, rel=0.01)  # four frames


def test_a_known_condition_is_not_fitted(runs):
    """Where the load is known for every run the base model describes them all; its derivative by that run is nought."""
    known = {name: r for name, r in runs.items() if name == "bare"}
    known["loaded"] = _let_go("loaded", "train", 0.05, known=0.05, seed=1)
    found = fit_model(known, BEAM, FitOptions(segments=SEGMENTS))
    assert found.metrics["train"].tip_rmse_mm < 0.04 and "payload.m" not in found.parameters
    item = observe_recording(known["loaded"])
    model = Model(Chain.tube(BEAM, SEGMENTS), (catalogue()["payload"](),))
    seen = predict_observed(model, np.append(TRUTH, 0.0), item, range(8))
    assert seen is not None and not seen.dpoints[..., 7].any() and seen.dpoints[..., 0].any()


def test_a_beam_with_two_chambers_bends_alike_to_both_sides():
    rod = Actuator(kind="rod", outer_radius=0.0125, inner_radius=0.0044, length=0.07, mass_per_length=0.47)
    model = Model(Chain.tube(rod, 4))
    par = np.zeros(len(model.names))
    par[:7] = base_reference(rod, 4)
    pressure = 4e4 * np.sin(np.linspace(0.0, 12.0, 1500))
    times = np.arange(0.1, 2.9, 0.04)
    there, back = (model.simulate(par, Excitation(0.0, 2e-3, way * pressure), times) for way in (1.0, -1.0))
    assert there.ok
    assert back.ok
    assert np.ptp(there.phi[:, -1]) > 0.2
    np.testing.assert_allclose(there.phi, -back.phi, atol=1e-6)
    np.testing.assert_allclose(model.steady(par, -4e4).phi, -model.steady(par, 4e4).phi, atol=1e-9)
    softens = Model(Chain.tube(rod, 4), (catalogue()["mullins"](),))
    softened = np.append(par, [0.3, 0.3])
    there, back = (softens.simulate(softened, Excitation(0.0, 2e-3, way * pressure), times) for way in (1.0, -1.0))
    np.testing.assert_allclose(there.phi, -back.phi, atol=1e-6)
    to_left, to_right = bending_angle(par[:7], 4, [4e5, -4e5], rod)
    assert to_left == pytest.approx(-to_right)
    assert to_left > 1.0  # beyond where the bore of a tube of these radii would close


ROD = Actuator(kind="rod", outer_radius=0.0125, inner_radius=0.0044, length=0.07, mass_per_length=0.47)
OWN = ("pressure_gain@right", "pressure_lag@right", "pressure_offset@left")
OWN_TRUTH = {"pressure_gain@right.g": 0.8, "pressure_lag@right.T": 0.06, "pressure_offset@left.p0": 3e3}


#: A chamber beside the middle, behind a thin long line.
FAR_OFF = {"pressure_gain@right.g": 0.2, "pressure_lag@right.T": 3.0, "pressure_offset@left.p0": 3e3}


def _two_chambers(name, role, seed, truth=OWN_TRUTH):
    """A rod with a chamber on either side, the right one on a shorter lever and behind a slow line, each driven in its turn."""
    time = np.arange(0.0, 6.0, 0.02)
    waves = np.random.default_rng(seed).normal(size=(2, 8))
    left, right = (4e4 * np.abs(np.interp(time, np.linspace(0, 6, 8), wave)) for wave in waves)
    model = Model(Chain.tube(ROD, SEGMENTS), find_effects(OWN))
    par = np.append(base_reference(ROD, SEGMENTS), [truth[name] for name in model.names[7:]])
    excitation = Excitation.from_log(
        time, left - right, 0.0, 5.98, chambers_Pa={"left": (1.0, left), "right": (-1.0, right)}
    )
    frames = np.arange(0.1, 5.8, 0.04)
    angle = np.rad2deg(model.simulate(par, excitation, frames).phi[:, -1])
    data = xr.Dataset(
        {
            "valid": ("time", np.ones(frames.size, np.int8)),
            "reason": ("time", np.full(frames.size, "", dtype=object)),
            "bend_angle": ("time", angle + np.random.default_rng(seed + 1).normal(0, 0.02, angle.size)),
            "pressure": ("log_time", (left - right) / 1e3),
            "chamber_pressure": (("chamber", "log_time"), np.stack([left, right]) / 1e3),
        },
        coords={"time": frames, "log_time": time, "chamber": ["left", "right"], "chamber_sign": ("chamber", [1, -1])},
        attrs={"experiment": name, "role": role, "bends": "left"},
    )
    return Recording(data)


@pytest.fixture(scope="module")
def chambers():
    return {name: _two_chambers(name, role, seed) for name, role, seed in (("a", "train", 3), ("b", "validate", 7))}


def test_a_chamber_may_have_a_fifth_of_the_lever_and_a_line_of_seconds():
    """A lever below a half and a lag above 2 s had been out of bounds, whatever the body: neither could be named."""
    runs = {
        name: _two_chambers(name, role, seed, FAR_OFF) for name, role, seed in (("a", "train", 3), ("b", "validate", 7))
    }
    own = fit_model(runs, ROD, FitOptions(segments=SEGMENTS, effects=OWN))
    assert own.metrics["validate"].angle_rmse_deg < 0.03
    assert own.parameters["pressure_gain@right.g"].value == pytest.approx(0.2, rel=0.05)
    assert own.parameters["pressure_lag@right.T"].value == pytest.approx(3.0, rel=0.1)


def test_torques_of_effects_may_be_as_large_as_the_body_is_stiff():
    """An arm of 26 N m/rad could rub with 0.05 N m at most, a fifth of a degree, and so never showed a loop.

    And a beam of 91 g could carry 100 g at most: one of 101 g was weighed at that, and nothing said so.
    """
    arm = Actuator(kind="rod", outer_radius=0.04, inner_radius=0.016, length=0.3, mass_per_length=2.0)
    for name, parameter in (("hysteresis", "tau_h"), ("coulomb", "tau_c")):
        declared = catalogue()[name].parameters[parameter]
        (paper,), (large,) = (
            make_model(body, FitOptions(segments=2, effects=(name,))).effects for body in (Actuator(), arm)
        )
        assert paper.parameters[parameter] == declared == catalogue()[name].parameters[parameter]
        assert large.parameters[parameter].upper > 7e4 * 8e-4 * 0.04  # 70 kPa on 8 cm^2, 40 mm from the middle: 2.2 N m
    beam = Actuator(kind="rectangle", width=0.03, outer_radius=0.015, length=0.09, density=1070.0)
    model = make_model(beam, FitOptions(segments=2, effects=("payload",)))
    assert model.effects[0].parameters["m"].upper > 0.2
    coordinates = build(model, beam, 2, 0.2)
    amplitude = [name.startswith("payload") for name in coordinates.names].index(True)
    y = np.where(np.isfinite(coordinates.upper), 0.5 * (coordinates.lower + coordinates.upper), 1.0)
    y[amplitude] = 0.99995 * coordinates.upper[amplitude]  # as near to a bound as an optimiser comes
    assert not coordinates.inside(y)[amplitude] and coordinates.upper[amplitude] > 50
    y[amplitude] = 0.1  # small beside the bound, and no less there
    assert coordinates.inside(y)[amplitude]


def test_lever_lag_and_zero_of_each_chamber_are_found(chambers):
    tied = fit_model(chambers, ROD, FitOptions(segments=SEGMENTS))
    own = fit_model(chambers, ROD, FitOptions(segments=SEGMENTS, effects=OWN))
    assert own.metrics["validate"].angle_rmse_deg < 0.03 < 0.3 < tied.metrics["validate"].angle_rmse_deg
    for name, value in OWN_TRUTH.items():
        found = own.parameters[name]
        assert found.value == pytest.approx(value, abs=max(4 * found.stderr, 0.01 * value)), name


def test_what_is_predicted_takes_the_steps_that_were_scored(chambers):
    """A model that was scored in other steps than a later version would take is predicted in its own."""
    recording = chambers["a"]
    usual = observe_recording(recording).excitation.step_s
    score = ExperimentScore(role="train", step_s=usual / 2)
    model = ModelFit(name="base", segments=4, parameters={}, metrics={}, experiments={"a": score})
    assert observe_as_scored(model, recording).excitation.step_s == usual / 2
    assert observe_as_scored(model.model_copy(update={"experiments": {}}), recording).excitation.step_s == usual


def test_what_test_runs_show_does_not_enter_the_fit(chambers):
    """How far springs must hold is asked of the training runs alone."""
    test = chambers["b"].dataset.copy(deep=True)
    test["bend_angle"] = 9 * test["bend_angle"]
    test.attrs["role"] = "test"
    alone = {"a": chambers["a"]}
    assert make_problem({**alone, "b": Recording(test)}, ROD).bend == make_problem(alone, ROD).bend


def test_a_pressure_to_play_next_is_shared_among_the_chambers(chambers):
    """One side at a time: of each side the first chamber is driven, and their sum with signs is what was asked for."""
    item = observe_recording(chambers["a"])
    pressure = 4e4 * np.sin(np.linspace(0, 6, 50))
    shared = _shared(pressure, item)
    assert set(shared) == {"left", "right"} and all(np.all(own >= 0) for _, own in shared.values())
    np.testing.assert_allclose(sum(sign * own for sign, own in shared.values()), pressure)


def test_a_tube_is_let_go_when_it_is_and_not_at_the_sample_before():
    run = _let_go("let-go", "train", 0.0)
    run.dataset.attrs["held_until_s"] = LET_GO_S
    assert observe_recording(run).excitation.start_s == LET_GO_S


def test_what_is_predicted_has_the_zero_that_was_scored(chambers):
    """The zero of a sensor is found in what the fit looks at: seen otherwise, it is another."""
    recording = Recording(chambers["a"].dataset.assign(tip=(("time", "xy"), np.full((143, 2), 5.0))))
    model = ModelFit(name="base", segments=4, observe="angle", parameters={}, metrics={}, experiments={})
    assert observe_as_scored(model, recording).observe == "angle"


def test_a_clock_drift_is_nought_in_the_middle_of_a_run_however_much_of_it_is_looked_at(chambers):
    item = observe_recording(chambers["a"])
    every = np.arange(item.time[0], item.time[-1] + 0.2, 0.04)
    for part in (item.opening(40), item.thinned(7), item.everywhere(every)):
        assert part.middle_s == item.middle_s


def test_a_rod_does_not_stretch_along_its_middle(chambers):
    item = observe_recording(chambers["a"])
    model, par = Model(Chain.tube(ROD, SEGMENTS)), base_reference(ROD, SEGMENTS)
    seen = predict_observed(model, par, item, (), fractions=np.ones(1))
    assert not as_dataset(model, item, chambers["a"], seen, np.ones(1))["elongation"].values[item.frame].any()


def test_derivatives_by_the_effects_of_a_chamber(chambers):
    item = observe_recording(chambers["a"])
    model = Model(Chain.tube(ROD, SEGMENTS), find_effects((*OWN, "pressure_lag")))
    par = np.append(base_reference(ROD, SEGMENTS), [*OWN_TRUTH.values(), 0.03])
    exact = predict_observed(model, par, item, range(7, 11)).dangle
    for column, k in enumerate(range(7, 11)):
        step = 1e-3 * par[k] * np.eye(par.size)[k]
        above, below = (predict_observed(model, par + way * step, item, ()).angle for way in (1, -1))
        smallest = 1e-4 * np.abs(exact[:, column]).max()
        np.testing.assert_allclose(exact[:, column], (above - below) / (2e-3 * par[k]), rtol=1e-3, atol=smallest)


def test_an_effect_at_a_chamber_that_there_is_not_is_refused(chambers):
    with pytest.raises(InputError, match=r"@middle.*the chambers are left, right"):
        fit_model(chambers, ROD, FitOptions(segments=SEGMENTS, effects=("pressure_lag@middle",)))
    with pytest.raises(InputError, match=r"maxwell@right.*the number of a joint"):
        fit_model(chambers, ROD, FitOptions(segments=SEGMENTS, effects=("maxwell@right",)))


@pytest.mark.parametrize("relaxes_s", [3e-4, 0.5], ids=["rings for long", "creeps"])
def test_a_tube_that_is_let_go_is_fitted_whether_it_rings_or_creeps(relaxes_s):
    """Thirty swings, or none: no start may be caught half a swing off, and none needs a swing."""
    truth = TRUTH.copy()
    truth[[2, 4]] = relaxes_s * truth[0]
    run = _let_go("let-go", "train", 0.0, truth=truth)
    found = fit_model({"let-go": run}, BEAM, FitOptions(segments=SEGMENTS))
    assert found.parameters["k_ref"].value == pytest.approx(truth[0], rel=0.01)
    assert found.metrics["train"].tip_rmse_mm < 0.04


def test_pressures_that_differ_from_run_to_run_are_a_push(runs):
    item = observe_recording(runs["bare"])
    other = replace(item, excitation=replace(item.excitation, pressure=item.excitation.pressure + 2e4))
    assert pushed([item, other]) and not pushed([other])


CUT_S, PULL_N = 0.5, 1.2


def _pulled(load_N, seed):
    """The beam under a string at its tip that is cut, hanging; its tip as motion capture sees it."""
    model = Model(Chain.tube(BEAM, SEGMENTS))
    force = load_N * np.array([-1.0, 0.0])
    time = np.arange(0, 2.5, 0.01)
    excitation = Excitation(CUT_S, 1e-3, np.zeros(2101))
    motion = model.simulate(TRUTH, excitation, time[time >= CUT_S], pulled=force)
    tip = np.empty((time.size, 2))
    tip[time >= CUT_S] = model.centre_line(motion, np.array([1.0]))[0][:, 0] * 1e3
    tip[time < CUT_S] = tip[time >= CUT_S][0]
    tip += np.random.default_rng(seed).normal(0, 0.01, tip.shape)
    attrs = {"held_until_s": CUT_S, "pulled_N": load_N, "pulled_deg": 90.0, "offset_s": 0.0}
    return _captured(time, tip, experiment="string", role="train", **attrs)


def test_a_string_that_is_cut_tells_the_stiffness_without_a_measured_shape():
    found = fit_model({"string": _pulled(PULL_N, 4)}, BEAM, FitOptions(segments=SEGMENTS))
    assert found.parameters["k_ref"].value == pytest.approx(TRUTH[0], rel=0.005)
    assert found.metrics["train"].tip_rmse_mm < 0.03


def test_a_force_at_the_tip_bends_as_a_cantilever_and_its_derivatives_are_right():
    model = Model(Chain.tube(BEAM, 24), gravity=0.0)
    par = TRUTH.copy()
    par[0] *= 24 / SEGMENTS
    times = np.array([0.0, 0.05])
    excitation = Excitation(0.0, 1e-3, np.zeros(101))
    force = np.array([-0.05, 0.02])
    motion = model.simulate(par, excitation, times, range(7), pulled=force)
    tip = model.centre_line(motion, np.array([1.0]))[0][0, 0]
    flexural = par[0] * BEAM.length / 24  # of joints that each stand for a 24th of the length
    assert tip[0] == pytest.approx(-0.05 * BEAM.length**3 / (3 * flexural), rel=0.01)
    for k in (0, 2):
        step = 1e-4 * par[k] * np.eye(7)[k]
        above, below = (model.simulate(par + way * step, excitation, times, pulled=force).phi for way in (1, -1))
        difference = (above - below) / (2e-4 * par[k])
        smallest = 1e-6 * np.abs(difference).max()
        np.testing.assert_allclose(motion.sensitivity[:, :, k], difference, rtol=1e-4, atol=smallest)


def test_a_clamp_that_turns_feels_the_force_at_the_tip():
    """Its angle is its compliance times the moment of the force, of which the shape says the lever."""
    model = Model(Chain.tube(BEAM, 6), find_effects(["base_rotation"]), gravity=0.0)
    par = np.zeros(len(model.names))
    par[:7] = TRUTH
    par[model.names.index("base_rotation.c")] = compliance = 0.4
    bent = model.steady(par, 0.0, pulled=np.array([-0.3, 0.0]))
    tip = model.line_at_rest(par, bent, np.array([1.0]))[0][0]
    # the moment arm is the curve's, not the chain's
    assert bent.found and bent.phi[0] == pytest.approx(compliance * 0.3 * -tip[1], rel=1e-4)


def test_what_is_known_of_a_run_stands_beside_what_is_fitted(runs):
    """Wherever the law puts the parameter that only this run knows, the fitted ones keep their derivatives."""
    item = replace(observe_recording(runs["bare"]), conditions={"drag.c": 0.5})
    chain, values = Chain.tube(BEAM, SEGMENTS), {"maxwell.k1": 0.1, "maxwell.T": 0.4, "drag.c": 0.5}
    own = Model(chain, find_effects(["maxwell"]))
    both = Model(chain, find_effects(["maxwell", "drag"]))
    seen, wanted = (
        predict_observed(model, np.append(TRUTH, [values[name] for name in model.names[7:]]), item, free)
        for model, free in ((own, range(9)), (both, [both.names.index(name) for name in own.names]))
    )
    assert both.names[7] == "drag.c" and seen is not None and wanted is not None
    assert np.array_equal(seen.points, wanted.points) and np.array_equal(seen.dpoints, wanted.dpoints)
    assert all(seen.dpoints[..., k].any() for k in (7, 8))
