"""The exported C is the Python step to rounding, for every effect that a tube can have, and depends on nothing."""

import ctypes
import re
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.parameters import PUBLISHED, scaled
from rfea_vision.dynamics.realtime import Stepper
from rfea_vision.dynamics.simulation import Chain, Excitation, Model
from rfea_vision.effects.catalogue import catalogue
from rfea_vision.errors import DataError, InputError
from rfea_vision.export import c_files
from rfea_vision.export.fmu import _description
from rfea_vision.fitting.camera_view import seen_by_camera
from tests.hostile import PAYLOADS

TIME = np.arange(0, 0.8, 1e-3)
PRESSURE = np.interp(TIME, [0, 0.05, 0.2, 0.4, 0.5, 0.8], [10e3, 10e3, 180e3, 180e3, 60e3, 120e3])
OUTSIDE = {"camera_scale", "camera_roll", "plane_tilt", "time_offset", "clock_drift"}

# Together they touch every part of the runtime: states, body forces, a compliant clamp, a line, one joint only.
MODELS = {
    "bare": (8, "middle", (), {}),
    "one": (1, "start", ("maxwell",), {}),
    "memory": (8, "middle", ("maxwell", "hysteresis", "mullins"), {}),
    "forces": (6, "start", ("contact", "drag", "payload", "gravity_tilt"), {}),
    "line": (6, "middle", ("fluid_inertia", "fluid_damping", "pressure_lag", "pressure_gain", "pressure_offset"), {}),
    "clamp": (5, "middle", ("base_rotation", "maxwell", "fluid_damping", "drag", "variable_mass", "com_offset"), {}),
    "laws": (4, "middle", ("nonlinear_stiffness", "pressure_stiffening", "stiffness_profile", "damping_profile"), {}),
    "rest": (4, "start", ("radial_expansion", "compressibility", "virtual_work", "nonlinear_damping"), {}),
    "place": (6, "middle", ("rest_curvature", "coulomb"), {"rest_curvature": 3}),
}


def _model(name, **options):
    segments, joints, ids, at = MODELS[name]
    model = Model(Chain.tube(Actuator(), segments, joints), tuple(catalogue()[i]() for i in ids), at=at, order=2, **options)
    base = scaled(PUBLISHED["8-DoF"].vector(), 8, segments)
    par = dict(zip(model.names, base, strict=False))
    for effect in model.effects:
        for key, spec in effect.parameters.items():
            par[f"{effect.id}.{key}"] = (spec.grid or (spec.start,))[0] if spec.absent is None else spec.start
    if "radial_expansion" in ids:
        par["radial_expansion.c"] = 2e-7
    if "coulomb" in ids:
        par["coulomb.w"] = 0.1
    return model, np.array([par[key] for key in model.names])


class Exported:
    """The two functions of a library, on a state of this side."""

    def __init__(self, library, name):
        self.state, self.output = (ctypes.c_double * 20000)(), (ctypes.c_double * 4)()
        self._init, self._step = getattr(library, f"{name}_init"), getattr(library, f"{name}_step")
        for function in (self._init, self._step):
            function.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]

    def init(self, pressure):
        return self._init(self.state, pressure, self.output)

    def step(self, pressure):
        return self._step(self.state, pressure, self.output)


@pytest.mark.parametrize("name", MODELS)
def test_c_is_python(name, compiled):
    model, par = _model(name)
    exported = Exported(compiled(*c_files(model, par, name, 1e-3), name), name)
    stepper = Stepper(model, par, pressure_Pa=PRESSURE[0])
    assert exported.init(PRESSURE[0]) == 0
    tips, seen = [], []
    for pressure in PRESSURE[1:]:
        moment = stepper.step(pressure)
        assert exported.step(pressure) == int(not moment.settled)
        tips.append([*moment.tip_m, moment.angle_rad])
        seen.append(list(exported.output)[:3])
        assert exported.output[3] == pytest.approx(moment.flow_m3_s, rel=1e-6, abs=1e-14)
    assert np.abs(np.array(seen) - tips).max() < 1e-11  # m and rad
    assert np.ptp(np.array(seen)[:, 0]) > 0.01


@pytest.mark.parametrize("name", ["bare", "memory", "line"])
def test_step_is_the_simulation(name):
    """Three Newton iterations a stage are the full solution within a micrometre."""
    model, par = _model(name)
    motion = model.simulate(par, Excitation(0.0, 1e-3, PRESSURE), TIME[:-1])
    reference = model.centre_line(motion, np.array([1.0]))[0][:, 0]
    stepper = Stepper(model, par, pressure_Pa=PRESSURE[0])
    tips = np.array([stepper.step(pressure).tip_m for pressure in PRESSURE[1:]])
    assert np.abs(tips[:-1] - reference[1:]).max() < 1e-6


