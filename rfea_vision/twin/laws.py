"""Physics of one joint, written from the paper and shared with nothing on the model's side.

Legend: theta, joint angle; rate, its speed; n, number of joints; Theta = n theta, the angle the whole tube would have;
p, pressure in the tube. Everything SI. The formulas of one joint are compiled: a torque is asked for some 10,000 times a second
of motion, and in NumPy these took two thirds of a campaign's time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator
from rfea_vision.errors import DataError
from rfea_vision.loops import forget_stale_loops
from rfea_vision.twin.options import HIDDEN, BaseParameters

forget_stale_loops(Path(__file__).parent)


class Memory(NamedTuple):
    """What the material remembers, per joint: Maxwell angle, Bouc-Wen state, largest bend so far."""

    maxwell: FloatArray
    loop: FloatArray
    largest: FloatArray


class JointLaw:
    """Torque of the joints of a tube cut into `n`, with the effects of `hidden`.

    Parameters
    ----------
    actuator : dimensions at rest
    base : seven parameters for n = 8; stiffness, damping and their slopes grow with n
    hidden : effect parameters by ``effect.parameter``; absent ones take the value at which they vanish
    """

    def __init__(self, actuator: Actuator, base: BaseParameters, n: int, hidden: Mapping[str, float]) -> None:
        self.n = n
        self.rest_length = actuator.length / n
        self.outer_radius = actuator.outer_radius
        self.inner_radius = actuator.inner_radius
        scale = n / 8
        self.base = replace(
            base,
            **{
                name: getattr(base, name) * scale
                for name in ("k_ref", "k_slope", "b_pos_ref", "b_pos_slope", "b_neg_ref", "b_neg_slope")
            },
        )
        self._hidden = {**{key: parameter.absent for key, parameter in HIDDEN.items()}, **hidden}
        sigma = (np.arange(n) + 0.5) / n
        x = 2 * sigma - 1
        get = self.hidden
        stiffness_profile = (
            1
            + get("stiffness_profile.a1") * x
            + get("stiffness_profile.a2") * (3 * x**2 - 1) / 2
            + get("stiffness_profile.a3") * (5 * x**3 - 3 * x) / 2
        )
        if get("kink.c"):  # a weak ring: a tenth of the tube is softer
            stiffness_profile *= 1 - get("kink.c") * np.exp(-0.5 * ((sigma - get("kink.at")) / 0.05) ** 2)
        # a uniform rest angle, and what varies about it
        rest_angle = (
            get("rest_curvature.angle")
            + get("rest_curvature_profile.a1") * x
            + get("rest_curvature_profile.a2") * (3 * x**2 - 1) / 2
        ) / self.n
        damping_profile = 1 + get("damping_profile.a1") * x + get("damping_profile.a2") * (3 * x**2 - 1) / 2
        self._along = np.stack([stiffness_profile, damping_profile, rest_angle], axis=1)
        own = vars(self) | vars(self.base) | {key.replace(".", "_"): value for key, value in self._hidden.items()}
        self._constants = Constants(*(float(own[name]) for name in Constants._fields))

    @property
    def all_hidden(self) -> Mapping[str, float]:
        """Every effect parameter, those that are absent included."""
        return self._hidden

    def hidden(self, key: str) -> float:
        """Value of an effect's parameter, or the value at which it is absent."""
        return self._hidden[key]

    def felt_outer_radius(self, p: FloatArray | float) -> FloatArray | float:
        """Outer radius (m) under pressure (Pa): constant (assumption 2) unless `radial_expansion` is there."""
        return self.outer_radius * (1 + self.hidden("radial_expansion.c") * p)

    def inner_area(self, theta: FloatArray, p: float) -> FloatArray:
        """Inner area pi r_i^2 (joints,) in m^2 of joints bent by theta (joints,) in rad under p in Pa."""
        return _inner_area(self._constants, theta, p)

    def relaxed(self, theta: FloatArray) -> Memory:
        """Memory of a tube that has rested at theta (joints,) in rad for long."""
        return Memory(theta.copy(), np.zeros_like(theta), np.abs(theta))

    def advance(self, memory: Memory, theta: FloatArray, rate: FloatArray, step: float) -> Memory:
        """Implicit Euler step of the memory to a stage at (theta, rate), each (joints,); each state has a closed form."""
        later = np.empty((3, theta.size))
        _advance(self._constants, theta, rate, *memory, step, later)
        return Memory(*later)

    def torque(self, theta: FloatArray, rate: FloatArray, memory: Memory, p: float, time: float) -> FloatArray:
        """Torque (joints,) in N m: pressure (eq. HydraulicTorque) less spring, less damper, and what is hidden.

        Parameters
        ----------
        theta, rate : (joints,) in rad and rad/s
        memory : of each joint
        p : Pa
        time : s since the tube was cold

        Raises
        ------
        DataError
            If bore, stiffness or damping has become negative: such a tube does not exist.
        """
        return self.torque_and_slope(theta, rate, memory, p, time, 0.0, 0.0)[0]

    def torque_and_slope(
        self, theta: FloatArray, rate: FloatArray, memory: Memory, p: float, time: float, step: float, nudge: float
    ) -> FloatArray:
        """The same (first row) `step` seconds after `memory`, and its slope over the rate where theta follows it (second row).

        nudge : rad/s, the rate's change in the divided difference; away from 0, where the damper's two branches meet

        Raises
        ------
        DataError
            As for `torque`.
        """
        found = np.empty((2, theta.size))
        status = _torques(self._constants, self._along, theta, rate, *memory, p, time, step, nudge, found)
        if status == FOLDED:
            raise DataError("simulate: the tube folds up; lower pressure_max_kPa, or take a larger k_ref")
        if status == NEGATIVE:
            raise DataError(
                "simulate: stiffness or damping becomes negative on the way; lower pressure_max_kPa or the slopes"
            )
        return found


