"""What comes out of the engine: the frames of a run, and a steady state."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.excitation import Excitation
from rfea_vision.dynamics.system import BLOWN_UP, NOT_CONVERGED, OK


@dataclass(frozen=True)
class Motion:
    """What came out of a run. A failed run says so in `status` and `message`; its arrays are not to be used.

    phi : (frames, n + 1) absolute angles, index 0 the clamp (rad); rate : the same per second
    sensitivity : (frames, n + 1, p) d phi / d free parameter; states : (frames, n, m) at the end of the step
    steps : that were taken; more than the excitation has where some had to be cut
    pivot : how far outside the hinge line the clamp turns (m), and the derivatives of that by the free parameters
    """

    status: int
    message: str
    phi: FloatArray
    rate: FloatArray
    states: FloatArray
    sensitivity: FloatArray
    free: NDArray[np.int64]
    newton_iterations: int = 0
    pivot: FloatArray = field(default_factory=lambda: np.zeros(1))
    steps: int = 0

    @property
    def ok(self) -> bool:
        """Whether the run came to its end; else its arrays are not to be used."""
        return self.status == OK

    @property
    def theta(self) -> FloatArray:
        """Joint angles (frames, n) in rad."""
        return np.diff(self.phi, axis=1)


@dataclass(frozen=True)
class Steady:
    """A steady state: `found` is False where there is none up to the asked pressure (`pressure` is then the last one reached)."""

    found: bool
    phi: FloatArray
    states: FloatArray
    sensitivity: FloatArray
    state_sensitivity: FloatArray
    pressure: float
    stability: float
    fallen: int = 0  # steps that it took to come to rest where it fell


def why_it_failed(status: int, done: int, taken: int, excitation: Excitation) -> str:
    """When a run failed, where in the log, and why."""
    time_s = excitation.start_s + done * excitation.step_s
    reasons = {
        NOT_CONVERGED: "no step is short enough for what happens there",
        BLOWN_UP: "the motion grows without end",
    }
    return (
        f"the simulation failed at {time_s:.3f} s of the log, at {excitation.pressure[done] / 1e3:.1f} kPa, after {taken} steps: "
        f"{reasons.get(status, 'for no known reason')}"
    )
