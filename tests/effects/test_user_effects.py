"""A user's own effect: what is wrong with it is said before anything runs; what is right with it works."""

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.parameters import PUBLISHED
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.base import HOOKS, Effect
from rfea_vision.effects.catalogue import catalogue, find_effects, load_effect_file
from rfea_vision.effects.permission import name_files
from rfea_vision.effects.typeset import typeset
from rfea_vision.effects.validation import validate
from rfea_vision.errors import InputError

TEMPLATE = """
import sympy as sp
from rfea_vision.effects.base import Effect, EffectParameter

class Mine(Effect):
    id = "mine"
    title = "Mine"
    reference = "none"
    parameters = {{"c": EffectParameter("{unit}", 0.0, -1.0, 1.0, 0.1, "strength")}}

    def {hook}:
        return {law}
"""


def _write(tmp_path, law, unit="1/rad^2", hook="stiffness(self, joint, stiffness)"):
    path = tmp_path / "mine.py"
    path.write_text(TEMPLATE.format(law=law, unit=unit, hook=hook))
    name_files([path])
    return path


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_the_catalogue_keeps_its_own_rules(name):
    validate(catalogue()[name]())
    assert typeset(catalogue()[name]())["latex"]


@pytest.mark.parametrize(
    ("law", "unit", "words"),
    [
        ("stiffness * (1 + self.c * joint.theta)", "1/m", "units"),
        ("stiffness + self.c", "1", "units"),
        ("sp.Piecewise((stiffness, joint.theta > joint.pressure), (2 * stiffness, True))", "1", "units"),
        ("stiffness * sp.exp(joint.pressure)", "1", "units"),
        ("stiffness * joint.theta * joint.rate", "1", "unit"),
        ("stiffness * (1 + self.c * sp.Symbol('whatever'))", "1", "whatever"),
        ("stiffness * (1 + self.d)", "1", "'d'"),
        ("stiffness * (1 + self.c * joint.positions[3])", "1", "positions"),
        ("stiffness * (1 + self.c * sp.Function('f')(joint.theta))", "1", "differentiated"),
        ("'stiff'", "1", "stiff"),
        ("1 / 0", "1", "ZeroDivisionError"),
        ("stiffness * (1 + self.c)", "flurps", "flurps"),
        ("stiffness * (1 + self.c * joint.pressure)", "1/MPa", "of which that is 1e-06, and display='1/MPa'"),
    ],
)
def test_a_faulty_law_is_named_in_one_sentence(tmp_path, law, unit, words):
    path = _write(tmp_path, law, unit)
    with pytest.raises(InputError) as caught:
        load_effect_file(path)
    message = str(caught.value)
    assert words in message and "mine" in message and "\n" not in message


def test_an_effect_with_a_misspelt_hook_changes_nothing_and_is_refused(tmp_path):
    path = _write(tmp_path, "stiffness * (1 + self.c)", "1")
    path.write_text(path.read_text().replace("def stiffness(", "def stifness("))
    with pytest.raises(InputError, match="changes nothing, as it has no hook; 'stifness' is none, did you mean 'stiffness'"):
        load_effect_file(path)


def test_an_effect_of_ones_own_takes_the_id_of_no_other(tmp_path):
    path = _write(tmp_path, "stiffness * (1 + self.c)", "1")
    path.write_text(path.read_text().replace('id = "mine"', 'id = "maxwell"'))
    with pytest.raises(InputError, match="effect maxwell: the catalogue has one of this id; give yours another"):
        find_effects(["maxwell"], [path])


def test_a_file_without_an_effect(tmp_path):
    path = tmp_path / "empty.py"
    path.write_text("x = 1\n")
    name_files([path])
    with pytest.raises(InputError, match="declares no effect"):
        load_effect_file(path)
    with pytest.raises(InputError, match="rfea effects new"):
        load_effect_file(tmp_path / "absent.py")


def test_a_sound_law_runs_and_equals_the_built_in_one(tmp_path):
    path = _write(tmp_path, "stiffness * (1 + self.c * joint.tube_angle**2)")
    time = np.arange(0, 0.6, 1e-3)
    excitation = Excitation.from_log(time, np.interp(time, [0, 0.3], [0, 1.5e5]), 0, 0.59)
    frames = np.linspace(0, 0.58, 20)
    motions = []
    for effects in (find_effects(["mine"], [path]), find_effects(["nonlinear_stiffness"])):
        model = Model(Chain.tube(Actuator(), 8), effects)
        par = np.append(PUBLISHED["8-DoF"].vector(), 0.05)
        motions.append(model.simulate(par, excitation, frames).phi)
    assert np.abs(motions[0]).max() > 0.3
    np.testing.assert_allclose(motions[0], motions[1], atol=1e-12)


WRONG = {"base_pivot": "self.c", "line_shift": "self.c * pressure", "time_shift": "self.c", "flow_inertance": "self.c"}


@pytest.mark.parametrize("hook", sorted(WRONG))
def test_units_of_hooks_that_are_evaluated_once_a_run_are_checked(tmp_path, hook):
    declared = f"{hook}(self, {', '.join(HOOKS[hook].arguments)})" if HOOKS[hook].arguments else f"{hook}(self)"
    with pytest.raises(InputError, match=f"{hook} has the unit"):
        load_effect_file(_write(tmp_path, WRONG[hook], "1", declared))


@pytest.mark.parametrize("hook", HOOKS)
def test_every_hook_says_its_unit_and_how_it_is_typeset(hook):
    known = HOOKS[hook]
    assert known.units and all("{" + str(k) + "}" in known.latex for k in range(min(len(known.units), 1)))
    assert getattr(Effect, hook).__doc__
