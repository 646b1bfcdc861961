"""A tube (or any planar chain) with its law, ready to run: the Python face of the engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.branches import followed
from rfea_vision.dynamics.chain import Chain
from rfea_vision.dynamics.compilation import CompiledLaw, compile_law, constants
from rfea_vision.dynamics.equilibrium import equilibrium
from rfea_vision.dynamics.excitation import Excitation, lagged
from rfea_vision.dynamics.integration import Course, Trace, integrate
from rfea_vision.dynamics.line import at_rest, felt_pressure, first_of, pressure_of_chambers, scalar
from rfea_vision.dynamics.motion import Motion, Steady, why_it_failed
from rfea_vision.dynamics.shape import centre_line
from rfea_vision.dynamics.system import OK, OPPOSED, System
from rfea_vision.effects.base import OF_THE_TUBE
from rfea_vision.errors import InputError

if TYPE_CHECKING:
    from rfea_vision.effects.base import Effect


STANDARD_GRAVITY = g

#: L-stable, stiffly accurate tableaux (Alexander 1977, doi:10.1137/0714068), by order.
_GAMMA2 = 1 - np.sqrt(0.5)
_GAMMA3 = 0.435866521508458999416019451194
_B3 = 1.5 * _GAMMA3**2 - 5 * _GAMMA3 + 1.25
TABLEAUX: dict[int, FloatArray] = {
    1: np.array([[1.0]]),
    2: np.array([[_GAMMA2, 0.0], [1 - _GAMMA2, _GAMMA2]]),
    3: np.array([[_GAMMA3, 0.0, 0.0], [(1 - _GAMMA3) / 2, _GAMMA3, 0.0], [1 - _B3 - _GAMMA3, _B3, _GAMMA3]]),
}


@dataclass(frozen=True)
class Model:
    """A chain and a law. Parameters are one vector in SI units, in the order of `names`."""

    chain: Chain
    effects: tuple[Effect, ...] = ()
    mirror: float = 1.0
    gravity: float = STANDARD_GRAVITY
    mounting: float = 0.0  # direction of gravity (rad) from down, positive towards the side of the bend
    #: Of the integrator. At 1 ms that of order two rings slower by 3e-5, which a long and clean track would see as a bias of one
    #: standard error in r_hyd; the steps of this one may be twice as long and more.
    order: int = 3
    tolerance: float = 1e-8
    at: dict[str, int] = field(default_factory=dict)  # effect id -> the only joint it acts on (counted from 1)

    def __post_init__(self) -> None:
        """Refuse a joint for an effect that acts on the whole tube (InputError)."""
        for effect in self.effects:
            if effect.id in self.at and any(effect.overrides(name) for name in OF_THE_TUBE):
                place = f"@{self.at[effect.id]}"
                raise InputError(f"effect '{effect.id}{place}': acts on the whole tube; leave '{place}' away")

    @cached_property
    def law(self) -> CompiledLaw:
        """The compiled law of these effects; InputError for one that cannot be derived."""
        return compile_law(self.effects)

    @cached_property
    def _rigged(self) -> dict[Any, Model]:
        return {}

    def rigged(self, gravity: float, mounting: float, known: Mapping[str, float] | None = None) -> Model:
        """The same tube under gravity (m/s^2) from another side (rad), with the effects that `known` names beside its own.

        Parameters of those effects stand where the law has them; their values are the caller's.
        """
        own = {effect.id for effect in self.effects}
        more = tuple(dict.fromkeys(name.split(".")[0] for name in known or {} if name.split(".")[0] not in own))
        key = (gravity, mounting, more)
        if key == (self.gravity, self.mounting, ()):
            return self
        if key not in self._rigged:
            from rfea_vision.effects.catalogue import find_effects

            effects = (*self.effects, *find_effects(more))
            self._rigged[key] = replace(self, gravity=gravity, mounting=mounting, effects=effects)
        return self._rigged[key]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters (p,), in the order of their vector."""
        return self.law.parameters

    @cached_property
    def _constants(self) -> FloatArray:
        chain = self.chain
        length = chain.base_length + chain.length.sum()
        radii = (chain.outer_radius, chain.inner_radius)
        density = chain.mass.sum() / chain.length.sum()
        return constants(chain.count, *radii, chain.fluid_density, length, self.mirror, chain.offset, chain.bore_offset, density)

    @cached_property
    def _weights(self) -> FloatArray:
        weights = np.ones((self.chain.bodies, max(len(self.effects), 1)))
        for column, effect in enumerate(self.law.effects):
            if effect in self.at:
                weights[:, column] = 0.0
                weights[self.at[effect] - 1, column] = 1.0
        return weights

    def _bodies(self, par: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns of the engine's `chain`, and the derivative of (mass, along, across, inertia) per parameter."""
        chain, n = self.chain, self.chain.bodies
        own = (chain.mass, chain.along, chain.across, chain.inertia, chain.length, np.eye(n)[-1])
        rows = self.law.inertia(par, self._constants, *own)
        values = [np.broadcast_to(row[0], n) for row in rows]
        columns = np.column_stack([chain.length, *values, chain.force_along, chain.force_across, chain.added_along])
        derivative = np.zeros((n, 4, par.size))
        for index, row in enumerate(rows):
            for k in range(par.size):  # engine order: mass, along, across, inertia
                derivative[:, index, k] = row[1 + len(own) + k]
        return np.ascontiguousarray(columns), derivative

    def _environment(self, par: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        law = self.law
        line, dline = np.zeros(4), np.zeros((4, par.size))
        functions = (law.flow_resistance, law.flow_inertance, law.base_compliance, law.base_pivot)
        for index, function in enumerate(functions):
            line[index], dline[index] = scalar(function, par, self._constants)
        rows = law.gravity(par, self._constants, self.gravity)
        gravity = np.array([float(row[0]) for row in rows])
        dgravity = np.array([[float(v) for v in row[2:]] for row in rows])
        s, c = np.sin(self.mounting), np.cos(self.mounting)
        turned = np.array([[c, s], [-s, c]])
        return line, dline, turned @ gravity, np.ascontiguousarray(turned @ dgravity)

    def system(self, par: FloatArray, waves: int = 0) -> System:
        """Chain, law and one set of parameters (SI, in the order of `names`) as the compiled engine reads them.

        `waves` of pressure are parameters to the engine, too: the last ones, which nothing but the pressure depends on.
        """
        chain, dchain = self._bodies(par)
        law = self.law
        line, dline, gravity, dgravity = self._environment(par)
        count = par.size + waves
        return System(
            chain=chain,
            dchain=first_of(count, dchain),
            base_length=self.chain.base_length,
            line=line,
            dline=first_of(count, dline),
            gravity=gravity,
            dgravity=first_of(count, dgravity),
            position=self.chain.position,
            arc=self.chain.arc,
            length=chain[:, 0].copy(),
            weights=self._weights,
            par=first_of(count, par),
            con=self._constants.copy(),
            columns=law.columns,
            states=law.state_count,
            with_force=law.has_body_force,
            with_base=law.changes("base_compliance"),
            with_line=law.changes("flow_resistance", "flow_inertance"),
            with_added=law.has_added_mass,
            volume_rate=np.pi * self.chain.outer_radius**2 * self.chain.bore_offset,
        )

    def combined(self, par: FloatArray, excitation: Excitation) -> tuple[FloatArray, FloatArray | None]:
        """Pressure (grid,) in Pa with the effects that chambers have of their own: see `pressure_of_chambers`."""
        return pressure_of_chambers(self.law, par, self._constants, excitation)

    def steady(
        self,
        par: FloatArray,
        pressure: float,
        free: Sequence[int] = (),
        *,
        start: FloatArray | None = None,
        drive: FloatArray | None = None,
        pulled: FloatArray | None = None,
        fall: bool = False,
        change: FloatArray | None = None,
        opposed: float = 0.0,
    ) -> Steady:
        """Steady state at one pressure (Pa), by continuation from the unloaded tube unless a start is given.

        Where that branch ends before the pressure is reached (a limit point, or a tube that stands upright and buckles), no
        steady state is found.

        Parameters
        ----------
        par : (parameters,) in SI, in the order of `names`
        free : places in `par` of the parameters to differentiate by
        start : (n + 1,) absolute angles in rad, the clamp first
        drive : (n,) torques on the joints in N m
        pulled : (2,) force in N at the tip, put on once the pressure is reached
        fall : take the steady state into which the tube falls from where its branch ends
        change : (parameters + waves,) derivative of a pressure that depends on parameters, or on waves that `free` numbers behind them
        opposed : in Pa, of several chambers what the sum of all pressures is beyond the one that bends
        """
        par = np.asarray(par, dtype=float)
        n, m = self.chain.bodies, max(self.law.state_count, 1)
        system = self.system(par, 0 if change is None else change.size - par.size)
        system.con[OPPOSED] = opposed
        index = np.asarray(free, dtype=np.int64)
        target, dpressure = at_rest(self.law, par, self._constants, pressure, change)
        torque = np.zeros(n) if drive is None else np.asarray(drive, dtype=float)
        force = np.zeros(2) if pulled is None else np.asarray(pulled, dtype=float)
        phi = np.zeros(n + 1) if start is None else start.copy()
        states = np.zeros((n, m))
        S_phi, S_z = np.zeros((n + 1, index.size)), np.zeros((n, m, index.size))
        none, nothing, stability, fallen = np.zeros(0, dtype=np.int64), np.zeros(2), 0.0, 0

        def solve(
            value: float,
            guess: FloatArray,
            wanted: NDArray[np.int64] = none,
            falling: float = 0.0,
            pull: FloatArray = nothing,
        ) -> bool:
            nonlocal stability, fallen
            status, stability, steps = equilibrium(
                *self.law.loops, system, value, dpressure, torque, pull, wanted, falling, guess, states, S_phi, S_z
            )
            fallen = max(fallen, steps)
            return status == OK and stability > 0

        reached = target
        if start is None:
            phi, reached = followed(solve, phi, target) if solve(0.0, phi) else (np.zeros(n + 1), np.nan)
        found = reached == target and solve(target, phi, index)
        if fall and not found:
            # A nudge, so that a tube that stands exactly upright does fall.
            phi = phi + 1e-3 * np.arange(n + 1) / n
            found = solve(target, phi, index, 10 * abs(float(par[0])))
        if found and pulled is not None:
            phi, share = followed(lambda part, guess: solve(target, guess, pull=part * force), phi, 1.0)
            found = share == 1.0 and solve(target, phi, index, pull=force)
        return Steady(found, phi, states, S_phi, S_z, target if found else np.nan_to_num(reached), stability, fallen)

    def _course(
        self,
        par: FloatArray,
        excitation: Excitation,
        sensed: tuple[FloatArray, FloatArray | None],
        frames_s: FloatArray,
        free: NDArray[np.int64],
    ) -> Course:
        """The excitation at the stage times, and where the frames fall; `sensed` as of `felt_pressure`."""
        tableau = TABLEAUX[self.order]
        nodes = np.concatenate([[0.0], tableau.sum(axis=1)])
        felt, dfelt = felt_pressure(self.law, par, self._constants, *sensed, excitation.step_s, nodes)
        opposed = lagged(excitation.opposed, excitation.step_s, nodes, 0.0)[0]
        drive = np.zeros((0, 0, self.chain.bodies))
        if excitation.drive is not None:
            a, b = excitation.drive[:-1, None, :], excitation.drive[1:, None, :]
            drive = np.ascontiguousarray(a + (b - a) * nodes[None, :, None])
        place = (frames_s - excitation.start_s) / excitation.step_s
        step = np.clip(np.floor(place), 0, felt.shape[0] - 1).astype(np.int64)
        within = np.clip(place - step, 0.0, 1.0)  # the end of the excitation is a multiple of its step to rounding only
        return Course(tableau, excitation.step_s, felt, opposed, dfelt, drive, free, step, within, self.tolerance)

    def simulate(
        self,
        par: FloatArray,
        excitation: Excitation,
        frames_s: FloatArray,
        free: Sequence[int] = (),
        *,
        start: tuple[FloatArray, FloatArray] | None = None,
        held: FloatArray | None = None,
        pulled: FloatArray | None = None,
        waves: FloatArray | None = None,
    ) -> Motion:
        """Run along the excitation, from the steady state at its first pressure unless another start is given.

        Parameters
        ----------
        par, free : as for `steady`
        frames_s : (frames,) times in s at which the motion is read off, sorted, inside the excitation
        start : joint angles (n,) in rad and rates (n,) in rad/s; hidden states are then zero, and no start depends on parameters
        held : (n,) joint angles in rad in which the tube was kept until the excitation begins, its hidden states relaxed
        pulled : (2,) force in N at the tip that held the tube until then
        waves : (k, grid) pressures in Pa; the motion is differentiated by an amplitude of each, behind the parameters `free`

        Returns
        -------
        Motion
            With a status and a message in place of an exception where the run fails.
        """
        par = np.asarray(par, dtype=float)
        n, m = self.chain.bodies, max(self.law.state_count, 1)
        pressure, change = self.combined(par, excitation)
        pivot = self.pivot(par, free)
        index = np.asarray(free, dtype=np.int64)
        if waves is not None:
            change = np.column_stack([np.zeros((pressure.size, par.size)) if change is None else change, waves.T])
            index = np.concatenate([index, np.arange(par.size, change.shape[1])])
        system = self.system(par, 0 if waves is None else len(waves))
        frames_s = np.asarray(frames_s, dtype=float)
        p, count = index.size, frames_s.size
        out_phi, out_om, out_z = np.zeros((count, n + 1)), np.zeros((count, n + 1)), np.zeros((count, n, m))
        out_S = np.zeros((count, n + 1, p))
        first = float(pressure[0]), None if change is None else change[0]
        if held is not None:
            begin = self._held(par, system, np.asarray(held, dtype=float), *first, index)
        elif start is None:
            first_drive = None if excitation.drive is None else excitation.drive[0]
            also = {"drive": first_drive, "pulled": pulled, "change": first[1], "opposed": excitation.opposed[0]}
            rest = self.steady(par, first[0], index.tolist(), fall=True, **also)
            if not rest.found:
                message = f"no steady state at the first pressure ({excitation.pressure[0] / 1e3:.1f} kPa)"
                return Motion(1, message, out_phi, out_om, out_z, out_S, index, pivot=pivot)
            begin = (rest.phi, np.zeros(n + 1), rest.states, rest.sensitivity, rest.state_sensitivity)
        else:
            phi, om = (np.concatenate([[0.0], np.cumsum(values)]) for values in start)
            begin = (phi, om, np.zeros((n, m)), np.zeros((n + 1, p)), np.zeros((n, m, p)))
        loops = self.law.loops
        status, done, taken, iterations = integrate(
            loops.joint_law,
            loops.joint_law_parameters,
            loops.body_force,
            system,
            self._course(par, excitation, (pressure, change), frames_s, index),
            Trace(*begin, out_phi, out_om, out_z, out_S),  # pyright: ignore[reportCallIssue]
        )
        message = "" if status == OK else why_it_failed(status, done, taken, excitation)
        return Motion(status, message, out_phi, out_om, out_z, out_S, index, iterations, pivot, taken)

    def _held(
        self,
        par: FloatArray,
        system: System,
        theta: FloatArray,
        pressure: float,
        change: FloatArray | None,
        free: NDArray[np.int64],
    ) -> tuple[Any, ...]:
        """Start of a run that is let go: a shape that does not depend on the parameters, hidden states that may."""
        n, m = self.chain.bodies, max(self.law.state_count, 1)
        phi = np.concatenate([[0.0], np.cumsum(theta)])
        relaxed = np.zeros((n, m, 3 + system.par.size))
        if self.law.state_count:
            felt, slope = at_rest(self.law, par, self._constants, pressure, change)
            at = (system.position, system.arc, system.weights, system.par, system.con)
            self.law.loops.relaxed_states(theta, np.zeros(n), np.zeros((n, m)), felt, *at, relaxed)
            relaxed[:, :, 3:] += relaxed[:, :, 2, None] * slope
        slopes = np.ascontiguousarray(relaxed[:, :, 3 + free])
        return phi, np.zeros(n + 1), relaxed[:, :, 0].copy(), np.zeros((n + 1, free.size)), slopes

    def pivot(self, par: FloatArray, free: Sequence[int] | NDArray[np.int64] = ()) -> FloatArray:
        """Where the clamp turns (m outside the hinge line), followed by the derivatives by the free parameters: (1 + p,)."""
        value, slope = scalar(self.law.base_pivot, np.asarray(par, dtype=float), self._constants)
        return np.concatenate([[value], slope[list(free)]])

    def centre_line(self, motion: Motion, fractions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points at fractions of the centre line's length: (frames, m, 2) in m, and (frames, m, 2, p) derivatives."""
        frames, count = motion.phi.shape[0], np.asarray(fractions).size
        nodes = np.empty((frames, count, 2))
        dnodes = np.empty((frames, count, 2, motion.sensitivity.shape[2]))
        dpivot = np.zeros(motion.sensitivity.shape[2])
        dpivot[: motion.pivot.size - 1] = motion.pivot[1:]
        centre_line(
            motion.phi,
            motion.sensitivity,
            float(self.chain.arc[0]),
            self.chain.offset,
            self.chain.polygon,
            float(motion.pivot[0]),
            dpivot,
            np.asarray(fractions, dtype=float),
            nodes,
            dnodes,
        )
        return nodes, dnodes

    def line_at_rest(
        self, par: FloatArray, rest: Steady, fractions: FloatArray, free: Sequence[int] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Points of a steady state at fractions of the centre line's length: (m, 2) in m, and (m, 2, p) derivatives.

        par : (parameters,) in SI, in the order of `names`; fractions : (m,) from clamp (0) to tip (1)
        """
        still, pivot, index = np.zeros((1, rest.phi.size)), self.pivot(par, free), np.asarray(free, dtype=np.int64)
        motion = Motion(OK, "", rest.phi[None], still, rest.states[None], rest.sensitivity[None], index, pivot=pivot)
        points, slopes = self.centre_line(motion, fractions)
        return points[0], slopes[0]


__all__ = ["STANDARD_GRAVITY", "TABLEAUX", "Chain", "Excitation", "Model", "Motion", "Steady"]
