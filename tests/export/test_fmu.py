"""The FMU, loaded as a master would load it, moves as the Python step does."""

import ctypes
import xml.etree.ElementTree as ElementTree
import zipfile

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.parameters import PUBLISHED
from rfea_vision.dynamics.realtime import Stepper
from rfea_vision.dynamics.simulation import Chain, Model
from rfea_vision.export import fmu_content

ALLOCATE, RELEASE = (
    ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t, ctypes.c_size_t),
    ctypes.CFUNCTYPE(None, ctypes.c_void_p),
)


class Callbacks(ctypes.Structure):
    _fields_ = [
        ("logger", ctypes.c_void_p),
        ("allocate", ALLOCATE),
        ("release", RELEASE),
        ("finished", ctypes.c_void_p),
        ("environment", ctypes.c_void_p),
    ]


class Master:
    """As much of a co-simulation master as the test needs."""

    def __init__(self, folder):
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        co_simulation = root.find("CoSimulation")
        assert root.get("fmiVersion") == "2.0" and co_simulation is not None
        self.variables = {
            item.get("name"): int(item.get("valueReference")) for item in root.iterfind("ModelVariables/ScalarVariable")
        }
        (library,) = (folder / "binaries").glob("*/*")
        assert library.stem == co_simulation.get("modelIdentifier")
        self.library = ctypes.CDLL(str(library))
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        self.library.fmi2GetVersion.restype = ctypes.c_char_p
        self.held = {}
        self.callbacks = Callbacks(None, ALLOCATE(self._allocate), RELEASE(self._release), None, None)
        guid = root.get("guid").encode()
        self.instance = ctypes.c_void_p(
            self.library.fmi2Instantiate(b"tube", 1, guid, b"", ctypes.byref(self.callbacks), 0, 0)
        )
        assert self.instance.value
        wrong = self.library.fmi2Instantiate(b"tube", 1, b"{another}", b"", ctypes.byref(self.callbacks), 0, 0)
        assert not wrong

    def _allocate(self, count, size):
        buffer = ctypes.create_string_buffer(count * size)
        self.held[ctypes.addressof(buffer)] = buffer
        return ctypes.addressof(buffer)

    def _release(self, address):
        del self.held[address]

    def set(self, name, value):
        reference, number = ctypes.c_uint(self.variables[name]), ctypes.c_double(value)
        return self.library.fmi2SetReal(
            self.instance, ctypes.byref(reference), ctypes.c_size_t(1), ctypes.byref(number)
        )

    def get(self, name):
        reference, number = ctypes.c_uint(self.variables[name]), ctypes.c_double()
        size = ctypes.c_size_t(1)
        assert self.library.fmi2GetReal(self.instance, ctypes.byref(reference), size, ctypes.byref(number)) == 0
        return number.value

    def begin(self, pressure):
        assert self.set("pressure_Pa", pressure) == 0
        numbers = (ctypes.c_int(0), ctypes.c_double(0), ctypes.c_double(0), ctypes.c_int(0), ctypes.c_double(1))
        assert self.library.fmi2SetupExperiment(self.instance, *numbers) == 0
        assert self.library.fmi2EnterInitializationMode(self.instance) == 0
        return self.library.fmi2ExitInitializationMode(self.instance)

    def step(self, time, length):
        return self.library.fmi2DoStep(self.instance, ctypes.c_double(time), ctypes.c_double(length), ctypes.c_int(1))


@pytest.fixture
def model():
    return Model(Chain.tube(Actuator(), 8))


@pytest.fixture
def master(cc, model, tmp_path):
    (tmp_path / "tube.fmu").write_bytes(fmu_content(model, PUBLISHED["8-DoF"].vector(), "tube", 1e-3, "a <tube>"))
    with zipfile.ZipFile(tmp_path / "tube.fmu") as archive:
        assert {"sources/tube.c", "sources/tube.h", "sources/fmu.c"} < set(archive.namelist())
        archive.extractall(tmp_path)
    return Master(tmp_path)


def test_fmu_moves_as_python(master, model):
    """Communication steps of 2 ms: two steps of the model, the pressure linear over both."""
    assert master.library.fmi2GetVersion() == b"2.0"
    stepper = Stepper(model, PUBLISHED["8-DoF"].vector(), pressure_Pa=20e3)
    assert master.begin(20e3) == 0
    before = 20e3
    for index, pressure in enumerate(np.linspace(20e3, 200e3, 60)):
        assert master.set("pressure_Pa", pressure) == 0
        assert master.step(index * 2e-3, 2e-3) == 0
        stepper.step((before + pressure) / 2)
        moment = stepper.step(pressure)
        before = pressure
        seen = [master.get(name) for name in ("tip_x_m", "tip_y_m", "angle_rad")]
        assert seen == pytest.approx([*moment.tip_m, moment.angle_rad], abs=1e-11)
    assert master.get("angle_rad") > 0.3 and master.get("last_change_rad") < 1e-5
    # Reset and begin again: the same start.
    assert master.library.fmi2Reset(master.instance) == 0
    assert master.begin(20e3) == 0
    rest = Stepper(model, PUBLISHED["8-DoF"].vector(), pressure_Pa=20e3).step(20e3)
    assert master.get("tip_y_m") == pytest.approx(rest.tip_m[1], abs=1e-10)
    # A master may ask before initialisation has ended.
    assert master.library.fmi2Reset(master.instance) == 0
    assert master.set("pressure_Pa", 20e3) == 0
    assert master.get("tip_y_m") == pytest.approx(rest.tip_m[1], abs=1e-10)
    master.library.fmi2FreeInstance(master.instance)
    assert not master.held


def test_fmu_refuses_what_it_cannot_do(master):
    assert master.begin(500e3) == 3  # fmi2Error: no equilibrium there
    assert master.begin(0.0) == 0
    assert master.step(0.0, 1.5e-3) == 3  # not a multiple of the step
    assert master.set("tip_x_m", 0.0) == 3  # an output
