"""The contract that every effect keeps: nested in the base model, exact derivatives, finite over its bounds."""

import numpy as np
import pytest

from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.effects.catalogue import catalogue

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
    row = model.law.time_shift(par, model._constants, 0.0)[0]
    motion = model.simulate(par, excitation, frames + float(row[0]) * 0, free)
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


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_changes_something_it_says_it_changes(name, actuator, published, excitation, frames):
    effect = catalogue()[name]
    hooks = [
        "outer_radius",
        "rubber_volume",
        "rest_angle",
        "stiffness",
        "damping",
        "hydraulic_torque",
        "joint_torque",
        "inertia",
        "added_mass",
        "gravity",
        "body_force",
        "base_compliance",
        "felt_pressure",
        "line_time_constant",
        "flow_resistance",
        "flow_inertance",
        "observed_position",
        "time_shift",
    ]
    assert any(effect.overrides(hook) for hook in hooks)
    assert effect.title and effect.reference and effect.shows and effect.mistaken_for and effect.split_by
    for spec in effect.parameters.values():
        assert spec.lower < spec.upper and spec.lower <= spec.start <= spec.upper
        if spec.absent is None:
            assert spec.grid
    if effect.overrides("observed_position") or effect.overrides("time_shift"):
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
