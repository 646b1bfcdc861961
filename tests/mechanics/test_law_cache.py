"""What is kept of laws in a person's cache folder does not grow without end."""

import os
import shutil
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics import compilation
from rfea_vision.dynamics.parameters import PUBLISHED
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.effects.catalogue import find_effects, load_effect_file
from rfea_vision.effects.permission import name_files


def test_what_was_used_longest_ago_goes(tmp_path, monkeypatch):
    monkeypatch.setattr(compilation, "MOST_BYTES", 2000)
    (tmp_path / "__pycache__").mkdir()
    for age, name in enumerate(("law_new.py", "__pycache__/law_old.nbc", "law_older.py", "__pycache__/law_oldest.nbc")):
        (tmp_path / name).write_bytes(bytes(900))
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    os.utime(tmp_path / "law_older.py", (2e9, 1e9))  # written long ago, and used today
    compilation._derive((), tmp_path / "law_just_made.py")
    left = {path.name for path in tmp_path.rglob("*.*")}
    assert {"law_new.py", "law_older.py", "law_just_made.py"} <= left
    assert not {"law_old.nbc", "law_oldest.nbc"} & left


def test_of_two_that_want_a_law_at_once_one_derives_it(tmp_path, monkeypatch):
    pytest.importorskip("fcntl", reason="there are no such locks on Windows")
    compilation.compile_law()
    here, key = compilation._cache_folder(), compilation._key(())
    monkeypatch.setenv("RFEA_CACHE_DIR", str(tmp_path))
    derived = []

    def derive(_, path):
        derived.append(path)
        time.sleep(0.2)
        for file in (here / path.name, *(here / f"{loop}.py" for loop in compilation._load(here / path.name).LOOPS.values())):
            shutil.copy(file, path.parent)

    monkeypatch.setattr(compilation, "_derive", derive)
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: compilation._compile((), key), range(2))
    assert len(derived) == 1
    assert first.loops == second.loops


TWO_FORMS = """
import sympy as sp
from rfea_vision.effects.base import Effect, EffectParameter
from rfea_vision.effects.maxwell import Maxwell


class Mine(Effect):
    id = "mine"
    title = "Mine"
    reference = "none"
    parameters = {"c": EffectParameter("1", 0.0, -1.0, 1.0, 0.1, "strength")}

    def stiffness(self, joint, stiffness):
        return stiffness * (1 + self.c)


class Other(Mine):
    form = "other"

    def stiffness(self, joint, stiffness):
        return stiffness * (1 - self.c)
"""


def test_each_form_and_whatever_it_inherits_has_a_law_of_its_own(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(TWO_FORMS)
    name_files([path])
    mine, other = (effect() for effect in load_effect_file(path))  # and not the effect that the file imports
    assert compilation._key([mine]) != compilation._key([other])
    law = {effect.form: Model(Chain.tube(Actuator(), 2), (effect,)) for effect in (mine, other)}
    par = np.append(PUBLISHED["8-DoF"].vector(), 0.3)
    bends = {form: model.steady(par, 1e5).phi[-1] for form, model in law.items()}
    assert abs(bends["other"]) > abs(bends[""])
    kinds = find_effects(["maxwell", "maxwell:logarithmic", "mullins", "mullins:linear"])
    assert len({compilation._key([kind]) for kind in kinds}) == 4


def test_a_law_that_inherits_changes_with_what_it_inherits_from(monkeypatch):
    (second,) = find_effects(["maxwell_2"])
    before = compilation._key([second])
    monkeypatch.setattr(type(second).__mro__[1], "source_text", "another law", raising=False)
    assert compilation._key([second]) != before


SHARED = """
from rfea_vision.effects.base import Effect, EffectParameter


class Common(Effect):
    title = "Mine"
    reference = "none"
    parameters = {"c": EffectParameter("1", 1.0, 0.5, 2.0, 1.1, "strength")}


class Mine(Common):
    id = "mine"

    def felt_pressure(self, pressure):
        return self.c * pressure
"""


def test_effects_of_one_file_may_share_what_is_none_and_stand_at_a_chamber(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(SHARED)
    name_files([path])
    chain, base = Chain.tube(Actuator(), 2), PUBLISHED["8-DoF"].vector()
    mine = Model(chain, find_effects(["mine"], [path])).steady(np.append(base, 1.2), 1e5)
    assert np.isclose(mine.phi[-1], Model(chain).steady(base, 1.2e5).phi[-1], rtol=1e-12)
    (placed,) = find_effects(["mine@left"], [path])
    before = compilation._key([placed])
    path.write_text(SHARED.replace("self.c *", "self.c**2 *"))
    assert compilation._key(find_effects(["mine@left"], [path])) != before
