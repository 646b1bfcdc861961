"""A tube (or any planar chain) with its law, ready to run: the Python face of the engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rfea_vision.artefacts.measurement import Actuator
from rfea_vision.dynamics.compilation import CompiledLaw, compile_law, constants
from rfea_vision.dynamics.engine import OK
from rfea_vision.dynamics.equilibrium import equilibrium
from rfea_vision.dynamics.integration import integrate
from rfea_vision.dynamics.shape import centre_line
from rfea_vision.effects.base import Effect
from rfea_vision.errors import InputError
from rfea_vision.tube import body_inertia, body_mass

FloatArray = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665
LONGEST_STEP_S = 1e-3

_GAMMA2 = 1 - np.sqrt(0.5)
_GAMMA3 = 0.435866521508458999416019451194
_B3 = 1.5 * _GAMMA3**2 - 5 * _GAMMA3 + 1.25
#: L-stable, stiffly accurate tableaux (Alexander 1977, doi:10.1137/0714068), by order.
TABLEAUX: dict[int, FloatArray] = {
    1: np.array([[1.0]]),
    2: np.array([[_GAMMA2, 0.0], [1 - _GAMMA2, _GAMMA2]]),
    3: np.array(
        [
            [_GAMMA3, 0.0, 0.0],
            [(1 - _GAMMA3) / 2, _GAMMA3, 0.0],
            [1 - _B3 - _GAMMA3, _B3, _GAMMA3],
        ]
    ),
}


@dataclass(frozen=True)
class Chain:
    """A planar chain of n hinged bodies, SI units. Arrays of shape (n,); the first hinge hangs `base_length` below the clamp.

    along, across : centre of mass from the hinge, along the body and towards the outside of the bend
    force_along, force_across : point on which body forces act (the middle of the centre line)
    position : material coordinate of each joint (0 clamp, 1 tip); arc : rest length that each joint stands for
    count : what makes a joint's angle the tube's: n for a tube, 1 for a general chain
    """

    length: FloatArray
    mass: FloatArray
    along: FloatArray
    across: FloatArray
    inertia: FloatArray
    force_along: FloatArray
    force_across: FloatArray
    position: FloatArray
    arc: FloatArray
    base_length: float
    count: float
    outer_radius: float
    inner_radius: float
    fluid_density: float
    polygon: bool = True

    @classmethod
    def tube(cls, actuator: Actuator, segments: int, joints: Literal["middle", "start"] = "middle") -> Chain:
        """Chain of the tube: joints in the middle of the arc they stand for, or at the start of each body (the paper's)."""
        if segments < 1:
            raise InputError(f"segments: {segments} is too few; use at least 1")
        arc = actuator.length / segments
        length = np.full(segments, arc)
        if joints == "middle":
            length[-1] = arc / 2
            position = (np.arange(segments) + 0.5) / segments
        elif joints == "start":
            position = np.arange(segments) / segments
        else:
            raise InputError(f"joints: '{joints}' is unknown; use middle or start")
        return cls(
            length=length,
            mass=body_mass(actuator, length),
            along=length / 2,
            across=np.zeros(segments),
            inertia=body_inertia(actuator, length),
            force_along=length / 2,
            force_across=np.full(segments, actuator.outer_radius),
            position=position,
            arc=np.full(segments, arc),
            base_length=arc / 2 if joints == "middle" else 0.0,
            count=float(segments),
            outer_radius=actuator.outer_radius,
            inner_radius=actuator.inner_radius,
            fluid_density=actuator.fluid_density,
            polygon=joints == "start",
        )

    @classmethod
    def general(
        cls, length: Sequence[float], mass: Sequence[float], along: Sequence[float], inertia: Sequence[float]
    ) -> Chain:
        """Any planar chain: link lengths (m), masses (kg), centres of mass from the hinge (m), inertias about them (kg m^2)."""
        values = [np.asarray(v, dtype=float) for v in (length, mass, along, inertia)]
        n = values[0].size
        if any(v.shape != (n,) for v in values):
            raise InputError("chain: length, mass, along and inertia must have one entry per body")
        return cls(
            length=values[0],
            mass=values[1],
            along=values[2],
            across=np.zeros(n),
            inertia=values[3],
            force_along=values[2],
            force_across=np.zeros(n),
            position=np.linspace(0, 1, n),
            arc=values[0],
            base_length=0.0,
            count=1.0,
            outer_radius=0.004,
            inner_radius=0.003,
            fluid_density=0.0,
        )

    @property
    def bodies(self) -> int:
        return self.length.size


@dataclass(frozen=True)
class Excitation:
    """Pressure (Pa, gauge) over time (s), on the uniform grid that the integrator steps along; linear between grid points."""

    start_s: float
    step_s: float
    pressure: FloatArray
    drive: FloatArray | None = None  # (grid, n) torques (N m) on the joints, for general chains

    @classmethod
    def from_log(
        cls,
        time_s: FloatArray,
        pressure_Pa: FloatArray,
        from_s: float,
        to_s: float,
        longest_step_s: float = LONGEST_STEP_S,
    ) -> Excitation:
        """Put a log on a grid aligned with its own samples: every sample of a regular log up to 1 kHz is a grid point."""
        period = float(np.median(np.diff(time_s)))
        step = period / np.ceil(period / longest_step_s - 1e-6) if period > longest_step_s / 2 else longest_step_s
        first = time_s[0] + np.floor((from_s - time_s[0]) / step + 1e-9) * step
        count = int(np.ceil((to_s - first) / step - 1e-9)) + 1
        grid = first + step * np.arange(max(count, 2))
        return cls(first, step, np.interp(grid, time_s, pressure_Pa))

    @property
    def end_s(self) -> float:
        return self.start_s + self.step_s * (self.pressure.size - 1)


@dataclass(frozen=True)
class Motion:
    """What came out of a run. A failed run says so in `status` and `message`; its arrays are not to be used.

    phi : (frames, n + 1) absolute angles, index 0 the clamp (rad); rate : the same per second
    sensitivity : (frames, n + 1, p) d phi / d free parameter; states : (frames, n, m) at the end of the step
    """

    status: int
    message: str
    phi: FloatArray
    rate: FloatArray
    states: FloatArray
    sensitivity: FloatArray
    free: NDArray[np.int64]
    newton_iterations: int = 0

    @property
    def ok(self) -> bool:
        return self.status == OK

    @property
    def theta(self) -> FloatArray:
        """Joint angles (frames, n) in rad."""
        return np.diff(self.phi, axis=1)


@njit(cache=True, nogil=True)
def _lagged(values, step, nodes, T):
    """First-order lag of a piecewise linear signal: value and d/dT at (steps, stages), exact; T = 0 is the signal itself."""
    steps, stages = values.size - 1, nodes.size
    out, slope = np.empty((steps, stages)), np.empty((steps, stages))
    y, dy = values[0], 0.0
    for k in range(steps):
        p0 = values[k]
        rate = (values[k + 1] - p0) / step
        for s in range(stages):
            t = nodes[s] * step
            if T < 1e-9:
                out[k, s], slope[k, s] = p0 + rate * t, -rate
            else:
                decay = np.exp(-t / T)
                gap = y - p0 + rate * T
                out[k, s] = p0 + rate * t - rate * T + gap * decay
                slope[k, s] = -rate + (dy + rate) * decay + gap * decay * t / T**2
        y, dy = out[k, stages - 1], slope[k, stages - 1]
    return out, slope


@dataclass(frozen=True)
class Model:
    """A chain and a law. Parameters are one vector in SI units, in the order of `names`."""

    chain: Chain
    effects: tuple[Effect, ...] = ()
    mirror: float = 1.0
    gravity: float = STANDARD_GRAVITY
    order: int = 2
    tolerance: float = 1e-8
    at: dict[str, int] = field(default_factory=dict)  # effect id -> the only joint it acts on (counted from 1)

    @cached_property
    def law(self) -> CompiledLaw:
        return compile_law(self.effects)

    @property
    def names(self) -> tuple[str, ...]:
        return self.law.parameters

    @cached_property
    def _constants(self) -> FloatArray:
        chain = self.chain
        length = chain.base_length + chain.length.sum()
        return constants(chain.count, chain.outer_radius, chain.inner_radius, chain.fluid_density, length, self.mirror)

    @cached_property
    def _weights(self) -> FloatArray:
        weights = np.ones((self.chain.bodies, max(len(self.effects), 1)))
        for column, effect in enumerate(self.effects):
            if effect.id in self.at:
                weights[:, column] = 0.0
                weights[self.at[effect.id] - 1, column] = 1.0
        return weights

    def _bodies(self, par: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns of the engine's `chain`, and the derivative of (mass, along, across, inertia) per parameter."""
        chain, n = self.chain, self.chain.bodies
        last = np.zeros(n)
        last[-1] = 1.0
        rows = self.law.inertia(
            par, self._constants, chain.mass, chain.along, chain.across, chain.inertia, chain.length, last
        )
        own = 6
        values = [np.broadcast_to(row[0], n) for row in rows]
        columns = np.column_stack([chain.length, *values, chain.force_along, chain.force_across])
        derivative = np.zeros((n, 4, par.size))
        for index, row in enumerate(rows):
            for k in range(par.size):
                # engine order: mass, along, across, inertia
                derivative[:, index, k] = row[1 + own + k]
        return np.ascontiguousarray(columns), derivative

    def _scalar(self, function: object, par: FloatArray) -> tuple[float, FloatArray]:
        row = function(par, self._constants)[0]  # type: ignore[operator]
        return float(row[0]), np.array([float(v) for v in row[1:]])

    def _environment(self, par: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        law = self.law
        line, dline = np.zeros(3), np.zeros((3, par.size))
        for index, function in enumerate((law.flow_resistance, law.flow_inertance, law.base_compliance)):
            line[index], dline[index] = self._scalar(function, par)
        rows = law.gravity(par, self._constants, self.gravity)
        gravity = np.array([float(row[0]) for row in rows])
        dgravity = np.array([[float(v) for v in row[2:]] for row in rows])
        return line, dline, gravity, dgravity

    def _felt(self, par: FloatArray, excitation: Excitation, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pressure in the tube at the stage times, and its derivative per parameter (no rows if there is none)."""
        row = self.law.felt_pressure(par, self._constants, excitation.pressure)[0]
        values = np.broadcast_to(np.asarray(row[0], dtype=float), excitation.pressure.shape).copy()
        lag, dlag = self._scalar(self.law.line_time_constant, par)
        felt, slope = _lagged(values, excitation.step_s, nodes, max(lag, 0.0))
        if not self.law.changes_pressure:
            return felt, np.zeros((0, 0, 0))
        derivative = np.zeros((*felt.shape, par.size))
        for k in range(par.size):
            change = np.broadcast_to(np.asarray(row[2 + k], dtype=float), values.shape)
            if np.any(change):
                derivative[:, :, k] += _lagged(change.copy(), excitation.step_s, nodes, max(lag, 0.0))[0]
            if dlag[k]:
                derivative[:, :, k] += slope * dlag[k]
        return felt, derivative

    def steady(
        self,
        par: FloatArray,
        pressure: float,
        free: Sequence[int] = (),
        *,
        start: FloatArray | None = None,
        drive: FloatArray | None = None,
    ) -> Steady:
        """Steady state at one pressure (Pa), by continuation from the unloaded tube unless a start is given."""
        par = np.asarray(par, dtype=float)
        n, m = self.chain.bodies, self.law.state_count
        chain, dchain = self._bodies(par)
        line, dline, gravity, dgravity = self._environment(par)
        index = np.asarray(free, dtype=np.int64)
        row = self.law.felt_pressure(par, self._constants, pressure)[0]
        target, dpressure = float(row[0]), np.array([float(v) for v in row[2:]])
        torque = np.zeros(n) if drive is None else np.asarray(drive, dtype=float)
        phi = np.zeros(n + 1) if start is None else start.copy()
        states, S_phi, S_z = (
            np.zeros((n, max(m, 1))),
            np.zeros((n + 1, index.size)),
            np.zeros((n, max(m, 1), index.size)),
        )

        def solve(value: float, guess: FloatArray, wanted: NDArray[np.int64]) -> tuple[int, float]:
            return equilibrium(
                self.law.module.joint_law,
                self.law.module.joint_law_parameters,
                self.law.module.relaxed_states,
                self.law.module.body_force,
                chain,
                dchain,
                self.chain.base_length,
                line,
                dline,
                gravity,
                dgravity,
                self.chain.position,
                self.chain.arc,
                self._weights,
                par,
                self._constants,
                value,
                dpressure,
                torque,
                self.law.columns,
                m,
                self.law.has_body_force,
                self.law.has_base,
                wanted,
                guess,
                states,
                S_phi,
                S_z,
            )

        none = np.zeros(0, dtype=np.int64)
        reached, stride = (0.0, target) if start is None else (target, 0.0)
        if start is None:
            solve(0.0, phi, none)
            while reached != target:
                guess = phi.copy()
                aim = target if abs(target - reached) <= abs(stride) else reached + stride
                status, stability = solve(aim, guess, none)
                if status == OK and stability > 0 and np.max(np.abs(guess - phi)) < 1.5:
                    phi, reached = guess, aim
                elif abs(stride) > 1e-3 * abs(target):
                    stride /= 2
                else:
                    return Steady(False, phi, states, S_phi, S_z, reached, 0.0)
        status, stability = solve(target, phi, index)
        return Steady(status == OK and stability > 0, phi, states, S_phi, S_z, target, stability)

    def simulate(
        self,
        par: FloatArray,
        excitation: Excitation,
        frames_s: FloatArray,
        free: Sequence[int] = (),
        *,
        start: tuple[FloatArray, FloatArray] | None = None,
    ) -> Motion:
        """Run along the excitation; read the motion off at `frames_s` (sorted, inside the excitation).

        From the steady state at the first pressure, or from joint angles (rad) and rates (rad/s), each (n,), in `start`;
        hidden states are then zero and the start does not depend on the parameters.
        """
        par = np.asarray(par, dtype=float)
        n, m = self.chain.bodies, self.law.state_count
        index = np.asarray(free, dtype=np.int64)
        frames_s = np.asarray(frames_s, dtype=float)
        out_phi, out_om = np.zeros((frames_s.size, n + 1)), np.zeros((frames_s.size, n + 1))
        out_z = np.zeros((frames_s.size, n, max(m, 1)))
        out_S = np.zeros((frames_s.size, n + 1, index.size))
        if start is None:
            first_drive = None if excitation.drive is None else excitation.drive[0]
            rest = self.steady(par, float(excitation.pressure[0]), list(free), drive=first_drive)
            if not rest.found:
                message = f"no steady state at the first pressure ({excitation.pressure[0] / 1e3:.1f} kPa)"
                return Motion(1, message, out_phi, out_om, out_z, out_S, index)
            phi, om, z = rest.phi.copy(), np.zeros(n + 1), rest.states.copy()
            S_phi, S_z = rest.sensitivity, rest.state_sensitivity
        else:
            phi, om = (np.concatenate([[0.0], np.cumsum(values)]) for values in start)
            z = np.zeros((n, max(m, 1)))
            S_phi, S_z = np.zeros((n + 1, index.size)), np.zeros((n, max(m, 1), index.size))
        tableau = TABLEAUX[self.order]
        nodes = tableau.sum(axis=1)
        chain, dchain = self._bodies(par)
        line, dline, gravity, dgravity = self._environment(par)
        felt, dfelt = self._felt(par, excitation, nodes)
        steps = felt.shape[0]
        drive = np.zeros((0, 0, n))
        if excitation.drive is not None:
            a, b = excitation.drive[:-1, None, :], excitation.drive[1:, None, :]
            drive = np.ascontiguousarray(a + (b - a) * nodes[None, :, None])
        place = (frames_s - excitation.start_s) / excitation.step_s
        step = np.clip(np.floor(place), 0, steps - 1).astype(np.int64)
        status, done, iterations = integrate(
            self.law.module.joint_law,
            self.law.module.joint_law_parameters,
            self.law.module.body_force,
            tableau,
            excitation.step_s,
            chain,
            dchain,
            self.chain.base_length,
            line,
            dline,
            gravity,
            dgravity,
            self.chain.position,
            self.chain.arc,
            self._weights,
            par,
            self._constants,
            felt,
            dfelt,
            drive,
            self.law.columns,
            m,
            self.law.has_body_force,
            self.law.has_base,
            self.law.has_line,
            np.pi * self.chain.outer_radius**3,
            index,
            phi,
            om,
            z,
            S_phi,
            S_z,
            step,
            place - step,
            out_phi,
            out_om,
            out_z,
            out_S,
            self.tolerance,
        )
        message = "" if status == OK else f"the simulation failed after {done * excitation.step_s:.3f} s"
        return Motion(status, message, out_phi, out_om, out_z, out_S, index, iterations)

    def centre_line(self, motion: Motion, fractions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points at fractions of the centre line's length: (frames, m, 2) in m, and (frames, m, 2, p) derivatives."""
        frames, count = motion.phi.shape[0], np.asarray(fractions).size
        nodes = np.empty((frames, count, 2))
        dnodes = np.empty((frames, count, 2, motion.sensitivity.shape[2]))
        centre_line(
            motion.phi,
            motion.sensitivity,
            float(self.chain.arc[0]),
            self.chain.outer_radius,
            self.chain.polygon,
            np.asarray(fractions, dtype=float),
            nodes,
            dnodes,
        )
        return nodes, dnodes


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
