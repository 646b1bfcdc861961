"""The contract that every effect keeps: nested in the base model, exact derivatives, finite over its bounds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.base import HOOKS
from rfea_vision.effects.catalogue import catalogue, find_effects
from rfea_vision.errors import InputError

FRACTIONS = np.linspace(0, 1, 7)
EFFECTS = sorted(catalogue())


def _model(actuator, *ids, segments=8, **options):
    return Model(Chain.tube(actuator, segments), tuple(catalogue()[i]() for i in ids), tolerance=1e-12, **options)


def _parameters(model, published, choose):
    """`choose(spec)` gives the value of each effect parameter."""
    values = dict(zip(model.names, np.append(published, np.zeros(len(model.names) - 7)), strict=True))
    for effect in model.effects:
        for name, spec in effect.parameters.items():
            values[f"{effect.id}.{name}"] = choose(spec)
    return np.array([values[name] for name in model.names])


def _absent(spec):
    return spec.absent if spec.absent is not None else (spec.grid or (spec.start,))[0]


def _present(spec):
    if spec.absent is None:
        return (spec.grid or (spec.start,))[0]
    return spec.start if spec.start != spec.absent else spec.absent + 0.05 * (spec.upper - spec.absent)


def _observed(model, par, excitation, frames, free=()):
    motion = model.simulate(par, excitation, frames, free)
    assert motion.ok, motion.message
    return model.centre_line(motion, FRACTIONS)


@pytest.mark.parametrize("name", EFFECTS)
def test_absent_value_gives_the_base_model(name, actuator, published, excitation, frames):
    base, _ = _observed(_model(actuator), published, excitation, frames)
    model = _model(actuator, name)
    with_effect, _ = _observed(model, _parameters(model, published, _absent), excitation, frames)
    assert np.abs(with_effect - base).max() < 1e-9


@pytest.mark.parametrize("name", EFFECTS)
def test_sensitivities_match_finite_differences(name, actuator, published, excitation, frames):
    model = _model(actuator, name)
    par = _parameters(model, published, _present)
    free = range(len(par))
    _, exact = _observed(model, par, excitation, frames, free)
    for index, parameter in enumerate(model.names):
        step = 1e-5 * max(abs(par[index]), 1e-3 * _scale(model, parameter))
        up, down = par.copy(), par.copy()
        up[index] += step
        down[index] -= step
        difference = (_observed(model, up, excitation, frames)[0] - _observed(model, down, excitation, frames)[0]) / (
            2 * step
        )
        size = np.abs(difference).max()
        if size * abs(par[index] or _scale(model, parameter)) < 1e-9:
            continue
        assert np.abs(exact[..., index] - difference).max() < 2e-3 * size, parameter


def _scale(model, parameter):
    if "." not in parameter:
        return 1.0
    effect, name = parameter.split(".")
    spec = catalogue()[effect].parameters[name]
    return max(abs(spec.start), 1e-3 * (spec.upper - spec.lower))


ONCE_A_RUN = [(n, h) for n in EFFECTS for h, hook in HOOKS.items() if hook.once and catalogue()[n].overrides(h)]
OF = {"pressure": 1.5e5, "x": -0.05, "y": -0.12, "time": 1.7, "gravity": 9.81}


@pytest.mark.parametrize(("name", "hook"), ONCE_A_RUN)
def test_derivatives_of_what_is_evaluated_once_a_run(name, hook, actuator, published):
    """By every parameter: of the camera and the clocks, too, which no motion of the tube feels."""
    model = _model(actuator, name)
    par = _parameters(model, published, _present)
    own = [OF[argument] for argument in HOOKS[hook].of] if hook != "inertia" else [4e-3, 5e-3, 1e-3, 1e-6, 0.02, 1.0]

    def values(at):
        return np.array([[float(v) for v in row] for row in getattr(model.law, hook)(at, model._constants, *own)])

    exact, felt = values(par), np.zeros(par.size, dtype=bool)
    for k in range(par.size):
        step = 1e-6 * max(abs(par[k]), 1e-3 * _scale(model, model.names[k]))
        up, down = par.copy(), par.copy()
        up[k], down[k] = par[k] + step, par[k] - step
        difference = (values(up)[:, 0] - values(down)[:, 0]) / (2 * step)
        felt[k] = bool(np.any(difference))
        assert exact[:, 1 + len(own) + k] == pytest.approx(difference, rel=1e-5, abs=1e-12), model.names[k]
    assert felt[7:].any(), "the effect is felt through one of its own parameters"


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_changes_something_it_says_it_changes(name, actuator, published, excitation, frames):
    effect = catalogue()[name]
    assert any(effect.overrides(hook) for hook in HOOKS)
    assert effect.title and effect.reference and effect.shows and effect.mistaken_for and effect.split_by
    assert "," not in effect.title  # titles are listed in sentences: "A, B or C"
    for spec in effect.parameters.values():
        assert spec.lower < spec.upper and spec.lower <= spec.start <= spec.upper
        if spec.absent is None:
            assert spec.grid
    if any(map(effect.overrides, ("observed_position", "time_shift", "stretch"))):
        return
    base, _ = _observed(_model(actuator), published, excitation, frames)
    model = _model(actuator, name)
    changed, _ = _observed(model, _parameters(model, published, _present), excitation, frames)
    assert np.abs(changed - base).max() > 1e-6


def test_effect_at_one_joint_only(actuator, published, excitation, frames):
    model = _model(actuator, "rest_curvature", at={"rest_curvature": 3})
    par = _parameters(model, published, lambda spec: 0.8)
    rest = model.steady(par, 0.0)
    theta = np.diff(rest.phi)
    assert theta.argmax() == 2 and theta[2] > 0.05 and np.abs(np.delete(theta, 2)).max() < 0.02


def _law(model, par, theta, rate, states, pressure):
    """Columns of the joint law for arrays of joints' theta and rate."""
    out = np.zeros((theta.size, model.law.columns))
    position, arc = np.linspace(0, 1, theta.size), np.full(theta.size, model.chain.arc[0])
    weights = np.ones((theta.size, max(len(model.effects), 1)))
    arguments = (theta, rate, states, pressure, position, arc, weights, par, model._constants)
    model.law.loops.joint_law(*arguments, out)
    derivatives = np.zeros((theta.size, 2 + model.law.state_count, par.size))
    model.law.loops.joint_law_parameters(*arguments, derivatives)
    return out, derivatives