class Constants(NamedTuple):
    """What the formulas of a joint are given: dimensions, the base parameters of a joint, and what is hidden, all SI."""

    n: float
    rest_length: float
    outer_radius: float
    inner_radius: float
    k_ref: float
    k_slope: float
    b_pos_ref: float
    b_pos_slope: float
    b_neg_ref: float
    b_neg_slope: float
    r_hyd: float
    virtual_work_a: float
    nonlinear_stiffness_c: float
    pressure_stiffening_c: float
    mullins_c: float
    mullins_s: float
    warm_up_c: float
    warm_up_T: float
    nonlinear_damping_c: float
    maxwell_k1: float
    maxwell_T: float
    hysteresis_tau_h: float
    hysteresis_w: float
    coulomb_tau_c: float
    coulomb_w: float
    radial_expansion_c: float
    compressibility_c: float


FOLDED, NEGATIVE = 1, 2  # why there is no torque


@njit(cache=True)
def _inner_area(tube, theta, p):
    """Inner area pi r_i^2 (m^2) of a joint, or of many: the rubber keeps its volume (eq. InnerRadius)."""
    outer = tube.outer_radius * (1 + tube.radial_expansion_c * p)
    rubber = (tube.outer_radius**2 - tube.inner_radius**2) * (1 - tube.compressibility_c * p)
    return np.pi * (outer**2 - rubber * tube.rest_length / (tube.rest_length + outer * theta))


@njit(cache=True)
def _remembered(
    tube: Constants, theta: float, rate: float, maxwell: float, loop: float, largest: float, step: float
) -> tuple[float, float, float]:
    """Maxwell angle, Bouc-Wen state and largest bend of a joint after an implicit Euler step."""
    if tube.maxwell_k1:
        ratio = step / tube.maxwell_T
        maxwell = (maxwell + ratio * theta) / (1 + ratio)
    if tube.hysteresis_tau_h:
        slide = step * tube.n * rate / tube.hysteresis_w
        loop = loop + slide
        loop = loop / (1 + 0.5 * abs(slide) + 0.5 * slide * np.sign(loop))
    return maxwell, loop, max(largest, abs(theta))


@njit(cache=True)
def _stiffness(tube: Constants, theta: float, stretch: float, largest: float, p: float, time: float) -> float:
    """k_j in N m/rad (eq. SpringCoefficient) and all that changes it but the profile along the tube."""
    k = tube.k_ref + tube.k_slope * stretch
    k *= 1 + tube.nonlinear_stiffness_c * (tube.n * theta) ** 2
    k *= 1 + tube.pressure_stiffening_c * p
    if tube.mullins_c:
        k *= 1 - tube.mullins_c * (1 - math.exp(-tube.n * largest / tube.mullins_s))
    if tube.warm_up_c:
        k *= 1 - tube.warm_up_c * (1 - math.exp(-time / tube.warm_up_T))
    return k


@njit(cache=True)
def _damping(tube: Constants, rate: float, stretch: float) -> float:
    """b_j in N m s/rad in its two directions (eq. DamperCoefficient) and all that changes it but the profile."""
    b = tube.b_pos_ref + tube.b_pos_slope * stretch if rate >= 0 else tube.b_neg_ref + tube.b_neg_slope * stretch
    return b * (1 + tube.nonlinear_damping_c * tube.n * abs(rate))


@njit(cache=True)
def _torque(tube, along, angle, speed, maxwell, loop, largest, p, time, step):
    """Torque of a joint, and why there is none; along (3,): profiles of stiffness and damping, rest angle."""
    area = _inner_area(tube, angle, p)
    if not area > 0:
        return 0.0, FOLDED
    stretch = math.sqrt(area / np.pi) - tube.inner_radius
    maxwell, loop, largest = _remembered(tube, angle, speed, maxwell, loop, largest, step)
    k = _stiffness(tube, angle, stretch, largest, p, time) * along[0]
    b = _damping(tube, speed, stretch) * along[1]
    if not (k > 0 and b > 0):
        return 0.0, NEGATIVE
    share = tube.virtual_work_a
    arm = (1 - share) * area * tube.r_hyd + share * np.pi * tube.outer_radius**3
    torque = p * arm - k * (angle - along[2]) - b * speed
    torque -= tube.maxwell_k1 * tube.k_ref * (angle - maxwell) + tube.hysteresis_tau_h * loop
    if tube.coulomb_tau_c:
        torque -= tube.coulomb_tau_c * math.tanh(tube.n * speed / tube.coulomb_w)
    return torque, 0


@njit(cache=True)
def _torques(tube, along, theta, rate, maxwell, loop, largest, p, time, step, nudge, found):
    """Fill found (2, joints) with torques and, where nudge is not 0, their slopes; say why there are none."""
    for j in range(theta.size):
        angle, speed, before = theta[j], rate[j], (maxwell[j], loop[j], largest[j])
        found[0, j], status = _torque(tube, along[j], angle, speed, *before, p, time, step)
        if status == 0 and nudge:
            change = nudge if speed >= 0 else -nudge
            moved, status = _torque(tube, along[j], angle + step * change, speed + change, *before, p, time, step)
            found[1, j] = (moved - found[0, j]) / change
        if status:
            return status
    return 0


@njit(cache=True)
def _advance(tube, theta, rate, maxwell, loop, largest, step, later):
    """Fill later (3, joints): what is remembered a step on."""
    for j in range(theta.size):
        later[0, j], later[1, j], later[2, j] = _remembered(
            tube, theta[j], rate[j], maxwell[j], loop[j], largest[j], step
        )