def test_the_tip_of_a_tube_that_widens_is_where_the_camera_sees_it():
    model, par = _model("rest")
    motion = model.simulate(par, Excitation(0.0, 1e-3, PRESSURE), TIME[:-1])
    seen = seen_by_camera(model, par, motion, np.ones(1), [], PRESSURE[:-1])[0][:, 0]
    assert np.abs(seen - model.centre_line(motion, np.ones(1))[0][:, 0])[:300].max() > 5e-5
    stepper = Stepper(model, par, pressure_Pa=PRESSURE[0])
    tips = np.array([stepper.step(pressure).tip_m for pressure in PRESSURE[1:]])
    assert np.abs(tips[:300] - seen[1:301]).max() < 1e-6  # later it whips round faster than three iterations follow


def test_every_effect_of_a_tube_is_covered_and_the_others_are_refused():
    covered = {effect for _, _, ids, _ in MODELS.values() for effect in ids}
    left = {name for name in catalogue() if name not in covered | OUTSIDE}
    for name in left:  # whatever joins the catalogue later must at least print as C
        effect = catalogue()[name]()
        model = Model(Chain.tube(Actuator(), 4), (effect,))
        par = [*PUBLISHED["8-DoF"].vector(), *(s.start for s in effect.parameters.values())]
        c_files(model, np.array(par), "late", 1e-3)
    for name in OUTSIDE:
        effect = catalogue()[name]()
        model = Model(Chain.tube(Actuator(), 4), (effect,))
        par = np.zeros(len(model.names))
        with pytest.raises(InputError, match=f"'{name}' belongs to the camera or the clocks"):
            c_files(model, par, "tube", 1e-3)


def test_source_depends_on_nothing_and_compiles_without_a_warning(cc, tmp_path):
    model, par = _model("memory")
    header, source = c_files(model, par, "tube", 1e-3)
    assert set(re.findall(r"#include (\S+)", header + source)) == {"<math.h>", "<string.h>", '"tube.h"'}
    assert not re.search(r"\b(malloc|calloc|realloc|free|printf)\b", source)
    (tmp_path / "tube.h").write_text(header)
    (tmp_path / "tube.c").write_text(source)
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-c", "-o", str(tmp_path / "tube.o")]
    done = subprocess.run([cc, *strict, str(tmp_path / "tube.c")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_no_equilibrium_is_said(compiled):
    model, par = _model("bare")
    exported = Exported(compiled(*c_files(model, par, "tube", 1e-3), "tube"), "tube")
    assert exported.init(270e3) == 0 and exported.init(500e3) == 1
    with pytest.raises(DataError, match=r"500\.0 kPa"):
        Stepper(model, par, pressure_Pa=500e3)


def test_tube_that_bends_right_is_mirrored(compiled):
    model, par = _model("bare", mirror=-1.0)
    exported = Exported(compiled(*c_files(model, par, "tube", 1e-3), "tube"), "tube")
    assert exported.init(200e3) == 0
    assert exported.output[0] > 0.05
    assert Stepper(model, par, pressure_Pa=200e3).step(200e3).tip_m[0] == pytest.approx(exported.output[0], abs=1e-10)


def test_name_must_be_one_that_c_accepts():
    model, par = _model("bare")
    with pytest.raises(InputError, match="'2 tubes' is no identifier"):
        c_files(model, par, "2 tubes", 1e-3)


def test_what_hostile_campaigns_are_called_stays_in_a_comment(cc, tmp_path):
    text = " ".join([*PAYLOADS, "??/", "// \\\n int evil;", "ends in \\"])
    header, source = c_files(*_model("bare"), "tube", 1e-3, text)
    (tmp_path / "tube.h").write_text(header, encoding="utf-8")
    (tmp_path / "tube.c").write_text(source, encoding="utf-8")
    strict = ["-std=c99", "-trigraphs", "-fsyntax-only", "-Wall", "-Werror", "-Wno-bidi-chars"]
    done = subprocess.run(
        [cc, *strict, str(tmp_path / "tube.c")], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.stderr == "" and done.returncode == 0
    bare = re.sub(r"/\*.*?\*/", "", header + source, flags=re.DOTALL)
    assert "evil" not in bare and "window" not in bare
    assert ElementTree.fromstring(_description("tube", "{0}", 1e-3, text)).attrib["modelName"] == "tube"


def test_a_name_that_is_no_identifier_is_refused():
    model, par = _model("bare")
    for name in ("a b", "1a", "", "a;b", "größe", "a\nb", "x/../y", "int"):
        with pytest.raises(InputError, match="is no identifier in C"):
            c_files(model, par, name, 1e-3)