@pytest.mark.parametrize("name", EFFECTS)
def test_law_is_finite_over_its_bounds(name, actuator, published, excitation, frames):
    """At every corner of the bounds: law and derivatives are numbers, and a run ends well or says that it did not."""
    model = _model(actuator, name)
    theta = np.linspace(-0.1, 0.6, 15)
    for which in range(len(model.names) - 7):
        for end in ("lower", "upper"):
            par = _parameters(model, published, _present)
            parameter = model.names[7 + which].split(".")[1]
            par[7 + which] = getattr(catalogue()[name].parameters[parameter], end)
            for speed in (-20.0, 0.0, 20.0):
                for pressure in (0.0, 270e3):
                    states = np.full((theta.size, max(model.law.state_count, 1)), 0.3)
                    out, derivatives = _law(model, par, theta, np.full(theta.size, speed), states, pressure)
                    assert np.isfinite(out).all() and np.isfinite(derivatives).all(), (parameter, end)
            motion = model.simulate(par, excitation, frames[:30], range(par.size))
            assert motion.message or (np.isfinite(motion.phi).all() and np.isfinite(motion.sensitivity).all())


@pytest.mark.parametrize("name", [name for name in EFFECTS if catalogue()[name].dissipates])
def test_effect_that_claims_to_dissipate_takes_energy(name, actuator, published):
    """Work done on joints at clamp and tip over closed cycles of their motion, at two speeds; pointwise where it acts on the bodies."""
    model = _model(actuator, name)
    par = _parameters(model, published, _present)
    if model.law.has_body_force:
        rng = np.random.default_rng(0)
        motion, out = rng.normal(0, 0.1, (50, 4)), np.zeros((50, 2, 5 + par.size))
        model.law.loops.body_force(motion, np.full(50, 0.01), par, model._constants, out)
        assert np.all((out[:, :, 0] * motion[:, 2:]).sum(axis=1) < 0)
        return
    if model.law.changes(
        "flow_resistance"
    ):  # the pressure lost is R times the flow: its power, R times the flow squared, is never gained
        line, _, _, _ = model._environment(par)
        assert line[0] > 0 and all(spec.lower >= 0 for spec in catalogue()[name].parameters.values())
        return
    bare, pressure = _model(actuator), 1e5 if catalogue()[name].needs_tendon else 0.0  # a tendon that is slack rubs on nothing
    for frequency in (0.5, 4.0):
        time = np.linspace(0, 3 / frequency, 30001)
        angle = 0.1 - 0.08 * np.cos(2 * np.pi * frequency * time)
        speed = 0.16 * np.pi * frequency * np.sin(2 * np.pi * frequency * time)
        z, m, work = np.zeros((2, max(model.law.state_count, 1))), model.law.state_count, np.zeros(time.size)
        if m:
            free = np.zeros((2, m, 3 + par.size))
            position, arc = np.array([0.0, 1.0]), np.full(2, model.chain.arc[0])
            model.law.loops.relaxed_states(
                np.full(2, angle[0]), np.zeros(2), z, pressure, position, arc, np.ones((2, 1)), par, model._constants, free
            )
            z[:, :m] = free[:, :, 0]
        for k in range(time.size):
            here, now = np.full(2, angle[k]), np.full(2, speed[k])
            out, _ = _law(model, par, here, now, z, pressure)
            base, _ = _law(bare, published, here, now, np.zeros((2, 1)), pressure)
            work[k] = (out[:, 0] - base[:, 0]) @ now * time[1]
            for a in range(m):
                z[:, a] += time[1] * out[:, 6 + m + 4 * a]
        last_cycle = work[20000:-1].sum()
        assert last_cycle < -1e-3 * np.abs(work[20000:-1]).sum(), frequency


