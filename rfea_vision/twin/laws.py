"""Physics of one joint, in plain NumPy, written from the paper and shared with nothing on the model's side.

Legend: theta, joint angle; rate, its speed; n, number of joints; Theta = n theta, the angle the whole tube would have;
p, pressure in the tube. Everything SI. Every function works on arrays whose last axis is the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator
from rfea_vision.errors import DataError
from rfea_vision.twin.options import HIDDEN, BaseParameters


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
        self.stiffness_profile = (
            1
            + get("stiffness_profile.a1") * x
            + get("stiffness_profile.a2") * (3 * x**2 - 1) / 2
            + get("stiffness_profile.a3") * (5 * x**3 - 3 * x) / 2
        )
        if get("kink.c"):  # a weak ring: a tenth of the tube is softer
            self.stiffness_profile *= 1 - get("kink.c") * np.exp(-0.5 * ((sigma - get("kink.at")) / 0.05) ** 2)
        # a uniform rest angle, and what varies about it
        self.rest_angle = (
            get("rest_curvature.angle")
            + get("rest_curvature_profile.a1") * x
            + get("rest_curvature_profile.a2") * (3 * x**2 - 1) / 2
        ) / self.n
        self.damping_profile = 1 + get("damping_profile.a1") * x + get("damping_profile.a2") * (3 * x**2 - 1) / 2

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

    def inner_area(self, theta: FloatArray, p: FloatArray | float) -> FloatArray:
        """Inner area pi r_i^2 (joints,) in m^2 of joints bent by theta (rad): the rubber keeps its volume (eq. InnerRadius)."""
        outer = self.felt_outer_radius(p)
        rubber = (self.outer_radius**2 - self.inner_radius**2) * (1 - self.hidden("compressibility.c") * p)
        return np.pi * (outer**2 - rubber * self.rest_length / (self.rest_length + outer * theta))

    def relaxed(self, theta: FloatArray) -> Memory:
        """Memory of a tube that has rested at theta (joints,) in rad for long."""
        return Memory(theta.copy(), np.zeros_like(theta), np.abs(theta))

    def advance(self, memory: Memory, theta: FloatArray, rate: FloatArray, step: float) -> Memory:
        """Implicit Euler step of the memory to a stage at (theta, rate); each state has a closed form."""
        maxwell, loop = memory.maxwell, memory.loop
        get = self._hidden.__getitem__
        if get("maxwell.k1"):
            ratio = step / get("maxwell.T")
            maxwell = (maxwell + ratio * theta) / (1 + ratio)
        if get("hysteresis.tau_h"):
            slide = step * self.n * rate / get("hysteresis.w")
            loop = loop + slide
            loop = loop / (1 + 0.5 * np.abs(slide) + 0.5 * slide * np.sign(loop))
        return Memory(maxwell, loop, np.maximum(memory.largest, np.abs(theta)))

    def stiffness(
        self, theta: FloatArray, radius: FloatArray, memory: Memory, p: FloatArray | float, time: float
    ) -> FloatArray:
        """k_j (joints,) in N m/rad (eq. SpringCoefficient) and all that changes it."""
        get = self._hidden.__getitem__
        k = (self.base.k_ref + self.base.k_slope * (radius - self.inner_radius)) * self.stiffness_profile
        if get("nonlinear_stiffness.c"):
            k = k * (1 + get("nonlinear_stiffness.c") * (self.n * theta) ** 2)
        if get("pressure_stiffening.c"):
            k = k * (1 + get("pressure_stiffening.c") * p)
        if get("mullins.c"):
            k = k * (1 - get("mullins.c") * (1 - np.exp(-self.n * memory.largest / get("mullins.s"))))
        if get("warm_up.c"):
            k = k * (1 - get("warm_up.c") * (1 - np.exp(-time / get("warm_up.T"))))
        return k

    def damping(self, rate: FloatArray, radius: FloatArray) -> FloatArray:
        """b_j (joints,) in N m s/rad in its two directions (eq. DamperCoefficient) and all that changes it."""
        base, stretch = self.base, radius - self.inner_radius
        b = np.where(
            rate >= 0, base.b_pos_ref + base.b_pos_slope * stretch, base.b_neg_ref + base.b_neg_slope * stretch
        )
        return b * self.damping_profile * (1 + self.hidden("nonlinear_damping.c") * self.n * np.abs(rate))

    def torque(
        self, theta: FloatArray, rate: FloatArray, memory: Memory, p: FloatArray | float, time: float
    ) -> FloatArray:
        """Torque (joints,) in N m: pressure (eq. HydraulicTorque) less spring, less damper, and what is hidden.

        Raises
        ------
        DataError
            If bore, stiffness or damping has become negative: such a tube does not exist.
        """
        # a torque is asked for some 20,000 times a second of motion: no look-up and no reduction goes through a wrapper
        get = self._hidden.__getitem__
        area = self.inner_area(theta, p)
        if not area.min() > 0:
            raise DataError("simulate: the tube folds up; lower pressure_max_kPa, or take a larger k_ref")
        radius = np.sqrt(area / np.pi)
        k = self.stiffness(theta, radius, memory, p, time)
        b = self.damping(rate, radius)
        if not (k.min() > 0 and b.min() > 0):
            raise DataError(
                "simulate: stiffness or damping becomes negative on the way; lower pressure_max_kPa or the slopes"
            )
        share = get("virtual_work.a")
        arm = (1 - share) * area * self.base.r_hyd + share * np.pi * self.outer_radius**3
        torque = p * arm - k * (theta - self.rest_angle) - b * rate
        if get("maxwell.k1"):
            torque = torque - get("maxwell.k1") * self.base.k_ref * (theta - memory.maxwell)
        if get("hysteresis.tau_h"):
            torque = torque - get("hysteresis.tau_h") * memory.loop
        if get("coulomb.tau_c"):
            torque = torque - get("coulomb.tau_c") * np.tanh(self.n * rate / get("coulomb.w"))
        return torque
