"""The tube in real time: one step of fixed length per call, at a cost that does not depend on the motion.

Newton's method takes the same number of iterations in every stage of every step, two stages a step. Nothing is allocated
in a step. What the last iteration still changed is handed back, so that a controller knows what a step is worth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import float64, int64, njit
from numba.core import cgutils, types
from numba.experimental.function_type import _get_jit_address, _get_wrapper_address
from numba.extending import intrinsic

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.integration import STAGES, Stages, keep_stage, start_stage
from rfea_vision.dynamics.line import scalar
from rfea_vision.dynamics.newton import linearise, move, newton_step
from rfea_vision.dynamics.shape import centre_line
from rfea_vision.dynamics.simulation import TABLEAUX, Model
from rfea_vision.dynamics.system import (
    FORCE_LAW,
    INDEX,
    JOINT_LAW,
    MATRIX,
    OM,
    OPTIONS,
    PHI,
    SYSTEM,
    VECTOR,
    WORK,
    Laws,
    allocate,
    copy_rows,
)
from rfea_vision.errors import DataError, InputError

NEWTON_ITERATIONS = 3  # default: every step takes as long as any other
SETTLED = 1e-5  # rad; a last change above it is no solution


def _at(law_type):
    """Return a function for compiled code that makes a law of `law_type` from its two addresses."""

    @intrinsic
    def law_at(typing_context, jit_address, c_address):
        def generate(context, builder, signature, arguments):
            law = cgutils.create_struct_proxy(law_type)(context, builder)
            pointer = context.get_value_type(types.voidptr)
            law.jit_addr, law.c_addr = (builder.inttoptr(address, pointer) for address in arguments)
            return law._getvalue()

        return law_type(int64, int64), generate

    return law_at


# The compiler supplies the first argument of an intrinsic, which a type checker cannot know.
_joint_law_at: Any = _at(JOINT_LAW)
_force_law_at: Any = _at(FORCE_LAW)


def _addresses(law, law_type) -> tuple[int, int]:
    """Addresses of a compiled law, looked up once: handing the law itself to compiled code costs 0.1 ms a time."""
    return _get_jit_address(law, law_type.signature), _get_wrapper_address(law, law_type.signature)


@njit(float64(INDEX, SYSTEM, WORK, STAGES, MATRIX, float64, VECTOR, VECTOR, int64), **OPTIONS)
def advance(addresses, system, work, stages, tableau, step_s, pressure, drive, iterations):
    """One step from the motion in `work.body` and `stages.z_old`; returns the last change of an angle (rad).

    addresses : of the law of the joints and of the body forces

    pressure (stages,) in the tube at the stage times; drive (n,) torques on the joints, or empty
    """
    joint_law, force_law = _joint_law_at(addresses[0], addresses[1]), _force_law_at(addresses[2], addresses[3])
    laws, body, last = Laws(joint_law, joint_law, force_law), work.body, 0.0
    for i in range(stages.old.shape[0]):
        stages.old[i, 0], stages.old[i, 1] = body[i, PHI], body[i, OM]
    for stage in range(tableau.shape[0]):
        change = np.inf
        s = start_stage(work, stages, tableau, stage, step_s)
        for _ in range(iterations):
            linearise(laws, system, work, pressure[stage], drive, s)
            newton_step(system, work, s)
            change = move(system, work, s, 1.0)
        last = max(last, change) if np.isfinite(change) else np.inf
        keep_stage(work, stages, stage, system.states, s)
    copy_rows(work.z, stages.z_old)
    return last


@dataclass(frozen=True)
class Moment:
    """The tube at the end of a step.

    tip_m : (2,) tip of the centre line in the rig frame, camera-right x; angle_rad : direction of the tip
    flow_m3_s : into the tube; last_change_rad : what the last Newton iteration changed; settled : below 1e-5 rad
    """

    tip_m: FloatArray
    angle_rad: float
    flow_m3_s: float
    last_change_rad: float

    @property
    def settled(self) -> bool:
        """Whether the last Newton iteration changed angles by less than `SETTLED` rad."""
        return self.last_change_rad < SETTLED


class Stepper:
    """A model that is stepped by whoever holds the clock.

    Parameters
    ----------
    model, par : tube and its parameters, SI
    step_s : length of a step
    newton_iterations : per stage; the step's cost is two times this many sweeps of the chain, always

    Raises
    ------
    DataError
        There is no static equilibrium at the pressure it is started with.
    """

    def __init__(
        self,
        model: Model,
        par: FloatArray,
        step_s: float = 1e-3,
        *,
        pressure_Pa: float = 0.0,
        newton_iterations: int = NEWTON_ITERATIONS,
    ) -> None:
        if model.law.chambers:
            raise InputError(f"effects at the chamber {model.law.chambers[0]}: in real time a tube has one pressure")
        if model.law.changes("stretch_time_constant"):
            raise InputError("a length that follows the pressure late has no step in real time; fit with `stretch` in its place")
        self.model, self.par, self.step_s = model, np.asarray(par, dtype=float), float(step_s)
        self._iterations = int(newton_iterations)
        self._system = model.system(self.par)
        self._lag_s = max(scalar(model.law.line_time_constant, self.par, model._constants)[0], 0.0)
        self._tableau = TABLEAUX[2]
        self._nodes = self._tableau.sum(axis=1)
        loops = model.law.loops
        self._laws = np.array([*_addresses(loops.joint_law, JOINT_LAW), *_addresses(loops.body_force, FORCE_LAW)])
        self._no_drive = np.zeros(0)
        self.start(pressure_Pa)

    def start(self, pressure_Pa: float) -> Moment:
        """Put the tube at rest in its static equilibrium at a pressure (Pa, gauge).

        Raises
        ------
        DataError
            If there is none.
        """
        rest = self.model.steady(self.par, pressure_Pa)
        if not rest.found:
            raise DataError(f"no static equilibrium at {pressure_Pa / 1e3:.1f} kPa; start from a lower pressure")
        n, m, count = self.model.chain.bodies, rest.states.shape[1], self._nodes.size
        self._work = allocate.py_func(self._system)
        self._work.body[: n + 1, PHI] = rest.phi
        self._stages = Stages(
            np.zeros((count, n + 1)),
            np.zeros((count, n + 1)),
            np.zeros((count, n, m)),
            np.zeros((n + 1, 2)),
            rest.states.copy(),
        )
        self._gauge = self._in_tube = self._sensed(pressure_Pa)
        return self._moment(0.0)

    def step(self, pressure_Pa: float) -> Moment:
        """Advance by one step; the pressure (Pa, gauge) is that at its end, linear since the last one."""
        gauge = self._sensed(pressure_Pa)
        course = self._course(gauge)
        last = advance(
            self._laws,
            self._system,
            self._work,
            self._stages,
            self._tableau,
            self.step_s,
            course,
            self._no_drive,
            self._iterations,
        )
        self._gauge, self._in_tube = gauge, float(course[-1])
        return self._moment(last)

    def _sensed(self, pressure_Pa: float) -> float:
        return float(self.model.law.felt_pressure(self.par, self.model._constants, pressure_Pa)[0][0])

    def _course(self, gauge: float) -> FloatArray:
        """Pressure in the tube at the stage times: linear at the sensor, behind it by the line's lag (exact)."""
        t, lag = self._nodes * self.step_s, self._lag_s
        slope = (gauge - self._gauge) / self.step_s
        if lag < 1e-9:
            return self._gauge + slope * t
        return self._gauge + slope * (t - lag) + (self._in_tube - self._gauge + slope * lag) * np.exp(-t / lag)

    def _moment(self, last: float) -> Moment:
        chain, body = self.model.chain, self._work.body
        phi, rate = body[: chain.bodies + 1, PHI], body[: chain.bodies + 1, OM]
        tip, none = np.empty((1, 1, 2)), np.empty((1, chain.bodies + 1, 0))
        tube = (float(chain.arc[0]), chain.offset, chain.polygon, float(self._system.line[3]), np.empty(0))
        centre_line(phi[None].copy(), none, *tube, np.ones(1), tip, np.empty((1, 1, 2, 0)))
        if self.model.law.changes("stretch"):
            tip *= 1.0 + float(self.model.law.stretch(self.par, self.model._constants, self._gauge)[0][0])
        if self.model.law.changes("line_shift"):
            shift = float(self.model.law.line_shift(self.par, self.model._constants, self._gauge)[0][0])
            tip[0, 0] += shift * np.array([np.cos(phi[-1]) - np.cos(phi[0]), np.sin(phi[0]) - np.sin(phi[-1])])
        tip[0, 0, 0] *= self.model.mirror
        return Moment(tip[0, 0], float(phi[-1]), float(self._system.volume_rate * (rate[-1] - rate[0])), float(last))