def test_a_line_of_second_order_is_two_of_the_first_in_series(actuator, published, excitation, frames):
    """Against the pressure that SciPy's linear systems make of the log, given to a tube without a line."""
    lag_s, chain = 0.03, Chain.tube(actuator, 4)
    found = Model(chain, find_effects(["pressure_lag:second_order"])).simulate(
        np.append(published, lag_s), excitation, frames
    )
    time = excitation.step_s * np.arange(excitation.pressure.size)
    rise = excitation.pressure - excitation.pressure[0]
    _, late, _ = lsim(([1.0], [lag_s**2, 2 * lag_s, 1.0]), rise, time)
    delayed = replace(excitation, pressure=late + excitation.pressure[0])
    wanted, prompt = (Model(chain).simulate(published, one, frames).phi for one in (delayed, excitation))
    assert np.abs(found.phi - wanted).max() < 0.01 * np.abs(prompt - wanted).max()


def test_a_line_with_a_valve_fills_and_drains_at_its_own_rates(actuator, published):
    """Of a pressure that steps up and down again the tube feels two exponentials; with one rate it is a line of first order."""
    chain, step_s, top = Chain.tube(actuator, 4), 1e-3, 5e4
    frames = np.arange(0.02, 1.2, 0.01)
    pressure = np.r_[np.zeros(20), np.full(600, top), np.zeros(600)]
    time = step_s * np.arange(pressure.size)
    fill_s, drain_s = 0.05, 0.2
    rise = top * (1.0 - np.exp(-np.clip(time - 0.0195, 0.0, 0.6) / fill_s))
    felt = rise * np.exp(-np.clip(time - 0.6195, 0.0, None) / drain_s)
    excitation = Excitation(0.0, step_s, pressure)
    valved = Model(chain, find_effects(["pressure_lag:valve"])).simulate(np.append(published, [fill_s, drain_s]), excitation, frames)
    wanted, prompt = (Model(chain).simulate(published, replace(excitation, pressure=one), frames).phi for one in (felt, pressure))
    assert np.abs(valved.phi - wanted).max() < 0.02 * np.abs(prompt - wanted).max()
    even = Model(chain, find_effects(["pressure_lag:valve"])).simulate(np.append(published, [fill_s, fill_s]), excitation, frames)
    first = Model(chain, find_effects(["pressure_lag"])).simulate(np.append(published, fill_s), excitation, frames)
    assert np.abs(even.phi - first.phi).max() < 0.02 * np.abs(prompt - first.phi).max()


def test_what_is_evaluated_once_a_run_costs_no_compiling(actuator):
    """Line, clamp and the order of effects change nothing that is compiled; every parameter stands under its name."""
    alone, lagged, turned = (
        _model(actuator, *ids).law
        for ids in (("drag", "maxwell"), ("pressure_lag", "maxwell", "drag"), ("maxwell", "payload", "drag"))
    )
    assert lagged.loops == turned.loops == alone.loops != _model(actuator, "drag").law.loops
    assert alone.parameters[7:] == ("drag.c", "maxwell.k1", "maxwell.T") and lagged.parameters[10:] == ("pressure_lag.T",)
    assert _model(actuator, "drag").law.loops.joint_law is _model(actuator, "base_rotation").law.loops.joint_law


def test_the_order_of_effects_does_not_change_the_law(actuator, published):
    """What is lagged is lagged in all that is made of the pressure."""
    bends = []
    for names in (["pressure_lag:second_order", "virtual_work"], ["virtual_work", "pressure_lag:second_order"]):
        model = Model(Chain.tube(actuator, 8), find_effects(names), tolerance=1e-12)
        excitation = Excitation(0.0, 1e-3, np.r_[np.zeros(20), np.full(200, 1e5)])
        motion = model.simulate(_parameters(model, published, _present), excitation, np.array([0.05, 0.1]))
        assert motion.ok, motion.message
        bends.append(motion.phi[:, -1])
    np.testing.assert_allclose(bends[0], bends[1], rtol=1e-9)


@pytest.mark.parametrize("name", ["drag", "payload", "camera_scale"])
def test_an_effect_of_the_whole_tube_has_no_joint(actuator, name):
    with pytest.raises(InputError, match=f"'{name}@2': acts on the whole tube"):
        Model(Chain.tube(actuator, 4), find_effects([name]), at={name: 2})
