"""The plant: a MuJoCo chain driven by pressure, integrated so finely that it hides no effect of its own.

MuJoCo computes the mass matrix and the bias forces; the joints' torques are stiff (b/I is 5e4 per s at eight joints),
so a two-stage, L-stable, second-order implicit Runge-Kutta method (SDIRK2; Alexander, SIAM J. Numer. Anal. 14, 1977,
doi:10.1137/0714068) takes the steps. Pressure that the tube feels is that of the line, through gain, zero and lag.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.signal import lfilter

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator
from rfea_vision.errors import DataError
from rfea_vision.twin.chain import HingedRods
from rfea_vision.twin.laws import JointLaw, Memory
from rfea_vision.twin.options import BaseParameters

# np.linalg.solve without its checks, called at every Newton step
_solve: Any = get_lapack_funcs("gesv", dtype=np.float64)

GAMMA = 1 - math.sqrt(0.5)
TOLERANCE = 1e-6  # rad/s: the last Newton change that is not followed by another look; it is still applied


@dataclass(frozen=True)
class PlantMotion:
    """How the plant moved.

    Attributes
    ----------
    time_s : (T,) on the log's clock
    theta, rate : (T, n) joint angles in rad and their speeds
    clamp_angle : (T,) rad, the turn of a compliant clamp
    pressure_Pa : (T,) felt by the tube
    outer_radius : (T,) m
    """

    time_s: FloatArray
    theta: FloatArray
    rate: FloatArray
    clamp_angle: FloatArray
    pressure_Pa: FloatArray
    outer_radius: FloatArray


class Plant:
    """A tube with known physics.

    Parameters
    ----------
    actuator : dimensions at rest
    base : seven parameters for n = 8
    hidden : effect parameters in SI units
    joints, layout : see `TwinOptions`; 48 joints are a tube to a fiftieth of a millimetre (tests/twin/test_plant.py)
    seed : of the gusts of `fan`
    gravity_deg : direction of gravity from down, positive in the direction of the bend; None for none in the plane
    """

    def __init__(
        self,
        actuator: Actuator,
        base: BaseParameters,
        hidden: dict[str, float],
        *,
        joints: int = 48,
        layout: Literal["middle", "start"] = "middle",
        seed: int = 0,
        gravity_deg: float | None = 0.0,
    ) -> None:
        self.law = JointLaw(actuator, base, joints, hidden)
        self.chain = HingedRods(actuator, joints, layout, self.law.all_hidden, gravity_deg)
        self.actuator, self.joints = actuator, joints
        self.layout: Literal["middle", "start"] = layout
        self._clamp = slice(1, None) if self.chain.has_base else slice(None)
        self._gusts = _gusts(seed)

    def felt_pressure(self, time_s: FloatArray, pressure_Pa: FloatArray) -> FloatArray:
        """Pressure (grid,) in Pa in the tube on the same, even time grid: gain and zero of the sensor, lag of the line."""
        get = self.law.hidden
        felt = get("pressure_gain.g") * pressure_Pa + get("pressure_offset.p0")
        lag = get("pressure_lag.T")
        if lag <= 0:
            return felt
        # exact response of a first-order line to a piecewise linear input, at rest before it
        step = time_s[1] - time_s[0]
        decay = np.exp(-step / lag)
        mean = (1 - decay) * lag / step
        return lfilter([1 - mean, mean - decay], [1.0, -decay], felt, zi=[mean * felt[0]])[0]

    def run(
        self,
        pressure_Pa: Callable[[FloatArray], FloatArray],
        start_s: float,
        end_s: float,
        step_s: float = 0.001,
        progress: Callable[[int, int], None] | None = None,
        supply: Callable[[float, float], float] | None = None,
    ) -> PlantMotion:
        """Move from the static equilibrium at the first pressure until `end_s`.

        Parameters
        ----------
        pressure_Pa : felt pressure (time,) as a function of times (time,) in s
        step_s : of the integrator; at 1 ms the tip is right to a fiftieth of a millimetre (tests/twin/test_plant.py)
        supply : felt pressure at the end of a step, by its time and the flow into the tube (m^3/s) before it; where it
            is given, `pressure_Pa` counts at the start only

        Raises
        ------
        DataError
            If there is no equilibrium to start from, or a step cannot be solved.
        """
        count = int(np.ceil((end_s - start_s) / step_s - 1e-9))
        time = start_s + step_s * np.arange(count + 1, dtype=np.float64)
        stage_pressure = pressure_Pa(time[:-1] + GAMMA * step_s)
        pressure = pressure_Pa(time)
        q = self.equilibrium(float(pressure[0]))
        v = np.zeros_like(q)
        memory = self.law.relaxed(q[self._clamp])
        angles, rates = np.empty((2, count + 1, q.size))
        angles[0], rates[0] = q, v
        acceleration = np.zeros_like(q)
        small, large = GAMMA * step_s, (1 - GAMMA) * step_s
        for index in range(count):
            now, later = time[index], time[index + 1]
            if supply is not None:
                flow = np.pi * self.actuator.outer_radius**3 * float(v[self._clamp].sum())
                pressure[index + 1] = supply(later, flow)
                stage_pressure[index] = pressure[index] + GAMMA * (pressure[index + 1] - pressure[index])
            first = self._stage(q, v, memory, small, float(stage_pressure[index]), now + small, acceleration)
            _, v1, a1, memory1 = first
            grown = _extrapolate(memory, memory1, large / small)
            q, v, acceleration, memory = self._stage(
                q + large * v1, v + large * a1, grown, small, float(pressure[index + 1]), later, a1
            )
            angles[index + 1], rates[index + 1] = q, v
            if progress is not None and index % 500 == 0:
                progress(index, count)
        law = self.law
        return PlantMotion(
            time_s=time,
            theta=angles[:, self._clamp],
            rate=rates[:, self._clamp],
            clamp_angle=angles[:, 0].copy() if self.chain.has_base else np.zeros(count + 1),
            pressure_Pa=pressure,
            outer_radius=np.broadcast_to(law.felt_outer_radius(pressure), pressure.shape).copy(),
        )

    def _stage(
        self, q0: FloatArray, v0: FloatArray, memory0: Memory, step: float, p: float, time: float, guess: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, Memory]:
        """Solve M(q) a = F(q, v) with v = v0 + step a and q = q0 + step v, by Newton on v."""
        wind, shake = self._weather(time)

        def equation(v: FloatArray) -> tuple[FloatArray, FloatArray]:
            q, change = q0 + step * v, v - v0
            inertia, bias = self.chain.inertia_and_bias(q, v)
            torque, slope, coupling = self._torque(q, v, change / step, memory0, step, p, time)
            residual = inertia @ change / step + bias - torque
            outside = self.chain.outside_forces(q, v, wind, shake)
            if outside is not None:
                residual -= outside
            matrix = inertia / step
            matrix.reshape(-1)[:: matrix.shape[0] + 1] -= slope
            if coupling is not None:
                matrix[self._clamp, self._clamp] -= coupling[:, None]
            return residual, matrix

        v = v0 + step * guess
        residual, matrix = equation(v)
        for _ in range(60):
            change = _solve(matrix, residual)[2]
            size = float(np.abs(change).max())
            if size < TOLERANCE:
                break
            if not math.isfinite(size):
                raise DataError(f"simulate: the plant blew up at {time:.3f} s; use a smaller step_s or milder effects")
            # dry friction is nearly a jump: walk down rather than leap over it
            weight = 1 / matrix.diagonal()
            before, share = float(np.abs(weight * residual).sum()), 1.0
            while True:
                residual, matrix = equation(v - share * change)
                if share < 0.02 or float(np.abs(weight * residual).sum()) <= before:
                    break
                share /= 2
            v = v - share * change
        else:
            raise DataError(f"simulate: the plant's step did not converge at {time:.3f} s; use a smaller step_s")
        v = v - change
        q = q0 + step * v
        memory = self.law.advance(memory0, q[self._clamp], v[self._clamp], step)
        return q, v, (v - v0) / step, memory

    def _torque(
        self, q: FloatArray, v: FloatArray, a: FloatArray, memory0: Memory, step: float, p: float, time: float
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Joint torques (size,), their slope over v where q follows, and over the sum of v where fluid couples all.

        The slope is a divided difference: it steers Newton's method and leaves no trace in the solution.
        """
        law, clamp = self.law, self._clamp
        get = law.hidden
        theta, rate = q[clamp], v[clamp]
        resistance, inertance = get("fluid_damping.R"), get("fluid_inertia.I")
        flow, felt = np.pi * self.actuator.outer_radius**3, p
        if resistance or inertance:
            felt = p - flow * float(resistance * rate.sum() + inertance * a[clamp].sum())
        nudge = 1e-6 * max(1.0, float(np.abs(rate).max()))
        torque, slope = law.torque_and_slope(theta, rate, memory0, felt, time, step, nudge)
        coupling = None
        if resistance or inertance:
            coupling = -flow * (resistance + inertance / step) * law.inner_area(theta, felt) * law.base.r_hyd
        if self.chain.has_base:
            stiffness = 1 / get("base_rotation.c")
            damper = 2e-5 * stiffness  # 20 microseconds: a spring, which does not damp
            torque = np.append(-stiffness * q[0] - damper * v[0], torque)
            slope = np.append(-stiffness * step - damper, slope)
        return torque, slope, coupling

    def _weather(self, time: float) -> tuple[float, float]:
        get = self.law.hidden
        frequency, phase, amplitude = self._gusts
        wind, shake = get("fan.F"), get("shaking.a")
        if wind:
            wind *= float(np.sum(amplitude * np.sin(frequency * time + phase)))
        if shake:
            shake *= float(np.sin(2 * np.pi * get("shaking.f") * time))
        return wind, shake

    def equilibrium(self, p: float) -> FloatArray:
        """Joint angles (joints,) in rad at rest under a constant pressure, by Newton along growing pressure.

        Raises
        ------
        DataError
            If there is none: beyond a limit point the tube winds up.
        """
        q = np.zeros(self.chain.size)
        for share in np.linspace(0.0, 1.0, 1 + int(np.ceil(abs(p) / 2e4))):
            for _ in range(30):
                residual = self._static_residual(q, share * p)
                matrix = np.empty((q.size, q.size))
                for column in range(q.size):
                    moved = q.copy()
                    moved[column] += 1e-7
                    matrix[:, column] = (self._static_residual(moved, share * p) - residual) / 1e-7
                change = np.linalg.solve(matrix, residual)
                q = q - change
                if np.max(np.abs(change)) < 1e-10:
                    break
            else:
                raise DataError(f"simulate: no static equilibrium at {share * p / 1e3:.0f} kPa; lower pressure_max_kPa")
        return q

    def _static_residual(self, q: FloatArray, p: float) -> FloatArray:
        rest = np.zeros_like(q)
        _, bias = self.chain.inertia_and_bias(q, rest, inertia=False)
        theta = q[self._clamp]
        torque = self.law.torque(theta, rest[self._clamp], self.law.relaxed(theta), p, 0.0)
        if self.chain.has_base:
            torque = np.append(-q[0] / self.law.hidden("base_rotation.c"), torque)
        outside = self.chain.outside_forces(q, rest, 0.0, 0.0)
        return bias - torque if outside is None else bias - torque - outside


def _extrapolate(memory: Memory, stage: Memory, ratio: float) -> Memory:
    """Memory at the foot of the second stage: the old one plus what its rate at the first stage carries."""
    return Memory(
        memory.maxwell + ratio * (stage.maxwell - memory.maxwell),
        memory.loop + ratio * (stage.loop - memory.loop),
        stage.largest,
    )


def _gusts(seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angular frequencies, phases and amplitudes of a gusty wind between 0.2 and 4 Hz with unit root mean square."""
    generator = np.random.default_rng([seed, 77])
    frequency = 2 * np.pi * generator.uniform(0.2, 4.0, 12)
    amplitude = 1 / np.sqrt(frequency)
    amplitude *= np.sqrt(2 / np.sum(amplitude**2))
    return frequency, generator.uniform(0, 2 * np.pi, 12), amplitude
