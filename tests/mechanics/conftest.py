import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.dynamics.parameters import PUBLISHED
from rfea_vision.dynamics.simulation import Excitation


@pytest.fixture(scope="session")
def actuator() -> Actuator:
    return Actuator()


@pytest.fixture(scope="session")
def published() -> np.ndarray:
    return PUBLISHED["8-DoF"].vector()


@pytest.fixture(scope="session")
def excitation() -> Excitation:
    """Rise, hold, partial fall, reversal: 2 s at 1 kHz."""
    time = np.arange(0, 2.0, 1e-3)
    knots = [0, 0.1, 0.5, 0.9, 1.2, 1.4, 1.7, 2.0]
    pressure = np.interp(time, knots, [10e3, 10e3, 180e3, 180e3, 90e3, 90e3, 150e3, 60e3])
    return Excitation.from_log(time, pressure, 0.0, 1.99)


@pytest.fixture(scope="session")
def frames() -> np.ndarray:
    return np.arange(0.0, 1.98, 1 / 60)
